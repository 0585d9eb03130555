//! What is wrong with a configuration: every field's range in one list.

use super::{Configuration, Joint, JointConstants, LOOP_PERIODS_NS, LoopConstants};
use crate::control::{SampledLoop, StabilityLimit};
use crate::trajectory::LimitError;
use serde::{Deserialize, Serialize};

/// Magnitude beyond which no constant is plausible, so that products of a few of them stay finite in `f32`.
const LARGEST: f64 = 1.0e9;

/// The least a number may be that has to be above 0, so that its `f32` and the reciprocal of that are finite and not 0.
const LEAST: f64 = 1.0e-9;

/// Largest record period in loop periods.
const MOST_LOOPS_PER_RECORD: u32 = 320;

/// A field of a [`Configuration`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the names are those of the fields")]
#[rustfmt::skip]
pub enum Field {
    GearRatio, CountsPerRev, TorqueConstant, CurrentLimit, PositionGain, Lead, ViscousFriction, CoulombFriction,
    LeastMotorInertia, FollowingErrorLimit, SpeedLimit, OverCurrentLimit, DacScale, DacOffset, AdcScale, AdcOffset,
    Gravity, LoopPeriod, RecordPeriod, CommandDelay, LinkTimeout, CurrentLimitTime, StopTime, Bandwidth,
    DampingRatio, ObserverBandwidth, FrictionSwitch, PositionLimit, CountsPerTick,
}

impl Field {
    /// The field's name in [`Configuration`], with its unit.
    pub fn name(self) -> &'static str {
        match self {
            Self::GearRatio => "gear_ratio",
            Self::CountsPerRev => "counts_per_rev",
            Self::TorqueConstant => "torque_constant_nm_per_a",
            Self::CurrentLimit => "current_limit_a",
            Self::PositionGain => "position_gain_a_per_count",
            Self::Lead => "lead",
            Self::ViscousFriction => "viscous_friction_nm_s_per_rad",
            Self::CoulombFriction => "coulomb_friction_nm",
            Self::LeastMotorInertia => "least_motor_inertia_kg_m2",
            Self::FollowingErrorLimit => "following_error_limit_counts",
            Self::SpeedLimit => "speed_limit_rad_s",
            Self::OverCurrentLimit => "over_current_limit_a",
            Self::DacScale => "dac_a_per_code",
            Self::DacOffset => "dac_offset_a",
            Self::AdcScale => "adc_a_per_code",
            Self::AdcOffset => "adc_offset_a",
            Self::Gravity => "gravity_m_s2",
            Self::LoopPeriod => "loop_period_ns",
            Self::RecordPeriod => "record_period_ns",
            Self::CommandDelay => "command_delay_ns",
            Self::LinkTimeout => "link_timeout_ns",
            Self::CurrentLimitTime => "current_limit_time_ns",
            Self::StopTime => "stop_time_ns",
            Self::Bandwidth => "bandwidth_rad_s",
            Self::DampingRatio => "damping_ratio",
            Self::ObserverBandwidth => "observer_bandwidth_rad_s",
            Self::FrictionSwitch => "friction_switch_motor_rad_s",
            Self::PositionLimit => "position limit in counts",
            Self::CountsPerTick => "counts_per_tick",
        }
    }
}

/// What limits a position gain; see [`StabilityLimit`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum GainLimitCause {
    /// The delay of sampling outweighs viscous friction and lead.
    Damping,
    /// The lead makes the loop unstable near the sampling frequency.
    LeadBandwidth,
}

impl GainLimitCause {
    /// The cause in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Damping => StabilityLimit::Damping(0.0).cause(),
            Self::LeadBandwidth => StabilityLimit::LeadBandwidth(0.0).cause(),
        }
    }
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum ConfigurationError {
    /// A number is NaN or infinite.
    #[error("{}{} is {value}, not a finite number; correct the robot file", Of(*joint), field.name())]
    NotFinite {
        /// Which field.
        field: Field,
        /// Of which joint; `None` for what belongs to none.
        joint: Option<Joint>,
        /// Its value.
        value: f64,
    },
    /// A number that divides is zero, or as good as zero.
    #[error("{}{} is {value}, but must not be 0; correct the robot file", Of(*joint), field.name())]
    Zero {
        /// Which field.
        field: Field,
        /// Of which joint; `None` for what belongs to none.
        joint: Option<Joint>,
        /// Its value.
        value: f64,
    },
    /// A number is below its range.
    #[error("{}{} is {value}, but must be at least {limit}; raise it", Of(*joint), field.name())]
    TooLow {
        /// Which field.
        field: Field,
        /// Of which joint; `None` for what belongs to none.
        joint: Option<Joint>,
        /// Its value.
        value: f64,
        /// The least allowed.
        limit: f64,
    },
    /// A number is above its range.
    #[error("{}{} is {value}, but must be at most {limit}; lower it", Of(*joint), field.name())]
    TooHigh {
        /// Which field.
        field: Field,
        /// Of which joint; `None` for what belongs to none.
        joint: Option<Joint>,
        /// Its value.
        value: f64,
        /// The greatest allowed.
        limit: f64,
    },
    /// The loop period is none of those offered.
    #[error("loop_period_ns is {loop_period_ns}, but must be 700000, 350000, 100000 or 50000; choose one of these")]
    LoopPeriod {
        /// Its value.
        loop_period_ns: u32,
    },
    /// The record period is not a multiple of the loop period.
    #[error(
        "record_period_ns is {record_period_ns}, but must be 1 to {MOST_LOOPS_PER_RECORD} times the loop period of \
         {loop_period_ns}; choose a multiple"
    )]
    RecordPeriod {
        /// Its value.
        record_period_ns: u32,
        /// The loop period.
        loop_period_ns: u32,
    },
    /// A position gain the sampled loop would not survive.
    #[error(
        "position_gain_a_per_count of {joint} is {gain_a_per_count:.5}, not below the stability limit \
         {limit_a_per_count:.5} set by {}; lower the gain, shorten the loop period or add lead",
        cause.name()
    )]
    UnstableGain {
        /// Which joint.
        joint: Joint,
        /// The gain asked for, A/count.
        gain_a_per_count: f64,
        /// The limit it must stay below, A/count.
        limit_a_per_count: f64,
        /// What sets the limit.
        cause: GainLimitCause,
    },
    /// The plausible range of a model parameter is empty or not finite.
    #[error("the plausible range of f{number} is {low} to {high}, which holds nothing; correct the range")]
    ModelRange {
        /// Number of the parameter, 1..=9.
        number: u8,
        /// Low end.
        low: f64,
        /// High end.
        high: f64,
    },
    /// The motion limits are not usable.
    #[error("{0}")]
    Motion(LimitError),
}

/// Shows whose field it is.
struct Of(Option<Joint>);

impl core::fmt::Display for Of {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some(Joint::Second) => formatter.write_str("joint 2: "),
            Some(Joint::Third) => formatter.write_str("joint 3: "),
            None => Ok(()),
        }
    }
}

/// One field's value and what it may be.
pub(super) struct FieldValue {
    field: Field,
    pub(super) value: f64,
    range: Range,
}

/// What a field may be.
enum Range {
    /// Anything but 0, of plausible magnitude.
    NotZero,
    /// From .0 to .1, both included.
    Within(f64, f64),
}

const ABOVE_ZERO: Range = Range::Within(LEAST, LARGEST);
const NOT_NEGATIVE: Range = Range::Within(0.0, LARGEST);
const ANY: Range = Range::Within(-LARGEST, LARGEST);

fn field(field: Field, value: f64, range: Range) -> FieldValue {
    FieldValue { field, value, range }
}

impl FieldValue {
    fn check(&self, joint: Option<Joint>) -> Result<(), ConfigurationError> {
        let Self { field, value, ref range } = *self;
        if !value.is_finite() {
            return Err(ConfigurationError::NotFinite { field, joint, value });
        }
        let (low, high) = match *range {
            Range::NotZero if value.abs() < LEAST => return Err(ConfigurationError::Zero { field, joint, value }),
            Range::NotZero => (-LARGEST, LARGEST),
            Range::Within(low, high) => (low, high),
        };
        if value < low {
            return Err(ConfigurationError::TooLow { field, joint, value, limit: low });
        }
        if value > high {
            return Err(ConfigurationError::TooHigh { field, joint, value, limit: high });
        }
        Ok(())
    }
}

impl JointConstants {
    /// Every field, in order, with its range.
    #[inline]
    pub(super) fn fields(&self) -> [FieldValue; 16] {
        let scale = &self.current_scale;
        [
            field(Field::GearRatio, self.gear_ratio, Range::NotZero),
            field(Field::CountsPerRev, self.counts_per_rev, ABOVE_ZERO),
            field(Field::TorqueConstant, self.torque_constant_nm_per_a, ABOVE_ZERO),
            field(Field::CurrentLimit, self.current_limit_a, ABOVE_ZERO),
            field(Field::PositionGain, self.position_gain_a_per_count, ABOVE_ZERO),
            field(Field::Lead, self.lead, Range::Within(0.0, 100.0)),
            field(Field::ViscousFriction, self.viscous_friction_nm_s_per_rad, ABOVE_ZERO),
            field(Field::CoulombFriction, self.coulomb_friction_nm, NOT_NEGATIVE),
            field(Field::LeastMotorInertia, self.least_motor_inertia_kg_m2, ABOVE_ZERO),
            field(Field::FollowingErrorLimit, self.following_error_limit_counts, Range::Within(1.0, 32_767.0)),
            field(Field::SpeedLimit, self.speed_limit_rad_s, ABOVE_ZERO),
            field(Field::OverCurrentLimit, self.over_current_limit_a, Range::Within(self.current_limit_a, LARGEST)),
            field(Field::DacScale, scale.dac_a_per_code, Range::NotZero),
            field(Field::DacOffset, scale.dac_offset_a, ANY),
            field(Field::AdcScale, scale.adc_a_per_code, Range::NotZero),
            field(Field::AdcOffset, scale.adc_offset_a, ANY),
        ]
    }

    /// Encoder counts per radian of the joint.
    pub fn counts_per_rad(&self) -> f64 {
        self.gear_ratio * self.counts_per_rev / core::f64::consts::TAU
    }

    fn check_gain(&self, joint: Joint, common: &LoopConstants) -> Result<(), ConfigurationError> {
        let sampled = SampledLoop {
            period_s: f64::from(common.loop_period_ns) * 1.0e-9,
            command_delay_s: f64::from(common.command_delay_ns) * 1.0e-9,
            viscous_friction_nm_s_per_rad: self.viscous_friction_nm_s_per_rad,
            counts_per_rev: self.counts_per_rev,
            least_motor_inertia_kg_m2: self.least_motor_inertia_kg_m2,
            lead: self.lead,
        };
        let gain_nm_per_count = self.position_gain_a_per_count * self.torque_constant_nm_per_a;
        sampled.check_gain(gain_nm_per_count).map_err(|error| ConfigurationError::UnstableGain {
            joint,
            gain_a_per_count: self.position_gain_a_per_count,
            limit_a_per_count: error.limit_nm_per_count / self.torque_constant_nm_per_a,
            cause: match sampled.stability_limit() {
                StabilityLimit::Damping(_) => GainLimitCause::Damping,
                StabilityLimit::LeadBandwidth(_) => GainLimitCause::LeadBandwidth,
            },
        })
    }
}

impl LoopConstants {
    /// Every field, in order, with its range.
    #[inline]
    pub(super) fn fields(&self) -> [FieldValue; 11] {
        let torque = &self.computed_torque;
        let loop_period = f64::from(self.loop_period_ns);
        [
            field(Field::Gravity, self.gravity_m_s2, Range::Within(0.0, 30.0)),
            field(Field::LoopPeriod, loop_period, ABOVE_ZERO),
            field(Field::RecordPeriod, f64::from(self.record_period_ns), ABOVE_ZERO),
            field(Field::CommandDelay, f64::from(self.command_delay_ns), Range::Within(0.0, loop_period)),
            field(Field::LinkTimeout, self.link_timeout_ns as f64, Range::Within(1.0e6, 60.0e9)),
            field(Field::CurrentLimitTime, self.current_limit_time_ns as f64, Range::Within(0.0, 60.0e9)),
            field(Field::StopTime, self.stop_time_ns as f64, Range::Within(1.0e6, 2.0e9)),
            field(Field::Bandwidth, torque.bandwidth_rad_s, ABOVE_ZERO),
            field(Field::DampingRatio, torque.damping_ratio, ABOVE_ZERO),
            field(Field::ObserverBandwidth, torque.observer_bandwidth_rad_s, ABOVE_ZERO),
            field(Field::FrictionSwitch, torque.friction_switch_motor_rad_s, Range::Within(LEAST, 1.0)),
        ]
    }
}

impl Configuration {
    /// Accepts constants only if every one is a finite number in its range, the periods are offered ones and both
    /// position gains are below their stability limits. Names the first that is not. Constant time.
    #[inline]
    pub fn check(&self) -> Result<(), ConfigurationError> {
        for (joint, constants) in Joint::ALL.into_iter().zip(&self.joints) {
            constants.fields().iter().try_for_each(|field| field.check(Some(joint)))?;
        }
        let common = &self.common;
        if !LOOP_PERIODS_NS.contains(&common.loop_period_ns) {
            return Err(ConfigurationError::LoopPeriod { loop_period_ns: common.loop_period_ns });
        }
        common.fields().iter().try_for_each(|field| field.check(None))?;
        let loops = common.record_period_ns / common.loop_period_ns;
        if !common.record_period_ns.is_multiple_of(common.loop_period_ns) || loops > MOST_LOOPS_PER_RECORD {
            return Err(ConfigurationError::RecordPeriod {
                record_period_ns: common.record_period_ns,
                loop_period_ns: common.loop_period_ns,
            });
        }
        for (joint, constants) in Joint::ALL.into_iter().zip(&self.joints) {
            constants.check_gain(joint, common)?;
        }
        self.check_motion()?;
        for (number, (&low, &high)) in (1u8..).zip(self.model_range.low.iter().zip(&self.model_range.high)) {
            if !(low.is_finite() && high.is_finite() && low < high) {
                return Err(ConfigurationError::ModelRange { number, low, high });
            }
        }
        Ok(())
    }

    #[inline]
    fn check_motion(&self) -> Result<(), ConfigurationError> {
        let motion = &self.motion_limits;
        let counts_per_rad = [0, 1].map(|index: usize| self.joints[index].counts_per_rad());
        motion
            .usable(counts_per_rad.map(|value| value as f32), u64::from(self.common.record_period_ns))
            .map_err(ConfigurationError::Motion)?;
        // References are recorded by their low 16 bits, and counted in 32.
        field(Field::CountsPerTick, f64::from(motion.counts_per_tick), Range::Within(LEAST, 32_000.0)).check(None)?;
        for joint in Joint::ALL {
            let index = joint.index();
            for limit_rad in [motion.position_low_rad[index], motion.position_high_rad[index]] {
                let counts = f64::from(limit_rad) * counts_per_rad[index];
                field(Field::PositionLimit, counts, Range::Within(-LARGEST, LARGEST)).check(Some(joint))?;
            }
        }
        Ok(())
    }
}

//! The robot's constants and the board's limits.

mod check;

pub use check::{ConfigurationError, Field, GainLimitCause};

use super::ModelRange;
use super::frame::Checksum;
use crate::trajectory::MotionLimits;
use serde::{Deserialize, Serialize};

/// The loop periods a board offers, in ns. The record period is a multiple of each.
pub const LOOP_PERIODS_NS: [u32; 4] = [700_000, 350_000, 100_000, 50_000];

/// One of the two joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Joint {
    /// Joint 2 of the PUMA 560, index 0 of every pair.
    Second,
    /// Joint 3 of the PUMA 560, index 1 of every pair.
    Third,
}

impl Joint {
    /// Both joints, in the order of every pair.
    pub const ALL: [Self; 2] = [Self::Second, Self::Third];

    /// Place in every pair: 0 or 1.
    pub const fn index(self) -> usize {
        self as usize
    }
}

impl core::fmt::Display for Joint {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::Second => "joint 2",
            Self::Third => "joint 3",
        })
    }
}

/// How converter codes and amperes belong together: current = (code − 2048) · scale + offset. The converters have 12
/// bits; code 2048 is 0 V.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurrentScale {
    /// Commanded amperes per code of the digital-analogue converter; negative where the wiring turns the sign.
    pub dac_a_per_code: f64,
    /// Current that flows at code 2048, in A.
    pub dac_offset_a: f64,
    /// Measured amperes per code of the analogue-digital converter; negative where the wiring turns the sign.
    pub adc_a_per_code: f64,
    /// Current that code 2048 stands for, in A.
    pub adc_offset_a: f64,
}

impl CurrentScale {
    /// ±`full_scale_a` over the whole range of both converters, no offsets.
    pub fn symmetric(full_scale_a: f64) -> Self {
        let a_per_code = full_scale_a / 2048.0;
        Self { dac_a_per_code: a_per_code, dac_offset_a: 0.0, adc_a_per_code: a_per_code, adc_offset_a: 0.0 }
    }

    /// The current in A that a command code asks for.
    pub fn command_a(&self, code: u16) -> f64 {
        (f64::from(code) - 2048.0) * self.dac_a_per_code + self.dac_offset_a
    }

    /// The current in A that a measured code stands for.
    pub fn measured_a(&self, code: u16) -> f64 {
        (f64::from(code) - 2048.0) * self.adc_a_per_code + self.adc_offset_a
    }
}

/// Constants and limits of one joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointConstants {
    /// Motor turns per joint turn; negative where the motor turns the other way. Not 0.
    pub gear_ratio: f64,
    /// Encoder counts per motor turn, quadrature included. Above 0.
    pub counts_per_rev: f64,
    /// Motor torque per ampere in N m/A. Above 0.
    pub torque_constant_nm_per_a: f64,
    /// Largest current to command, in A. Above 0.
    pub current_limit_a: f64,
    /// Gain of the position loop in A/count. Above 0 and below [`crate::control::SampledLoop::stability_limit`].
    pub position_gain_a_per_count: f64,
    /// Lead β of the position loop in loop periods. Not negative.
    pub lead: f64,
    /// Viscous friction at the motor in N m s/rad; sets the stability limit. Above 0. Computed torque uses the model's.
    pub viscous_friction_nm_s_per_rad: f64,
    /// Coulomb friction at the motor in N m. Not negative.
    pub coulomb_friction_nm: f64,
    /// The least inertia the motor may feel, gear included, in kg m² at the motor. Above 0.
    pub least_motor_inertia_kg_m2: f64,
    /// Tracking error that is a fault, in counts. 1 to 32 767.
    pub following_error_limit_counts: f64,
    /// Joint speed that is a fault, in rad/s. Above 0.
    pub speed_limit_rad_s: f64,
    /// Measured current that is a fault, in A. Not below the current limit.
    pub over_current_limit_a: f64,
    /// Scales of both converters.
    pub current_scale: CurrentScale,
}

/// Bandwidths of computed torque; see [`crate::control::ComputedTorqueSettings`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ComputedTorqueConstants {
    /// ω: bandwidth of the tracking error in rad/s. Above 0.
    pub bandwidth_rad_s: f64,
    /// ζ: damping ratio of the tracking error. Above 0.
    pub damping_ratio: f64,
    /// Bandwidth of the velocity observer in rad/s. Above 0.
    pub observer_bandwidth_rad_s: f64,
    /// Motor speed over which the friction feedforward changes sign, in rad/s. Above 0, at most 1.
    pub friction_switch_motor_rad_s: f64,
}

impl Default for ComputedTorqueConstants {
    /// [`crate::control::ComputedTorqueSettings::at_record_period`].
    fn default() -> Self {
        let settings = crate::control::ComputedTorqueSettings::<f64>::at_record_period();
        Self {
            bandwidth_rad_s: settings.bandwidth_rad_s,
            damping_ratio: settings.damping_ratio,
            observer_bandwidth_rad_s: settings.observer_bandwidth_rad_s,
            friction_switch_motor_rad_s: settings.friction_switch_motor_rad_s,
        }
    }
}

/// What belongs to no joint in particular.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoopConstants {
    /// Gravitational acceleration in m/s². Not negative, at most 30.
    pub gravity_m_s2: f64,
    /// Period of the control loop in ns: one of [`LOOP_PERIODS_NS`].
    pub loop_period_ns: u32,
    /// Period of the recording in ns: a multiple of the loop period, at most 16 ms.
    pub record_period_ns: u32,
    /// From sampling the encoders to the new current, in ns. At most one loop period.
    pub command_delay_ns: u32,
    /// Silence of the host, while the amplifiers are on, that is a fault, in ns. 1 ms to 60 s.
    pub link_timeout_ns: u64,
    /// How long a command may stay at its current limit before that is a fault, in ns. At most 60 s.
    pub current_limit_time_ns: u64,
    /// How long a stop takes from full speed, in ns. 1 ms to 2 s.
    pub stop_time_ns: u64,
    /// Bandwidths of computed torque.
    pub computed_torque: ComputedTorqueConstants,
}

/// Everything the board has to know of its robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// Joint 2 and joint 3.
    pub joints: [JointConstants; 2],
    /// What belongs to no joint in particular.
    pub common: LoopConstants,
    /// What a reference may ask for.
    pub motion_limits: MotionLimits,
    /// What a plausible model lies in.
    pub model_range: ModelRange,
}

/// A part of a [`Configuration`] that fits a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ConfigurationPart {
    /// Constants of one joint.
    Joint(Joint, JointConstants),
    /// What belongs to no joint in particular.
    Common(LoopConstants),
    /// What a reference may ask for.
    MotionLimits(MotionLimits),
    /// What a plausible model lies in.
    ModelRange(ModelRange),
}

/// Name of a [`ConfigurationPart`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PartName {
    /// Constants of one joint.
    Joint(Joint),
    /// What belongs to no joint in particular.
    Common,
    /// What a reference may ask for.
    MotionLimits,
    /// What a plausible model lies in.
    ModelRange,
}

impl Configuration {
    /// The parts to send, in order; then [`super::Request::ApplyConfiguration`] with [`Self::crc`].
    pub fn parts(&self) -> [ConfigurationPart; 5] {
        let [second, third] = self.joints;
        [
            ConfigurationPart::Joint(Joint::Second, second),
            ConfigurationPart::Joint(Joint::Third, third),
            ConfigurationPart::Common(self.common),
            ConfigurationPart::MotionLimits(self.motion_limits),
            ConfigurationPart::ModelRange(self.model_range),
        ]
    }

    /// CRC-32 of every number as a little-endian `f64`, in the order of the fields.
    #[inline]
    pub fn crc(&self) -> u32 {
        let mut checksum = Checksum::new();
        let mut add = |number: f64| checksum.add(&number.to_le_bytes());
        for joint in &self.joints {
            joint.fields().iter().for_each(|field| add(field.value));
        }
        self.common.fields().iter().for_each(|field| add(field.value));
        let motion = &self.motion_limits;
        let pairs = [motion.position_low_rad, motion.position_high_rad, motion.speed_rad_s, motion.acceleration_rad_s2];
        pairs.iter().flatten().for_each(|&number| add(f64::from(number)));
        add(f64::from(motion.counts_per_tick));
        self.model_range.low.iter().chain(&self.model_range.high).for_each(|&number| add(number));
        checksum.finish()
    }

    /// CRC-32 of the constants that give f1..f9 their meaning: gear ratios, counts per turn and torque constants of
    /// both joints, and gravity. A model made for other values of these is refused.
    #[inline]
    pub fn robot_identity(&self) -> u32 {
        let mut checksum = Checksum::new();
        for joint in &self.joints {
            for number in [joint.gear_ratio, joint.counts_per_rev, joint.torque_constant_nm_per_a] {
                checksum.add(&number.to_le_bytes());
            }
        }
        checksum.add(&self.common.gravity_m_s2.to_le_bytes());
        checksum.finish()
    }
}

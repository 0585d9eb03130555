//! What a board has to be told of its robot: the robot file in the protocol's terms.

use shared::control::SampledLoop;
use shared::protocol::{
    ComputedTorqueConstants, Configuration, CurrentScale, JointConstants, LOOP_PERIODS_NS, LoopConstants, ModelRange,
};
use shared::trajectory::MotionLimits;

use crate::effects::EffectError;
use crate::robot::{DEFAULT_FOLLOWING_ERROR_LIMIT_COUNTS, FrictionError, Joint, Kind, Law, Robot, UnsafeGain};

/// Joint speed that is a fault, as a multiple of the speed a movement may have.
const SPEED_MARGIN: f64 = 1.5;
/// Measured current that is a fault, as a share of the sensor's full scale: beyond it the sensor says nothing.
const OVER_CURRENT_SHARE: f64 = 0.95;
/// Silence of the host that switches the amplifiers off: ten keep-alives.
const LINK_TIMEOUT_NS: u64 = 1_000_000_000;
/// How long a command may stay at the amplifier's limit: the peak rating of a 12A8 is for two seconds.
const CURRENT_LIMIT_TIME_NS: u64 = 500_000_000;
/// How long a stop takes from full speed.
const STOP_TIME_NS: u64 = 300_000_000;

/// Most loop periods in a record period.
const MOST_LOOPS_PER_RECORD: f64 = 320.0;

/// Least viscous friction that the board takes, N m s/rad.
pub(crate) const LEAST_VISCOUS_FRICTION_NM_S_PER_RAD: f64 = 1e-9;

/// Why a robot cannot run on a board.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// The board drives two joints.
    #[error("\"{0}\" has a single axis, but the board drives two joints; use a robot file with two")]
    SingleAxis(String),
    /// The board runs the position loop.
    #[error("joint {0} runs under a cascade, which the board does not have; give position_gain_a_per_count")]
    Cascade(String),
    /// The viscous friction decides about stability.
    #[error(
        "viscous_friction_nm_s_per_rad of joint {0} is missing, and the stability limit of its gain follows from it; add \
         an estimate, rather too small than too large"
    )]
    UnknownFriction(String),
    /// The loop period is not one of the board's.
    #[error("loop_period_s is {0}, but the board offers 0.0007, 0.00035, 0.0001 and 0.00005; choose one of them")]
    LoopPeriod(f64),
    /// The board would switch off within the current that the amplifier may give.
    #[error(
        "current_full_scale_a of joint {joint} is {full_scale_a}, but must be at least {least_a}: the board switches off at \
         95 % of it, and the amplifier gives up to current_limit_a; give the range of the sensor, or lower current_limit_a"
    )]
    FullScale {
        /// Name of the joint.
        joint: String,
        /// Its value.
        full_scale_a: f64,
        /// What it must be at least.
        least_a: String,
    },
    /// An effect of the model cannot be.
    #[error("the model's {0}")]
    Effect(#[from] EffectError),
    /// Friction that a drive can never overcome.
    #[error("the model's {0}; {remedy}", remedy = FrictionError::REMEDY)]
    Friction(#[from] FrictionError),
    /// A gain is not stable.
    #[error("{0}; nothing was moved")]
    Unstable(#[from] UnsafeGain),
}

/// The board's configuration for `robot`.
pub fn configuration(robot: &Robot) -> Result<Configuration, SetupError> {
    let (Kind::TwoLink, [second, third]) = (robot.kind, robot.joints.as_slice()) else {
        return Err(SetupError::SingleAxis(robot.name.clone()));
    };
    let nanoseconds = |seconds: f64| (seconds * 1e9).round() as u32;
    let loop_period_ns = nanoseconds(robot.loop_period_s);
    if !LOOP_PERIODS_NS.contains(&loop_period_ns) {
        return Err(SetupError::LoopPeriod(robot.loop_period_s));
    }
    robot.check_gains()?;
    let joints = [joint_constants(robot, 0, second)?, joint_constants(robot, 1, third)?];
    let pair = |value: fn(&Joint) -> f64| [value(second) as f32, value(third) as f32];
    let counts_per_tick =
        |joint: &Joint| joint.limits.speed_rad_s * joint.counts_per_rad().abs() * robot.record_period_s;
    Ok(Configuration {
        joints,
        common: LoopConstants {
            gravity_m_s2: robot.gravity_m_s2,
            loop_period_ns,
            record_period_ns: nanoseconds(robot.record_period_s),
            command_delay_ns: nanoseconds(robot.command_delay_s),
            link_timeout_ns: LINK_TIMEOUT_NS,
            current_limit_time_ns: CURRENT_LIMIT_TIME_NS,
            stop_time_ns: STOP_TIME_NS,
            computed_torque: ComputedTorqueConstants {
                bandwidth_rad_s: robot.computed_torque.bandwidth_rad_s,
                damping_ratio: robot.computed_torque.damping_ratio,
                observer_bandwidth_rad_s: robot.computed_torque.observer_bandwidth_rad_s,
                friction_switch_motor_rad_s: robot.computed_torque.friction_switch_motor_rad_s,
            },
        },
        motion_limits: MotionLimits {
            position_low_rad: pair(|joint| joint.limits.position_low_rad),
            position_high_rad: pair(|joint| joint.limits.position_high_rad),
            speed_rad_s: pair(|joint| joint.limits.speed_rad_s),
            acceleration_rad_s2: pair(|joint| joint.limits.acceleration_rad_s2),
            // What the speed limits allow the faster counting joint; a finer encoder must not tighten them.
            counts_per_tick: robot
                .counts_per_tick_limit
                .unwrap_or_else(|| counts_per_tick(second).max(counts_per_tick(third)).ceil())
                as f32,
        },
        model_range: ModelRange::around(robot.search.map(|[low, _]| low), robot.search.map(|[_, high]| high)),
    })
}

/// Loop periods of the board that a record period is a multiple of, in s, longest first.
pub(crate) fn loop_periods_s(record_period_s: f64) -> Vec<f64> {
    let divides = |period_s: &f64| {
        let ratio = record_period_s / period_s;
        (1.0..=MOST_LOOPS_PER_RECORD).contains(&ratio.round()) && (ratio - ratio.round()).abs() < 1e-6 * ratio
    };
    LOOP_PERIODS_NS.iter().map(|&period_ns| f64::from(period_ns) / 1e9).filter(divides).collect()
}

/// Accepts a current range of the converters that measures what the amplifier may give.
pub(crate) fn check_full_scale(joint: &Joint) -> Result<(), SetupError> {
    let least_a = joint.current_limit_a / OVER_CURRENT_SHARE;
    if joint.current_full_scale_a >= least_a {
        return Ok(());
    }
    Err(SetupError::FullScale {
        joint: joint.name.clone(),
        full_scale_a: joint.current_full_scale_a,
        // Rounded up, so that the number named is accepted.
        least_a: format!("{:.3}", (1e3 * least_a).ceil() / 1e3),
    })
}

fn joint_constants(robot: &Robot, index: usize, joint: &Joint) -> Result<JointConstants, SetupError> {
    let Law::Proportional(position_loop) = joint.law else {
        return Err(SetupError::Cascade(joint.name.clone()));
    };
    let Some(SampledLoop { viscous_friction_nm_s_per_rad, least_motor_inertia_kg_m2, .. }) = robot.sampled_loop(index)
    else {
        return Err(SetupError::UnknownFriction(joint.name.clone()));
    };
    check_full_scale(joint)?;
    Ok(JointConstants {
        gear_ratio: joint.gear_ratio,
        counts_per_rev: joint.counts_per_rev,
        torque_constant_nm_per_a: joint.torque_constant_nm_per_a,
        current_limit_a: joint.current_limit_a,
        position_gain_a_per_count: position_loop.gain_a_per_count,
        lead: position_loop.lead,
        viscous_friction_nm_s_per_rad,
        coulomb_friction_nm: joint.coulomb_friction_nm.unwrap_or(0.0),
        least_motor_inertia_kg_m2,
        following_error_limit_counts: robot
            .following_error_limit_counts
            .unwrap_or(DEFAULT_FOLLOWING_ERROR_LIMIT_COUNTS),
        speed_limit_rad_s: SPEED_MARGIN * joint.limits.speed_rad_s,
        over_current_limit_a: OVER_CURRENT_SHARE * joint.current_full_scale_a,
        current_scale: CurrentScale::symmetric(joint.current_full_scale_a),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_robot_has_the_reference_limits() {
        let configuration = configuration(&Robot::paper()).unwrap();
        assert_eq!(configuration.motion_limits, MotionLimits::reference_robot());
        assert_eq!(configuration.common.loop_period_ns, 700_000);
        assert_eq!(configuration.common.command_delay_ns, 30_000);
    }

    #[test]
    fn unsuitable_robots_are_refused_by_name() {
        let refused = |change: fn(&mut Robot), part: &str| {
            let mut robot = Robot::paper();
            change(&mut robot);
            let text = configuration(&robot).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        };
        refused(|robot| robot.kind = Kind::SingleAxis, "single axis");
        refused(|robot| robot.loop_period_s = 0.0007 / 3.0, "0.00035");
        refused(|robot| robot.joints[1].viscous_friction_nm_s_per_rad = None, "joint 3 is missing");
        refused(|robot| robot.joints[0].law = Law::Cascade { position_gain_per_s: 1.0, velocity_gain: 1.0 }, "cascade");
        let stiff = shared::control::PositionLoop { gain_a_per_count: 0.384, lead: 0.0 };
        let mut robot = Robot::paper();
        robot.joints[0].law = Law::Proportional(stiff);
        let text = configuration(&robot).unwrap_err().to_string();
        assert!(text.contains("joint 2") && text.contains("0.09600") && text.contains("limit 0.01"), "{text}");
    }
}

//! What follows from answers: search ranges, and a position loop to begin with.

use shared::control::PositionLoop;

use crate::links::{ArmBounds, Link, LinkBounds};
use crate::robot::{DEFAULT_FOLLOWING_ERROR_LIMIT_COUNTS, Law, Robot, default_search};

/// A guess may be this share of the truth, low and high.
pub(super) const GUESS_LOW: f64 = 0.5;
pub(super) const GUESS_HIGH: f64 = 1.5;

/// A loop that friction alone damps is taken where it is at least this fast, in rad/s.
const LEAST_BANDWIDTH_RAD_S: f64 = 30.0;

/// What the lead of a loop looks ahead where friction does not damp enough, in s, and the most ticks a lead may be.
const LEAD_S: f64 = 0.014;
const MOST_LEAD_TICKS: f64 = 20.0;

/// Share of the stability limit that is proposed.
const LIMIT_SHARE: f64 = 0.5;

/// Search ranges with the f of `links` in their middle, as wide as guesses may be wrong.
pub(super) fn search(robot: &Robot, links: &[Link; 2]) -> [[f64; 2]; 9] {
    let [Some(first), Some(second)] = [0, 1].map(|joint| robot.joints.get(joint)) else { return default_search() };
    let share = |value: f64| [GUESS_LOW * value, GUESS_HIGH * value];
    let bounds = ArmBounds {
        upper_arm_m: robot.upper_arm_m,
        links: links.map(|link| {
            let [x, y] = link.centre_m;
            let off = 0.5 * x.abs().max(y.abs()).max(0.1 * robot.upper_arm_m);
            LinkBounds {
                mass_kg: share(link.mass_kg),
                centre_x_m: [x - off, x + off],
                centre_y_m: [y - off, y + off],
                inertia_kg_m2: share(link.inertia_kg_m2),
                motor_inertia_kg_m2: share(link.motor_inertia_kg_m2),
            }
        }),
        gear_ratios: [first.gear_ratio, second.gear_ratio],
        joints: [first.name.clone(), second.name.clone()],
    };
    let expected = bounds.f(links);
    let ranges = bounds.ranges();
    std::array::from_fn(|index| {
        let [low, high] = ranges[index];
        let value = expected[index];
        // Inertias are above 0: their range reaches down to their least, and as far up.
        let is_inertia = matches!(index, 0 | 1 | 6);
        let width = if is_inertia { value - low } else { (value - low).max(high - value) };
        [value - width, value + width]
    })
}

/// A position loop for joint `index` to begin with: damped by friction where that is enough, else by a lead.
pub(super) fn position_loop(robot: &Robot, index: usize) -> PositionLoop<f64> {
    let without_lead = with_lead(robot, index, 0.0);
    if without_lead.bandwidth_rad_s >= LEAST_BANDWIDTH_RAD_S || robot.sampled_loop(index).is_none() {
        return without_lead.position_loop;
    }
    let lead = (LEAD_S / robot.loop_period_s).min(MOST_LEAD_TICKS).floor().max(1.0);
    with_lead(robot, index, lead).position_loop
}

/// A gain for joint `index` with the lead it has.
pub(super) fn gain_a_per_count(robot: &Robot, index: usize) -> f64 {
    let Law::Proportional(PositionLoop { lead, .. }) = robot.joints[index].law else { return 0.0 };
    with_lead(robot, index, lead).position_loop.gain_a_per_count
}

struct Proposal {
    position_loop: PositionLoop<f64>,
    bandwidth_rad_s: f64,
}

fn with_lead(robot: &Robot, index: usize, lead: f64) -> Proposal {
    let mut robot = robot.clone();
    let joint = &mut robot.joints[index];
    joint.law = Law::Proportional(PositionLoop { gain_a_per_count: 1.0, lead });
    let (torque_constant, counts_per_rad) =
        (joint.torque_constant_nm_per_a, joint.counts_per_rev / std::f64::consts::TAU);
    let Some(sampled) = robot.sampled_loop(index) else {
        return Proposal { position_loop: PositionLoop { gain_a_per_count: 0.0, lead }, bandwidth_rad_s: 0.0 };
    };
    let limit = LIMIT_SHARE * sampled.stability_limit().nm_per_count();
    let inertia = 2.0 * sampled.least_motor_inertia_kg_m2;
    let ahead_s = lead * sampled.period_s - 0.5 * sampled.period_s - sampled.command_delay_s;
    // A lead of d looks d ahead: damping of one half at a bandwidth of 1/d.
    let damped = if ahead_s > 0.0 { inertia / (ahead_s * ahead_s * counts_per_rad) } else { f64::INFINITY };
    let gain_nm_per_count = limit.min(damped);
    let gain_a_per_count = two_digits(gain_nm_per_count / torque_constant);
    Proposal {
        position_loop: PositionLoop { gain_a_per_count, lead },
        bandwidth_rad_s: (gain_nm_per_count * counts_per_rad / inertia).sqrt(),
    }
}

/// `value` rounded down to two digits.
fn two_digits(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let unit = value.log10().floor() as i32 - 1;
    let digits = (value / 10_f64.powi(unit)).floor();
    // Through text, so that 3.4e-2 is not 0.034000000000000002.
    format!("{digits}e{unit}").parse().unwrap_or(value)
}

/// Friction is switched over the same joint speed as on the reference robot, whatever the gears: its motors are fast, one
/// without a gear is as slow as its joint.
pub(super) fn set_friction_switch(robot: &mut Robot) {
    let slowest = |robot: &Robot| robot.joints.iter().map(|joint| joint.gear_ratio.abs()).fold(f64::INFINITY, f64::min);
    let usual = robot.computed_torque.friction_switch_motor_rad_s;
    let scaled = usual * slowest(robot) / slowest(&Robot::paper());
    robot.computed_torque.friction_switch_motor_rad_s = two_digits(scaled.min(usual));
}

/// A loop that needs more counts than the usual limit before its amplifier is at its end gets a limit of its own.
pub(super) fn set_following_error_limit(robot: &mut Robot) {
    let counts = robot.joints.iter().filter_map(|joint| match joint.law {
        Law::Proportional(position_loop) => Some(3.0 * joint.current_limit_a / position_loop.gain_a_per_count),
        Law::Cascade { .. } => None,
    });
    let most = counts.fold(0.0, f64::max).ceil();
    robot.following_error_limit_counts =
        (most > DEFAULT_FOLLOWING_ERROR_LIMIT_COUNTS && most.is_finite()).then_some(most);
}

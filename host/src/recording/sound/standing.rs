//! A motor that stands although the torque on it changes by more than friction can hold: a stop, a brake or an obstacle.
//!
//! Friction holds a motor as long as its torque stays near what the arm asks for in return, and that changes too while
//! the other joint moves: with gravity and by the coupling of the links. How much is not known before an
//! identification, so the arm within the search ranges that explains the most decides.

use std::ops::Range;

use shared::arm::{Arm, PARAMETERS};

use crate::recording::Recording;
use crate::robot::Robot;

/// A motor against a stop stands for at least this long.
const STANDING_S: f64 = 0.05;

/// Friction holds a motor until the torque has changed by twice its Coulomb friction. Change beyond twice that is
/// held by something else.
const HELD_BY_FRICTION: f64 = 4.0;

/// Where the friction is not known, this share of the largest torque instead.
const HELD_SHARE: f64 = 0.3;

/// Velocity and acceleration of the other joint come from counts this far apart: one count is then 0.03 rad/s² at 4e5
/// counts per turn.
const DIFFERENCE_S: f64 = 0.025;

/// The stretches of `range`, whose ticks follow each other, in which joint `index` stands although the torque of
/// `commands_a` (in A, a value a sample) changes by more than friction and the arm explain.
pub(super) fn standing(
    recording: &Recording,
    robot: &Robot,
    commands_a: &[f64],
    index: usize,
    range: &Range<usize>,
) -> Vec<Range<usize>> {
    let joint = &robot.joints[index];
    let held_nm = match joint.coulomb_friction_nm {
        Some(coulomb_nm) if coulomb_nm > 0.0 => HELD_BY_FRICTION * coulomb_nm,
        _ => HELD_SHARE * joint.current_limit_a * joint.torque_constant_nm_per_a,
    };
    let position = |k: usize| position_counts(recording, index, k);
    let least = (STANDING_S / robot.record_period_s) as usize;
    let mut found = Vec::new();
    let mut from = range.start;
    while from < range.end {
        let to = (from + 1..range.end).find(|&k| (position(k) - position(from)).abs() > 1.0).unwrap_or(range.end);
        if to - from >= least {
            let by_command = |a: &usize, b: &usize| commands_a[*a].total_cmp(&commands_a[*b]);
            if let (Some(lowest), Some(highest)) = ((from..to).min_by(by_command), (from..to).max_by(by_command)) {
                let change_nm = (commands_a[highest] - commands_a[lowest]) * joint.torque_constant_nm_per_a;
                if change_nm > held_nm + load_change_nm(recording, robot, index, range, [lowest, highest]) {
                    found.push(from..to);
                }
            }
            from = to;
        } else {
            from += 1;
        }
    }
    found
}

/// By how much the torque that holds motor `index`, which stands, can have grown between two samples of `range`, N m at
/// the motor: the most that an arm within the search ranges asks for, with all it may carry.
fn load_change_nm(
    recording: &Recording,
    robot: &Robot,
    index: usize,
    range: &Range<usize>,
    [from, to]: [usize; 2],
) -> f64 {
    let load = robot
        .gripper
        .map_or([0.0; PARAMETERS], |gripper| gripper.holding(gripper.maximum_load_kg).delta_f(robot.upper_arm_m));
    let per_unit = |parameter: usize| {
        let mut f = [0.0; PARAMETERS];
        f[parameter] = 1.0;
        let arm = Arm { f, gravity_m_s2: robot.gravity_m_s2 };
        let torque_nm = |k: usize| {
            let [position, velocity, acceleration] = motion(recording, robot, index, range, k);
            arm.inverse_dynamics_nm(position, velocity, acceleration)[index] / robot.joints[index].gear_ratio
        };
        torque_nm(to) - torque_nm(from)
    };
    let largest = (0..PARAMETERS).map(|parameter| {
        let ([low, high], carried, per_unit) = (robot.search[parameter], load[parameter], per_unit(parameter));
        [low, high, low + carried, high + carried].map(|f| f * per_unit).into_iter().fold(f64::NEG_INFINITY, f64::max)
    });
    largest.sum::<f64>().max(0.0)
}

/// Joint positions, velocities and accelerations about sample `k` of `range`, in rad; joint `standing` stands.
fn motion(recording: &Recording, robot: &Robot, standing: usize, range: &Range<usize>, k: usize) -> [[f64; 2]; 3] {
    let apart = ((DIFFERENCE_S / robot.record_period_s) as usize).min((range.len() - 1) / 2);
    let middle = k.clamp(range.start + apart, range.end - 1 - apart);
    let apart_s = apart as f64 * robot.record_period_s;
    let mut motion = [[0.0; 2]; 3];
    for (index, joint) in robot.joints.iter().enumerate() {
        let at = |k: usize| position_counts(recording, index, k) / joint.counts_per_rad();
        motion[0][index] = at(k);
        if index != standing && apart > 0 {
            let (before, here, after) = (at(middle - apart), at(middle), at(middle + apart));
            motion[1][index] = (after - before) / (2.0 * apart_s);
            motion[2][index] = (after - 2.0 * here + before) / (apart_s * apart_s);
        }
    }
    motion
}

/// Where the motor of joint `index` is at sample `k`, in counts.
fn position_counts(recording: &Recording, index: usize, k: usize) -> f64 {
    recording.reference_counts[index][k] - recording.error_counts[index][k]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a second in which the shoulder swings by 0.8 rad and back while the elbow stands, its motor's torque that of
    /// `arm` and up to `pushed_nm` more.
    fn elbow_stands(robot: &Robot, arm: &Arm<f64>, pushed_nm: f64) -> (Recording, Vec<f64>) {
        let samples = 715_u32;
        let phase = |k: u32| std::f64::consts::PI * f64::from(k) / f64::from(samples - 1);
        let rate = std::f64::consts::PI / (f64::from(samples - 1) * robot.record_period_s);
        let shoulder_rad = |k: u32| -1.2 + 0.8 * phase(k).sin();
        let elbow = &robot.joints[1];
        let command = |k: u32| {
            let motion = [0.8 * rate * phase(k).cos(), -0.8 * rate * rate * phase(k).sin()];
            let load_nm = arm.inverse_dynamics_nm([shoulder_rad(k), 0.0], [motion[0], 0.0], [motion[1], 0.0])[1];
            (load_nm / elbow.gear_ratio + pushed_nm * phase(k).sin()) / elbow.torque_constant_nm_per_a
        };
        let counts = |k: u32| (shoulder_rad(k) * robot.joints[0].counts_per_rad()).trunc();
        let still = vec![vec![0.0; samples as usize]; 2];
        let recording = Recording {
            path: "stands.csv".into(),
            tick: (0..samples).collect(),
            reference_counts: vec![(0..samples).map(counts).collect(), still[1].clone()],
            error_counts: still.clone(),
            current_a: still,
            command_a: None,
            added_torque: None,
            manifest: None,
            notes: Vec::new(),
        };
        (recording, (0..samples).map(command).collect())
    }

    #[test]
    fn an_elbow_that_sticks_while_the_shoulder_moves_its_load_is_no_stop() {
        // Friction so small that what the arm asks for is far beyond it.
        let mut robot = Robot::paper();
        robot.joints[1].coulomb_friction_nm = Some(0.02);
        let arm = Arm { f: robot.expected_f(), gravity_m_s2: robot.gravity_m_s2 };
        let found = |pushed_nm: f64| {
            let (recording, commands_a) = elbow_stands(&robot, &arm, pushed_nm);
            let change_a = commands_a.iter().fold(f64::NEG_INFINITY, |most, a| most.max(a - commands_a[0]));
            (standing(&recording, &robot, &commands_a, 1, &(0..commands_a.len())), change_a)
        };
        let (stretches, change_a) = found(0.02);
        assert!(change_a * robot.joints[1].torque_constant_nm_per_a > HELD_BY_FRICTION * 0.02, "{change_a} A");
        assert!(stretches.is_empty(), "{stretches:?}");
        assert_eq!(found(2.5).0, vec![0..715]);
    }
}

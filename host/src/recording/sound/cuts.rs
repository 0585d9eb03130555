//! Stretches in which the arm did not move freely under its command: the model would be fitted to something else.

use std::ops::Range;

use super::{contiguous, median};
use crate::recording::Recording;
use crate::robot::Robot;

/// A state lasting less than this is passed over: the model follows it well enough.
const LEAST_S: f64 = 0.0035;

/// How long after a saturated stretch the loop still recovers from it.
const RECOVERY_S: f64 = 0.02;

/// A command this share of the limit is at the limit: the converters' steps are finer.
const AT_LIMIT: f64 = 0.995;

/// Measured current is beside the commanded one from this on, in A and as a share of the command: far beyond noise.
const BESIDE_A: f64 = 0.2;
const BESIDE_SHARE: f64 = 0.06;

/// A stretch in which it is reaches as far as half of that holds: the edges of a limit are soft.
const EDGE: f64 = 0.5;

/// Where this share of a recording's current is beside its command, the command is wrong and not the stretch.
const MOST_BESIDE: f64 = 0.3;

/// A motor against a stop stands for at least this long.
const STANDING_S: f64 = 0.05;

/// Friction holds a motor until the torque has changed by twice its Coulomb friction. Change beyond twice that is
/// held by something else.
const HELD_BY_FRICTION: f64 = 4.0;

/// Where the friction is not known, this share of the largest torque instead.
const HELD_SHARE: f64 = 0.3;

/// Left out around a stop: the bounce.
const BOUNCE_S: f64 = 0.05;

/// Left out at the end of a movement that a fault ended: what led to it.
const BEFORE_FAULT_S: f64 = 0.2;

/// What to leave out and why, in the order of time, without overlaps.
pub fn find(recording: &Recording, robot: &Robot, commands_a: Option<&[Vec<f64>]>) -> Vec<(Range<usize>, String)> {
    let samples = |seconds: f64| (seconds / robot.record_period_s).round() as usize;
    let mut stretches: Vec<(Range<usize>, String)> = Vec::new();
    for (index, joint) in robot.joints.iter().enumerate() {
        for range in contiguous(&recording.tick) {
            let mut leave_out = |stretch: Range<usize>, before: usize, after: usize, reason: String| {
                let from = stretch.start.saturating_sub(before).max(range.start);
                stretches.push((from..(stretch.end + after).min(range.end), reason));
            };
            let Some(commands) = commands_a.map(|columns| &columns[index]) else { continue };
            let limit_a = joint.current_limit_a;
            let at_limit = |k: usize| commands[k].abs() >= AT_LIMIT * limit_a;
            for stretch in runs(&range, samples(LEAST_S), at_limit) {
                let reason = format!("the command of joint {} is at the amplifier's limit of {limit_a} A", joint.name);
                leave_out(stretch, 0, samples(RECOVERY_S), reason);
            }
            if !robot.current_is_command && robot.loop_ticks_per_record() == 1 {
                let offset_a = current_offset_a(recording, robot, commands_a.unwrap_or_default(), index).unwrap_or(0.0);
                let beside = |k: usize, share: f64| {
                    let commanded = commands[k.saturating_sub(1).max(range.start)];
                    let measured = recording.current_a[index][k] - offset_a;
                    (measured - commanded).abs() > share * (BESIDE_A + BESIDE_SHARE * commanded.abs())
                };
                let reaching = |found: Range<usize>| {
                    let first = (range.start..found.start).rev().take_while(|&k| beside(k, EDGE)).last();
                    let last = (found.end..range.end).take_while(|&k| beside(k, EDGE)).last();
                    // What is measured at a sample was commanded at the one before.
                    let first = first.unwrap_or(found.start).saturating_sub(1).max(range.start);
                    first..last.map_or(found.end, |last| last + 1)
                };
                let found: Vec<Range<usize>> =
                    runs(&range, samples(LEAST_S), |k| beside(k, 1.0)).into_iter().map(reaching).collect();
                let share = found.iter().map(Range::len).sum::<usize>() as f64 / range.len() as f64;
                for stretch in found.into_iter().filter(|_| share < MOST_BESIDE) {
                    let largest = |values: &[f64]| values[stretch.clone()].iter().fold(0.0, |a: f64, b| a.max(b.abs()));
                    let reason = format!(
                        "the current of joint {} does not follow its command ({:.2} A at most where {:.2} A were asked for): \
                         the amplifier is at a limit that the robot file does not give",
                        joint.name,
                        largest(&recording.current_a[index]),
                        largest(commands)
                    );
                    leave_out(stretch, 0, samples(RECOVERY_S), reason);
                }
            }
            for stretch in standing(recording, robot, commands, index, &range) {
                let reason = format!(
                    "joint {} stands still against a torque that friction alone could not hold: a stop, a brake or an obstacle",
                    joint.name
                );
                leave_out(stretch, samples(BOUNCE_S), samples(BOUNCE_S), reason);
            }
        }
    }
    if let Some(partial) = recording.manifest.as_ref().and_then(|manifest| manifest.partial.as_ref()) {
        let end = recording.samples();
        let reason = format!("the movement ended early ({partial}), and its end shows what led to that");
        stretches.push((end.saturating_sub(samples(BEFORE_FAULT_S))..end, reason));
    }
    merged(stretches)
}

/// Measured less commanded current in A over a whole recording, in the median; nothing where they cannot be compared.
pub fn current_offset_a(recording: &Recording, robot: &Robot, commands_a: &[Vec<f64>], joint: usize) -> Option<f64> {
    if robot.current_is_command || robot.loop_ticks_per_record() != 1 {
        return None;
    }
    // The measured current shows the command of the tick before. Saturated samples show the amplifier's limit.
    let limit_a = robot.joints[joint].current_limit_a;
    let mut differences: Vec<f64> = (1..recording.samples())
        .filter(|&k| commands_a[joint][k - 1].abs() < AT_LIMIT * limit_a)
        .map(|k| recording.current_a[joint][k] - commands_a[joint][k - 1])
        .collect();
    (!differences.is_empty()).then(|| median(&mut differences))
}

/// The stretches of at least `least` samples in `range` throughout which `holds`.
fn runs(range: &Range<usize>, least: usize, holds: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = None;
    for k in range.start..=range.end {
        match (k < range.end && holds(k), from) {
            (true, None) => from = Some(k),
            (false, Some(start)) => {
                if k - start >= least.max(1) {
                    found.push(start..k);
                }
                from = None;
            }
            _ => {}
        }
    }
    found
}

/// Stretches in which a motor stands although the torque on it changes by more than friction holds.
fn standing(
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
    let position = |k: usize| recording.reference_counts[index][k] - recording.error_counts[index][k];
    let least = (STANDING_S / robot.record_period_s) as usize;
    let mut found = Vec::new();
    let mut from = range.start;
    while from < range.end {
        let to = (from + 1..range.end).find(|&k| (position(k) - position(from)).abs() > 1.0).unwrap_or(range.end);
        if to - from >= least {
            let stretch = &commands_a[from..to];
            let lowest = stretch.iter().copied().fold(f64::INFINITY, f64::min);
            let highest = stretch.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            if (highest - lowest) * joint.torque_constant_nm_per_a > held_nm {
                found.push(from..to);
            }
            from = to;
        } else {
            from += 1;
        }
    }
    found
}

/// In the order of time; what overlaps becomes one stretch with the reasons of all.
fn merged(mut stretches: Vec<(Range<usize>, String)>) -> Vec<(Range<usize>, String)> {
    stretches.retain(|(range, _)| !range.is_empty());
    stretches.sort_by_key(|(range, _)| range.start);
    let mut merged: Vec<(Range<usize>, String)> = Vec::new();
    for (range, reason) in stretches {
        match merged.last_mut() {
            Some((last, reasons)) if range.start <= last.end => {
                last.end = last.end.max(range.end);
                if !reasons.contains(&reason) {
                    *reasons = format!("{reasons}; {reason}");
                }
            }
            _ => merged.push((range, reason)),
        }
    }
    merged
}

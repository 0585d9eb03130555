//! Stretches in which the arm did not move freely under its command: the model would be fitted to something else.

use std::ops::Range;

use super::standing::standing;
use super::{contiguous, median};
use crate::recording::Recording;
use crate::robot::Robot;

/// A state lasting less than this is passed over: the model follows it well enough.
const LEAST_S: f64 = 0.0035;

/// How long after a saturated stretch the loop still recovers from it.
const RECOVERY_S: f64 = 0.02;

/// A command this share of the limit is at the limit: the converters' steps are finer.
const AT_LIMIT: f64 = 0.995;

/// Measured current is beside the commanded one from this on, in A and as a share of the command: four times the noise
/// of a sensor, and the scales of two converters.
const BESIDE_A: f64 = 0.08;
const BESIDE_SHARE: f64 = 0.02;

/// A stretch in which it is reaches as far as half of that holds: the edges of a limit are soft.
const EDGE: f64 = 0.5;

/// Where this share of a recording's current is beside its command, the command is wrong and not the stretch.
const MOST_BESIDE: f64 = 0.3;

/// A current that is this share of its peak throughout a stretch is at a limit there.
const FLAT: f64 = 0.95;

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
            let mut limit_a = joint.current_limit_a;
            if !robot.current_is_command && robot.loop_ticks_per_record() == 1 {
                let offset_a = current_offset_a(recording, robot, commands_a.unwrap_or_default(), index).unwrap_or(0.0);
                let commanded = |k: usize| commands[k.saturating_sub(1).max(range.start)];
                let measured = |k: usize| recording.current_a[index][k] - offset_a;
                let beside = |k: usize, share: f64| {
                    (measured(k) - commanded(k)).abs() > share * (BESIDE_A + BESIDE_SHARE * commanded(k).abs())
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
                    let largest =
                        |value: &dyn Fn(usize) -> f64| stretch.clone().map(|k| value(k).abs()).fold(0.0, f64::max);
                    let (flowed_a, asked_a) = (largest(&measured), largest(&commanded));
                    let mut sizes: Vec<f64> = stretch.clone().map(|k| measured(k).abs()).collect();
                    let level_a = median(&mut sizes);
                    if flowed_a < asked_a && level_a > FLAT * flowed_a && level_a > 0.5 * asked_a {
                        // A flat top: commands just beyond it are cut short too, by too little to stand out.
                        limit_a = limit_a.min(level_a);
                    }
                    let reason = format!(
                        "the current of joint {} does not follow its command ({flowed_a:.2} A at most where {asked_a:.2} A were \
                         asked for): the amplifier is at a limit that the robot file does not give",
                        joint.name
                    );
                    leave_out(stretch, 0, samples(RECOVERY_S), reason);
                }
            }
            let at_limit = |k: usize| commands[k].abs() >= AT_LIMIT * limit_a;
            for stretch in runs(&range, 1, at_limit) {
                // A single tick at the limit of the robot file is followed well enough by the model.
                if limit_a < joint.current_limit_a || stretch.len() >= samples(LEAST_S) {
                    let reason =
                        format!("the command of joint {} is at the amplifier's limit of {limit_a:.2} A", joint.name);
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

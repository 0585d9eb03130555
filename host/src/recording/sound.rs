//! What of a recording can be used to identify from: corrupted samples mended, stretches in which the arm was not
//! moving freely under its command cut out, a bias of the current told.
//!
//! What is cut leaves a gap in the ticks, like samples that never came.

mod cuts;
mod spikes;
mod standing;

use std::fmt;
use std::ops::Range;

use super::{Mode, Recording};
use crate::robot::{Law, Robot};

/// A recording without what cannot be used, and what was done to it.
#[derive(Clone, Debug)]
pub struct SoundPart {
    /// The usable samples.
    pub recording: Recording,
    /// What was found, for the user to see.
    pub findings: Vec<Finding>,
    /// Current flowing or shown beside the command, per joint in A, where it stands out from the sensor's noise.
    pub current_offset_a: [Option<f64>; 2],
}

/// Something about a recording that its user should know.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// Single samples far off the course of their neighbours, replaced by the line between these.
    Mended {
        /// The column.
        column: String,
        /// Their ticks.
        ticks: Vec<u32>,
    },
    /// A column with so many of them that mending would make data up.
    Noisy {
        /// The column.
        column: String,
        /// How many.
        count: usize,
        /// Of how many samples.
        samples: usize,
    },
    /// A stretch left out.
    Cut {
        /// First tick left out.
        from_tick: u32,
        /// Last tick left out.
        to_tick: u32,
        /// Why.
        reason: String,
    },
    /// Measured current is beside the commanded one throughout.
    CurrentOffset {
        /// Name of the joint.
        joint: String,
        /// Measured less commanded, in A.
        offset_a: f64,
    },
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mended { column, ticks } => {
                let shown: Vec<String> = ticks.iter().take(5).map(u32::to_string).collect();
                let more = if ticks.len() > 5 { ", …" } else { "" };
                write!(
                    f,
                    "{} samples of {column} are far off their neighbours (tick {}{more}) and were replaced by the line between \
                     these",
                    ticks.len(),
                    shown.join(", ")
                )
            }
            Self::Noisy { column, count, samples } => write!(
                f,
                "{count} of {samples} samples of {column} are far off their neighbours, too many to replace: check the \
                 encoder and its cable"
            ),
            Self::Cut { from_tick, to_tick, reason } => {
                write!(f, "ticks {from_tick} to {to_tick} were left out: {reason}")
            }
            Self::CurrentOffset { joint, offset_a } => write!(
                f,
                "the current of joint {joint} shows {:.0} mA more than commanded throughout: a bias of the sensor, or of the \
                 amplifier; the motor's torque offset is identified too, to tell which",
                1e3 * offset_a
            ),
        }
    }
}

/// A bias of the current below this is the converters' own.
const LEAST_OFFSET_A: f64 = 0.02;

impl Recording {
    /// The part of this recording an identification on `robot` can use.
    pub fn sound_part(&self, robot: &Robot) -> SoundPart {
        let mut recording = self.clone();
        let mut findings = spikes::mend(&mut recording, robot);
        let commands = commands_a(&recording, robot);
        let mut current_offset_a = [None; 2];
        if let Some(commands) = &commands {
            for (joint, offset) in current_offset_a.iter_mut().enumerate().take(robot.joints.len()) {
                *offset = cuts::current_offset_a(&recording, robot, commands, joint)
                    .filter(|offset_a| offset_a.abs() > LEAST_OFFSET_A);
                if let Some(offset_a) = *offset {
                    let joint = robot.joints[joint].name.clone();
                    findings.push(Finding::CurrentOffset { joint, offset_a });
                }
            }
        }
        let stretches = cuts::find(&recording, robot, commands.as_deref());
        for (range, reason) in &stretches {
            findings.push(Finding::Cut {
                from_tick: recording.tick[range.start],
                to_tick: recording.tick[range.end - 1],
                reason: reason.clone(),
            });
        }
        let ranges: Vec<Range<usize>> = stretches.into_iter().map(|(range, _)| range).collect();
        recording.leave_out(&ranges);
        SoundPart { recording, findings, current_offset_a }
    }

    /// Removes the samples in `ranges`.
    fn leave_out(&mut self, ranges: &[Range<usize>]) {
        if ranges.is_empty() {
            return;
        }
        let keep: Vec<bool> = (0..self.samples()).map(|k| !ranges.iter().any(|range| range.contains(&k))).collect();
        let kept = |k: &mut usize| {
            *k += 1;
            keep[*k - 1]
        };
        let mut k = 0;
        self.tick.retain(|_| kept(&mut k));
        let groups = [
            Some(&mut self.reference_counts),
            Some(&mut self.error_counts),
            Some(&mut self.current_a),
            self.command_a.as_mut(),
            self.added_torque.as_mut(),
        ];
        for column in groups.into_iter().flatten().flatten() {
            let mut k = 0;
            column.retain(|_| kept(&mut k));
        }
    }
}

/// The command at each sample in A, limited by the amplifier: as recorded, or by the position loop on the recorded
/// errors. Nothing where neither is there.
fn commands_a(recording: &Recording, robot: &Robot) -> Option<Vec<Vec<f64>>> {
    if let Some(commands) = &recording.command_a {
        return Some(commands.clone());
    }
    if robot.current_is_command {
        return Some(recording.current_a.clone());
    }
    let loops = (recording.mode() == Mode::P).then(|| recording.position_loops(robot)).flatten()?;
    let of_joint = |(joint, law): (usize, &shared::control::PositionLoop<f64>)| {
        let errors = &recording.error_counts[joint];
        let limit_a = robot.joints[joint].current_limit_a;
        (0..errors.len())
            .map(|k| law.command_a(errors[k], errors[k.saturating_sub(1)]).clamp(-limit_a, limit_a))
            .collect()
    };
    Some(loops.iter().enumerate().map(of_joint).collect())
}

/// How many counts of error are worth the change of current `current_a` of a joint under its law; nothing under a
/// cascade.
fn gain_a_per_count(robot: &Robot, joint: usize) -> Option<f64> {
    match robot.joints[joint].law {
        Law::Proportional(law) => Some(law.gain_a_per_count * (1.0 + 2.0 * law.lead)),
        Law::Cascade { .. } => None,
    }
}

/// The ranges of samples whose ticks follow each other.
fn contiguous(tick: &[u32]) -> Vec<Range<usize>> {
    let mut ranges = Vec::new();
    let mut from = 0;
    for k in 1..=tick.len() {
        if k == tick.len() || tick[k] != tick[k - 1].wrapping_add(1) {
            ranges.push(from..k);
            from = k;
        }
    }
    ranges
}

/// The middle of `values`, which are reordered; 0 of none.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

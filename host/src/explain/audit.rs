//! Before anything is explained: whether recordings and robot file belong together, and whether anything can be told
//! from them at all.

use nalgebra::{DMatrix, DVector};

use super::trace::Trace;
use crate::identify::Experiment;
use crate::recording::{Mode, Recording};
use crate::robot::Law;

/// Largest relative difference between the gain of the robot file and that of the recordings.
const GAIN_TOLERANCE: f64 = 0.03;

/// Samples that a gain is told from at least.
const LEAST_SAMPLES: usize = 100;

/// Share of the samples at the current limit from which nothing can be told.
const SATURATED: f64 = 0.5;

/// Recordings from which nothing can be concluded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AuditError {
    /// They say that they are of different robots.
    #[error(
        "{first} is of the robot \"{one}\" and {second} of \"{other}\": what they disagree about could be either robot, so \
         no effect can be named; explain the recordings of one robot at a time"
    )]
    DifferentRobots {
        /// A recording.
        first: String,
        /// Its robot.
        one: String,
        /// Another recording.
        second: String,
        /// Its robot.
        other: String,
    },
    /// The controller was another one.
    #[error(
        "{recording} was made under computed torque; what a model lacks is told from recordings under the position loop, \
         so nothing can be concluded from it: record with --mode p"
    )]
    NotUnderThePositionLoop {
        /// The recording.
        recording: String,
    },
    /// The commands do not follow from the errors.
    #[error(
        "{recording}: joint {joint} acts on its error with {found:.5} A/count, but the robot file says {expected:.5}: with a \
         wrong gain every command is wrong, so no effect can be named; run `armid calibrate` and correct the robot file"
    )]
    WrongGain {
        /// The recording.
        recording: String,
        /// The joint.
        joint: String,
        /// Gain seen, A/count.
        found: f64,
        /// Gain of the robot file.
        expected: f64,
    },
    /// The amplifier was at its end most of the time.
    #[error(
        "{recording}: joint {joint} is at its current limit of {limit_a:.2} A in {percent:.0} % of the samples: the command \
         hardly acts there, so no effect can be named; record a gentler movement"
    )]
    Saturated {
        /// The recording.
        recording: String,
        /// The joint.
        joint: String,
        /// The limit in A.
        limit_a: f64,
        /// Share of the samples in %.
        percent: f64,
    },
    /// A joint never turns round.
    #[error(
        "joint {joint} never reverses in these recordings: friction, offset and gravity cannot be told apart without a \
         reversal, so no effect can be named; record a movement that goes both ways"
    )]
    NoReversal {
        /// The joint.
        joint: String,
    },
}

/// Refuses recordings from which nothing can be concluded.
pub fn audit(experiment: &Experiment, recordings: &[&Recording], traces: &[Trace]) -> Result<(), AuditError> {
    let path = |recording: &Recording| recording.path.display().to_string();
    let named = |recording: &&Recording| recording.manifest.as_ref().map(|m| m.robot.clone()).filter(|n| !n.is_empty());
    let mut names = recordings.iter().filter_map(|r| named(r).map(|name| (*r, name)));
    if let Some((first, one)) = names.next()
        && let Some((second, other)) = names.find(|(_, other)| *other != one)
    {
        return Err(AuditError::DifferentRobots { first: path(first), one, second: path(second), other });
    }
    if let Some(other) = recordings.iter().find(|recording| recording.mode() != Mode::P) {
        return Err(AuditError::NotUnderThePositionLoop { recording: path(other) });
    }
    for (joint, robot) in experiment.robot.joints.iter().enumerate() {
        let reverses = traces.iter().any(|trace| {
            let still = 2.0 / experiment.counts_per_rad(joint).abs() / 0.05;
            let fast = |sign: f64| trace.velocity_rad_s[joint].iter().any(|v| sign * v > still);
            fast(1.0) && fast(-1.0)
        });
        if !reverses {
            return Err(AuditError::NoReversal { joint: robot.name.clone() });
        }
    }
    for recording in recordings {
        for (joint, robot) in experiment.robot.joints.iter().enumerate() {
            saturation(recording, joint, robot)?;
            gain(experiment, recording, joint, robot)?;
        }
    }
    Ok(())
}

fn saturation(recording: &Recording, joint: usize, robot: &crate::robot::Joint) -> Result<(), AuditError> {
    let command = recording.command_a.as_ref().unwrap_or(&recording.current_a);
    let at_the_end = command[joint].iter().filter(|c| c.abs() >= 0.995 * robot.current_limit_a).count();
    let share = at_the_end as f64 / command[joint].len().max(1) as f64;
    if share > SATURATED {
        return Err(AuditError::Saturated {
            recording: recording.path.display().to_string(),
            joint: robot.name.clone(),
            limit_a: robot.current_limit_a,
            percent: 100.0 * share,
        });
    }
    Ok(())
}

/// The gain by which command, or measured current, follows the error: beside what dead zones, offsets and induced
/// voltages add, where the current is not at its end.
fn gain(
    experiment: &Experiment,
    recording: &Recording,
    joint: usize,
    robot: &crate::robot::Joint,
) -> Result<(), AuditError> {
    let Law::Proportional(law) = robot.law else { return Ok(()) };
    if experiment.commands_are_missing() || law.gain_a_per_count == 0.0 {
        return Ok(());
    }
    let error = &recording.error_counts[joint];
    let reference = &recording.reference_counts[joint];
    // A measured current shows the command of the tick before; a command its own.
    let (seen, lag) = match (&recording.command_a, experiment.robot.current_is_command) {
        (Some(command), _) => (&command[joint], 0),
        (None, true) => (&recording.current_a[joint], 0),
        (None, false) => (&recording.current_a[joint], 1),
    };
    let predicted: Vec<f64> = (0..error.len())
        .map(|k| law.gain_a_per_count * (error[k] + law.lead * (error[k] - error[k.saturating_sub(1)])))
        .collect();
    let most = |of: &[f64]| of.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    // A current can be at an end that nobody knows of, far below the amplifier's.
    let largest = most(&predicted).min(robot.current_limit_a).min(most(seen));
    let mut rows: Vec<([f64; 4], f64)> = Vec::new();
    for k in 2..error.len() {
        let u = predicted[k - lag];
        if u.abs() > 0.7 * largest || u.abs() < 0.05 * largest {
            continue;
        }
        let speed = (reference[k] - error[k]) - (reference[k - 2] - error[k - 2]);
        rows.push(([u, u.signum() * largest, speed, 1.0], seen[k]));
    }
    if largest <= 0.0 || rows.len() < LEAST_SAMPLES {
        return Ok(());
    }
    let slope = most_agree(rows)[0];
    if (slope - 1.0).abs() > GAIN_TOLERANCE {
        return Err(AuditError::WrongGain {
            recording: recording.path.display().to_string(),
            joint: robot.name.clone(),
            found: slope * law.gain_a_per_count,
            expected: law.gain_a_per_count,
        });
    }
    Ok(())
}

/// Coefficients of the regression that most of the rows agree on. A voltage at its end takes current away where the joint is
/// fast, however small the command: such samples are far from what the others have in common, and are left out.
fn most_agree(mut rows: Vec<([f64; 4], f64)>) -> DVector<f64> {
    /// How often what is far off is left out, and what is: so many times the deviation that the median stands for.
    const ROUNDS: usize = 10;
    const FAR_OFF: f64 = 2.5;
    const DEVIATION_PER_MEDIAN: f64 = 1.4826;
    let fit = |rows: &[([f64; 4], f64)]| {
        let mut normal = DMatrix::<f64>::zeros(4, 4);
        let mut right = DVector::<f64>::zeros(4);
        for (row, seen) in rows {
            for i in 0..4 {
                for j in 0..4 {
                    normal[(i, j)] += row[i] * row[j];
                }
                right[i] += row[i] * seen;
            }
        }
        super::linear::solve(&normal, &right)
    };
    let mut coefficients = fit(&rows);
    for _ in 0..ROUNDS {
        let off = |(row, seen): &([f64; 4], f64)| -> f64 {
            let foretold: f64 = row.iter().zip(coefficients.iter()).map(|(x, c)| x * c).sum();
            (seen - foretold).abs()
        };
        let mut sizes: Vec<f64> = rows.iter().map(off).collect();
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        let most = FAR_OFF * DEVIATION_PER_MEDIAN * *median;
        let kept: Vec<([f64; 4], f64)> = rows.iter().filter(|row| off(row) <= most).copied().collect();
        if kept.len() < LEAST_SAMPLES || kept.len() == rows.len() {
            break;
        }
        rows = kept;
        coefficients = fit(&rows);
    }
    coefficients
}

/// Standard deviation of the current measurement per joint in A, from its differences between neighbouring samples: the
/// current itself changes little from one to the next. Nothing where the recording holds the command instead.
pub fn current_sigma(experiment: &Experiment) -> Option<[f64; 2]> {
    if experiment.robot.current_is_command || experiment.commands_are_missing() {
        return None;
    }
    Some(std::array::from_fn(|joint| {
        let limit = experiment.robot.joints.get(joint).map_or(0.0, |joint| joint.current_limit_a);
        let mut differences: Vec<f64> = experiment
            .segments
            .iter()
            .flat_map(|segment| {
                let rest =
                    |k: usize| segment.current_a[k][joint] - segment.command_a[k - 1][joint].clamp(-limit, limit);
                (2..segment.current_a.len()).map(move |k| (rest(k) - rest(k - 1)).abs())
            })
            .collect();
        if differences.is_empty() {
            return 1.0;
        }
        let middle = differences.len() / 2;
        let (_, median, _) = differences.select_nth_unstable_by(middle, f64::total_cmp);
        // The median of a normal difference of two samples is 0.6745·√2 of one's deviation.
        (*median / (0.674_5 * std::f64::consts::SQRT_2)).max(0.002)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Robot;

    /// A joint that is 400 counts behind at most, with `gain_share` times the gain of the robot file, under an amplifier that
    /// gives no more than `limit_a` says for a speed, 1 at its fastest.
    fn audited(limit_a: impl Fn(f64) -> f64, gain_share: f64) -> Result<(), AuditError> {
        let robot = Robot::paper();
        let Law::Proportional(law) = robot.joints[0].law else { panic!("a position loop") };
        let samples = 2000;
        let swing = |k: usize| (k as f64 * 0.0126).sin();
        let error: Vec<f64> = (0..samples).map(|k| (400.0 * swing(k)).trunc()).collect();
        let current = |k: usize| {
            let (asked_a, speed) = (gain_share * law.gain_a_per_count * error[k.saturating_sub(1)], swing(k + 125));
            let limit_a = limit_a(speed * asked_a.signum());
            asked_a.clamp(-limit_a, limit_a)
        };
        let current: Vec<f64> = (0..samples).map(current).collect();
        let recording = Recording {
            path: "early.csv".into(),
            tick: (0..samples as u32).collect(),
            reference_counts: vec![(0..samples).map(|k| 9000.0 * swing(k) + error[k]).collect(); 2],
            error_counts: vec![error; 2],
            current_a: vec![current; 2],
            command_a: None,
            added_torque: None,
            manifest: None,
            notes: Vec::new(),
        };
        let experiment = Experiment::new(&robot, std::slice::from_ref(&recording)).expect("a recording");
        gain(&experiment, &recording, 0, &robot.joints[0])
    }

    /// Where nothing but the measured current says what the amplifier did, its own end may be far below the robot file's.
    #[test]
    fn a_current_that_ends_early_is_no_wrong_gain() {
        for limit_a in [3.0, 4.5, 8.0] {
            assert_eq!(audited(|_| limit_a, 1.0), Ok(()), "{limit_a} A");
            assert!(matches!(audited(|_| limit_a, 0.8), Err(AuditError::WrongGain { .. })), "{limit_a} A");
        }
    }

    /// A voltage at its end leaves little current where the joint is fast, whatever was asked for.
    #[test]
    fn a_voltage_that_ends_early_is_no_wrong_gain() {
        let limit_a = |along: f64| (14.0 - 9.0 * along).clamp(1.5, 12.0);
        assert_eq!(audited(limit_a, 1.0), Ok(()));
        assert!(matches!(audited(limit_a, 0.9), Err(AuditError::WrongGain { .. })));
    }
}

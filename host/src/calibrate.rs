//! Calibration of the position loop: A per count, and lead, from recorded current and error.
//!
//! The commanded current is `gain (e + lead (e − e_previous)) + offset`: linear in (gain, gain · lead, offset), so plain
//! least squares finds all three and their standard errors. The measured current shows the command of the loop tick
//! before. Where the loop runs faster than the recording, the error at that tick is read off the straight line between
//! two samples.
//!
//! The residual is mostly the converters' rounding, which repeats while the error dwells on a count; the standard errors
//! take correlation over 100 samples into account (Newey & West 1987).
//!
//! Left out: the amplifier's bandwidth.

use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

use crate::recording::{Mode, Recording};
use crate::robot::{Law, Robot};

/// Below this many counts rms of variation, the error tells nothing about the gain.
const LEAST_VARIATION_COUNTS: f64 = 2.0;
/// A sample this near the current limit, as a share of it, may have been limited.
const SATURATION_SHARE: f64 = 0.98;
/// Fewer samples than this after leaving out saturated ones are too few.
const LEAST_SAMPLES: usize = 50;
/// A lead is reported only where it is this many standard errors from zero.
const SIGNIFICANT: f64 = 4.0;
/// A gain disagrees with the robot file where it is further off than this share and [`SIGNIFICANT`] standard errors.
const DISAGREEMENT_SHARE: f64 = 0.005;
/// A correlation between error and current below this means that something else drives the current.
const LEAST_CORRELATION: f64 = 0.9;

/// Over how many samples the residual may be correlated: 70 ms at 0.7 ms, half a period of the loop's slow mode.
const CORRELATED_SAMPLES: usize = 100;

/// A number with its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub standard_error: f64,
}

/// What was used as the current.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The commanded current, columns `cmd`.
    Command,
    /// The measured current, columns `cur`.
    Measured,
}

/// One joint's calibration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointCalibration {
    /// The joint's name.
    pub joint: String,
    /// What the gain was fitted to.
    pub source: Source,
    /// Position gain in A/count.
    pub position_gain_a_per_count: Estimate,
    /// Lead in loop ticks; nothing where it is not distinguishable from zero.
    pub lead: Option<Estimate>,
    /// Current at zero error in A.
    pub offset_a: Estimate,
    /// Current left over by the fit, A rms.
    pub residual_a_rms: f64,
    /// Gain from the measured current, where the command was recorded too: differs where the amplifier's scale does.
    pub measured_gain_a_per_count: Option<Estimate>,
    /// Samples used.
    pub samples: usize,
    /// Samples left out because the current was at its limit.
    pub saturated: usize,
    /// The robot file's gain.
    pub file_gain_a_per_count: f64,
    /// The robot file's lead.
    pub file_lead: f64,
    /// Whether the robot file agrees with what was found.
    pub agrees: bool,
}

/// What stops a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// No recording was given.
    #[error("no recording to calibrate from; give at least one")]
    NoRecording,
    /// The law is not the position loop.
    #[error("joint {joint} runs under a cascade, which has no gain per count; calibrate is for the position loop")]
    NotThePositionLoop {
        /// The joint.
        joint: String,
    },
    /// The recording was made under another controller.
    #[error("{path}: recorded under {mode}, where the current does not follow the error; record with --mode p")]
    OtherMode {
        /// The recording.
        path: String,
        /// Its mode.
        mode: Mode,
    },
    /// The error hardly varies.
    #[error(
        "joint {joint}: the tracking error varies by {variation_counts:.2} counts rms only, at least \
         {LEAST_VARIATION_COUNTS} are needed to tell a gain from noise; record a movement of this joint"
    )]
    HardlyVaries {
        /// The joint.
        joint: String,
        /// Standard deviation of the error in counts.
        variation_counts: f64,
    },
    /// Too many samples are saturated.
    #[error(
        "joint {joint}: {saturated} of {samples} samples are at the current limit of {limit_a} A, fewer than \
         {LEAST_SAMPLES} are left; record a slower movement, or correct current_limit_a"
    )]
    Saturated {
        /// The joint.
        joint: String,
        /// Samples at the limit.
        saturated: usize,
        /// All samples.
        samples: usize,
        /// The limit.
        limit_a: f64,
    },
    /// The current does not follow the error.
    #[error(
        "joint {joint}: error and current correlate by {correlation:.2} only, at least {LEAST_CORRELATION} is expected; \
         check the current sensor, and that the joint ran under the position loop"
    )]
    DoesNotFollow {
        /// The joint.
        joint: String,
        /// Correlation of the fit with the current.
        correlation: f64,
    },
}

/// Calibrates every joint from all `recordings` together.
pub fn calibrate(robot: &Robot, recordings: &[Recording]) -> Result<Vec<JointCalibration>, CalibrateError> {
    if recordings.is_empty() {
        return Err(CalibrateError::NoRecording);
    }
    for recording in recordings {
        if recording.mode() != Mode::P {
            return Err(CalibrateError::OtherMode {
                path: recording.path.display().to_string(),
                mode: recording.mode(),
            });
        }
    }
    (0..robot.joints.len()).map(|joint| calibrate_joint(robot, recordings, joint)).collect()
}

/// The lead of every joint's loop in ticks, from all `recordings` together, whether or not it can be told from none.
pub fn leads(robot: &Robot, recordings: &[Recording]) -> Result<Vec<Estimate>, CalibrateError> {
    let calibrated = calibrate(robot, recordings)?;
    let lead = |(index, joint): (usize, &JointCalibration)| {
        let none_found = || solve(&gather(robot, recordings, index, joint.source), true)?.lead;
        joint
            .lead
            .or_else(none_found)
            .ok_or(CalibrateError::HardlyVaries { joint: joint.joint.clone(), variation_counts: 0.0 })
    };
    calibrated.iter().enumerate().map(lead).collect()
}

fn calibrate_joint(robot: &Robot, recordings: &[Recording], joint: usize) -> Result<JointCalibration, CalibrateError> {
    let known = &robot.joints[joint];
    let Law::Proportional(file) = known.law else {
        return Err(CalibrateError::NotThePositionLoop { joint: known.name.clone() });
    };
    let has_command = recordings.iter().all(|recording| recording.command_a.is_some()) || robot.current_is_command;
    let source = if has_command { Source::Command } else { Source::Measured };
    let rows = gather(robot, recordings, joint, source);
    if rows.kept.len() < LEAST_SAMPLES {
        return Err(CalibrateError::Saturated {
            joint: known.name.clone(),
            saturated: rows.saturated,
            samples: rows.kept.len() + rows.saturated,
            limit_a: known.current_limit_a,
        });
    }
    let variation_counts = rows.variation_counts();
    if variation_counts.is_nan() || variation_counts < LEAST_VARIATION_COUNTS {
        return Err(CalibrateError::HardlyVaries { joint: known.name.clone(), variation_counts });
    }
    let fit = fit(&rows).ok_or(CalibrateError::HardlyVaries { joint: known.name.clone(), variation_counts })?;
    if fit.correlation < LEAST_CORRELATION {
        return Err(CalibrateError::DoesNotFollow { joint: known.name.clone(), correlation: fit.correlation });
    }
    let measured_gain_a_per_count = (source == Source::Command && !robot.current_is_command)
        .then(|| self::fit(&gather(robot, recordings, joint, Source::Measured)))
        .flatten()
        .map(|fit| fit.gain);
    let off = (fit.gain.value / file.gain_a_per_count - 1.0).abs();
    let gain_agrees = off < DISAGREEMENT_SHARE
        || (fit.gain.value - file.gain_a_per_count).abs() < SIGNIFICANT * fit.gain.standard_error;
    let lead_agrees = match fit.lead {
        Some(lead) => (lead.value - file.lead).abs() < (SIGNIFICANT * lead.standard_error).max(0.02),
        None => file.lead == 0.0,
    };
    Ok(JointCalibration {
        joint: known.name.clone(),
        source,
        position_gain_a_per_count: fit.gain,
        lead: fit.lead,
        offset_a: fit.offset_a,
        residual_a_rms: fit.residual_a_rms,
        measured_gain_a_per_count,
        samples: rows.kept.len(),
        saturated: rows.saturated,
        file_gain_a_per_count: file.gain_a_per_count,
        file_lead: file.lead,
        agrees: gain_agrees && lead_agrees,
    })
}

/// One equation: current = gain · error + gain · lead · change + offset.
struct Row {
    error: f64,
    change: f64,
    current_a: f64,
}

struct Rows {
    kept: Vec<Row>,
    saturated: usize,
}

impl Rows {
    fn variation_counts(&self) -> f64 {
        let n = self.kept.len() as f64;
        let mean = self.kept.iter().map(|row| row.error).sum::<f64>() / n;
        (self.kept.iter().map(|row| (row.error - mean).powi(2)).sum::<f64>() / n).sqrt()
    }
}

fn gather(robot: &Robot, recordings: &[Recording], joint: usize, source: Source) -> Rows {
    let ticks_per_record = robot.loop_ticks_per_record() as f64;
    let limit_a = SATURATION_SHARE * robot.joints[joint].current_limit_a;
    // Samples needed before the one whose current is explained.
    let history = if source == Source::Measured && ticks_per_record == 1.0 { 2 } else { 1 };
    let mut rows = Rows { kept: Vec::new(), saturated: 0 };
    for recording in recordings {
        let error = &recording.error_counts[joint];
        let current = match (&recording.command_a, source) {
            (Some(command), Source::Command) => &command[joint],
            _ => &recording.current_a[joint],
        };
        for k in history..recording.samples() {
            if recording.tick[k] != recording.tick[k - history] + history as u32 {
                continue;
            }
            let step = (error[k] - error[k - 1]) / ticks_per_record;
            let (error, change) = match source {
                Source::Command => (error[k], step),
                Source::Measured if history == 2 => (error[k - 1], error[k - 1] - error[k - 2]),
                Source::Measured => (error[k] - step, step),
            };
            if current[k].abs() < limit_a {
                rows.kept.push(Row { error, change, current_a: current[k] });
            } else {
                rows.saturated += 1;
            }
        }
    }
    rows
}

struct Fit {
    gain: Estimate,
    lead: Option<Estimate>,
    offset_a: Estimate,
    residual_a_rms: f64,
    correlation: f64,
}

/// Least squares with the lead, and without it where it turns out not to differ from zero.
fn fit(rows: &Rows) -> Option<Fit> {
    let with_lead = solve(rows, true)?;
    let lead_is_there = with_lead.lead.is_some_and(|lead| lead.value.abs() > SIGNIFICANT * lead.standard_error);
    if lead_is_there { Some(with_lead) } else { solve(rows, false) }
}

fn solve(rows: &Rows, with_lead: bool) -> Option<Fit> {
    let regressors = |row: &Row| Vector3::new(row.error, if with_lead { row.change } else { 0.0 }, 1.0);
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    let (mut sum, mut sum_of_squares) = (0.0, 0.0);
    for row in &rows.kept {
        let x = regressors(row);
        normal += x * x.transpose();
        right += x * row.current_a;
        sum += row.current_a;
        sum_of_squares += row.current_a * row.current_a;
    }
    let unknowns = if with_lead {
        3.0
    } else {
        // The lead's own equation then reads "lead = 0".
        normal[(1, 1)] = 1.0;
        2.0
    };
    let inverse = normal.try_inverse()?;
    let solution = inverse * right;
    let residual = |row: &Row| row.current_a - regressors(row).dot(&solution);
    let squares: f64 = rows.kept.iter().map(|row| residual(row).powi(2)).sum();
    let n = rows.kept.len() as f64;
    let scores: Vec<Vector3<f64>> = rows.kept.iter().map(|row| regressors(row) * residual(row)).collect();
    let covariance = inverse * correlated_scatter(&scores) * inverse * (n / (n - unknowns));
    let [gain, gain_times_lead, offset] = [solution[0], solution[1], solution[2]];
    let of = |i: usize, j: usize| covariance[(i, j)];
    let lead = gain_times_lead / gain;
    // The lead is a quotient: to first order its error is that of (gain · lead − lead · gain) / gain.
    let lead_variance = (of(1, 1) - 2.0 * lead * of(0, 1) + lead * lead * of(0, 0)) / (gain * gain);
    let total = sum_of_squares - sum * sum / n;
    let fit = Fit {
        gain: Estimate { value: gain, standard_error: of(0, 0).sqrt() },
        lead: with_lead.then(|| Estimate { value: lead, standard_error: lead_variance.max(0.0).sqrt() }),
        offset_a: Estimate { value: offset, standard_error: of(2, 2).sqrt() },
        residual_a_rms: (squares / n).sqrt(),
        // A current that never changes follows nothing; what is left of its variance is rounding.
        correlation: if total > 1e-12 * sum_of_squares {
            (1.0 - squares / total).max(0.0).sqrt() * gain.signum()
        } else {
            0.0
        },
    };
    fit.gain.value.is_finite().then_some(fit)
}

/// Covariance of the sum of `scores`, correlation up to [`CORRELATED_SAMPLES`] included with weights falling to zero.
fn correlated_scatter(scores: &[Vector3<f64>]) -> Matrix3<f64> {
    let mut scatter = Matrix3::zeros();
    for lag in 0..CORRELATED_SAMPLES.min(scores.len()) {
        let products: Matrix3<f64> =
            scores.iter().zip(&scores[lag..]).map(|(before, after)| before * after.transpose()).sum();
        let weight = 1.0 - lag as f64 / CORRELATED_SAMPLES as f64;
        scatter += if lag == 0 { products } else { (products + products.transpose()) * weight };
    }
    scatter
}

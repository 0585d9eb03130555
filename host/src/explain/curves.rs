//! The shape of what is left: the residual torque as a smooth curve over position, speed, motor torque, time and time
//! since the last reversal, ranked by how well the curve of one recording foretells another's.

use serde::Serialize;

use super::engine::Engine;
use super::trace::{Trace, residual_torque};
use crate::identify::Columns;

/// Bins of a curve.
const BINS: usize = 24;
/// Samples nearer to a reversal than this are left out but for the curve over the time since it: the low-pass smears
/// friction's jump there.
const REVERSAL_S: f64 = 0.05;

/// The residual torque over one quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// The joint's name.
    pub joint: String,
    /// The quantity.
    pub over: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Quantity, mean residual torque at the motor in N m, half width of its 95 % band.
    pub points: Vec<[f64; 3]>,
    /// Share of the residual torque's power that the curve of the other recordings (or the other half of a single one)
    /// foretells; below 0 where it makes things worse.
    pub foretold: f64,
}

type Quantity = (&'static str, &'static str, fn(&Trace, usize, usize) -> f64);

const QUANTITIES: [Quantity; 5] = [
    ("position", "rad", |trace, joint, k| trace.position_rad[joint][k]),
    ("speed", "rad/s", |trace, joint, k| trace.velocity_rad_s[joint][k]),
    ("motor torque", "N m", |trace, joint, k| trace.motor_torque_nm[joint][k]),
    ("time", "s", |trace, _, k| trace.time_s[k]),
    ("time since reversal", "s", |trace, joint, k| trace.since_reversal_s[joint][k].min(2.0)),
];

/// Every curve, the one that foretells best first.
pub fn curves(engine: &Engine, innovations: &Columns) -> Vec<Curve> {
    let experiment = engine.setting.experiment;
    let arm = engine.baseline.values.arm(experiment.robot);
    let torque = residual_torque(experiment, &engine.traces, &arm, innovations);
    let mut curves = Vec::new();
    for (joint, named) in experiment.robot.joints.iter().enumerate() {
        for (over, unit, quantity) in QUANTITIES {
            // (fold, quantity, torque), thinned: the low-pass leaves nothing new between.
            let mut samples: Vec<(usize, f64, f64)> = Vec::new();
            for (index, segment) in experiment.segments.iter().enumerate() {
                let trace = &engine.traces[index];
                let settled = experiment.settled(segment);
                let middle = settled.start + settled.len() / 2;
                for k in settled.step_by(8) {
                    let near = trace.since_reversal_s[joint][k] < REVERSAL_S;
                    let x = quantity(trace, joint, k);
                    if (near && over != "time since reversal") || !x.is_finite() {
                        continue;
                    }
                    let fold = if experiment.segments.len() > 1 { index } else { usize::from(k >= middle) };
                    samples.push((fold, x, torque[index][joint][k]));
                }
            }
            if let Some((points, foretold)) = curve(&samples) {
                curves.push(Curve { joint: named.name.clone(), over, unit, points, foretold });
            }
        }
    }
    curves.sort_by(|a, b| b.foretold.total_cmp(&a.foretold));
    curves
}

fn curve(samples: &[(usize, f64, f64)]) -> Option<(Vec<[f64; 3]>, f64)> {
    let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(l, h), s| (l.min(s.1), h.max(s.1)));
    if samples.len() < 4 * BINS || low >= high {
        return None;
    }
    let bin = |x: f64| (((x - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
    let folds = samples.iter().map(|s| s.0).max()? + 1;
    // Sums per fold and bin: count, torque, torque squared.
    let mut sums = vec![[[0.0; 3]; BINS]; folds];
    for &(fold, x, torque) in samples {
        let sum = &mut sums[fold][bin(x)];
        sum[0] += 1.0;
        sum[1] += torque;
        sum[2] += torque * torque;
    }
    let total = |wanted: &dyn Fn(usize) -> bool, bin: usize| -> [f64; 3] {
        let mut total = [0.0; 3];
        for sum in sums.iter().enumerate().filter(|(fold, _)| wanted(*fold)).map(|(_, sum)| &sum[bin]) {
            total.iter_mut().zip(sum).for_each(|(t, s)| *t += s);
        }
        total
    };
    let (mut left, mut whole) = (0.0, 0.0);
    for (fold, bins) in sums.iter().enumerate() {
        for (index, own) in bins.iter().enumerate() {
            let others = total(&|other| other != fold, index);
            let mean = if others[0] > 0.0 { others[1] / others[0] } else { 0.0 };
            left += own[2] - 2.0 * mean * own[1] + mean * mean * own[0];
            whole += own[2];
        }
    }
    let points = (0..BINS)
        .filter_map(|index| {
            let [count, sum, square] = total(&|_| true, index);
            if count < 4.0 {
                return None;
            }
            let mean = sum / count;
            // Neighbouring samples share the low-pass: about one in four counts.
            let band = 1.96 * ((square / count - mean * mean).max(0.0) / (count / 4.0)).sqrt();
            Some([low + (index as f64 + 0.5) / BINS as f64 * (high - low), mean, band])
        })
        .collect();
    Some((points, if whole > 0.0 { 1.0 - left / whole } else { 0.0 }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A torque that follows a quantity in both halves is foretold; one that turns round from one to the other is not.
    #[test]
    fn only_what_repeats_is_foretold() {
        let sample = |fold: usize, k: usize, sign: f64| {
            let x = k as f64 / 400.0;
            (fold, x, sign * (6.0 * x).sin())
        };
        let repeats: Vec<_> = (0..800).map(|k| sample(k / 400, k % 400, 1.0)).collect();
        let turns: Vec<_> = (0..800).map(|k| sample(k / 400, k % 400, if k < 400 { 1.0 } else { -1.0 })).collect();
        let (points, foretold) = curve(&repeats).unwrap();
        assert!(foretold > 0.95, "{foretold}");
        assert!(points.iter().all(|[x, mean, _]| (mean - (6.0 * x).sin()).abs() < 0.05));
        assert!(curve(&turns).unwrap().1 < -1.0);
    }
}

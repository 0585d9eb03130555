//! How well a movement would determine the parameters, before it is made.

use nalgebra::DMatrix;
use shared::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

use crate::identify::{Experiment, Parameter, Residual, Values};
use crate::robot::Robot;

/// Standard deviation of a count that stands for everything between it and the next.
const ROUNDING_COUNTS: f64 = 0.288_675_134_594_812_9;

/// Relative size of the smallest information still told from none.
const LEAST_INFORMATION: f64 = 1e-14;

/// What a robot would do on a movement, and how well that would determine its parameters.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Covariance of the estimates, in the parameters' units squared.
    pub covariance: DMatrix<f64>,
    /// Greatest commanded current of each joint, in A.
    pub peak_current_a: [f64; 2],
    /// Greatest tracking error of each joint, in counts.
    pub peak_error_counts: [f64; 2],
}

impl Prediction {
    /// Foresees movements given by their `references_rad`, evaluated together.
    ///
    /// The estimator is least squares on innovations ν = Hn whose only noise n is the rounding of the encoder, white,
    /// 1/√12 counts; H is the state correction, which follows slow noise. Hence (JᵀJ)⁻¹ JᵀHHᵀJ (JᵀJ)⁻¹ σ², with the
    /// exact sensitivities J of the innovations.
    pub fn new(robot: &Robot, values: &Values, free: &[Parameter], references_rad: &[Vec<[f64; 2]>]) -> Self {
        let experiment = Experiment::foreseen(robot, values, references_rad);
        let joints = robot.joints.len();
        let columns = experiment.sensitivities(values, free, Residual::Innovations);
        let settled: Vec<Vec<Vec<f64>>> = columns
            .into_iter()
            .map(|column| {
                let of_segments = column.into_iter().zip(&experiment.segments);
                of_segments
                    .flat_map(|(pair, segment)| {
                        let range = experiment.settled(segment);
                        pair.into_iter().take(joints).map(move |series| series[range.clone()].to_vec())
                    })
                    .collect()
            })
            .collect();
        let seen: Vec<Vec<Vec<f64>>> = settled
            .iter()
            .map(|column| column.iter().map(|series| corrected_backwards(series, robot.record_period_s)).collect())
            .collect();

        let count = free.len();
        let scale: Vec<f64> =
            (0..count).map(|i| inner(&settled[i], &settled[i]).sqrt().max(f64::MIN_POSITIVE)).collect();
        let gram = |columns: &[Vec<Vec<f64>>]| {
            let mut gram = DMatrix::zeros(count, count);
            for i in 0..count {
                for j in i..count {
                    let value = inner(&columns[i], &columns[j]) / (scale[i] * scale[j]);
                    gram[(i, j)] = value;
                    gram[(j, i)] = value;
                }
            }
            gram
        };
        let eigen = gram(&settled).symmetric_eigen();
        let floor = eigen.eigenvalues.max() * LEAST_INFORMATION;
        let inverse = &eigen.eigenvectors
            * DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.max(floor)))
            * eigen.eigenvectors.transpose();
        let scaled = &inverse * gram(&seen) * &inverse;
        let variance = ROUNDING_COUNTS * ROUNDING_COUNTS;
        let covariance = DMatrix::from_fn(count, count, |i, j| variance * scaled[(i, j)] / (scale[i] * scale[j]));

        let peak = |of: &dyn Fn(usize) -> Vec<f64>| {
            std::array::from_fn(|joint| of(joint).into_iter().fold(0.0, |peak: f64, value| peak.max(value.abs())))
        };
        let segments = &experiment.segments;
        Self {
            covariance,
            peak_current_a: peak(&|joint| segments.iter().flat_map(|s| s.command_a.iter().map(|c| c[joint])).collect()),
            peak_error_counts: peak(&|joint| {
                segments.iter().flat_map(|s| s.error_counts.iter().map(|e| e[joint])).collect()
            }),
        }
    }

    /// Standard error of each parameter, in its unit.
    pub fn standard_errors(&self) -> Vec<f64> {
        self.covariance.diagonal().iter().map(|variance| variance.max(0.0).sqrt()).collect()
    }
}

fn inner(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>()).sum()
}

/// Hᵀ of a series: the state correction run from its end to its start.
fn corrected_backwards(series: &[f64], period_s: f64) -> Vec<f64> {
    let omega = std::f64::consts::TAU * CORRECTION_HZ;
    let position_gain = 2.0 * CORRECTION_DAMPING * omega * period_s;
    let velocity_gain = omega * omega * period_s;
    let (mut position, mut velocity) = (0.0, 0.0);
    let mut corrected: Vec<f64> = series
        .iter()
        .rev()
        .map(|value| {
            let innovation = value - position;
            velocity += velocity_gain * innovation;
            position += position_gain * innovation + velocity * period_s;
            innovation
        })
        .collect();
    corrected.reverse();
    corrected
}

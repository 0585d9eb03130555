//! How well a movement would determine the parameters, before it is made.

use nalgebra::DMatrix;

use crate::identify::{Experiment, Parameter, Residual, Values};
use crate::robot::Robot;

/// Standard deviation of a count that stands for everything between it and the next.
const ROUNDING_COUNTS: f64 = 0.288_675_134_594_812_9;

/// Relative size of the smallest information still told from none.
const LEAST_INFORMATION: f64 = 1e-14;

/// Variance of a parameter that leaves no trace at all: finite, so that one can go on computing.
const UNKNOWN: f64 = 1e30;

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
    /// The estimator is least squares on innovations whose noise is the rounding of the encoder, taken as white,
    /// 1/√12 counts: σ²(JᵀJ)⁻¹ with their exact sensitivities J. In truth the state correction takes its slow part away,
    /// and near a reversal, where a count lasts long, it is not white; the two about cancel.
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
        let information = gram(&settled);
        // A model that blows up tells nothing.
        let finite = information.iter().all(|value| value.is_finite());
        let covariance = if finite {
            let eigen = information.symmetric_eigen();
            let floor = eigen.eigenvalues.max().max(f64::MIN_POSITIVE) * LEAST_INFORMATION;
            let inverse = &eigen.eigenvectors
                * DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.max(floor)))
                * eigen.eigenvectors.transpose();
            let variance = ROUNDING_COUNTS * ROUNDING_COUNTS;
            DMatrix::from_fn(count, count, |i, j| {
                let value = variance * inverse[(i, j)] / (scale[i] * scale[j]);
                let known = value.is_finite() && value.abs() < UNKNOWN;
                if known {
                    value
                } else if i == j {
                    UNKNOWN
                } else {
                    0.0
                }
            })
        } else {
            DMatrix::from_diagonal_element(count, count, UNKNOWN)
        };

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

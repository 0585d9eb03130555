//! Levenberg–Marquardt on simulated residuals, within linear bounds.

use nalgebra::{DMatrix, DVector};

use crate::convex;

/// Residual series: each a stretch of samples in time order, so that their correlation in time can be estimated.
pub type Series = Vec<Vec<f64>>;

/// A nonlinear least-squares problem in which every evaluation is a simulation.
pub struct Problem<'a> {
    /// Residuals at parameter values; every call gives series of the same lengths. NaN where the model blows up.
    pub residuals: &'a (dyn Fn(&[f64]) -> Series + Sync),
    /// Derivatives of the residuals by each parameter at parameter values.
    pub sensitivities: &'a (dyn Fn(&[f64]) -> Vec<Series> + Sync),
    /// The bounds that values break. A step is made the best one within all bounds met so far.
    pub broken_bounds: &'a (dyn Fn(&[f64]) -> Vec<Bound> + Sync),
    /// Whether values describe something that can exist; refused candidates count as infinitely bad.
    pub acceptable: &'a (dyn Fn(&[f64]) -> bool + Sync),
    /// Relative improvement below which a step is the last.
    pub tolerance: f64,
    /// Told after every iteration.
    pub progress: &'a (dyn Fn(f64) + Sync),
}

/// A linear bound: the sum of `weights` times the values is at least `least`.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// One weight a parameter.
    pub weights: Vec<f64>,
    /// The least value of the sum.
    pub least: f64,
}

/// How often a step is corrected for further bounds.
const BOUND_ROUNDS: usize = 12;

/// Where Levenberg–Marquardt ended.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Parameter values.
    pub values: Vec<f64>,
    /// Simulations spent.
    pub evaluations: usize,
}

/// Iterations after which a fit that still moves is stopped; a start in the basin needs under ten.
pub const ITERATIONS: usize = 25;

fn cost(series: &Series) -> f64 {
    let sum: f64 = series.iter().flatten().map(|x| x * x).sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

impl Problem<'_> {
    /// Minimises the sum of squared residuals from `start`, damping each step by the scaled diagonal.
    pub fn solve(&self, start: &[f64]) -> Fit {
        let mut values = start.to_vec();
        let mut residuals = (self.residuals)(&values);
        let mut best = cost(&residuals);
        let mut evaluations = 1;
        let mut damping = 1e-3;
        let mut bounds = Vec::new();
        for _ in 0..ITERATIONS {
            let sensitivities = (self.sensitivities)(&values);
            evaluations += values.len();
            let (normal, scale) = scaled_normal_matrix(&sensitivities);
            let slopes = sensitivities.iter().zip(&scale).map(|(column, scale)| inner(column, &residuals) / scale);
            let gradient = DVector::from_iterator(values.len(), slopes);
            let mut improved = false;
            let mut small = false;
            while damping < 1e9 {
                let mut damped = normal.clone();
                for i in 0..values.len() {
                    damped[(i, i)] += damping;
                }
                let Some(step) = damped.clone().cholesky().map(|c| c.solve(&gradient)) else {
                    damping *= 10.0;
                    continue;
                };
                let candidate: Vec<f64> =
                    values.iter().zip(step.iter()).zip(&scale).map(|((v, s), d)| v - s / d).collect();
                let candidate = self.within_bounds(&values, candidate, &damped, &gradient, &scale, &mut bounds);
                let (series, value) = if (self.acceptable)(&candidate) {
                    let series = (self.residuals)(&candidate);
                    evaluations += 1;
                    let value = cost(&series);
                    (series, value)
                } else {
                    (Vec::new(), f64::INFINITY)
                };
                if value < best {
                    small = (best - value) < self.tolerance * best;
                    (values, residuals, best) = (candidate, series, value);
                    damping = (damping * 0.1).max(1e-9);
                    improved = true;
                    break;
                }
                damping *= 10.0;
            }
            (self.progress)(best);
            if !improved || small {
                break;
            }
        }
        Fit { values, evaluations }
    }

    /// The best step from `values` within bounds, where the free one, to `candidate`, breaks some. What is bounded is
    /// convex (see [`super::consistency`]), so that the bounds that a step breaks, met one after another, close in on it.
    fn within_bounds(
        &self,
        values: &[f64],
        candidate: Vec<f64>,
        normal: &DMatrix<f64>,
        gradient: &DVector<f64>,
        scale: &[f64],
        bounds: &mut Vec<Bound>,
    ) -> Vec<f64> {
        let mut candidate = candidate;
        for _ in 0..BOUND_ROUNDS {
            let broken = (self.broken_bounds)(&candidate);
            if broken.is_empty() {
                break;
            }
            bounds.extend(broken);
            // In steps s, value = v − s / scale: a·value ≥ b is (a/scale)·s ≤ a·v − b.
            let rows: Vec<(Vec<f64>, f64)> = bounds
                .iter()
                .map(|bound| {
                    let room: f64 = bound.weights.iter().zip(values).map(|(a, v)| a * v).sum::<f64>() - bound.least;
                    (bound.weights.iter().zip(scale).map(|(a, d)| a / d).collect(), room)
                })
                .collect();
            let Some(step) = convex::minimise(normal, &(-gradient), &rows, &[]) else { break };
            candidate = values.iter().zip(&step).zip(scale).map(|((v, s), d)| v - s / d).collect();
        }
        candidate
    }
}

fn inner(a: &Series, b: &Series) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>()).sum()
}

/// JᵀJ with a unit diagonal, and what each column of J was divided by: the parameters differ by orders of magnitude.
pub fn scaled_normal_matrix(sensitivities: &[Series]) -> (DMatrix<f64>, Vec<f64>) {
    let count = sensitivities.len();
    let scale: Vec<f64> =
        sensitivities.iter().map(|column| inner(column, column).sqrt().max(f64::MIN_POSITIVE)).collect();
    let mut normal = DMatrix::zeros(count, count);
    for i in 0..count {
        for j in i..count {
            let value = inner(&sensitivities[i], &sensitivities[j]) / (scale[i] * scale[j]);
            normal[(i, j)] = value;
            normal[(j, i)] = value;
        }
    }
    (normal, scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(values: &[f64], noise: &[f64]) -> Series {
        vec![noise.iter().enumerate().map(|(k, n)| values[0] + values[1] * (k as f64 / 100.0).sin() - n).collect()]
    }

    #[test]
    fn finds_the_minimum_of_a_linear_problem_in_few_steps() {
        let noise = vec![3.0; 500];
        let residuals = |values: &[f64]| line(values, &noise);
        let sensitivities = |_: &[f64]| [[1.0, 0.0], [0.0, 1.0]].map(|values| line(&values, &[0.0; 500])).to_vec();
        let problem = Problem {
            residuals: &residuals,
            sensitivities: &sensitivities,
            broken_bounds: &|_| Vec::new(),
            acceptable: &|_| true,
            tolerance: 1e-9,
            progress: &|_| (),
        };
        let fit = problem.solve(&[10.0, -4.0]);
        assert!((fit.values[0] - 3.0).abs() < 1e-6 && fit.values[1].abs() < 1e-6, "{fit:?}");
    }

    /// The nearest point of a bounded plane: the free minimum (3, 0) is cut off by value 0 + value 1 ≤ 1, so that the
    /// best allowed one lies on the bound, where the cost of leaving the free minimum is least.
    #[test]
    fn stays_within_bounds_and_is_the_best_there() {
        let residuals = |values: &[f64]| vec![vec![values[0] - 3.0, 2.0 * values[1]]];
        let sensitivities = |_: &[f64]| vec![vec![vec![1.0, 0.0]], vec![vec![0.0, 2.0]]];
        let broken_bounds = |values: &[f64]| {
            let broken = values[0] + values[1] > 1.0 + 1e-9;
            broken.then(|| Bound { weights: vec![-1.0, -1.0], least: -1.0 }).into_iter().collect()
        };
        let problem = Problem {
            residuals: &residuals,
            sensitivities: &sensitivities,
            broken_bounds: &broken_bounds,
            acceptable: &|_| true,
            tolerance: 1e-12,
            progress: &|_| (),
        };
        let fit = problem.solve(&[0.0, 0.0]);
        // Lagrange: x − 3 = 4 y, x + y = 1.
        assert!((fit.values[0] - 1.4).abs() < 1e-5 && (fit.values[1] + 0.4).abs() < 1e-5, "{fit:?}");
    }
}

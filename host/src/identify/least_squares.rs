//! Levenberg–Marquardt on simulated residuals, and what the data say about the result.

use nalgebra::{DMatrix, DVector};

/// Residual series: each a stretch of samples in time order, so that their correlation in time can be estimated.
pub type Series = Vec<Vec<f64>>;

/// A nonlinear least-squares problem in which every evaluation is a simulation.
pub struct Problem<'a> {
    /// Residuals at parameter values; every call gives series of the same lengths. NaN where the model blows up.
    pub residuals: &'a (dyn Fn(&[f64]) -> Series + Sync),
    /// Derivatives of the residuals by each parameter at parameter values.
    pub sensitivities: &'a (dyn Fn(&[f64]) -> Vec<Series> + Sync),
    /// Whether values describe something that can exist; refused candidates count as infinitely bad.
    pub acceptable: &'a (dyn Fn(&[f64]) -> bool + Sync),
    /// Relative improvement below which a step is the last.
    pub tolerance: f64,
    /// Told after every iteration.
    pub progress: &'a (dyn Fn(f64) + Sync),
}

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
                let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                    damping *= 10.0;
                    continue;
                };
                let candidate: Vec<f64> =
                    values.iter().zip(step.iter()).zip(&scale).map(|((v, s), d)| v - s / d).collect();
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

    /// The covariance of the fitted values, from the sensitivities and from how the residuals scatter.
    ///
    /// Sandwich form A⁻¹ B A⁻¹ with A = JᵀJ and B the long-run covariance of Jᵀr (Newey & West 1987, Bartlett
    /// weights over `correlated_samples`). Residuals are correlated in time: innovations have less than their share
    /// of noise below the bandwidth of the state correction, where the sensitivities are, and a real robot's torque
    /// noise has more; σ²(JᵀJ)⁻¹ would be wrong either way. Directions that the data do not determine come out with
    /// a huge variance, not with an error.
    pub fn covariance(&self, values: &[f64], correlated_samples: usize) -> DMatrix<f64> {
        let sensitivities = (self.sensitivities)(values);
        let residuals = (self.residuals)(values);
        let count = values.len();
        let (bread, scale) = scaled_normal_matrix(&sensitivities);
        let eigen = bread.symmetric_eigen();
        let floor = eigen.eigenvalues.max() * 1e-14;
        let inverse = &eigen.eigenvectors
            * DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.max(floor)))
            * eigen.eigenvectors.transpose();

        let mut meat = DMatrix::<f64>::zeros(count, count);
        for (index, residual) in residuals.iter().enumerate() {
            let columns: Vec<&[f64]> = sensitivities.iter().map(|series| series[index].as_slice()).collect();
            let score = |k: usize| {
                DVector::from_iterator(count, columns.iter().zip(&scale).map(|(c, s)| c[k] * residual[k] / s))
            };
            // Bartlett's weighted lags are the mean of squared sums over all windows: one pass, no lag matrices.
            let window = correlated_samples.clamp(1, residual.len().max(1));
            let mut sum = DVector::<f64>::zeros(count);
            for k in 0..residual.len() + window {
                if k < residual.len() {
                    sum += score(k);
                }
                if k >= window {
                    sum -= score(k - window);
                }
                meat.ger(1.0 / window as f64, &sum, &sum, 1.0);
            }
        }
        let scaled = &inverse * meat * &inverse;
        DMatrix::from_fn(count, count, |i, j| scaled[(i, j)] / (scale[i] * scale[j]))
    }
}

fn inner(a: &Series, b: &Series) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>()).sum()
}

/// JᵀJ with a unit diagonal, and what each column of J was divided by: the parameters differ by orders of magnitude.
fn scaled_normal_matrix(sensitivities: &[Series]) -> (DMatrix<f64>, Vec<f64>) {
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
    use rand::{RngExt, SeedableRng};

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
            acceptable: &|_| true,
            tolerance: 1e-9,
            progress: &|_| (),
        };
        let fit = problem.solve(&[10.0, -4.0]);
        assert!((fit.values[0] - 3.0).abs() < 1e-6 && fit.values[1].abs() < 1e-6, "{fit:?}");
    }

    /// With white noise the sandwich must agree with σ²(JᵀJ)⁻¹; with noise correlated over ten samples it must see
    /// that the mean is known ten times less well in variance, where σ²(JᵀJ)⁻¹ would not.
    #[test]
    fn covariance_follows_the_noise_correlation() {
        let mut random = rand::rngs::StdRng::seed_from_u64(5);
        for (block, expected) in [(1, 1.0), (10, 10.0)] {
            let mut sum = 0.0;
            let trials = 40;
            for _ in 0..trials {
                let noise: Vec<f64> = (0..400)
                    .flat_map(|_| {
                        let level: f64 = random.random_range(-1.0..1.0);
                        std::iter::repeat_n(level, block)
                    })
                    .collect();
                let samples = noise.len() as f64;
                let residuals = |values: &[f64]| vec![noise.iter().map(|n| values[0] - n).collect()];
                let problem = Problem {
                    residuals: &residuals,
                    sensitivities: &|_| vec![vec![vec![1.0; noise.len()]]],
                    acceptable: &|_| true,
                    tolerance: 1e-9,
                    progress: &|_| (),
                };
                let fit = problem.solve(&[0.0]);
                sum += problem.covariance(&fit.values, 5 * block)[(0, 0)] * samples * 3.0;
            }
            let ratio = sum / f64::from(trials) / expected;
            assert!((0.8..1.2).contains(&ratio), "block {block}: {ratio}");
        }
    }
}

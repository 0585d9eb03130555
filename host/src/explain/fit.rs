//! Nonlinear refits: every evaluation a simulation, sixteen of them at once.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::linear::{Column, solve};
use super::rows::Rows;
use super::simulate::{Candidate, simulate};
use crate::identify::Experiment;

/// How damped the steps are that one iteration tries side by side.
const DAMPINGS: [f64; 8] = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e4];

/// Where a step changes nothing, one this much wider may: a plant that sets itself a limit (the least inertia that it leaves a
/// motor) would hold a parameter for good that came to lie beyond it.
const WIDER: f64 = 16.0;

/// What is common to all refits of an experiment.
pub struct Setting<'a> {
    /// The recordings.
    pub experiment: &'a Experiment<'a>,
    /// How they become rows.
    pub rows: &'a Rows,
    /// Standard deviation of the current measurement per joint in A; none where current says nothing of its own.
    pub current_sigma_a: Option<[f64; 2]>,
}

impl Setting<'_> {
    /// What every candidate leaves.
    pub fn residuals(&self, candidates: &[Candidate]) -> Vec<Column> {
        let left = simulate(self.experiment, candidates);
        left.par_iter()
            .map(|left| {
                let mut current = Vec::new();
                if let Some(sigma) = self.current_sigma_a {
                    for (segment, columns) in self.experiment.segments.iter().zip(&left.current) {
                        for joint in 0..self.experiment.robot.joints.len() {
                            let settled = self.experiment.settled(segment);
                            let command = segment.command_a[settled.clone()].iter().map(|pair| pair[joint]);
                            let rest = without_zero_and_gain(&columns[joint][settled], &command.collect::<Vec<f64>>());
                            current.extend(rest.into_iter().map(|x| x / sigma[joint]));
                        }
                    }
                }
                Column { motion: self.rows.of(&left.innovations), current }
            })
            .collect()
    }
}

/// `current` less what a zero and a gain of the sensor that are a little off would leave: nobody calibrates them well.
fn without_zero_and_gain(current: &[f64], command: &[f64]) -> Vec<f64> {
    let count = current.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
    let (zero, centre) = (mean(current), mean(command));
    let (mut both, mut square) = (0.0, 0.0);
    for (c, u) in current.iter().zip(command) {
        both += (c - zero) * (u - centre);
        square += (u - centre).powi(2);
    }
    let gain = if square > 0.0 { both / square } else { 0.0 };
    current.iter().zip(command).map(|(c, u)| c - zero - gain * (u - centre)).collect()
}

/// One parameter of a refit.
#[derive(Clone, Debug)]
pub struct Unknown {
    /// Step of the derivative, absolute.
    pub step: f64,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Centre and standard deviation of what is known about it beforehand.
    pub prior: Option<[f64; 2]>,
    /// Whether it may move.
    pub free: bool,
}

/// A refit about to be made.
pub struct Refit<'a> {
    /// What is common to all.
    pub setting: &'a Setting<'a>,
    /// Its parameters.
    pub unknowns: &'a [Unknown],
    /// The model at parameter values; none where they describe nothing that can exist.
    pub build: &'a (dyn Fn(&[f64]) -> Option<Candidate> + Sync),
    /// Weight of every row of the motion.
    pub weights: &'a [f64],
    /// Columns that are good enough as they are, by parameter.
    pub known_columns: &'a [Option<Column>],
    /// Iterations at most.
    pub iterations: usize,
}

/// Where a refit ended.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Parameter values.
    pub values: Vec<f64>,
    /// χ² of motion, current and priors.
    pub cost: f64,
    /// What is left.
    pub residual: Column,
    /// The derivatives where it ended, or nearly there.
    pub columns: Vec<Column>,
}

impl Refit<'_> {
    /// χ² of a residual and of the priors at `values`.
    pub fn cost(&self, values: &[f64], residual: &Column) -> f64 {
        let cost = residual.inner(residual, self.weights) + self.prior_cost(values);
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    fn prior_cost(&self, values: &[f64]) -> f64 {
        let each = values.iter().zip(self.unknowns);
        each.filter_map(|(value, unknown)| unknown.prior.map(|[centre, sigma]| ((value - centre) / sigma).powi(2)))
            .sum()
    }

    fn residuals(&self, points: &[Vec<f64>]) -> Vec<Option<Column>> {
        let built: Vec<Option<Candidate>> = points.iter().map(|point| (self.build)(point)).collect();
        let possible: Vec<Candidate> = built.iter().flatten().cloned().collect();
        let mut residuals = self.setting.residuals(&possible).into_iter();
        built.iter().map(|one| if one.is_some() { residuals.next() } else { None }).collect()
    }

    /// The derivatives at `values`, where the model leaves `residual`.
    pub fn columns(&self, values: &[f64], residual: &Column) -> Vec<Column> {
        let mut columns: Vec<Column> =
            (0..values.len()).map(|i| self.known_columns.get(i).cloned().flatten().unwrap_or_default()).collect();
        let mut wanted: Vec<usize> = (0..values.len())
            .filter(|&i| self.unknowns[i].free && self.known_columns.get(i).is_none_or(Option::is_none))
            .collect();
        for wider in [1.0, WIDER] {
            let stepped = |i: usize, step: f64| {
                let mut point = values.to_vec();
                point[i] += step;
                point
            };
            // A step that would leave the range, or what can exist, is taken the other way.
            let step = |&i: &usize| {
                let unknown = &self.unknowns[i];
                let step = wider * unknown.step;
                let point = stepped(i, step);
                let fits = (unknown.range[0]..=unknown.range[1]).contains(&point[i]) && (self.build)(&point).is_some();
                if fits { step } else { -step }
            };
            let steps: Vec<f64> = wanted.iter().map(step).collect();
            let points: Vec<Vec<f64>> = wanted.iter().zip(&steps).map(|(&i, &step)| stepped(i, step)).collect();
            for ((&i, &step), left) in wanted.iter().zip(&steps).zip(self.residuals(&points)) {
                if let Some(left) = left {
                    columns[i] = residual.difference(&left, step);
                }
            }
            wanted.retain(|&i| columns[i].is_nothing());
            if wanted.is_empty() {
                break;
            }
        }
        columns
    }

    /// Minimises χ² from `start`; none where the start itself describes nothing that can exist.
    pub fn solve(&self, start: &[f64]) -> Option<Solution> {
        let mut values = start.to_vec();
        let mut residual = self.residuals(std::slice::from_ref(&values)).pop()??;
        let mut cost = self.cost(&values, &residual);
        let mut columns = self.columns(&values, &residual);
        for iteration in 0..self.iterations {
            if iteration > 0 {
                columns = self.columns(&values, &residual);
            }
            let free: Vec<usize> =
                (0..values.len()).filter(|&i| self.unknowns[i].free && !columns[i].motion.is_empty()).collect();
            let (normal, right) = self.normal(&values, &residual, &columns, &free);
            let mut points: Vec<Vec<f64>> = Vec::new();
            for damping in DAMPINGS {
                let mut damped = normal.clone();
                for i in 0..free.len() {
                    damped[(i, i)] *= 1.0 + damping;
                }
                let step = solve(&damped, &right);
                let mut point = values.clone();
                for (&i, step) in free.iter().zip(step.iter()) {
                    let [low, high] = self.unknowns[i].range;
                    point[i] = (values[i] + step).clamp(low, high);
                }
                points.push(point);
            }
            let tried = self.residuals(&points);
            let best = points
                .into_iter()
                .zip(tried)
                .filter_map(|(point, residual)| {
                    residual.map(|residual| (self.cost(&point, &residual), point, residual))
                })
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((best, point, left)) = best else { break };
            if best >= cost {
                break;
            }
            let gained = cost - best;
            (values, residual, cost) = (point, left, best);
            if gained < 0.1 || gained < 1e-5 * cost {
                break;
            }
        }
        Some(Solution { values, cost, residual, columns })
    }

    fn normal(
        &self,
        values: &[f64],
        residual: &Column,
        columns: &[Column],
        free: &[usize],
    ) -> (DMatrix<f64>, DVector<f64>) {
        let count = free.len();
        let mut normal = DMatrix::zeros(count, count);
        let mut right = DVector::zeros(count);
        for (a, &i) in free.iter().enumerate() {
            for (b, &j) in free.iter().enumerate().skip(a) {
                let value = columns[i].inner(&columns[j], self.weights);
                normal[(a, b)] = value;
                normal[(b, a)] = value;
            }
            right[a] = columns[i].inner(residual, self.weights);
            if let Some([centre, sigma]) = self.unknowns[i].prior {
                normal[(a, a)] += 1.0 / (sigma * sigma);
                right[a] -= (values[i] - centre) / (sigma * sigma);
            }
        }
        (normal, right)
    }

    /// Covariance of the free parameters, in their order, from the columns and priors.
    pub fn covariance(&self, columns: &[Column]) -> (Vec<usize>, DMatrix<f64>) {
        let free: Vec<usize> =
            (0..columns.len()).filter(|&i| self.unknowns[i].free && !columns[i].motion.is_empty()).collect();
        let zero = Column { motion: Vec::new(), current: Vec::new() };
        let (normal, _) = self.normal(&vec![0.0; columns.len()], &zero, columns, &free);
        let scale: Vec<f64> = (0..free.len()).map(|i| normal[(i, i)].max(f64::MIN_POSITIVE).sqrt()).collect();
        let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| normal[(i, j)] / (scale[i] * scale[j]));
        let eigen = scaled.symmetric_eigen();
        let inverse = &eigen.eigenvectors
            * DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| 1.0 / value.max(1e-12)))
            * eigen.eigenvectors.transpose();
        let covariance = DMatrix::from_fn(free.len(), free.len(), |i, j| inverse[(i, j)] / (scale[i] * scale[j]));
        (free, covariance)
    }
}

//! CMA-ES, the evolution strategy that adapts its covariance matrix (Hansen, "The CMA evolution strategy: a tutorial",
//! 2016), with its default settings, restarted with twice the population where it has converged (Auger and Hansen,
//! 2005).

use nalgebra::{DMatrix, DVector};
use rand_core::Rng;

use super::problem::Problem;
use super::random::{normal, uniform};

/// How a search begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Where, in the unit box; anywhere if none is given, and at every restart.
    pub start: Option<Vec<f64>>,
    /// First step, as a share of the box.
    pub first_step: f64,
    /// Candidates in a generation of the first run; as the tutorial has it by default.
    pub offspring: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { start: None, first_step: 0.3, offspring: None }
    }
}

/// Step as a share of the box at which a run counts as converged.
const LAST_STEP: f64 = 1e-7;
/// Least progress of the best of a generation, as a share of it, over [`patience`] generations.
const LEAST_PROGRESS: f64 = 1e-6;

/// Spends the budget.
pub fn run(problem: &mut Problem, settings: &Settings, random: &mut impl Rng) {
    let mut offspring = settings.offspring.unwrap_or(4 + (3.0 * (problem.dimensions as f64).ln()) as usize);
    let mut start = settings.start.clone().map(DVector::from_vec);
    while !problem.is_over() {
        let from = start.take().unwrap_or_else(|| DVector::from_fn(problem.dimensions, |_, _| uniform(random)));
        descend(problem, from, settings.first_step, offspring, random);
        offspring *= 2;
    }
}

/// Generations over which there must be progress.
fn patience(dimensions: usize, offspring: usize) -> usize {
    10 + 30 * dimensions / offspring
}

fn descend(problem: &mut Problem, start: DVector<f64>, first_step: f64, offspring: usize, random: &mut impl Rng) {
    let n = start.len();
    let dimensions = n as f64;
    let parents = offspring / 2;
    let raw: Vec<f64> = (1..=parents).map(|rank| ((parents as f64 + 0.5) / rank as f64).ln()).collect();
    let weights: Vec<f64> = raw.iter().map(|weight| weight / raw.iter().sum::<f64>()).collect();
    let effective = 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>();
    let step_rate = (effective + 2.0) / (dimensions + effective + 5.0);
    let step_damping = 1.0 + step_rate + 2.0 * (((effective - 1.0) / (dimensions + 1.0)).sqrt() - 1.0).max(0.0);
    let path_rate = (4.0 + effective / dimensions) / (dimensions + 4.0 + 2.0 * effective / dimensions);
    let rank_one = 2.0 / ((dimensions + 1.3).powi(2) + effective);
    let rank_many =
        (1.0 - rank_one).min(2.0 * (effective - 2.0 + 1.0 / effective) / ((dimensions + 2.0).powi(2) + effective));
    let normal_length = dimensions.sqrt() * (1.0 - 1.0 / (4.0 * dimensions) + 1.0 / (21.0 * dimensions * dimensions));

    let mut mean = start;
    let mut step = first_step;
    let mut covariance = DMatrix::<f64>::identity(n, n);
    let (mut step_path, mut path) = (DVector::<f64>::zeros(n), DVector::<f64>::zeros(n));
    let mut bests: Vec<f64> = Vec::new();
    let mut stage = problem.stage();
    while !problem.is_over() {
        if problem.stage() != stage {
            // Another objective: what is known of the place and the shape is kept, the bests are not comparable.
            stage = problem.stage();
            bests.clear();
        }
        let eigen = covariance.clone().symmetric_eigen();
        let axes = eigen.eigenvalues.map(|value| value.max(1e-20).sqrt());
        let root = &eigen.eigenvectors * DMatrix::from_diagonal(&axes);
        let steps: Vec<DVector<f64>> =
            (0..offspring).map(|_| &root * DVector::from_fn(n, |_, _| normal(random))).collect();
        let candidates: Vec<Vec<f64>> = steps.iter().map(|y| (&mean + y * step).iter().copied().collect()).collect();
        let objectives: Vec<f64> = problem
            .judge(&candidates)
            .into_iter()
            .zip(&candidates)
            // Outside the box a candidate is judged on its edge, and the worse the further out.
            .map(|(objective, genes)| {
                let outside: f64 = genes.iter().map(|gene| (gene - gene.clamp(0.0, 1.0)).powi(2)).sum();
                objective * (1.0 + outside)
            })
            .collect();
        let mut order: Vec<usize> = (0..offspring).collect();
        order.sort_by(|&a, &b| objectives[a].total_cmp(&objectives[b]));

        let mut shift = DVector::<f64>::zeros(n);
        for (&index, weight) in order.iter().zip(&weights) {
            shift += &steps[index] * *weight;
        }
        mean += &shift * step;
        let whitened = &eigen.eigenvectors
            * DMatrix::from_diagonal(&axes.map(|axis| 1.0 / axis))
            * eigen.eigenvectors.transpose()
            * &shift;
        step_path = step_path * (1.0 - step_rate) + whitened * (step_rate * (2.0 - step_rate) * effective).sqrt();
        let expected = (1.0 - (1.0 - step_rate).powi(2 * (bests.len() as i32 + 1))).sqrt();
        let short = step_path.norm() / expected < (1.4 + 2.0 / (dimensions + 1.0)) * normal_length;
        let pull = if short { (path_rate * (2.0 - path_rate) * effective).sqrt() } else { 0.0 };
        path = path * (1.0 - path_rate) + &shift * pull;
        let lost = if short { 0.0 } else { rank_one * path_rate * (2.0 - path_rate) };
        covariance *= 1.0 - rank_one - rank_many + lost;
        covariance += &path * path.transpose() * rank_one;
        for (&index, weight) in order.iter().zip(&weights) {
            covariance += &steps[index] * steps[index].transpose() * (rank_many * weight);
        }
        step *= (step_rate / step_damping * (step_path.norm() / normal_length - 1.0)).min(1.0).exp();

        bests.push(objectives[order[0]]);
        let patience = patience(n, offspring);
        let stalled = bests.len() > patience && {
            let recent = &bests[bests.len() - patience..];
            let least = recent.iter().copied().fold(f64::INFINITY, f64::min);
            let most = recent.iter().copied().fold(0.0, f64::max);
            most - least <= LEAST_PROGRESS * least
        };
        if stalled || !step.is_finite() || step * axes.max() < LAST_STEP {
            return;
        }
    }
}

//! Covariance matrix adaptation evolution strategy (N. Hansen, "The CMA evolution strategy: a tutorial", 2016): draws
//! candidates from a normal distribution and shapes it after the better half. Needs no derivative, and does not care
//! that a criterion has kinks where another parameter becomes the worst.

use nalgebra::{DMatrix, DVector};

use crate::random::Random;

/// The strategy between two generations.
pub struct Evolution {
    mean: DVector<f64>,
    step: f64,
    covariance: DMatrix<f64>,
    /// Eigenvectors of the covariance times the roots of its eigenvalues, and those roots inverted.
    axes: DMatrix<f64>,
    lengths: DVector<f64>,
    step_path: DVector<f64>,
    covariance_path: DVector<f64>,
    generation: i32,
    weights: Vec<f64>,
    offspring: usize,
    drawn: Vec<DVector<f64>>,
    random: Random,
}

impl Evolution {
    /// A strategy about `mean` with standard deviation `step` in every direction. `offspring` candidates a
    /// generation, at least 4.
    pub fn new(mean: &[f64], step: f64, offspring: usize, random: Random) -> Self {
        let size = mean.len();
        let parents = offspring / 2;
        let raw: Vec<f64> = (1..=parents).map(|rank| (parents as f64 + 0.5).ln() - (rank as f64).ln()).collect();
        let sum: f64 = raw.iter().sum();
        Self {
            mean: DVector::from_column_slice(mean),
            step,
            covariance: DMatrix::identity(size, size),
            axes: DMatrix::identity(size, size),
            lengths: DVector::from_element(size, 1.0),
            step_path: DVector::zeros(size),
            covariance_path: DVector::zeros(size),
            generation: 0,
            weights: raw.into_iter().map(|weight| weight / sum).collect(),
            offspring,
            drawn: Vec::new(),
            random,
        }
    }

    /// The next generation's candidates.
    pub fn ask(&mut self) -> Vec<Vec<f64>> {
        let size = self.mean.len();
        self.drawn.clear();
        for _ in 0..self.offspring {
            let normal = DVector::from_fn(size, |_, _| self.random.normal());
            self.drawn.push(&self.axes * self.lengths.component_mul(&normal));
        }
        self.drawn.iter().map(|direction| (&self.mean + direction * self.step).as_slice().to_vec()).collect()
    }

    /// How good the candidates of [`Evolution::ask`] were, in their order; smaller is better, not a number is worst.
    pub fn tell(&mut self, costs: &[f64]) {
        let size = self.mean.len() as f64;
        let mut order: Vec<usize> = (0..self.drawn.len()).collect();
        let rank = |index: &usize| if costs[*index].is_nan() { f64::INFINITY } else { costs[*index] };
        order.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
        let best: Vec<&DVector<f64>> = order.iter().take(self.weights.len()).map(|&index| &self.drawn[index]).collect();

        // Learning rates of the tutorial, its table 1, without the negative weights.
        let effective = 1.0 / self.weights.iter().map(|weight| weight * weight).sum::<f64>();
        let step_rate = (effective + 2.0) / (size + effective + 5.0);
        let damping = 1.0 + step_rate + 2.0 * (((effective - 1.0) / (size + 1.0)).sqrt() - 1.0).max(0.0);
        let path_rate = (4.0 + effective / size) / (size + 4.0 + 2.0 * effective / size);
        let rank_one_rate = 2.0 / ((size + 1.3).powi(2) + effective);
        let rank_mu_rate = (1.0 - rank_one_rate)
            .min(2.0 * (effective - 2.0 + 1.0 / effective) / ((size + 2.0).powi(2) + effective))
            .max(0.0);
        let expected_length = size.sqrt() * (1.0 - 1.0 / (4.0 * size) + 1.0 / (21.0 * size * size));

        let mut moved = DVector::zeros(self.mean.len());
        for (direction, weight) in best.iter().zip(&self.weights) {
            moved += *direction * *weight;
        }
        self.mean += &moved * self.step;
        let whitened = &self.axes * (self.axes.tr_mul(&moved)).component_div(&self.lengths);
        self.step_path =
            &self.step_path * (1.0 - step_rate) + whitened * (step_rate * (2.0 - step_rate) * effective).sqrt();
        self.generation += 1;
        let path_length = self.step_path.norm();
        let remembered = (1.0 - (1.0 - step_rate).powi(2 * self.generation)).sqrt();
        let keeps = path_length / remembered < (1.4 + 2.0 / (size + 1.0)) * expected_length;
        let kept = if keeps { 1.0 } else { 0.0 };
        self.covariance_path = &self.covariance_path * (1.0 - path_rate)
            + &moved * (kept * (path_rate * (2.0 - path_rate) * effective).sqrt());
        let lost = (1.0 - kept) * rank_one_rate * path_rate * (2.0 - path_rate);
        self.covariance *= 1.0 - rank_one_rate - rank_mu_rate + lost;
        self.covariance.ger(rank_one_rate, &self.covariance_path, &self.covariance_path, 1.0);
        for (direction, weight) in best.iter().zip(&self.weights) {
            self.covariance.ger(rank_mu_rate * weight, direction, direction, 1.0);
        }
        self.step *= ((step_rate / damping) * (path_length / expected_length - 1.0)).exp();
        let eigen = self.covariance.clone().symmetric_eigen();
        self.axes = eigen.eigenvectors;
        // Rounding may leave the smallest just below zero.
        self.lengths = eigen.eigenvalues.map(|value| value.max(1e-20).sqrt());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A narrow curved valley in eight dimensions, whose minimum is 0 at (1, …, 1).
    fn rosenbrock(x: &[f64]) -> f64 {
        x.windows(2).map(|pair| 100.0 * (pair[1] - pair[0] * pair[0]).powi(2) + (1.0 - pair[0]).powi(2)).sum()
    }

    #[test]
    fn finds_the_end_of_a_curved_valley() {
        let mut evolution = Evolution::new(&[0.0; 8], 0.5, 12, Random::new(3, 9));
        let mut best = f64::INFINITY;
        for _ in 0..700 {
            let costs: Vec<f64> = evolution.ask().iter().map(|x| rosenbrock(x)).collect();
            best = costs.iter().copied().fold(best, f64::min);
            evolution.tell(&costs);
        }
        assert!(best < 1e-9, "{best}");
    }
}

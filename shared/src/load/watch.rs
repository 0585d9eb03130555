//! The test of every row for a change of load.

use super::bundle::{MODEL_UNKNOWNS, NOISE_COUNTS, NUISANCES, Shown, UNKNOWNS};
use super::quadratic::Quadratic;

/// Share of the change test's memory that a row leaves: it looks some 60 ms back.
const MEMORY: f32 = 1.0 - 1.0 / 86.0;
/// Rows before the change test begins: its replicas have forgotten their start.
const FROM_ROWS: u32 = 60;
/// The change test is made every so many rows.
const EVERY_ROWS: u32 = 8;
/// Standard errors that a change must have.
const ERRORS: f64 = 6.0;
/// Least change that is one, as a share of the largest mass.
const LEAST: f32 = 0.05;

/// The change test: the mass that the last rows would have beside the one found, fitted with a memory that fades, against
/// what the uncertainty of everything else lets it be.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    rows: u32,
    noise_ratio: f32,
    /// Σ s², Σ s·innovation, Σ s·(sensitivity of every unknown), s being the sensitivity to mass; all fading.
    squares: f32,
    products: f32,
    crossed: [f32; UNKNOWNS],
}

impl Watch {
    /// Of no rows; rows leave `noise_ratio` times what noise of the encoder alone would, or less than that.
    pub const fn new(noise_ratio: f32) -> Self {
        let noise_ratio = noise_ratio.max(1.0);
        Self { rows: 0, noise_ratio, squares: 0.0, products: 0.0, crossed: [0.0; UNKNOWNS] }
    }

    /// Forgets all rows.
    pub fn restart(&mut self) {
        *self = Self::new(self.noise_ratio);
    }

    /// Whether there are no rows.
    pub fn is_new(&self) -> bool {
        self.rows == 0
    }

    /// Whether the test is to be made now.
    pub fn is_due(&self) -> bool {
        self.rows >= FROM_ROWS && self.rows.is_multiple_of(EVERY_ROWS)
    }

    /// Takes in what a row shows; `direction` is how the load's numbers move with its mass.
    pub fn add(&mut self, shown: &Shown, direction: &[f32; UNKNOWNS - NUISANCES]) {
        self.rows = self.rows.saturating_add(1);
        self.squares *= MEMORY;
        self.products *= MEMORY;
        for sum in &mut self.crossed {
            *sum *= MEMORY;
        }
        for (innovation, sensitivity) in shown.innovation_counts.iter().zip(&shown.sensitivity) {
            let load = sensitivity.iter().skip(NUISANCES).zip(direction);
            let mass: f32 = load.map(|(sensitivity, direction)| sensitivity * direction).sum();
            self.squares += mass * mass;
            self.products += mass * innovation;
            for (sum, other) in self.crossed.iter_mut().zip(sensitivity) {
                *sum += mass * other;
            }
        }
    }

    /// The change of mass in kg, if it is one, of an arm that may carry `maximum_kg`.
    pub fn change_kg(&self, quadratic: &Quadratic, gradient: &[[f64; 4]; 4], maximum_kg: f32) -> Option<f32> {
        let change = self.products / self.squares;
        if !change.is_finite() || change.abs() < LEAST * maximum_kg {
            return None;
        }
        let mut weights = self.crossed.map(|sum| sum / self.squares);
        // The state at the start is not that of the rows collected.
        let (_, state_and_load) = weights.split_at_mut(MODEL_UNKNOWNS);
        let (state, load) = state_and_load.split_at_mut(NUISANCES - MODEL_UNKNOWNS);
        let of_state: f32 = state.iter().map(|weight| weight * weight).sum();
        state.fill(0.0);
        let linear: [f32; 4] = [load[0], load[1], load[2], load[3]];
        for (column, weight) in load.iter_mut().enumerate() {
            *weight = linear.iter().zip(gradient).map(|(weight, row)| weight * row[column] as f32).sum();
        }
        let of_noise = NOISE_COUNTS * NOISE_COUNTS / self.squares;
        let scale = f64::from(self.noise_ratio * self.noise_ratio);
        let variance = scale * (quadratic.variance(&weights) + f64::from(of_state + of_noise));
        let change = f64::from(change);
        (change * change > ERRORS * ERRORS * variance).then_some(change as f32)
    }
}

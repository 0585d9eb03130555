//! What an empty arm has shown of the model's errors: with it a load is found by its difference from the empty arm.

use super::bundle::{MODEL_UNKNOWNS, NUISANCES};
use super::quadratic::Quadratic;

const ELEMENTS: usize = MODEL_UNKNOWNS * (MODEL_UNKNOWNS + 1) / 2;

/// What the rows of an empty arm say counts only so much: another movement, with a load, shows errors of the model that they
/// do not, and the standard errors of what is found then have to hold.
const BELIEVED: f64 = 0.5;

/// Where f1..f9 and friction are, and how well that is known: a normal distribution of all of them together.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The inverse of their covariance in the standard errors they had before, its upper triangle by rows.
    information: [f64; ELEMENTS],
    /// Where they are, in those standard errors from the model.
    at: [f32; MODEL_UNKNOWNS],
}

impl Learned {
    /// How well it is known, from a form of the rows of an empty arm whose states are eliminated; where it is, is still to
    /// be told.
    #[inline(never)]
    pub fn new(quadratic: &Quadratic) -> Self {
        let weight = quadratic.prior_weight();
        let mut information = [0.0; ELEMENTS];
        let mut next = information.iter_mut();
        for row in 0..MODEL_UNKNOWNS {
            for (column, element) in (row..MODEL_UNKNOWNS).zip(&mut next) {
                let before = if row == column { 1.0 } else { 0.0 };
                *element = before + BELIEVED * (quadratic.element(row, column) / weight - before);
            }
        }
        Self { information, at: [0.0; MODEL_UNKNOWNS] }
    }

    /// Where it is.
    pub fn is_at(&mut self, nuisances: &[f32; NUISANCES]) {
        for (at, nuisance) in self.at.iter_mut().zip(nuisances) {
            *at = *nuisance;
        }
    }

    /// Where the nuisances are: those of the state at a first row are not known.
    pub fn nuisances(&self) -> [f32; NUISANCES] {
        core::array::from_fn(|unknown| self.at.get(unknown).copied().unwrap_or(0.0))
    }

    /// Adds what is known to a form whose nuisances are at `assumed`.
    #[inline(never)]
    pub fn add_to(&self, quadratic: &mut Quadratic, assumed: &[f32; NUISANCES], weight: f64) {
        let mut elements = self.information.iter();
        for row in 0..MODEL_UNKNOWNS {
            for (column, &element) in (row..MODEL_UNKNOWNS).zip(&mut elements) {
                quadratic.add_prior(
                    row,
                    column,
                    weight * element,
                    [row, column].map(|unknown| f64::from(self.at[unknown] - assumed[unknown])),
                );
            }
        }
    }
}

//! Random draws of a case.

use crate::simulator::noise::{Purpose, RandomStream};

/// A stream of draws.
#[derive(Clone, Debug)]
pub struct Draw(RandomStream);

impl Draw {
    /// The stream of one case: `seed` is the benchmark's, `case` the case's number.
    #[must_use]
    pub fn of_case(seed: u64, case: u64) -> Self {
        // An odd constant spreads neighbouring cases over all bits; the generator mixes the rest.
        Self(RandomStream::new(seed.rotate_left(32) ^ case.wrapping_mul(0xD134_2543_DE82_EF95), Purpose::Robot))
    }

    /// Uniform between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.uniform()
    }

    /// Uniform in the logarithm.
    pub fn logarithmic(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.0.uniform() < 0.5 { -1.0 } else { 1.0 }
    }

    /// A phase in rad.
    pub fn phase(&mut self) -> f64 {
        self.between(0.0, std::f64::consts::TAU)
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.0.uniform() < probability
    }

    /// Standard normal.
    pub fn gaussian(&mut self) -> f64 {
        self.0.gaussian()
    }

    /// An index below `count`.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.0.uniform() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// A seed for a run.
    pub fn seed(&mut self) -> u64 {
        (self.0.uniform() * (1_u64 << 53) as f64) as u64
    }
}

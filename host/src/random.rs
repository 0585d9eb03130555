//! Random numbers for simulated robots: the same seed gives the same numbers on every machine.

use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

/// A source of random numbers.
#[derive(Clone, Debug)]
pub struct Random(Pcg64Mcg);

impl Random {
    /// A source for `seed`. `purpose` keeps sources of one seed apart.
    pub fn new(seed: u64, purpose: u64) -> Self {
        // An odd multiplier spreads the purposes over the seeds, so that neighbours share nothing.
        Self(Pcg64Mcg::seed_from_u64(seed.wrapping_add(purpose.wrapping_mul(0x9E37_79B9_7F4A_7C15))))
    }

    /// A number in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number in `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A normally distributed number of standard deviation 1 (Box–Muller).
    pub fn normal(&mut self) -> f64 {
        // 1 − u is never 0, whose logarithm does not exist.
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_distributed_as_they_should_be() {
        let mut random = Random::new(1, 0);
        let count = 100_000;
        let (mut sum, mut square, mut uniform) = (0.0, 0.0, 0.0);
        for _ in 0..count {
            let value = random.normal();
            sum += value;
            square += value * value;
            uniform += random.between(2.0, 4.0);
        }
        let count = f64::from(count);
        assert!((sum / count).abs() < 0.015);
        assert!((square / count - 1.0).abs() < 0.02);
        assert!((uniform / count - 3.0).abs() < 0.01);
    }

    #[test]
    fn seeds_and_purposes_differ_and_repeat() {
        let first = |seed, purpose| Random::new(seed, purpose).unit();
        assert_eq!(first(7, 1), first(7, 1));
        assert_ne!(first(7, 1), first(7, 2));
        assert_ne!(first(7, 1), first(8, 1));
    }
}

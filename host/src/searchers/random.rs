//! Random numbers for the searchers, of any source.

use rand_core::Rng;

/// Uniform in [0, 1).
pub fn uniform(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform in `0..limit`.
pub fn below(limit: usize, random: &mut impl Rng) -> usize {
    ((u64::from(random.next_u32()) * limit as u64) >> 32) as usize
}

/// Standard normal (Box and Muller).
pub fn normal(random: &mut impl Rng) -> f64 {
    let radius = (-2.0 * (1.0 - uniform(random)).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(random)).cos()
}

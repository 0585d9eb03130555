//! Objectives, statistics, and other things that several of these tests need.

use proptest::prelude::*;
use rand_core::SeedableRng as _;
use rand_pcg::Pcg32;
use shared::genetic::{Coding, Genetic, Range, Settings, Subpopulation};

pub const INDIVIDUALS: usize = 20;
pub const SUBPOPULATIONS: usize = 4;
pub type Paper<const GENES: usize> = Genetic<GENES, INDIVIDUALS, SUBPOPULATIONS, Pcg32>;

pub fn random(seed: u64) -> Pcg32 {
    Pcg32::seed_from_u64(seed)
}

pub fn paper<const GENES: usize>(settings: Settings, half_width: f64, seed: u64) -> Paper<GENES> {
    Genetic::new(settings, [Range { low: -half_width, high: half_width }; GENES], random(seed)).unwrap()
}

/// Makes an objective of one candidate into one of a batch.
pub fn each<const GENES: usize>(objective: impl Fn(&[f64; GENES]) -> f64) -> impl Fn(&[[f64; GENES]], &mut [f64]) {
    move |candidates, objectives| {
        for (candidate, value) in candidates.iter().zip(objectives) {
            *value = objective(candidate);
        }
    }
}

pub fn sphere<const GENES: usize>(genes: &[f64; GENES]) -> f64 {
    genes.iter().map(|x| x * x).sum()
}

pub fn rastrigin<const GENES: usize>(genes: &[f64; GENES]) -> f64 {
    genes.iter().map(|x| x * x + 10.0 * (1.0 - (core::f64::consts::TAU * x).cos())).sum()
}

#[track_caller]
pub fn assert_binomial(count: usize, trials: usize, probability: f64) {
    let (mean, variance) = (trials as f64 * probability, trials as f64 * probability * (1.0 - probability));
    assert!((count as f64 - mean).abs() <= 5.0 * variance.sqrt(), "{count} of {trials}, expected {mean:.1}");
}

#[track_caller]
pub fn assert_uniform(counts: &[usize]) {
    let mean = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
    assert!(mean >= 20.0, "too few for chi-square");
    let chi_square: f64 = counts.iter().map(|&count| (count as f64 - mean).powi(2) / mean).sum();
    // Wilson and Hilferty's approximation of the quantile 1 - 1e-6, which is 4.75 standard deviations of a normal.
    let spread = 2.0 / (9.0 * (counts.len() - 1) as f64);
    let limit = (counts.len() - 1) as f64 * (1.0 - spread + 4.75 * spread.sqrt()).powi(3);
    assert!(chi_square < limit, "chi-square {chi_square:.1} over {limit:.1}: {counts:?}");
}

/// The string of bits a chromosome stands for, most significant bit of each gene first.
pub fn bits(chromosome: &[u32], bits_per_gene: u32) -> Vec<u32> {
    chromosome.iter().flat_map(|gene| (0..bits_per_gene).rev().map(move |bit| gene >> bit & 1)).collect()
}

pub fn chromosome<const GENES: usize>(bits_per_gene: u32, random: &mut Pcg32) -> [u32; GENES] {
    Subpopulation::<GENES, 1>::random(bits_per_gene, random).chromosomes()[0]
}

pub fn coding() -> impl Strategy<Value = Coding> {
    prop_oneof![Just(Coding::Binary), Just(Coding::Gray)]
}

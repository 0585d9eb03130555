//! The operators, each on its own so that each can be tested for the statistics it must have.
//!
//! A chromosome is one string of `GENES * bits_per_gene` bits: gene 0 first, the most significant bit of a gene first.

use rand_core::Rng;

use super::coding::highest_level;

/// Uniform in [0, 1), in steps of 2^-32: exact in `f64`, hence the same on every platform.
fn uniform(random: &mut impl Rng) -> f64 {
    f64::from(random.next_u32()) / 4_294_967_296.0
}

/// Uniform in `0..limit`; no value is favoured by more than `limit` / 2^32.
fn below(limit: usize, random: &mut impl Rng) -> usize {
    ((u64::from(random.next_u32()) * limit as u64) >> 32) as usize
}

/// Puts the items in a uniformly random order (Fisher and Yates).
pub fn shuffle<T>(items: &mut [T], random: &mut impl Rng) {
    for last in (1..items.len()).rev() {
        items.swap(last, below(last + 1, random));
    }
}

/// Fitness by rank: how many offspring an individual may expect, relative to the mean of 1.
///
/// `2 - SP + 2 (SP - 1) (position - 1) / (N - 1)`, the worst individual having position 1, the best position N
/// (Baker 1985; Sheffield toolbox `ranking`). Equal objectives share the mean of their positions, so that the order in
/// which ties happen to be stored breeds nothing.
///
/// `objectives` must be sorted, best (smallest) first, without NaN; `selective_pressure` is 1 to 2. The sum is N.
pub fn linear_ranking<const N: usize>(objectives: &[f64; N], selective_pressure: f64) -> [f64; N] {
    let mut fitness = [0.0; N];
    let mut first = 0;
    for tied in objectives.chunk_by(|a, b| a == b) {
        let after = first + tied.len();
        let mean_worse = ((N - 1 - first) + (N - after)) as f64 / 2.0;
        fitness[first..after]
            .fill(2.0 - selective_pressure + 2.0 * (selective_pressure - 1.0) * mean_worse / (N - 1) as f64);
        first = after;
    }
    fitness
}

/// Chooses `selected.len()` parents, writing their indices in ascending order.
///
/// One random number places equally spaced pointers on the fitnesses laid end to end, so an individual that expects
/// `e = selected.len() fitness / sum` copies gets floor(e) or ceil(e) of them (Baker 1987, stochastic universal
/// sampling). Fitnesses must not be negative and their sum must be positive.
pub fn stochastic_universal_sampling(fitness: &[f64], selected: &mut [usize], random: &mut impl Rng) {
    let spacing = fitness.iter().sum::<f64>() / selected.len() as f64;
    let offset = uniform(random);
    let mut individual = 0;
    let mut reach = fitness[0];
    for (pointer, selected) in selected.iter_mut().enumerate() {
        // Ends: the last pointer is short of the sum by 2^-32 of the spacing, far more than rounding.
        while (pointer as f64 + offset) * spacing >= reach {
            individual += 1;
            reach += fitness[individual];
        }
        *selected = individual;
    }
}

/// With the given probability (0 to 1) exchanges everything behind a point of the two bit strings.
///
/// The point is uniform over the places between two bits, inside genes as well as between them, so at least one bit is
/// kept and one exchanged (Holland 1975; Sheffield toolbox `xovsp`). At every bit position the pair keeps its two bits.
pub fn single_point_crossover<const GENES: usize>(
    first: &mut [u32; GENES],
    second: &mut [u32; GENES],
    bits_per_gene: u32,
    probability: f64,
    random: &mut impl Rng,
) {
    let places = GENES * bits_per_gene as usize - 1;
    if places == 0 || uniform(random) >= probability {
        return;
    }
    let point = 1 + below(places, random);
    let (gene, kept) = (point / bits_per_gene as usize, point as u32 % bits_per_gene);
    let exchanged = (first[gene] ^ second[gene]) & highest_level(bits_per_gene - kept);
    first[gene] ^= exchanged;
    second[gene] ^= exchanged;
    first[gene + 1..].swap_with_slice(&mut second[gene + 1..]);
}

/// Flips every bit independently with the given probability (0 to 1; Sheffield toolbox `mut`).
pub fn mutate<const GENES: usize>(
    chromosome: &mut [u32; GENES],
    bits_per_gene: u32,
    probability: f64,
    random: &mut impl Rng,
) {
    // As `uniform(random) < probability`, both sides times 2^32, which is exact.
    let flips_below = probability * 4_294_967_296.0;
    for gene in chromosome {
        for bit in 0..bits_per_gene {
            *gene ^= u32::from(f64::from(random.next_u32()) < flips_below) << bit;
        }
    }
}

/// Individuals that breed among themselves, always sorted: the best, with the smallest objective, first.
#[derive(Debug, Clone)]
pub struct Subpopulation<const GENES: usize, const INDIVIDUALS: usize> {
    pub(super) chromosomes: [[u32; GENES]; INDIVIDUALS],
    objectives: [f64; INDIVIDUALS],
}

impl<const GENES: usize, const INDIVIDUALS: usize> Subpopulation<GENES, INDIVIDUALS> {
    /// Uniformly random chromosomes, not evaluated yet: their objectives are infinite.
    pub fn random(bits_per_gene: u32, random: &mut impl Rng) -> Self {
        let mut gene = || random.next_u32() >> (u32::BITS - bits_per_gene);
        Self {
            chromosomes: core::array::from_fn(|_| core::array::from_fn(|_| gene())),
            objectives: [f64::INFINITY; INDIVIDUALS],
        }
    }

    /// The chromosomes, best first.
    pub fn chromosomes(&self) -> &[[u32; GENES]; INDIVIDUALS] {
        &self.chromosomes
    }

    /// The objectives of the chromosomes, ascending. Infinite means not evaluated, or evaluated to no number.
    pub fn objectives(&self) -> &[f64; INDIVIDUALS] {
        &self.objectives
    }

    /// Elitist reinsertion: the offspring take the places of the worst individuals, whatever their own objectives, and
    /// the `INDIVIDUALS - offspring.len()` best individuals survive (Sheffield toolbox `reins`, fitness-based).
    ///
    /// An objective that is NaN or infinite, either way, counts as positive infinity and therefore ranks last.
    ///
    /// # Panics
    /// With more offspring than individuals, or another number of objectives than of offspring.
    pub fn reinsert(&mut self, offspring: &[[u32; GENES]], objectives: &[f64]) {
        let survivors = INDIVIDUALS - offspring.len();
        self.chromosomes[survivors..].copy_from_slice(offspring);
        self.objectives[survivors..].copy_from_slice(objectives);
        for objective in &mut self.objectives[survivors..] {
            if !objective.is_finite() {
                *objective = f64::INFINITY;
            }
        }
        self.sort();
    }

    /// Restores the order by insertion, which keeps equals in place: an unstable sort may order them differently in
    /// another version of the standard library, and with them the whole run.
    fn sort(&mut self) {
        for sorted in 1..INDIVIDUALS {
            let objective = self.objectives[sorted];
            let place = self.objectives[..sorted].partition_point(|&better| better <= objective);
            self.objectives[place..=sorted].rotate_right(1);
            self.chromosomes[place..=sorted].rotate_right(1);
        }
    }
}

/// Complete-net migration: in every subpopulation `migrants` individuals are replaced by copies from the others.
///
/// Every subpopulation offers its `migrants` best. Each then receives that many, drawn uniformly without repetition
/// from what all the *other* subpopulations offer, in place of its worst (Sheffield toolbox `migrate`, fitness-based,
/// net structure; the toolbox overwrites whoever is stored first). A single subpopulation stays as it is.
///
/// # Panics
/// If `migrants` is more than half of `INDIVIDUALS`: the worst would be among those that leave.
pub fn migrate<const GENES: usize, const INDIVIDUALS: usize>(
    subpopulations: &mut [Subpopulation<GENES, INDIVIDUALS>],
    migrants: usize,
    random: &mut impl Rng,
) {
    assert!(2 * migrants <= INDIVIDUALS, "{migrants} migrants are more than half of {INDIVIDUALS} individuals");
    let others = subpopulations.len() - 1;
    if others == 0 {
        return;
    }
    // Offered are the first of every subpopulation, overwritten the last, and sorting waits until all have received:
    // nobody receives what has only just arrived.
    for receiver in 0..=others {
        let mut place = INDIVIDUALS - migrants;
        let mut offered = others * migrants;
        for donor in (0..=others).filter(|&donor| donor != receiver) {
            for migrant in 0..migrants {
                // Selection sampling (Knuth, algorithm 3.4.2 S): each is taken with the probability that leaves every
                // subset equally likely, without a list of the offered.
                if below(offered, random) < INDIVIDUALS - place {
                    subpopulations[receiver].chromosomes[place] = subpopulations[donor].chromosomes[migrant];
                    subpopulations[receiver].objectives[place] = subpopulations[donor].objectives[migrant];
                    place += 1;
                }
                offered -= 1;
            }
        }
    }
    subpopulations.iter_mut().for_each(Subpopulation::sort);
}

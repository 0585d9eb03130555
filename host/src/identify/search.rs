//! The genetic algorithm on the paper's objective.

use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use shared::genetic::{Genetic, Range, Settings};

use super::IdentifyError;
use super::experiment::Experiment;
use super::parameters::{Parameter, Values};

/// Individuals in a subpopulation and subpopulations, as the paper has them.
const INDIVIDUALS: usize = 20;
const SUBPOPULATIONS: usize = 4;

/// One generation's outcome.
#[derive(Clone, Debug, PartialEq)]
pub struct Generation {
    /// Best objective so far over all subpopulations, counts².
    pub best_counts2: f64,
    /// Best objective of each subpopulation, counts².
    pub subpopulations_counts2: [f64; SUBPOPULATIONS],
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct Found {
    /// The best candidate.
    pub values: Values,
    /// Its objective in counts².
    pub objective_counts2: f64,
    /// Simulations spent.
    pub evaluations: usize,
    /// The course of the search, the initial population first.
    pub generations: Vec<Generation>,
}

/// Where to search.
pub struct SearchBox<'a> {
    /// The parameters sought; everything else stays as in `known`.
    pub free: &'a [Parameter],
    /// Lowest and highest value of each.
    pub ranges: &'a [[f64; 2]],
    /// The values of everything else.
    pub known: &'a Values,
    /// A known good candidate, put into the first population.
    pub start: Option<&'a [f64]>,
    /// The algorithm's settings: the paper's by default.
    pub settings: Settings,
}

/// Minimises the paper's Y over `place` with the paper's genetic algorithm. The same seed gives the same result.
pub fn search(
    experiment: &Experiment,
    place: &SearchBox,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Found, IdentifyError> {
    // The chromosome's length is part of the type; these are the numbers of parameters a robot can have.
    match place.free.len() {
        0..=4 => search_sized::<4>(experiment, place, seed, progress),
        5..=9 => search_sized::<9>(experiment, place, seed, progress),
        10..=13 => search_sized::<13>(experiment, place, seed, progress),
        // With the torque offsets.
        _ => search_sized::<15>(experiment, place, seed, progress),
    }
}

fn search_sized<const GENES: usize>(
    experiment: &Experiment,
    place: &SearchBox,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Found, IdentifyError> {
    // Genes beyond the parameters change nothing.
    let mut ranges = [Range { low: 0.0, high: 1.0 }; GENES];
    for (range, &[low, high]) in ranges.iter_mut().zip(place.ranges) {
        *range = Range { low, high };
    }
    let used = place.free.len();
    let mut judge = Judge::new(experiment);
    let mut objective = |candidates: &[[f64; GENES]], objectives: &mut [f64]| {
        let values: Vec<Values> = candidates.iter().map(|genes| place.known.with(place.free, &genes[..used])).collect();
        objectives.copy_from_slice(&judge.objectives_counts2(&values));
    };
    let random = Pcg64Mcg::seed_from_u64(seed);
    let mut genetic = Genetic::<GENES, INDIVIDUALS, SUBPOPULATIONS, _>::new(place.settings, ranges, random)?;
    if let Some(start) = place.start {
        let mut genes = [0.0; GENES];
        genes[..used].copy_from_slice(start);
        genetic.seed_individual(0, 0, genes)?;
    }
    let mut generations = Vec::new();
    genetic.run(&mut objective, |state| {
        let best_counts2 = state.best().1;
        generations
            .push(Generation { best_counts2, subpopulations_counts2: std::array::from_fn(|s| state.best_of(s).1) });
        progress(best_counts2);
    });
    let (genes, objective_counts2) = genetic.best();
    Ok(Found {
        values: place.known.with(place.free, &genes[..used]),
        objective_counts2,
        evaluations: genetic.evaluations() as usize,
        generations,
    })
}

/// How much better than the best so far a candidate may really be than it looks in single precision, as a share of the
/// objective: twice what the two precisions differ by at most.
const DOUBT: f64 = 2e-4;

/// Judges the candidates of one search: fast, and exactly where it decides.
///
/// Single precision orders the population. Whatever might be the best so far is judged again in double precision, so
/// that the best of every generation and the result carry their true objective.
pub struct Judge<'a> {
    experiment: &'a Experiment<'a>,
    best_counts2: f64,
}

impl<'a> Judge<'a> {
    /// Before the first candidate.
    pub fn new(experiment: &'a Experiment<'a>) -> Self {
        Self { experiment, best_counts2: f64::INFINITY }
    }

    /// The objective of each candidate, in order; infinite for one that no arm could have.
    pub fn objectives_counts2(&mut self, candidates: &[Values]) -> Vec<f64> {
        let experiment = self.experiment;
        let possible: Vec<usize> =
            (0..candidates.len()).filter(|&index| acceptable(experiment, &candidates[index])).collect();
        let plants: Vec<_> = possible.iter().map(|&index| candidates[index].plant(experiment.robot)).collect();
        let mut judged = experiment.search_objectives_counts2(&plants);
        // Copies of a candidate are common in a population that converges: one of each is judged again.
        let least = judged.iter().copied().fold(self.best_counts2, f64::min);
        let mut leading: Vec<usize> =
            (0..plants.len()).filter(|&index| judged[index] <= least * (1.0 + DOUBT)).collect();
        leading.sort_by(|&a, &b| judged[a].total_cmp(&judged[b]));
        let distinct: Vec<Vec<usize>> =
            leading.chunk_by(|&a, &b| plants[a] == plants[b]).map(<[usize]>::to_vec).collect();
        let representatives: Vec<_> = distinct.iter().map(|same| plants[same[0]]).collect();
        for (same, objective) in distinct.iter().zip(experiment.objectives_counts2(&representatives)) {
            for &index in same {
                judged[index] = objective;
            }
            self.best_counts2 = self.best_counts2.min(objective);
        }
        let mut objectives = vec![f64::INFINITY; candidates.len()];
        for (index, value) in possible.into_iter().zip(judged) {
            objectives[index] = value;
        }
        objectives
    }
}

/// Whether an arm could have these values: a positive definite inertia matrix and no negative friction.
pub fn acceptable(experiment: &Experiment, values: &Values) -> bool {
    let inertia = match experiment.robot.kind {
        crate::robot::Kind::TwoLink => values.arm(experiment.robot).check_inertia().is_ok(),
        crate::robot::Kind::SingleAxis => values.f[6].is_finite() && values.f[6] > 0.0,
    };
    inertia && values.coulomb_nm.iter().chain(&values.viscous_nm_s_per_rad).all(|&friction| friction >= 0.0)
}

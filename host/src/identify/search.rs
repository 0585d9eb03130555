//! The genetic algorithm on the paper's objective.

use std::collections::HashMap;

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
    let values_of = |genes: &[f64; GENES]| place.known.with(place.free, &genes[..used]);
    let mut judge = Judge::new(experiment);
    let mut objective = |candidates: &[[f64; GENES]], objectives: &mut [f64]| {
        let values: Vec<Values> = candidates.iter().map(values_of).collect();
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
    let mut leaders = Vec::new();
    genetic.run(&mut objective, |state| {
        let (genes, best_counts2) = state.best();
        leaders.push(values_of(&genes));
        generations
            .push(Generation { best_counts2, subpopulations_counts2: std::array::from_fn(|s| state.best_of(s).1) });
        progress(best_counts2);
    });
    judge.judge_exactly(leaders.iter().copied());
    for (generation, leader) in generations.iter_mut().zip(&leaders) {
        generation.best_counts2 = judge.exact_counts2(leader).unwrap_or(generation.best_counts2);
    }
    // What was the best of its generation in single precision may be worse in double precision than one before it.
    for k in 1..generations.len() {
        generations[k].best_counts2 = generations[k].best_counts2.min(generations[k - 1].best_counts2);
    }
    let (values, objective_counts2) = judge.best().unwrap_or((values_of(&genetic.best().0), f64::INFINITY));
    if let Some(last) = generations.last_mut() {
        last.best_counts2 = objective_counts2;
    }
    Ok(Found { values, objective_counts2, evaluations: genetic.evaluations() as usize, generations })
}

/// How much better than the best a candidate may really be than it looks in single precision, as a share of the
/// objective: twice what the two precisions differ by at most.
const DOUBT: f64 = 2e-4;

/// Judges the candidates of one search: fast while it runs, and exactly what may become its result.
///
/// Single precision orders the population. Everything that it finds within 2e-4 of the best is kept, and in the end
/// judged again in double precision. What came before, as copies that selection makes do, is not simulated again.
pub struct Judge<'a> {
    experiment: &'a Experiment<'a>,
    fast_counts2: HashMap<Key, f64>,
    exact_counts2: HashMap<Key, f64>,
    leading: Vec<(Values, f64)>,
    least_counts2: f64,
}

/// The bits of a candidate's numbers.
type Key = Vec<u64>;

fn key(values: &Values) -> Key {
    let Values { f, viscous_nm_s_per_rad, coulomb_nm, torque_offset_nm, gain, upper_arm_m } = values;
    let pairs = [viscous_nm_s_per_rad, coulomb_nm, torque_offset_nm, gain];
    f.iter().chain(pairs.into_iter().flatten()).chain(upper_arm_m).map(|number| number.to_bits()).collect()
}

impl<'a> Judge<'a> {
    /// Before the first candidate.
    pub fn new(experiment: &'a Experiment<'a>) -> Self {
        Self {
            experiment,
            fast_counts2: HashMap::new(),
            exact_counts2: HashMap::new(),
            leading: Vec::new(),
            least_counts2: f64::INFINITY,
        }
    }

    /// The objective of each candidate, in order, within a relative 1e-4; infinite for one that no arm could
    /// have.
    pub fn objectives_counts2(&mut self, candidates: &[Values]) -> Vec<f64> {
        let experiment = self.experiment;
        let keys: Vec<Key> = candidates.iter().map(key).collect();
        let mut new: Vec<usize> = Vec::new();
        for (index, candidate) in candidates.iter().enumerate() {
            if !self.fast_counts2.contains_key(&keys[index]) {
                // A copy within the call, or what no arm could have, is not simulated.
                self.fast_counts2.insert(keys[index].clone(), f64::INFINITY);
                if acceptable(experiment, candidate) {
                    new.push(index);
                }
            }
        }
        let plants: Vec<_> = new.iter().map(|&index| candidates[index].plant(experiment.robot)).collect();
        for (&index, objective) in new.iter().zip(experiment.search_objectives_counts2(&plants)) {
            self.fast_counts2.insert(keys[index].clone(), objective);
            if objective <= self.least_counts2 * (1.0 + DOUBT) {
                self.leading.push((candidates[index], objective));
                self.least_counts2 = self.least_counts2.min(objective);
            }
        }
        keys.iter().map(|key| self.fast_counts2[key]).collect()
    }

    /// The best candidate so far and its objective, both by double precision; the first of several equal ones. None
    /// before any was judged to a finite objective.
    pub fn best(&mut self) -> Option<(Values, f64)> {
        let limit = self.least_counts2 * (1.0 + DOUBT);
        self.leading.retain(|&(_, objective)| objective <= limit);
        let leading: Vec<Values> = self.leading.iter().map(|&(values, _)| values).collect();
        self.judge_exactly(leading.iter().copied());
        let judged = leading.into_iter().filter_map(|values| Some((values, self.exact_counts2(&values)?)));
        judged.filter(|(_, objective)| objective.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Judges candidates in double precision, those not judged so before.
    fn judge_exactly(&mut self, candidates: impl Iterator<Item = Values>) {
        let mut new: Vec<(Key, Values)> = Vec::new();
        for values in candidates {
            let key = key(&values);
            if !self.exact_counts2.contains_key(&key) && new.iter().all(|(other, _)| *other != key) {
                new.push((key, values));
            }
        }
        let plants: Vec<_> = new.iter().map(|(_, values)| values.plant(self.experiment.robot)).collect();
        let judged = self.experiment.objectives_counts2(&plants);
        self.exact_counts2.extend(new.into_iter().map(|(key, _)| key).zip(judged));
    }

    fn exact_counts2(&self, values: &Values) -> Option<f64> {
        self.exact_counts2.get(&key(values)).copied()
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

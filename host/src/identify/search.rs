//! Searches for the least of the paper's objective: by its genetic algorithm, and by an evolution strategy.

use std::collections::HashMap;

use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use shared::genetic::{Genetic, Range, Settings};

use super::IdentifyError;
use super::experiment::Experiment;
use super::parameters::{Parameter, Values};
use crate::searchers::{Problem, evolution_strategy};

/// Individuals in a subpopulation and subpopulations, as the paper has them.
const INDIVIDUALS: usize = 20;
const SUBPOPULATIONS: usize = 4;

/// One generation's outcome.
#[derive(Clone, Debug, PartialEq)]
pub struct Generation {
    /// Best objective so far, counts².
    pub best_counts2: f64,
    /// Candidates judged so far.
    pub evaluations: usize,
    /// Best objective so far of each subpopulation as the search judged it, within a relative 1e-4, counts²; empty for a
    /// search without subpopulations.
    pub subpopulation_counts2: Vec<f64>,
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
    /// The searcher and its settings.
    pub searcher: Searcher,
}

/// Who searches.
#[derive(Clone, Debug, PartialEq)]
pub enum Searcher {
    /// The genetic algorithm.
    Genetic(Settings),
    /// CMA-ES within a number of candidates.
    EvolutionStrategy {
        /// How it begins; its start is the box's own.
        settings: evolution_strategy::Settings,
        /// How many candidates it may judge.
        budget: usize,
    },
}

/// Minimises the paper's Y over `place`. The same seed gives the same result, on however many threads.
pub fn search(
    experiment: &Experiment,
    place: &SearchBox,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Found, IdentifyError> {
    let experiment = &*experiment.led(place.known);
    let settings = match &place.searcher {
        Searcher::Genetic(settings) => *settings,
        Searcher::EvolutionStrategy { settings, budget } => {
            return Ok(evolve(experiment, place, settings, *budget, seed, progress));
        }
    };
    // The chromosome's length is part of the type; these are the numbers of parameters a robot can have.
    match place.free.len() {
        0..=4 => search_sized::<4>(experiment, place, settings, seed, progress),
        5..=9 => search_sized::<9>(experiment, place, settings, seed, progress),
        10..=13 => search_sized::<13>(experiment, place, settings, seed, progress),
        // With the torque offsets.
        _ => search_sized::<15>(experiment, place, settings, seed, progress),
    }
}

fn search_sized<const GENES: usize>(
    experiment: &Experiment,
    place: &SearchBox,
    settings: Settings,
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
    let mut genetic = Genetic::<GENES, INDIVIDUALS, SUBPOPULATIONS, _>::new(settings, ranges, random)?;
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
        generations.push(Generation {
            best_counts2,
            evaluations: state.evaluations() as usize,
            subpopulation_counts2: (0..SUBPOPULATIONS).map(|index| state.best_of(index).1).collect(),
        });
        progress(best_counts2);
    });
    let fallback = values_of(&genetic.best().0);
    Ok(conclude(judge, leaders, generations, fallback, genetic.evaluations() as usize))
}

/// CMA-ES in the box of `place`.
fn evolve(
    experiment: &Experiment,
    place: &SearchBox,
    settings: &evolution_strategy::Settings,
    budget: usize,
    seed: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Found {
    let values_of = |unit: &[f64]| {
        let genes: Vec<f64> =
            unit.iter().zip(place.ranges).map(|(share, [low, high])| low + share * (high - low)).collect();
        place.known.with(place.free, &genes)
    };
    let unit_of = |genes: &[f64]| -> Vec<f64> {
        genes.iter().zip(place.ranges).map(|(gene, [low, high])| (gene - low) / (high - low)).collect()
    };
    let settings = evolution_strategy::Settings { start: place.start.map(unit_of), ..settings.clone() };
    let mut judge = Judge::new(experiment);
    let (mut leaders, mut generations): (Vec<Values>, Vec<Generation>) = (Vec::new(), Vec::new());
    let (mut evaluations, mut best) = (0, f64::INFINITY);
    let mut judge_all = |_: usize, _: usize, candidates: &[Vec<f64>]| {
        let mut values: Vec<Values> = candidates.iter().map(|unit| values_of(unit)).collect();
        // What the search starts from is a candidate too.
        if generations.is_empty() {
            values.extend(place.start.map(|start| place.known.with(place.free, start)));
        }
        let mut objectives = judge.objectives_counts2(&values);
        evaluations += values.len();
        let leader = (0..values.len()).min_by(|&a, &b| objectives[a].total_cmp(&objectives[b])).unwrap_or(0);
        if objectives[leader] < best || leaders.is_empty() {
            best = objectives[leader];
            leaders.push(values[leader]);
        } else {
            leaders.push(leaders[leaders.len() - 1]);
        }
        generations.push(Generation { best_counts2: best, evaluations, subpopulation_counts2: Vec::new() });
        progress(best);
        objectives.truncate(candidates.len());
        objectives
    };
    let mut problem = Problem::new(place.free.len(), budget, 1, &mut judge_all);
    evolution_strategy::run(&mut problem, &settings, &mut Pcg64Mcg::seed_from_u64(seed));
    let fallback = leaders.last().copied().unwrap_or(*place.known);
    conclude(judge, leaders, generations, fallback, evaluations)
}

/// The outcome of a search whose best candidate was `leaders[k]` after generation k; `fallback` stands where none was
/// judged to a finite objective.
fn conclude(
    mut judge: Judge,
    leaders: Vec<Values>,
    mut generations: Vec<Generation>,
    fallback: Values,
    evaluations: usize,
) -> Found {
    judge.judge_exactly(leaders.iter().copied());
    for (generation, leader) in generations.iter_mut().zip(&leaders) {
        generation.best_counts2 = judge.exact_counts2(leader).unwrap_or(generation.best_counts2);
    }
    // What was the best of its generation in single precision may be worse in double precision than one before it.
    for k in 1..generations.len() {
        generations[k].best_counts2 = generations[k].best_counts2.min(generations[k - 1].best_counts2);
    }
    let (values, objective_counts2) = judge.best().unwrap_or((fallback, f64::INFINITY));
    if let Some(last) = generations.last_mut() {
        last.best_counts2 = objective_counts2;
    }
    Found { values, objective_counts2, evaluations, generations }
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
    /// Where in `fast_counts2` a candidate's objective is.
    places: HashMap<Key, usize>,
    fast_counts2: Vec<f64>,
    exact_counts2: HashMap<Key, f64>,
    leading: Vec<(Values, f64)>,
    least_counts2: f64,
}

/// The bits of a candidate's numbers.
type Key = Vec<u64>;

fn key(values: &Values) -> Key {
    let Values { f, viscous_nm_s_per_rad, coulomb_nm, torque_offset_nm, gain, lead, upper_arm_m } = values;
    let pairs = [viscous_nm_s_per_rad, coulomb_nm, torque_offset_nm, gain];
    f.iter()
        .chain(pairs.into_iter().flatten())
        .chain(lead.iter().flatten())
        .chain(upper_arm_m)
        .map(|number| number.to_bits())
        .collect()
}

impl<'a> Judge<'a> {
    /// Before the first candidate.
    pub fn new(experiment: &'a Experiment<'a>) -> Self {
        Self {
            experiment,
            places: HashMap::new(),
            fast_counts2: Vec::new(),
            exact_counts2: HashMap::new(),
            leading: Vec::new(),
            least_counts2: f64::INFINITY,
        }
    }

    /// The objective of each candidate, in order, within a relative 1e-4; infinite for one that no arm could
    /// have.
    pub fn objectives_counts2(&mut self, candidates: &[Values]) -> Vec<f64> {
        let experiment = self.experiment;
        let mut new: Vec<(usize, Values)> = Vec::new();
        let place_of = |candidate: &Values| {
            // A copy, within the call or from before, is not simulated, nor what no arm could have.
            let next = self.fast_counts2.len();
            let place = *self.places.entry(key(candidate)).or_insert(next);
            if place == next {
                self.fast_counts2.push(f64::INFINITY);
                if acceptable(experiment, candidate) {
                    new.push((place, *candidate));
                }
            }
            place
        };
        let places: Vec<usize> = candidates.iter().map(place_of).collect();
        let plants: Vec<_> = new.iter().map(|(_, values)| values.plant(experiment.robot)).collect();
        for ((place, values), objective) in new.into_iter().zip(experiment.search_objectives_counts2(&plants)) {
            self.fast_counts2[place] = objective;
            if objective <= self.least_counts2 * (1.0 + DOUBT) {
                self.leading.push((values, objective));
                self.least_counts2 = self.least_counts2.min(objective);
            }
        }
        places.into_iter().map(|place| self.fast_counts2[place]).collect()
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

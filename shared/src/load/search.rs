//! From the quadratic form of the rows to the load: the genetic algorithm on it, what it leaves open, and the physical gate.

#![expect(clippy::needless_range_loop, reason = "matrices are read by their indices")]

use rand_pcg::Pcg32;
use serde::{Deserialize, Serialize};

use super::bundle::{LOAD_UNKNOWNS, NUISANCES, linear_load};
use super::prior::{KNOWN, Prior, gradient, physical};
use super::quadratic::{Quadratic, Reduced};
use super::{LoadSettings, Rejected};
use crate::arm::Load;
use crate::genetic::{Genetic, Range, Settings};

/// Generations of one search. The best of the form without its limits is planted in the first.
const GENERATIONS: u32 = 16;
/// Individuals of a subpopulation, and subpopulations.
const INDIVIDUALS: usize = 8;
const SUBPOPULATIONS: usize = 2;

/// Standard errors by which the data must contradict a limit before a result is thrown away.
const CONTRADICTION: f64 = 4.0;
/// What a result may contradict a limit by in kg although it is certain: what is smaller nobody misses.
const SLACK_KG: f64 = 0.02;
/// Largest standard error of a mass that is used, as a share of the largest mass.
const LARGEST_ERROR: f64 = 0.25;
/// Largest ratio of what the rows show to noise; above, they are not of one arm with one load.
pub const LARGEST_NOISE_RATIO: f32 = 20.0;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadEstimate {
    /// Mass in kg.
    pub mass_kg: f32,
    /// Its standard error in kg, that of the model's parameters included.
    pub standard_error_kg: f32,
    /// Centre of mass in frame 3, m.
    pub centre_m: [f32; 2],
    /// Its standard errors; those of the prior where the data tell nothing.
    pub centre_standard_error_m: [f32; 2],
    /// Inertia about its own centre, kg m².
    pub inertia_kg_m2: f32,
    /// Its standard error; that of the prior where the data tell nothing.
    pub inertia_standard_error_kg_m2: f32,
    /// Root mean square of what the result leaves of the rows, over that of a noise of the encoder alone: 1 where the arm is
    /// as its model.
    pub noise_ratio: f32,
    /// Rows it was found from.
    pub rows: u16,
}

impl LoadEstimate {
    /// Nothing found.
    pub const NONE: Self = Self {
        mass_kg: 0.0,
        standard_error_kg: f32::INFINITY,
        centre_m: [0.0; 2],
        centre_standard_error_m: [0.0; 2],
        inertia_kg_m2: 0.0,
        inertia_standard_error_kg_m2: 0.0,
        noise_ratio: 0.0,
        rows: 0,
    };

    /// The load found.
    pub fn load(&self) -> Load<f32> {
        Load { mass_kg: self.mass_kg, centre_m: self.centre_m, inertia_kg_m2: self.inertia_kg_m2 }
    }
}

fn load_of(genes: &[f64; LOAD_UNKNOWNS]) -> Load<f32> {
    let [mass, x, y, inertia] = genes.map(|gene| gene as f32);
    Load { mass_kg: mass, centre_m: [x, y], inertia_kg_m2: inertia }
}

/// A search on the form that the rows gave about one load.
#[derive(Clone, Debug)]
pub struct Search {
    genetic: Genetic<LOAD_UNKNOWNS, INDIVIDUALS, SUBPOPULATIONS, Pcg32>,
    reduced: Reduced,
    prior: Prior,
    about: Load<f32>,
    /// Where the form is least if nothing is limited.
    unlimited: [f64; LOAD_UNKNOWNS],
    deviation: [f64; LOAD_UNKNOWNS],
}

impl Search {
    /// Prepares the search on a form whose nuisances are eliminated; `None` where something is not a number.
    pub fn new(quadratic: &Quadratic, settings: &LoadSettings, about: &Load<f32>, seed: u32) -> Option<Self> {
        let reduced = quadratic.reduced();
        let prior = Prior::new(settings).weighted(quadratic.prior_weight());
        let (unlimited, deviation) = solve(&reduced, &prior, about)?;
        let widest = |mean: f64, deviation: f64, low: f64, high: f64| {
            let low = (mean - 4.0 * deviation).max(low);
            Range { low, high: (mean + 4.0 * deviation).min(high).max(low + KNOWN) }
        };
        let reach = f64::from(settings.reach_m);
        let [_, x, y, inertia] = prior.mean;
        let ranges = [
            Range { low: 0.0, high: f64::from(settings.maximum_kg) },
            widest(x, prior.deviation[1], -reach, reach),
            widest(y, prior.deviation[2], -reach, reach),
            widest(inertia, prior.deviation[3], 0.0, f64::MAX),
        ];
        let settings = Settings { generations: GENERATIONS, ..Settings::default() };
        let mut genetic = Genetic::new(settings, ranges, Pcg32::new(u64::from(seed), 1)).ok()?;
        genetic.seed_individual(0, 0, unlimited).ok()?;
        Some(Self { genetic, reduced, prior, about: *about, unlimited, deviation })
    }

    /// One generation; true once all are done.
    #[inline(never)]
    pub fn step(&mut self) -> bool {
        let Self { genetic, reduced, prior, about, .. } = self;
        let from = linear_load(about);
        genetic.step(|candidates, objectives| {
            for (candidate, objective) in candidates.iter().zip(objectives) {
                *objective = objective_of(reduced, prior, &from, candidate);
            }
        });
        genetic.generation() >= GENERATIONS
    }

    /// The best load so far.
    #[inline(never)]
    pub fn best(&self) -> Load<f32> {
        load_of(&self.genetic.best().0)
    }

    /// How far the best load is from the one that the bundle ran with, in the standard errors of whichever of mass, centre
    /// and inertia moved most.
    #[inline(never)]
    pub fn moved_errors(&self) -> f64 {
        let each = physical(&self.best()).into_iter().zip(physical(&self.about)).zip(self.deviation);
        each.map(|((to, from), error)| libm::fabs(to - from) / error.max(KNOWN)).fold(0.0, f64::max)
    }

    /// By which share the best load and nuisances lower the sum of squares.
    pub fn gained_share(&self, quadratic: &Quadratic) -> f64 {
        let best = physical(&self.best());
        let from = linear_load(&self.about);
        let of = |candidate: &[f64; LOAD_UNKNOWNS]| objective_of(&self.reduced, &self.prior, &from, candidate);
        quadratic.gained_share() + (of(&physical(&self.about)) - of(&best)) / quadratic.squares().max(1.0)
    }

    /// Where the nuisances are best for the best load.
    pub fn nuisances(&self, quadratic: &Quadratic, assumed: &[f32; NUISANCES]) -> [f32; NUISANCES] {
        let (from, to) = (linear_load(&self.about), linear_load(&self.best()));
        quadratic.nuisances(assumed, &core::array::from_fn(|index| f64::from(to[index]) - f64::from(from[index])))
    }

    /// The result and whether it may be used: the physical gate. `quadratic` then answers for variances.
    pub fn finish(&self, quadratic: &mut Quadratic, settings: &LoadSettings) -> (LoadEstimate, Result<(), Rejected>) {
        let best = self.best();
        let noise_ratio = quadratic.noise_ratio();
        let rows = quadratic.rows() as u16;
        quadratic.finish(&gradient(&best), &self.prior);
        let scale = f64::from(noise_ratio.max(1.0));
        let (to, from) = (physical(&best), physical(&self.about));
        let error = |index: usize| {
            let known = if index == 0 { f64::MAX } else { self.prior.deviation[index] };
            // Nor is it known better than the last run still moved it.
            let moved = to[index] - from[index];
            let stated = scale * self.deviation[index];
            libm::sqrt(stated * stated + moved * moved).min(known)
        };
        let estimate = LoadEstimate {
            mass_kg: best.mass_kg,
            standard_error_kg: error(0) as f32,
            centre_m: best.centre_m,
            centre_standard_error_m: [error(1) as f32, error(2) as f32],
            inertia_kg_m2: best.inertia_kg_m2,
            inertia_standard_error_kg_m2: error(3) as f32,
            noise_ratio,
            rows,
        };
        (estimate, self.gate(&estimate, error(0), settings))
    }

    fn gate(&self, estimate: &LoadEstimate, error_kg: f64, settings: &LoadSettings) -> Result<(), Rejected> {
        let maximum = f64::from(settings.maximum_kg);
        let tolerance = CONTRADICTION * error_kg + SLACK_KG;
        let [x, y] = estimate.centre_m;
        let finite = [estimate.mass_kg, x, y, estimate.inertia_kg_m2].iter().all(|value| value.is_finite());
        if !finite || !error_kg.is_finite() {
            return Err(Rejected::NotFinite);
        }
        if estimate.noise_ratio > LARGEST_NOISE_RATIO {
            return Err(Rejected::Inconsistent);
        }
        if error_kg > LARGEST_ERROR * maximum {
            return Err(Rejected::Uncertain);
        }
        if self.unlimited[0] < -tolerance {
            return Err(Rejected::Negative);
        }
        if self.unlimited[0] > maximum + tolerance {
            return Err(Rejected::TooHeavy);
        }
        if x * x + y * y > settings.reach_m * settings.reach_m {
            return Err(Rejected::OutOfReach);
        }
        Ok(())
    }
}

/// The form at a candidate, less a constant.
fn objective_of(
    reduced: &Reduced,
    prior: &Prior,
    from: &[f32; LOAD_UNKNOWNS],
    candidate: &[f64; LOAD_UNKNOWNS],
) -> f64 {
    let [mass, x, y, inertia] = *candidate;
    let to = [mass, mass * x, mass * y, inertia + mass * (x * x + y * y)];
    let moved: [f64; LOAD_UNKNOWNS] = core::array::from_fn(|index| to[index] - f64::from(from[index]));
    let mut sum = 0.0;
    for row in 0..LOAD_UNKNOWNS {
        let mut product = -2.0 * reduced.vector[row];
        for column in 0..LOAD_UNKNOWNS {
            product += reduced.matrix[row][column] * moved[column];
        }
        sum += product * moved[row];
        let off = candidate[row] - prior.mean[row];
        sum += off * off * prior.information[row];
    }
    sum
}

/// Mass, centre and inertia where the form is least with nothing limited, and their standard deviations.
#[inline(never)]
fn solve(reduced: &Reduced, prior: &Prior, about: &Load<f32>) -> Option<([f64; LOAD_UNKNOWNS], [f64; LOAD_UNKNOWNS])> {
    const N: usize = LOAD_UNKNOWNS;
    let gradient = gradient(about);
    let start = physical(about);
    let mut half = [[0.0; N]; N];
    for row in 0..N {
        for column in 0..N {
            half[row][column] = (0..N).map(|inner| reduced.matrix[row][inner] * gradient[inner][column]).sum();
        }
    }
    // Augmented by the right side and the unit matrix, so that the inverse comes along.
    let mut rows = [[0.0; 2 * N + 1]; N];
    for row in 0..N {
        for column in 0..N {
            rows[row][column] = (0..N).map(|inner| gradient[inner][row] * half[inner][column]).sum();
            rows[row][N] += gradient[column][row] * reduced.vector[column];
        }
        rows[row][row] += prior.information[row];
        rows[row][N] += prior.information[row] * (prior.mean[row] - start[row]);
        rows[row][N + 1 + row] = 1.0;
    }
    for pivot in 0..N {
        let pivot_row = rows[pivot];
        let inverse = 1.0 / pivot_row[pivot];
        for (index, row) in rows.iter_mut().enumerate() {
            if index != pivot {
                let factor = row[pivot] * inverse;
                for (element, above) in row.iter_mut().zip(&pivot_row) {
                    *element -= factor * above;
                }
            }
        }
    }
    let best: [f64; N] = core::array::from_fn(|row| start[row] + rows[row][N] / rows[row][row]);
    let deviation: [f64; N] =
        core::array::from_fn(|row| libm::sqrt((rows[row][N + 1 + row] / rows[row][row]).max(0.0)));
    best.iter().chain(&deviation).all(|value| value.is_finite()).then_some((best, deviation))
}

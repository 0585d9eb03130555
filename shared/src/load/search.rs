//! From what the rows showed to the load: a quadratic form, the genetic algorithm on it, and what it leaves open.

#![expect(clippy::needless_range_loop, reason = "matrices are read by their indices")]

use rand_pcg::Pcg32;
use serde::{Deserialize, Serialize};

use super::bundle::{
    LOAD_UNKNOWNS, MODEL_UNKNOWNS, NOISE_COUNTS, NUISANCES, STATE_UNKNOWNS, Shown, UNKNOWNS, linear_load,
};
use super::learned::Learned;
use super::{LoadSettings, Rejected};
use crate::arm::Load;
use crate::genetic::{Genetic, Range, Settings};

/// Rows whose products are summed in single precision before they go into the sums in double precision, which a Cortex-M4
/// has to emulate.
const BLOCK_ROWS: u32 = 8;

/// Standard deviation that stands for "known": in kg, m or kg m². Small against every other, large against rounding.
const KNOWN: f64 = 1e-4;

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
pub(super) const LARGEST_NOISE_RATIO: f32 = 20.0;

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

/// Place of an element of the upper triangle.
const fn place(row: usize, column: usize) -> usize {
    row * UNKNOWNS - row * (row + 1) / 2 + column
}

const ELEMENTS: usize = UNKNOWNS * (UNKNOWNS + 1) / 2;

/// The sum of squares of the innovations as a function of all unknowns.
#[derive(Clone, Debug)]
pub struct Quadratic {
    matrix: [f64; ELEMENTS],
    vector: [f64; UNKNOWNS],
    block_matrix: [f32; ELEMENTS],
    block_vector: [f32; UNKNOWNS],
    block_rows: u32,
    squares: f64,
    rows: u32,
}

impl Quadratic {
    /// Of no rows.
    pub const fn new() -> Self {
        Self {
            matrix: [0.0; ELEMENTS],
            vector: [0.0; UNKNOWNS],
            block_matrix: [0.0; ELEMENTS],
            block_vector: [0.0; UNKNOWNS],
            block_rows: 0,
            squares: 0.0,
            rows: 0,
        }
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        *self = Self::new();
    }

    /// Adds what a row shows.
    #[inline(never)]
    pub fn add(&mut self, shown: &Shown) {
        let weight = 1.0 / (NOISE_COUNTS * NOISE_COUNTS);
        for (innovation, sensitivity) in shown.innovation_counts.iter().zip(&shown.sensitivity) {
            let mut elements = self.block_matrix.iter_mut();
            for (row, (&left, sum)) in sensitivity.iter().zip(&mut self.block_vector).enumerate() {
                let left = left * weight;
                *sum += left * innovation;
                let rights = sensitivity.get(row..).unwrap_or(&[]);
                for (right, sum) in rights.iter().zip(&mut elements) {
                    *sum += left * right;
                }
            }
            self.squares += f64::from(innovation * innovation * weight);
        }
        self.rows += 1;
        self.block_rows += 1;
        if self.block_rows == BLOCK_ROWS {
            self.flush();
        }
    }

    fn flush(&mut self) {
        for (sum, block) in self.matrix.iter_mut().zip(&mut self.block_matrix) {
            *sum += f64::from(core::mem::take(block));
        }
        for (sum, block) in self.vector.iter_mut().zip(&mut self.block_vector) {
            *sum += f64::from(core::mem::take(block));
        }
        self.block_rows = 0;
    }

    /// Root mean square of the innovations over that of the noise.
    pub fn noise_ratio(&self) -> f32 {
        let degrees = (2 * self.rows).saturating_sub((STATE_UNKNOWNS + LOAD_UNKNOWNS) as u32).max(1);
        libm::sqrtf((self.squares / f64::from(degrees)) as f32)
    }

    /// Gives every nuisance its standard normal prior, or what an empty arm has shown of it, `assumed` being where they are
    /// now, in standard errors. After the last row, before [`Self::eliminate`].
    #[inline(never)]
    pub fn expect(&mut self, assumed: &[f32; NUISANCES], learned: Option<&Learned>) {
        self.flush();
        let shown = if let Some(learned) = learned {
            learned.add_to(self, assumed);
            MODEL_UNKNOWNS
        } else {
            0
        };
        for (unknown, &assumed) in assumed.iter().enumerate().skip(shown) {
            self.add_prior(unknown, unknown, 1.0, [-f64::from(assumed); 2]);
        }
    }

    /// Adds an element of the inverse of a covariance to both of its places; `expected` are the means of its row's and of
    /// its column's unknown from where they are now.
    pub fn add_prior(&mut self, row: usize, column: usize, information: f64, expected: [f64; 2]) {
        self.matrix[place(row, column)] += information;
        self.vector[row] += information * expected[1];
        if row != column {
            self.vector[column] += information * expected[0];
        }
    }

    /// An element of the upper triangle.
    pub fn element(&self, row: usize, column: usize) -> f64 {
        self.matrix[place(row, column)]
    }

    /// Eliminates a nuisance from those before it; the load stays where it is.
    #[inline(never)]
    pub fn eliminate_backward(&mut self, pivot: usize) {
        let inverse = 1.0 / self.matrix[place(pivot, pivot)];
        for row in 0..pivot {
            let factor = self.matrix[place(row, pivot)] * inverse;
            for column in row..pivot {
                self.matrix[place(row, column)] -= factor * self.matrix[place(column, pivot)];
            }
            self.vector[row] -= factor * self.vector[pivot];
        }
    }

    /// Where the nuisances are best when the load stays; after all of them were eliminated backward.
    #[inline(never)]
    pub fn settled_nuisances(&self, assumed: &[f32; NUISANCES]) -> [f32; NUISANCES] {
        let mut solution = [0.0; NUISANCES];
        let mut best = *assumed;
        for unknown in 0..NUISANCES {
            let mut sum = self.vector[unknown];
            for earlier in 0..unknown {
                sum -= self.matrix[place(earlier, unknown)] * solution[earlier];
            }
            solution[unknown] = sum / self.matrix[place(unknown, unknown)];
            best[unknown] += solution[unknown] as f32;
        }
        best
    }

    /// Holds the load, which is `about`, and answers for variances then; after [`Self::expect`] and the elimination.
    pub fn hold(&mut self, about: &Load<f32>) {
        self.finish(&gradient(about), &Prior::known(about));
    }

    /// Eliminates one unknown from all after it. Apart from each other, because all at once take the board milliseconds.
    #[inline(never)]
    pub fn eliminate(&mut self, pivot: usize) {
        let inverse = 1.0 / self.matrix[place(pivot, pivot)];
        for row in pivot + 1..UNKNOWNS {
            let factor = self.matrix[place(pivot, row)] * inverse;
            if factor == 0.0 {
                continue;
            }
            for column in row..UNKNOWNS {
                self.matrix[place(row, column)] -= factor * self.matrix[place(pivot, column)];
            }
            self.vector[row] -= factor * self.vector[pivot];
        }
    }

    /// The form of the load alone, once all nuisances are eliminated.
    #[inline(never)]
    fn reduced(&self) -> Reduced {
        let mut reduced = Reduced { matrix: [[0.0; LOAD_UNKNOWNS]; LOAD_UNKNOWNS], vector: [0.0; LOAD_UNKNOWNS] };
        for row in 0..LOAD_UNKNOWNS {
            reduced.vector[row] = self.vector[NUISANCES + row];
            for column in 0..LOAD_UNKNOWNS {
                let (low, high) = (row.min(column), row.max(column));
                reduced.matrix[row][column] = self.matrix[place(NUISANCES + low, NUISANCES + high)];
            }
        }
        reduced
    }

    /// By which share the best nuisances lower the sum of squares while the load stays; after the elimination, forward or
    /// backward.
    #[inline(never)]
    pub fn gained_share(&self) -> f64 {
        let gained =
            |unknown: usize| self.vector[unknown] * self.vector[unknown] / self.matrix[place(unknown, unknown)];
        (0..NUISANCES).map(gained).sum::<f64>() / self.squares.max(1.0)
    }

    /// Where the nuisances are best when the load is moved by `moved`; after the elimination.
    #[inline(never)]
    fn nuisances(&self, assumed: &[f32; NUISANCES], moved: &[f64; LOAD_UNKNOWNS]) -> [f32; NUISANCES] {
        let mut solution = [0.0; UNKNOWNS];
        solution[NUISANCES..].copy_from_slice(moved);
        let mut best = *assumed;
        for unknown in (0..NUISANCES).rev() {
            let mut sum = self.vector[unknown];
            for later in unknown + 1..UNKNOWNS {
                sum -= self.matrix[place(unknown, later)] * solution[later];
            }
            solution[unknown] = sum / self.matrix[place(unknown, unknown)];
            best[unknown] += solution[unknown] as f32;
        }
        best
    }

    /// Turns the form into one of mass, centre and inertia with their priors, eliminated to the end, so that
    /// [`Self::variance`] can be asked; after the elimination.
    #[inline(never)]
    fn finish(&mut self, gradient: &[[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS], prior: &Prior) {
        let turned = |of: [f64; LOAD_UNKNOWNS]| -> [f64; LOAD_UNKNOWNS] {
            core::array::from_fn(|column| (0..LOAD_UNKNOWNS).map(|row| of[row] * gradient[row][column]).sum())
        };
        for row in 0..NUISANCES {
            let columns = core::array::from_fn(|column| self.matrix[place(row, NUISANCES + column)]);
            for (column, value) in turned(columns).into_iter().enumerate() {
                self.matrix[place(row, NUISANCES + column)] = value;
            }
        }
        let half: [[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS] = core::array::from_fn(|row| {
            turned(core::array::from_fn(|column| {
                self.matrix[place(NUISANCES + row.min(column), NUISANCES + row.max(column))]
            }))
        });
        for row in 0..LOAD_UNKNOWNS {
            for column in row..LOAD_UNKNOWNS {
                let sum = (0..LOAD_UNKNOWNS).map(|inner| gradient[inner][row] * half[inner][column]).sum::<f64>();
                let known = if row == column { prior.information[row] } else { 0.0 };
                self.matrix[place(NUISANCES + row, NUISANCES + column)] = sum + known;
            }
        }
        for pivot in NUISANCES..UNKNOWNS {
            self.eliminate(pivot);
        }
    }

    /// Variance of a sum of the unknowns with these weights; the load's are those of mass, centre and inertia. After
    /// [`Self::finish`].
    pub fn variance(&self, weights: &[f32; UNKNOWNS]) -> f64 {
        let mut left = weights.map(f64::from);
        let mut variance = 0.0;
        for unknown in 0..UNKNOWNS {
            let scaled = left[unknown] / self.matrix[place(unknown, unknown)];
            variance += left[unknown] * scaled;
            for later in unknown + 1..UNKNOWNS {
                left[later] -= scaled * self.matrix[place(unknown, later)];
            }
        }
        variance
    }
}

/// The form of the load alone, about the load assumed.
#[derive(Clone, Copy, Debug)]
struct Reduced {
    matrix: [[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS],
    vector: [f64; LOAD_UNKNOWNS],
}

/// Mass, centre and inertia as they are expected, and the inverse of their variances.
#[derive(Clone, Copy, Debug)]
struct Prior {
    mean: [f64; LOAD_UNKNOWNS],
    deviation: [f64; LOAD_UNKNOWNS],
    information: [f64; LOAD_UNKNOWNS],
}

impl Prior {
    /// Of a load that is known.
    fn known(load: &Load<f32>) -> Self {
        let deviation = [KNOWN; LOAD_UNKNOWNS];
        Self { mean: physical(load), deviation, information: deviation.map(|deviation| 1.0 / (deviation * deviation)) }
    }

    fn new(settings: &LoadSettings) -> Self {
        let centre = f64::from(settings.centre_standard_error_m).max(KNOWN);
        let inertia = f64::from(settings.inertia_standard_error_kg_m2).max(KNOWN);
        // Any mass is as likely as any other, so wide that it decides nothing.
        let deviation = [10.0 * f64::from(settings.maximum_kg), centre, centre, inertia];
        Self {
            mean: [
                0.5 * f64::from(settings.maximum_kg),
                f64::from(settings.centre_m[0]),
                f64::from(settings.centre_m[1]),
                f64::from(settings.inertia_kg_m2),
            ],
            deviation,
            information: deviation.map(|deviation| 1.0 / (deviation * deviation)),
        }
    }
}

fn physical(load: &Load<f32>) -> [f64; LOAD_UNKNOWNS] {
    [load.mass_kg, load.centre_m[0], load.centre_m[1], load.inertia_kg_m2].map(f64::from)
}

fn load_of(genes: &[f64; LOAD_UNKNOWNS]) -> Load<f32> {
    let [mass, x, y, inertia] = genes.map(|gene| gene as f32);
    Load { mass_kg: mass, centre_m: [x, y], inertia_kg_m2: inertia }
}

/// How [`linear_load`] moves with mass, centre and inertia: rows by the former, columns by the latter.
#[inline(never)]
pub(super) fn gradient(load: &Load<f32>) -> [[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS] {
    let [mass, x, y, _] = physical(load);
    [
        [1.0, 0.0, 0.0, 0.0],
        [x, mass, 0.0, 0.0],
        [y, 0.0, mass, 0.0],
        [x * x + y * y, 2.0 * mass * x, 2.0 * mass * y, 1.0],
    ]
}

/// A search on the form that the rows gave about one load.
#[derive(Clone, Debug)]
pub(super) struct Search {
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
    pub(super) fn new(quadratic: &Quadratic, settings: &LoadSettings, about: &Load<f32>, seed: u32) -> Option<Self> {
        let reduced = quadratic.reduced();
        let prior = Prior::new(settings);
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
    pub(super) fn step(&mut self) -> bool {
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
    pub(super) fn best(&self) -> Load<f32> {
        load_of(&self.genetic.best().0)
    }

    /// How far the best load is from the one that the bundle ran with, in the standard errors of whichever of mass, centre
    /// and inertia moved most.
    #[inline(never)]
    pub(super) fn moved_errors(&self) -> f64 {
        let each = physical(&self.best()).into_iter().zip(physical(&self.about)).zip(self.deviation);
        each.map(|((to, from), error)| libm::fabs(to - from) / error.max(KNOWN)).fold(0.0, f64::max)
    }

    /// By which share the best load and nuisances lower the sum of squares.
    pub(super) fn gained_share(&self, quadratic: &Quadratic) -> f64 {
        let best = physical(&self.best());
        let from = linear_load(&self.about);
        let of = |candidate: &[f64; LOAD_UNKNOWNS]| objective_of(&self.reduced, &self.prior, &from, candidate);
        quadratic.gained_share() + (of(&physical(&self.about)) - of(&best)) / quadratic.squares.max(1.0)
    }

    /// Where the nuisances are best for the best load.
    pub(super) fn nuisances(&self, quadratic: &Quadratic, assumed: &[f32; NUISANCES]) -> [f32; NUISANCES] {
        let (from, to) = (linear_load(&self.about), linear_load(&self.best()));
        quadratic.nuisances(assumed, &core::array::from_fn(|index| f64::from(to[index]) - f64::from(from[index])))
    }

    /// The result and whether it may be used: the physical gate. `quadratic` then answers for variances.
    pub(super) fn finish(
        &self,
        quadratic: &mut Quadratic,
        settings: &LoadSettings,
    ) -> (LoadEstimate, Result<(), Rejected>) {
        let best = self.best();
        let noise_ratio = quadratic.noise_ratio();
        let rows = quadratic.rows as u16;
        quadratic.finish(&gradient(&best), &self.prior);
        let scale = f64::from(noise_ratio.max(1.0));
        let error = |index: usize| {
            let known = self.prior.deviation[index];
            (scale * self.deviation[index]).min(if index == 0 { f64::MAX } else { known })
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
    // Augmented by the right side and the unit matrix, so that the inverse comes along.
    let mut rows = [[0.0; 2 * N + 1]; N];
    for row in 0..N {
        for column in 0..N {
            for inner in 0..N {
                for other in 0..N {
                    rows[row][column] += gradient[inner][row] * reduced.matrix[inner][other] * gradient[other][column];
                }
            }
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

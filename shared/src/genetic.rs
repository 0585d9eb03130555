//! The genetic algorithm of the paper, for any objective and any source of random numbers.
//!
//! Subpopulations of binary chromosomes evolve side by side (the "regional model" of the Sheffield toolbox and GEATbx):
//! fitness by linear ranking, stochastic universal sampling, single-point crossover, mutation, elitist reinsertion, and
//! now and then migration between all of them. The objective is minimised.
//!
//! Everything is stored in [`Genetic`], and nothing but the seed of the random numbers and the objective decides the
//! result: host and board agree bit for bit.
//!
//! ```
//! use rand_core::SeedableRng;
//! use shared::genetic::{Genetic, Range, Settings};
//!
//! let ranges = [Range { low: -1.0, high: 3.0 }; 2];
//! let random = rand_pcg::Pcg32::seed_from_u64(1);
//! let mut genetic = Genetic::<2, 20, 4, _>::new(Settings::default(), ranges, random)?;
//! genetic.run(
//!     |candidates, objectives| {
//!         for ([x, y], objective) in candidates.iter().zip(objectives) {
//!             *objective = (x - 1.0) * (x - 1.0) + y * y;
//!         }
//!     },
//!     |progress| assert!(progress.generation() <= progress.settings().generations),
//! );
//! let ([x, y], objective) = genetic.best();
//! assert!(objective < 0.01 && (x - 1.0).abs() < 0.1 && y.abs() < 0.1);
//! # Ok::<(), shared::genetic::Error>(())
//! ```

mod coding;
mod operators;
mod settings;

pub use coding::{Coding, Range};
pub use operators::{
    Subpopulation, linear_ranking, migrate, mutate, shuffle, single_point_crossover, stochastic_universal_sampling,
};
pub use settings::{Error, Settings};

use rand_core::Rng;

/// A run of the genetic algorithm, with all its storage: about `SUBPOPULATIONS * INDIVIDUALS * (16 * GENES + 16)`
/// bytes, 13 KB for the paper's 4 subpopulations of 20 individuals with 9 genes. On the board keep it in a static.
///
/// An objective is called as `objective(candidates, objectives)`: it writes the objective of `candidates[i]`, in the
/// order and units of the ranges, to `objectives[i]`. A generation is one call for all subpopulations, so that it can
/// fill SIMD lanes and threads. What it leaves unwritten, NaN or infinite ranks last and never wins.
#[derive(Debug, Clone)]
pub struct Genetic<const GENES: usize, const INDIVIDUALS: usize, const SUBPOPULATIONS: usize, R> {
    settings: Settings,
    ranges: [Range; GENES],
    random: R,
    subpopulations: [Subpopulation<GENES, INDIVIDUALS>; SUBPOPULATIONS],
    offspring: [[[u32; GENES]; INDIVIDUALS]; SUBPOPULATIONS],
    candidates: [[[f64; GENES]; INDIVIDUALS]; SUBPOPULATIONS],
    objectives: [[f64; INDIVIDUALS]; SUBPOPULATIONS],
    evaluated: bool,
    generation: u32,
    evaluations: u64,
}

impl<const GENES: usize, const INDIVIDUALS: usize, const SUBPOPULATIONS: usize, R: Rng>
    Genetic<GENES, INDIVIDUALS, SUBPOPULATIONS, R>
{
    /// A random population within the ranges, not evaluated yet.
    pub fn new(settings: Settings, ranges: [Range; GENES], mut random: R) -> Result<Self, Error> {
        const { assert!(GENES >= 1 && INDIVIDUALS >= 2 && SUBPOPULATIONS >= 1, "too few to breed") };
        settings.validate()?;
        settings::validate_ranges(&ranges)?;
        Ok(Self {
            subpopulations: core::array::from_fn(|_| Subpopulation::random(settings.bits_per_gene, &mut random)),
            settings,
            ranges,
            random,
            offspring: [[[0; GENES]; INDIVIDUALS]; SUBPOPULATIONS],
            candidates: [[[0.0; GENES]; INDIVIDUALS]; SUBPOPULATIONS],
            objectives: [[0.0; INDIVIDUALS]; SUBPOPULATIONS],
            evaluated: false,
            generation: 0,
            evaluations: 0,
        })
    }

    /// Puts a known start, clamped to the ranges and rounded to the resolution of the genes, in the place of an
    /// individual. The whole population is evaluated (again) before the next generation is bred.
    ///
    /// # Panics
    /// If there is no such subpopulation or individual.
    pub fn seed_individual(&mut self, subpopulation: usize, index: usize, genes: [f64; GENES]) -> Result<(), Error> {
        if let Some((gene, &value)) = genes.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(Error::Seed { gene, value });
        }
        let Settings { bits_per_gene, coding, .. } = self.settings;
        self.subpopulations[subpopulation].chromosomes[index] =
            core::array::from_fn(|gene| coding.encode(genes[gene], self.ranges[gene], bits_per_gene));
        self.evaluated = false;
        Ok(())
    }

    /// Evaluates every individual of the population, in one call: needed at the start, and again whenever the objective
    /// itself has changed.
    pub fn initialise(&mut self, objective: impl FnMut(&[[f64; GENES]], &mut [f64])) {
        for (everyone, subpopulation) in self.offspring.iter_mut().zip(&self.subpopulations) {
            *everyone = *subpopulation.chromosomes();
        }
        self.evaluate_and_reinsert(INDIVIDUALS, objective);
        self.evaluated = true;
    }

    /// Breeds, evaluates and reinserts one generation, after [`initialise`](Self::initialise) if that has not been
    /// done; then, every [`Settings::migration_interval`] generations, lets individuals migrate.
    pub fn step(&mut self, mut objective: impl FnMut(&[[f64; GENES]], &mut [f64])) {
        if !self.evaluated {
            self.initialise(&mut objective);
        }
        let count = self.settings.offspring(INDIVIDUALS);
        for subpopulation in 0..SUBPOPULATIONS {
            self.breed(subpopulation, count);
        }
        self.evaluate_and_reinsert(count, objective);
        self.generation += 1;
        if self.generation.is_multiple_of(self.settings.migration_interval) {
            migrate(&mut self.subpopulations, self.settings.migrants(INDIVIDUALS), &mut self.random);
        }
    }

    /// Evaluates the population if that has not been done, then steps until [`Settings::generations`]. `report` sees
    /// the state before the first step and after every step.
    pub fn run(&mut self, mut objective: impl FnMut(&[[f64; GENES]], &mut [f64]), mut report: impl FnMut(&Self)) {
        if !self.evaluated {
            self.initialise(&mut objective);
        }
        report(self);
        while self.generation < self.settings.generations {
            self.step(&mut objective);
            report(self);
        }
    }

    /// The best individual of all subpopulations and its objective, which is infinite as long as nothing has been
    /// evaluated to a finite number.
    pub fn best(&self) -> ([f64; GENES], f64) {
        let objective = |subpopulation: &usize| self.subpopulations[*subpopulation].objectives()[0];
        let best = (0..SUBPOPULATIONS).min_by(|a, b| objective(a).total_cmp(&objective(b)));
        self.best_of(best.unwrap_or(0))
    }

    /// The best individual of one subpopulation and its objective.
    ///
    /// # Panics
    /// If there is no such subpopulation.
    pub fn best_of(&self, subpopulation: usize) -> ([f64; GENES], f64) {
        let subpopulation = &self.subpopulations[subpopulation];
        (self.decode(&subpopulation.chromosomes()[0]), subpopulation.objectives()[0])
    }

    /// The whole population, for pictures of how it converges.
    pub fn subpopulations(&self) -> &[Subpopulation<GENES, INDIVIDUALS>; SUBPOPULATIONS] {
        &self.subpopulations
    }

    /// What a chromosome stands for.
    pub fn decode(&self, chromosome: &[u32; GENES]) -> [f64; GENES] {
        let Settings { bits_per_gene, coding, .. } = self.settings;
        core::array::from_fn(|gene| coding.decode(chromosome[gene], self.ranges[gene], bits_per_gene))
    }

    /// Generations bred so far.
    pub fn generation(&self) -> u32 {
        self.generation
    }

    /// Candidates evaluated so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// What was chosen.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Fills the first `count` offspring of a subpopulation.
    fn breed(&mut self, subpopulation: usize, count: usize) {
        let Self { settings, random, .. } = self;
        let bits_per_gene = settings.bits_per_gene;
        let parents = &self.subpopulations[subpopulation];
        let offspring = &mut self.offspring[subpopulation][..count];

        let fitness = linear_ranking(parents.objectives(), settings.selective_pressure);
        let mut selected = [0; INDIVIDUALS];
        let selected = &mut selected[..count];
        stochastic_universal_sampling(&fitness, selected, random);
        // Sampling leaves copies of a parent side by side, where they would mate with each other.
        shuffle(selected, random);
        for (child, &parent) in offspring.iter_mut().zip(&*selected) {
            *child = parents.chromosomes()[parent];
        }

        // Neighbours mate; with an odd number the last one stays single.
        for [first, second] in offspring.as_chunks_mut::<2>().0 {
            single_point_crossover(first, second, bits_per_gene, settings.crossover_probability, random);
        }
        let mutation_probability = settings.mutation_probability(GENES * bits_per_gene as usize);
        for child in offspring {
            mutate(child, bits_per_gene, mutation_probability, random);
        }
    }

    /// Evaluates the first `count` offspring of every subpopulation in one call and reinserts them.
    fn evaluate_and_reinsert(&mut self, count: usize, mut objective: impl FnMut(&[[f64; GENES]], &mut [f64])) {
        for subpopulation in 0..SUBPOPULATIONS {
            for child in 0..count {
                let genes = self.decode(&self.offspring[subpopulation][child]);
                self.candidates.as_flattened_mut()[subpopulation * count + child] = genes;
            }
        }
        let candidates = &self.candidates.as_flattened()[..SUBPOPULATIONS * count];
        let objectives = &mut self.objectives.as_flattened_mut()[..SUBPOPULATIONS * count];
        objectives.fill(f64::NAN);
        objective(candidates, objectives);
        self.evaluations += candidates.len() as u64;
        let offspring = self.offspring.iter().zip(objectives.chunks_exact(count));
        for (subpopulation, (offspring, objectives)) in self.subpopulations.iter_mut().zip(offspring) {
            subpopulation.reinsert(&offspring[..count], objectives);
        }
    }
}

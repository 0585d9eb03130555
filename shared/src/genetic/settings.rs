//! What can be chosen about a run, and the limits of every choice.

use super::coding::{Coding, Range};

/// Everything that can be chosen about a run.
///
/// [`Settings::paper`] is the paper's genetic algorithm; `Settings::default()` is what comes nearest the minimum of all
/// settings that the host's study `armid bench ga` tries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Resolution of every gene, 1 to 32 bits; 20 in both, so one step is a millionth of the range.
    pub bits_per_gene: u32,
    /// How the bits of a gene are read as a number: [`Coding::Binary`] in the paper, [`Coding::Gray`] by default.
    pub coding: Coding,
    /// Expected number of copies of the best individual relative to the mean, 1 (no selection) to 2; 2 in both.
    pub selective_pressure: f64,
    /// Probability, 0 to 1, that a pair of parents exchanges genetic material; 0.6 in both.
    pub crossover_probability: f64,
    /// How many bits of a chromosome flip on average, 0 to 1000, where no probability is given. The paper names no number;
    /// with the 0.7 of the Sheffield toolbox, taken for it, half of all offspring stay as crossover made them. 2 by
    /// default.
    pub expected_mutations: f64,
    /// Probability, 0 to 1, that a bit flips; `None`, in both, for [`Self::expected_mutations`] over the bits there are.
    pub mutation_probability: Option<f64>,
    /// Fraction of a subpopulation, 0 to 1, that its offspring replace in a generation; 0.94 in both, which of 20
    /// individuals leaves 1. Rounded to whole individuals; at least one is replaced and at least one survives, so the
    /// best objective never gets worse.
    pub generation_gap: f64,
    /// Fraction of a subpopulation, 0 to 0.5, replaced by migrants; 0.3 in both. Rounded to whole individuals. More
    /// than half would overwrite individuals that are themselves leaving for other subpopulations.
    pub migration_rate: f64,
    /// Generations from one migration to the next, at least 1. The paper names no number; 20, taken for it, is what both
    /// the Sheffield toolbox's multi-population example and GEATbx use. 5 by default.
    pub migration_interval: u32,
    /// Generations after which [`Genetic::run`](super::Genetic::run) ends; 40 in both.
    pub generations: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { coding: Coding::Gray, expected_mutations: 2.0, migration_interval: 5, ..Self::paper() }
    }
}

impl Settings {
    /// The paper's genetic algorithm, with the toolbox's numbers where the paper names none.
    pub const fn paper() -> Self {
        Self {
            bits_per_gene: 20,
            coding: Coding::Binary,
            selective_pressure: 2.0,
            crossover_probability: 0.6,
            expected_mutations: 0.7,
            mutation_probability: None,
            generation_gap: 0.94,
            migration_rate: 0.3,
            migration_interval: 20,
            generations: 40,
        }
    }

    /// Refuses the first setting that is outside its limits.
    pub(super) fn validate(&self) -> Result<(), Error> {
        let mutation_probability = self.mutation_probability.unwrap_or(0.0);
        for (setting, value, low, high) in [
            ("bits_per_gene", f64::from(self.bits_per_gene), 1.0, 32.0),
            ("selective_pressure", self.selective_pressure, 1.0, 2.0),
            ("crossover_probability", self.crossover_probability, 0.0, 1.0),
            ("expected_mutations", self.expected_mutations, 0.0, 1000.0),
            ("mutation_probability", mutation_probability, 0.0, 1.0),
            ("generation_gap", self.generation_gap, 0.0, 1.0),
            ("migration_rate", self.migration_rate, 0.0, 0.5),
            ("migration_interval", f64::from(self.migration_interval), 1.0, f64::from(u32::MAX)),
        ] {
            if !(low..=high).contains(&value) {
                return Err(Error::Setting { setting, value, low, high });
            }
        }
        Ok(())
    }

    /// Probability that one of `bits` bits flips.
    pub(super) fn mutation_probability(&self, bits: usize) -> f64 {
        self.mutation_probability.unwrap_or((self.expected_mutations / bits as f64).min(1.0))
    }

    /// Offspring bred in a generation by a subpopulation of `individuals`.
    pub(super) fn offspring(&self, individuals: usize) -> usize {
        round(self.generation_gap * individuals as f64).clamp(1, individuals - 1)
    }

    /// Individuals replaced by migrants in a subpopulation of `individuals`.
    pub(super) fn migrants(&self, individuals: usize) -> usize {
        round(self.migration_rate * individuals as f64).min(individuals / 2)
    }
}

/// The nearest whole number, halves upwards. (`f64::round` needs the standard library.)
fn round(count: f64) -> usize {
    (count + 0.5) as usize
}

/// Why a genetic algorithm was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Error {
    /// A setting outside its limits.
    #[error(
        "genetic algorithm: {setting} = {value} is not within {low} to {high}; choose a value within, or leave it at \
         the paper's (Settings::paper())"
    )]
    Setting {
        /// Name of the field of [`Settings`].
        setting: &'static str,
        /// What it was set to.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// A search range without a width.
    #[error(
        "genetic algorithm: gene {gene} has the search range {low} to {high}; give finite limits with the low one \
         below the high one, or leave a gene that is known out of the search"
    )]
    Range {
        /// Index of the gene, from 0.
        gene: usize,
        /// Its lower limit as given.
        low: f64,
        /// Its upper limit as given.
        high: f64,
    },
    /// A known start that is not a number.
    #[error(
        "genetic algorithm: gene {gene} of the individual to start from is {value}; give finite numbers, or start \
         without this individual"
    )]
    Seed {
        /// Index of the gene, from 0.
        gene: usize,
        /// Its value as given.
        value: f64,
    },
}

/// Refuses the first range that has no width or no finite width.
pub(super) fn validate_ranges(ranges: &[Range]) -> Result<(), Error> {
    for (gene, &Range { low, high }) in ranges.iter().enumerate() {
        if !(low < high && (high - low).is_finite()) {
            return Err(Error::Range { gene, low, high });
        }
    }
    Ok(())
}

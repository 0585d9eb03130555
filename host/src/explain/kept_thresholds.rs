//! Scores of null simulations kept in a folder, so that an experiment is simulated once.
//!
//! They are found again by everything they were made from: recordings, model, noise, priors, features of the library, seed,
//! the tool's version and [`HOW`] they are made. What was kept is therefore what would be computed again.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

use super::engine::{Engine, Fitted};
use super::linear::Column;
use super::noise::Noise;
use super::screen::Feature;

/// How null simulations are made: another number when they are made otherwise.
const HOW: u32 = 3;

/// Where the scores of one set of null simulations are kept.
pub struct Kept {
    path: PathBuf,
}

impl Kept {
    /// The place in `folder` for what [`super::threshold::null_scores`] finds from the same arguments in as many
    /// `simulations`.
    pub fn new(
        folder: &Path,
        engine: &Engine,
        fitted: &Fitted,
        features: &[Feature],
        noise: &Noise,
        simulations: usize,
        seed: u64,
    ) -> Self {
        let mut hasher = DefaultHasher::new();
        (env!("CARGO_PKG_VERSION"), HOW, simulations, seed).hash(&mut hasher);
        let experiment = engine.setting.experiment;
        // The text of a number for programmers reads back as the same number.
        format!("{:?}{:?}{:?}{noise:?}", experiment.robot, engine.baseline, fitted.hypothesis).hash(&mut hasher);
        let mut numbers = |numbers: &mut dyn Iterator<Item = f64>| numbers.for_each(|x| x.to_bits().hash(&mut hasher));
        for segment in &experiment.segments {
            for rows in [&segment.reference_counts, &segment.error_counts, &segment.added_torque_nm] {
                numbers(&mut rows.iter().flatten().copied());
            }
        }
        let columns = fitted.columns.iter().chain(features.iter().flat_map(|feature| &feature.columns));
        for Column { motion, .. } in columns {
            numbers(&mut motion.iter().copied());
        }
        numbers(&mut features.iter().map(|feature| feature.price));
        Self { path: folder.join(format!("null-scores-{:016x}.txt", hasher.finish())) }
    }

    /// The scores, if all of them are there.
    pub fn read(&self, simulations: usize) -> Option<Vec<f64>> {
        let text = std::fs::read_to_string(&self.path).ok()?;
        let scores: Vec<f64> = text.lines().map(|line| line.parse().ok()).collect::<Option<_>>()?;
        (scores.len() == simulations && scores.iter().all(|score| score.is_finite())).then_some(scores)
    }

    /// Keeps them. A folder that cannot be written to costs time, not results, so nothing is said.
    pub fn write(&self, scores: &[f64]) {
        let lines: String = scores.iter().map(|score| format!("{score}\n")).collect();
        let _ = crate::write_file(&self.path, lines.as_bytes());
    }
}

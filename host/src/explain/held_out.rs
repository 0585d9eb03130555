//! The recordings kept back: what a model that was fitted elsewhere leaves in them. Only what every recording has for
//! itself, phases and instants, is found anew.

use super::engine::{Engine, Free};
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::library::{Role, Search};
use super::noise::{self, JointNoise, Noise};
use super::scan;
use super::verdict::MOST_TORQUE_NOISE;
use crate::identify::Columns;

/// What noise like `noise` leaves of recordings with these innovations, counts rms. A few seconds of slow noise are louder or
/// quieter by chance: it is that of the louder recordings, as far as it can be noise at all.
pub fn kept_back_floor(check: &Engine, innovations: &Columns, noise: &Noise) -> f64 {
    let rows = check.setting.rows.of(innovations);
    let own = noise::most_likely(check.setting.rows, &rows, noise.map(|joint| joint.white_counts2), 0.0);
    check.floor(noise).max(check.floor(&check.plausible(&own, MOST_TORQUE_NOISE)))
}

/// Phases that are tried.
const PHASES: usize = 8;

/// `hypothesis` with phases and instants of the recordings of `engine`, each effect's beside the others.
pub fn adapted(engine: &Engine, hypothesis: &Hypothesis, weights: &[f64]) -> Hypothesis {
    let records = engine.setting.experiment.segments.len();
    let own = |instance: &Instance| instance.kind.parameters.iter().any(|parameter| parameter.per_record);
    if !hypothesis.named.iter().any(own) {
        return hypothesis.clone();
    }
    let without: Vec<Instance> = hypothesis.named.iter().filter(|instance| !own(instance)).cloned().collect();
    let mut current = Hypothesis { base: hypothesis.base.clone(), named: without };
    for instance in hypothesis.named.iter().filter(|instance| own(instance)) {
        let mut starts: Vec<Instance> = match instance.kind.search {
            Search::Instant => {
                let innovations = engine.innovations(&current);
                let Some(fitted) = engine.refit(&current, weights, &[], Free::OfRecords, 0) else { continue };
                scan::instants(&engine.stage(&fitted, &innovations), instance.kind, instance.joint, weights)
                    .into_iter()
                    .map(|found| Instance { common: instance.common.clone(), ..found })
                    .collect()
            }
            _ => (0..PHASES)
                .map(|step| {
                    let phase = step as f64 / PHASES as f64 * std::f64::consts::TAU;
                    Instance { records: vec![vec![phase]; records], ..instance.clone() }
                })
                .collect(),
        };
        if matches!(instance.kind.search, Search::Wave(_)) {
            // The best phase of each recording by itself.
            let candidates: Vec<_> = starts
                .iter()
                .filter_map(|start| current.with(start.clone()).candidate(engine.baseline, engine.setting.experiment))
                .collect();
            let residuals = engine.setting.residuals(&candidates);
            let of = |record: usize, index: usize| -> f64 {
                let series = engine.setting.rows.series.iter().filter(|series| series.segment == record);
                let rows = series.flat_map(|series| series.rows.clone());
                rows.map(|row| (residuals[index].motion[row] * weights[row]).powi(2)).sum()
            };
            if residuals.len() == starts.len() {
                let mut best = starts[0].clone();
                for (record, values) in best.records.iter_mut().enumerate() {
                    let index = (0..starts.len()).min_by(|&a, &b| of(record, a).total_cmp(&of(record, b))).unwrap_or(0);
                    for (value, parameter) in values.iter_mut().zip(&starts[index].records[record]) {
                        *value = *parameter;
                    }
                }
                debug_assert!(instance.kind.parameters.iter().any(|parameter| parameter.role == Role::Phase));
                starts = vec![best];
            }
        }
        let fits =
            starts.into_iter().filter_map(|start| engine.refit(&current.with(start), weights, &[], Free::OfRecords, 5));
        if let Some(best) = fits.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
            current = best.hypothesis;
        }
    }
    current
}

/// The effects a baseline came with, their phases and instants found in the recordings to fit; none if there is nothing
/// to find.
pub fn adapted_to_train(engine: &Engine, baseline: &Baseline, known: &[Instance]) -> Option<Vec<Instance>> {
    if known.is_empty() {
        return None;
    }
    let rounding = if engine.setting.experiment.robot.quantised { 1.0 / 12.0 } else { 1.0 };
    let weights = engine.weights(&[JointNoise::white(rounding); 2]);
    Some(adapted(engine, &Hypothesis::baseline(baseline, known), &weights).named)
}

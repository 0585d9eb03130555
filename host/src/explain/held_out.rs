//! The recordings kept back: what a model that was fitted elsewhere leaves in them. Only what every recording has for
//! itself, phases and instants, is found anew.

use super::engine::{Engine, Free};
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::instants::instants;
use super::library::Search;
use super::noise::{self, JointNoise, Noise};
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
                let stage = engine.stage(&fitted, &innovations);
                instants(&stage, instance.kind, instance.joint, weights, Some(instance))
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
        // The best phase, or instant near the one it suggests, of each recording by itself.
        let alone = match instance.kind.search {
            Search::Instant => {
                starts.iter().filter_map(|start| best_of_moved(engine, &current, start, weights)).collect()
            }
            _ => Vec::from_iter(best_of_each_record(engine, &current, &starts, weights)),
        };
        if !alone.is_empty() {
            starts = alone.into_iter().map(|(_, instance)| instance).collect();
        }
        let fits =
            starts.into_iter().filter_map(|start| engine.refit(&current.with(start), weights, &[], Free::OfRecords, 5));
        if let Some(best) = fits.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
            current = best.hypothesis;
        }
    }
    current
}

/// What differs from recording to recording of these `alternatives`, of each the one that leaves least of it beside `others`,
/// with the χ² that is left; none where one of them cannot be.
pub fn best_of_each_record(
    engine: &Engine,
    others: &Hypothesis,
    alternatives: &[Instance],
    weights: &[f64],
) -> Option<(f64, Instance)> {
    let with =
        |instance: &Instance| others.with(instance.clone()).candidate(engine.baseline, engine.setting.experiment);
    let candidates: Vec<_> = alternatives.iter().map(with).collect::<Option<_>>()?;
    let residuals = engine.setting.residuals(&candidates);
    let of = |record: usize, index: usize| -> f64 {
        let series = engine.setting.rows.series.iter().filter(|series| series.segment == record);
        let rows = series.flat_map(|series| series.rows.clone());
        rows.map(|row| (residuals[index].motion[row] * weights[row]).powi(2)).sum()
    };
    let mut best = alternatives.first()?.clone();
    let mut cost = 0.0;
    for (record, values) in best.records.iter_mut().enumerate() {
        let each = (0..alternatives.len()).map(|index| (of(record, index), index));
        let (least, index) = each.min_by(|a, b| a.0.total_cmp(&b.0))?;
        cost += least;
        values.clone_from(&alternatives[index].records[record]);
    }
    cost.is_finite().then_some((cost, best))
}

/// How far a contact is moved to either side, in s, and in how many steps: friction that turns round under it hides its edge
/// from what is linear.
const MOVED_S: f64 = 0.24;
const MOVES: i32 = 12;

/// A contact with its starts moved to where each recording by itself leaves least; whatever else has instants stays as it is,
/// because a count that is lost is found to the sample.
pub fn best_of_moved(
    engine: &Engine,
    others: &Hypothesis,
    contact: &Instance,
    weights: &[f64],
) -> Option<(f64, Instance)> {
    let moves = if contact.kind.name == "external-contact" { MOVES } else { 0 };
    let step_s = MOVED_S / f64::from(MOVES);
    let moved = (-moves..=moves).map(|step| contact.with_own(|start_s| (start_s + f64::from(step) * step_s).max(0.0)));
    best_of_each_record(engine, others, &moved.collect::<Vec<_>>(), weights)
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

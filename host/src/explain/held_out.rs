//! The recordings kept back: what a model that was fitted elsewhere leaves in them. Only what every recording has for
//! itself, phases and instants, is found anew.

use super::engine::{Engine, Fitted, Free};
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::instants::instants;
use super::library::Search;
use super::noise::{self, JointNoise, Noise};
use super::verdict::MOST_TORQUE_NOISE;

/// A few seconds of slow noise are louder in one recording than in another by chance: up to this factor.
const LOUDER: f64 = 1.5;

/// What may be left of recordings kept back by a model that is right and was `fitted` to others under `noise`, counts rms: noise,
/// which is that of the kept-back recordings as far as those fitted leave such noise too, and what the fit could not know.
pub fn kept_back_floor(train: &Engine, fitted: &Fitted, noise: &Noise, check: &Engine) -> f64 {
    let weights = check.weights(noise);
    let adapted = adapted(check, &fitted.hypothesis, &weights);
    let rows = check.setting.rows.of(&check.innovations(&adapted));
    let white = noise.map(|joint| joint.white_counts2);
    let own = check.plausible(&noise::most_likely(check.setting.rows, &rows, white, 0.0), MOST_TORQUE_NOISE);
    let there = train.joint_gaps(&train.innovations(&fitted.hypothesis));
    let period_s = check.setting.experiment.robot.record_period_s;
    let joints = check.setting.experiment.robot.joints.len();
    let of = |joint: usize| {
        let rms2 = |noise: &Noise| noise[joint].rms_counts(period_s).powi(2);
        let rounding = JointNoise::white(white[joint]).rms_counts(period_s).powi(2);
        let most = rounding + LOUDER.powi(2) * (there[joint].powi(2) - rounding).max(0.0);
        rms2(&own).max(rms2(noise)).min(most)
    };
    let noise_counts2 = (0..joints).map(of).sum::<f64>() / joints as f64;
    (noise_counts2 + missed_counts2(train, fitted, noise, check, &adapted)).sqrt()
}

/// What the errors of a fit's parameters leave in recordings that it was not fitted to, a mean square in counts²: tr(J Σ Jᵀ)/n
/// with the covariance Σ of what all recordings share, and its derivatives J at the n samples kept back.
pub fn missed_counts2(train: &Engine, fitted: &Fitted, noise: &Noise, check: &Engine, adapted: &Hypothesis) -> f64 {
    let Some(kept_back) = check.refit(adapted, &check.weights(noise), &[], Free::All, 0) else { return 0.0 };
    let shared = |hypothesis: &Hypothesis| -> Vec<usize> {
        let effects = hypothesis.named.iter().flat_map(Instance::flat);
        let own = effects.map(|(parameter, _)| parameter.per_record);
        let own = std::iter::repeat_n(false, hypothesis.base.len()).chain(own);
        own.enumerate().filter_map(|(place, own)| (!own).then_some(place)).collect()
    };
    let (places, kept_places) = (shared(&fitted.hypothesis), shared(&kept_back.hypothesis));
    let (free, covariance) = train.covariance(fitted, &train.weights(noise));
    let derivative = |place: &usize| {
        let shared = places.iter().position(|other| other == place)?;
        kept_back.columns.get(*kept_places.get(shared)?).filter(|column| !column.motion.is_empty())
    };
    let derivatives: Vec<_> = free.iter().map(derivative).collect();
    let mut sum = 0.0;
    for (i, a) in derivatives.iter().enumerate() {
        for (j, b) in derivatives.iter().enumerate() {
            if let (Some(a), Some(b)) = (a, b) {
                sum += covariance[(i, j)] * a.motion.iter().zip(&b.motion).map(|(a, b)| a * b).sum::<f64>();
            }
        }
    }
    // Derivatives of a model far from the motion may not exist.
    let sum = if sum.is_finite() { sum.max(0.0) } else { 0.0 };
    sum / (check.setting.experiment.robot.joints.len() as f64 * check.length())
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

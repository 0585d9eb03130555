//! When something happens that happens at an instant of every recording's own: matched filters under the weights.
//!
//! What an event at each sample has in common with the residual is read off the residual sent backward through the state
//! correction, so that every sample is looked at and nothing is simulated.

use super::contacts::contacts;
use super::instance::Instance;
use super::library::Kind;
use super::screen::Stage;

/// No event is looked for so near to the end of a recording, in s: little of it would show.
pub const SHOWN_S: f64 = 0.1;

/// The instants in every recording where the residual suggests a slip or a contact: for either direction, and for contacts
/// with durations that fit; or for an effect that is `known` but for its instants, its own direction and duration.
pub fn instants(
    stage: &Stage,
    kind: &'static Kind,
    joint: usize,
    weights: &[f64],
    known: Option<&Instance>,
) -> Vec<Instance> {
    let signs: Vec<f64> = match known.and_then(|known| known.common[0]) {
        Some(size) => vec![size.signum()],
        None => vec![1.0, -1.0],
    };
    match kind.name {
        "count-loss" => slips(stage, kind, joint, weights, &signs),
        _ => contacts(stage, kind, joint, weights, &signs, known),
    }
}

/// Where a step of the measured position, followed by what the state correction makes of it, resembles the residual most.
/// A jump alone does not tell, because a slow encoder jumps at every edge.
fn slips(stage: &Stage, kind: &'static Kind, joint: usize, weights: &[f64], signs: &[f64]) -> Vec<Instance> {
    let rows = stage.setting.rows;
    let period_s = stage.setting.experiment.robot.record_period_s;
    // For every recording, what a step from each sample on has in common with the residual.
    let common: Vec<Vec<f64>> = rows
        .series
        .iter()
        .filter(|series| series.joint == joint)
        .map(|series| {
            let place = series.rows.clone();
            let weighed = rows.weighed_back(series, &stage.residual.motion[place.clone()], &weights[place]);
            let mut from = stage.response.back_to_position(&weighed);
            let mut sum = 0.0;
            for x in from.iter_mut().rev() {
                sum += *x;
                *x = sum;
            }
            from.truncate(from.len().saturating_sub((SHOWN_S / period_s) as usize));
            from.drain(..series.samples.start.min(from.len()));
            from
        })
        .collect();
    let begins = rows.series.iter().filter(|series| series.joint == joint).map(|series| series.samples.start);
    let begins: Vec<usize> = begins.collect();
    signs
        .iter()
        .map(|&sign| {
            let instant = |(common, begin): (&Vec<f64>, &usize)| {
                let best = (0..common.len()).max_by(|&a, &b| (sign * common[a]).total_cmp(&(sign * common[b])));
                vec![(begin + best.unwrap_or(0)) as f64 * period_s - 0.5 * period_s]
            };
            let records = common.iter().zip(&begins).map(instant).collect();
            Instance { kind, joint, common: vec![Some(sign), None], records }
        })
        .collect()
}

//! Orders of waves, looked at again once something else has been found.
//!
//! Over a travel of so many turns a wave of another order that is off by one over them looks much the same. While another
//! effect is still missing the wrong one may do better, and no refit moves from one to the next.

use super::decide::Case;
use super::engine::{Engine, Fitted, Free};
use super::instance::Instance;
use super::library::Search;

/// By how much χ² has to fall for another order.
const BETTER: f64 = 1.0;
/// How often an order moves on at most.
const MOVES: usize = 3;
/// Iterations of a refit.
const ITERATIONS: usize = 4;

impl Case<'_> {
    /// `fitted` with the orders of its effects from the `known`-th on, where those beside them leave less.
    pub fn with_better_orders(&self, mut fitted: Fitted, known: usize, weights: &[f64]) -> Fitted {
        for index in known..fitted.hypothesis.named.len() {
            for _ in 0..MOVES {
                let instance = &fitted.hypothesis.named[index];
                let tried = [-1.0, 1.0].iter().filter_map(|&side| {
                    let mut hypothesis = fitted.hypothesis.clone();
                    hypothesis.named[index] = beside(&self.train, instance, side)?;
                    self.train.refit(&hypothesis, weights, &[], Free::All, ITERATIONS)
                });
                match tried.min_by(|a, b| a.cost.total_cmp(&b.cost)) {
                    Some(better) if better.cost < fitted.cost - BETTER => fitted = better,
                    _ => break,
                }
            }
        }
        fitted
    }
}

/// A wave over the motor's angle with one cycle more or less over the whole travel, the same in its middle.
fn beside(engine: &Engine, instance: &Instance, side: f64) -> Option<Instance> {
    let parameters = instance.kind.parameters;
    let order = parameters.iter().position(|parameter| parameter.name == "order")?;
    // Phases of their own are those of waves over the motor's angle.
    if !matches!(instance.kind.search, Search::Wave(_)) || !parameters.iter().any(|parameter| parameter.per_record) {
        return None;
    }
    let ratio = engine.setting.experiment.robot.joints[instance.joint].gear_ratio;
    let ends: Vec<[f64; 2]> = engine
        .traces
        .iter()
        .map(|trace| {
            let angles = trace.position_rad[instance.joint].iter().map(|angle| ratio * angle);
            angles.fold([f64::MAX, f64::MIN], |[low, high], angle| [low.min(angle), high.max(angle)])
        })
        .collect();
    let travel_rad = ends.iter().map(|[low, high]| high - low).fold(0.0, f64::max);
    if travel_rad <= 0.0 {
        return None;
    }
    let shift = side * std::f64::consts::TAU / travel_rad;
    let mut other = instance.clone();
    if let Some(order) = &mut other.common[order] {
        *order += shift;
    }
    for (values, [low, high]) in other.records.iter_mut().zip(&ends) {
        // A wave has one value of each recording's own: its phase.
        values.iter_mut().for_each(|phase| *phase -= shift * 0.5 * (low + high));
    }
    other.can_be().then_some(other)
}

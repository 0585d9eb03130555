//! Which candidates are worth a refit, and which of those refitted cannot be told apart.

use super::decide::Rival;
use super::engine::Fitted;
use super::instance::Instance;
use super::library::{Search, kind};
use super::linear::{Base, Column};
use super::screen::{Feature, Scored};

/// Share of a threshold, itself no larger than this score, that a candidate has on the screen.
const SCREENED: [f64; 2] = [0.5, 20.0];
/// Beyond the leading candidates, those that look like one of them.
const ALIKE: f64 = 0.9;
const ALIKE_AT_MOST: usize = 3;
/// Starts of an effect whose refits get stuck.
const STARTS: usize = 3;
/// Candidates within this ΔBIC and this share of the gap are not told apart.
const SAME_BIC: f64 = 6.0;
/// See [`SAME_BIC`].
pub const SAME_GAP: f64 = 0.03;
/// A candidate that is behind by this share of the best's ΔBIC at most comes first if it narrows the gap by that share more.
const NEARLY: f64 = 0.05;
const MUCH_NARROWER: f64 = 0.15;
/// Members of a class at most.
const CLASS: usize = 3;

/// The effects to refit: the best start of each of the leading ones, two of those whose refits get stuck, and what looks
/// like one of them; without those `tried` before.
pub fn shortlist(
    base: &Base,
    features: &[Feature],
    scored: &[&Scored],
    threshold: f64,
    weights: &[f64],
    tried: &[(Rival, Fitted)],
    most: usize,
) -> Vec<Instance> {
    let is_tried = |feature: &Feature| {
        let same = |instance: &Instance| instance.kind.name == feature.kind.name && instance.joint == feature.joint;
        tried.iter().any(|(rival, _)| same(&rival.instance))
    };
    let coefficients = |scored: &Scored| {
        let from = scored.fit.coefficients.len() - features[scored.feature].columns.len();
        scored.fit.coefficients[from..].to_vec()
    };
    let mut starts: Vec<Instance> = Vec::new();
    let mut kinds: Vec<(&'static str, usize, usize)> = Vec::new();
    let mut explained: Vec<Vec<f64>> = Vec::new();
    for one in scored {
        // Refits gain on the screen where an effect is not proportional, but not without bounds.
        if one.delta_bic < SCREENED[0] * threshold.min(SCREENED[1]) {
            break;
        }
        let feature = &features[one.feature];
        if is_tried(feature) {
            continue;
        }
        // A gap and a spring have valleys of their own, and a wave one for every lobe of its order.
        let scanned = matches!(feature.kind.search, Search::Wave(None));
        let stuck = scanned || matches!(feature.kind.name, "backlash" | "joint-flexibility");
        let key = kinds.iter_mut().find(|(name, joint, _)| *name == feature.kind.name && *joint == feature.joint);
        match key {
            Some((_, _, count)) if *count >= if stuck { STARTS } else { 1 } => continue,
            Some((_, _, count)) => *count += 1,
            None => {
                let shape = explanation(base, feature, one);
                if kinds.len() >= most {
                    let alike = explained.iter().any(|other| correlation(other, &shape, weights) > ALIKE);
                    if !alike || kinds.len() >= most + ALIKE_AT_MOST {
                        continue;
                    }
                }
                kinds.push((feature.kind.name, feature.joint, 1));
                explained.push(shape);
            }
        }
        if let Some(instance) = feature.instance(&coefficients(one)) {
            starts.push(instance);
        }
    }
    starts
}

/// What a feature explains of the residual: the fit's columns together, base included.
fn explanation(base: &Base, feature: &Feature, scored: &Scored) -> Vec<f64> {
    let columns: Vec<&Column> = feature.columns.iter().collect();
    let without = base.left(&base.alone(), &[]);
    let with = base.left(&scored.fit, &columns);
    without.iter().zip(&with).map(|(a, b)| a - b).collect()
}

fn correlation(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    use super::linear::inner;
    inner(a, b, weights) / (inner(a, a, weights) * inner(b, b, weights)).sqrt().max(f64::MIN_POSITIVE)
}

/// Of the candidates that fit as well as the best, or nearly, puts the one first that foretells best what was kept back.
pub fn preferred_first(confirmed: &mut [(Rival, Fitted)]) {
    let Some((best, _)) = confirmed.first() else { return };
    let gap = |index: usize| confirmed[index].0.held_out_gap;
    let better = |first: usize, other: usize| {
        let behind = best.delta_bic - confirmed[other].0.delta_bic;
        let narrower = if behind <= SAME_BIC { SAME_GAP } else { MUCH_NARROWER };
        gap(other) < (1.0 - narrower) * gap(first)
    };
    let nearly = SAME_BIC.max(NEARLY * best.delta_bic);
    let as_good = confirmed.iter().take_while(|(rival, _)| best.delta_bic - rival.delta_bic <= nearly).count();
    let preferred = (1..as_good).fold(0, |first, other| if better(first, other) { other } else { first });
    confirmed[..=preferred].rotate_right(1);
}

/// The names that cannot be told from the best candidate, its own first.
pub fn class(confirmed: &[(Rival, Fitted)]) -> Vec<&'static str> {
    let Some((best, _)) = confirmed.first() else { return Vec::new() };
    let mut class = vec![best.instance.kind.name];
    for name in best.instance.kind.equivalent {
        if !class.contains(name) && kind(name).is_some() {
            class.push(name);
        }
    }
    for (rival, _) in &confirmed[1..] {
        let near = (best.delta_bic - rival.delta_bic).abs() <= SAME_BIC
            && (rival.held_out_gap - best.held_out_gap).abs() <= SAME_GAP * best.held_out_gap;
        let name = rival.instance.kind.name;
        if near && class.len() < CLASS && !class.contains(&name) {
            class.push(name);
        }
    }
    class
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::hypothesis::Hypothesis;

    fn candidate(joint: usize, delta_bic: f64, held_out_gap: f64) -> (Rival, Fitted) {
        let kind = kind("external-contact").expect("an effect");
        let rival = Rival { instance: Instance::new(kind, joint, &[1.0, 0.4, 1.0], 2), delta_bic, held_out_gap };
        let hypothesis = Hypothesis { base: Vec::new(), named: Vec::new() };
        (rival, Fitted { hypothesis, cost: 0.0, residual: Column::default(), columns: Vec::new() })
    }

    fn first(mut confirmed: Vec<(Rival, Fitted)>) -> usize {
        preferred_first(&mut confirmed);
        confirmed[0].0.instance.joint
    }

    /// Within ΔBIC 6 a gap narrower by 3 % decides, within 5 % of ΔBIC one narrower by 15 %, and beyond that ΔBIC alone.
    #[test]
    fn of_candidates_that_nearly_tie_the_one_that_foretells_comes_first() {
        assert_eq!(first(vec![candidate(0, 310.0, 1.0), candidate(1, 305.0, 0.96)]), 1);
        assert_eq!(first(vec![candidate(0, 310.0, 1.0), candidate(1, 305.0, 0.98)]), 0);
        assert_eq!(first(vec![candidate(0, 310.0, 1.0), candidate(1, 300.0, 0.8)]), 1);
        assert_eq!(first(vec![candidate(0, 310.0, 1.0), candidate(1, 300.0, 0.9)]), 0);
        assert_eq!(first(vec![candidate(0, 310.0, 1.0), candidate(1, 290.0, 0.5)]), 0);
    }
}

//! Answers against truths.

use std::collections::BTreeMap;

use serde::Serialize;

use super::answer::{Answer, Named};
use super::case::{Hidden, Kind, Truth};
use super::interval::{Share, quantile};

/// A class of more names than this is no answer.
pub const LARGEST_CLASS: usize = 3;

/// A case that was answered.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Name of the case.
    pub case: String,
    /// What was hidden.
    pub truth: Truth,
    /// What was said.
    pub answer: Answer,
}

/// What a score is of.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Group {
    /// Kind of the cases.
    pub kind: &'static str,
    /// Tier, or "all".
    pub tier: String,
    /// "clean", "noisy" or "all".
    pub noise: &'static str,
}

/// The figures of a group of cases.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Score {
    /// Every hidden effect got its name, and nothing else was named.
    pub right_name: Share,
    /// The same, where a class of at most three names that contains the truth counts as its name.
    pub in_class: Share,
    /// Names in the classes of named effects.
    pub class_sizes: Vec<usize>,
    /// Something was named that may not be what was hidden.
    pub wrong_name: Share,
    /// Of hidden effects named or classed rightly, how many on the right joint.
    pub joint_right: Share,
    /// Nothing was named and nothing complained of.
    pub said_none: Share,
    /// Said to be unknown, or explained in part only, and nothing named wrongly.
    pub flagged_unknown: Share,
    /// No answer.
    pub failed: Share,
    /// Held-out gap over floor, case by case.
    pub gap_over_floor: Vec<f64>,
    /// The same of those that were named.
    pub named_gap_over_floor: Vec<f64>,
    /// Time in s, case by case.
    pub seconds: Vec<f64>,
}

impl Score {
    fn add(&mut self, judged: &Judged) {
        let (truth, answer) = (&judged.truth, &judged.answer);
        self.seconds.push(answer.seconds);
        self.failed.add(answer.verdict.is_none());
        let named = answer.verdict.as_ref().map_or(&[][..], |verdict| verdict.effects.as_slice());
        let word = answer.verdict.as_ref().map_or("", |verdict| verdict.verdict.as_str());
        let hidden: &[Hidden] = if truth.kind == Kind::Outside { &[] } else { &truth.effect };
        let found = |fits: &dyn Fn(&Named, &Hidden) -> bool| {
            hidden.len() == named.len()
                && hidden.iter().all(|hidden| named.iter().any(|named| fits(named, hidden)))
                && named.iter().all(|named| hidden.iter().any(|hidden| fits(named, hidden)))
        };
        self.right_name.add(found(&|named, hidden| named.name == hidden.name));
        self.in_class.add(found(&|named, hidden| named.may_be(&hidden.name) && named.class_size() <= LARGEST_CLASS));
        let wrong = named.iter().any(|named| !hidden.iter().any(|hidden| named.may_be(&hidden.name)));
        self.wrong_name.add(wrong);
        self.class_sizes.extend(named.iter().map(Named::class_size));
        for hidden in hidden {
            let mut matching = named.iter().filter(|named| named.may_be(&hidden.name)).peekable();
            if matching.peek().is_some() {
                self.joint_right.add(matching.any(|named| named.joint == hidden.joint));
            }
        }
        self.said_none.add(word == "none" && named.is_empty());
        self.flagged_unknown.add((word == "unknown" || word == "partial") && !wrong);
        if let Some(gap) = answer.verdict.as_ref().and_then(|verdict| verdict.gap.as_ref())
            && let Some(held_out) = gap.held_out
        {
            let over_floor = held_out.after / gap.floor;
            self.gap_over_floor.push(over_floor);
            if word == "named" {
                self.named_gap_over_floor.push(over_floor);
            }
        }
    }

    /// Mean number of names in a class.
    pub fn mean_class_size(&self) -> Option<f64> {
        let count = self.class_sizes.len();
        (count > 0).then(|| self.class_sizes.iter().sum::<usize>() as f64 / count as f64)
    }
}

/// Median and 95 % quantile of gaps over their floors.
pub fn gap_quantiles(over_floor: &[f64]) -> Option<[f64; 2]> {
    Some([quantile(over_floor, 0.5)?, quantile(over_floor, 0.95)?])
}

/// How a kind is called in tables.
pub fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Null => "null",
        Kind::Single => "single",
        Kind::Pair => "pair",
        Kind::Outside => "outside",
    }
}

/// The figures of every group: each kind, tier and noise, and each of them with the others together.
pub fn groups(judged: &[Judged]) -> BTreeMap<Group, Score> {
    let mut groups: BTreeMap<Group, Score> = BTreeMap::new();
    for judged in judged {
        let kind = kind_name(judged.truth.kind);
        let tier = judged.truth.tier.as_str();
        let noise = if judged.truth.noisy { "noisy" } else { "clean" };
        let tiers: &[&str] = if tier.is_empty() { &["all"] } else { &["all", tier] };
        for tier in tiers {
            for noise in ["all", noise] {
                groups.entry(Group { kind, tier: (*tier).to_owned(), noise }).or_default().add(judged);
            }
        }
    }
    groups
}

/// What was answered, by what was hidden: `confusion[hidden][answer]` counts cases with one hidden thing at most.
pub fn confusion(judged: &[Judged]) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut table: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for judged in judged.iter().filter(|judged| judged.truth.kind != Kind::Pair) {
        let hidden = judged.truth.effect.first().map_or("nothing", |hidden| hidden.name.as_str());
        let said = match &judged.answer.verdict {
            None => "no answer".to_owned(),
            Some(verdict) if verdict.effects.is_empty() => verdict.verdict.clone(),
            Some(verdict) => {
                let names: Vec<&str> = verdict.effects.iter().map(|named| named.name.as_str()).collect();
                names.join(" + ")
            }
        };
        *table.entry(hidden.to_owned()).or_default().entry(said).or_default() += 1;
    }
    table
}

/// Estimated parameters against true ones.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Parameters {
    /// Relative errors, one per parameter of a rightly named effect.
    pub relative_errors: Vec<f64>,
    /// Whether the stated 95 % interval holds the true value.
    pub covered: Share,
}

/// Parameters of rightly named single effects, by effect and parameter.
pub fn parameters(judged: &[Judged]) -> BTreeMap<(String, String), Parameters> {
    let mut table: BTreeMap<(String, String), Parameters> = BTreeMap::new();
    for judged in judged.iter().filter(|judged| matches!(judged.truth.kind, Kind::Single | Kind::Pair)) {
        let Some(verdict) = &judged.answer.verdict else { continue };
        for hidden in &judged.truth.effect {
            let Some(named) =
                verdict.effects.iter().find(|named| named.name == hidden.name && named.joint == hidden.joint)
            else {
                continue;
            };
            for (name, &value) in &hidden.parameters {
                let Some(estimate) = named.parameters.get(name) else { continue };
                let error = parameter_error(named, &hidden.name, name, estimate.value, value);
                let entry = table.entry((hidden.name.clone(), name.clone())).or_default();
                entry.relative_errors.push((error / value).abs());
                if let Some(standard_error) = estimate.standard_error {
                    entry.covered.add(error.abs() <= 1.96 * standard_error);
                }
            }
        }
    }
    table
}

/// Estimate less truth. The amplitude of a wave has no sign of its own, and a direction no whole turns.
fn parameter_error(named: &Named, effect: &str, name: &str, estimate: f64, truth: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if name.starts_with("amplitude") || (effect == "gravity-spring" && name == "torque_nm") {
        return estimate.abs() - truth.abs();
    }
    if effect == "gravity-spring" && name == "angle_rad" {
        let pulls_back = named.parameters.get("torque_nm").is_some_and(|torque| torque.value < 0.0);
        let error = estimate + if pulls_back { PI } else { 0.0 } - truth;
        return error - TAU * (error / TAU).round();
    }
    estimate - truth
}

/// How small an effect is still named.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Power {
    /// Tier by tier from the strongest: its name, cases named or classed rightly, median size in counts rms and in
    /// per cent of Coulomb friction (on the joint where it is largest).
    pub tiers: Vec<(String, Share, f64, f64)>,
    /// Median size in counts rms of the weakest tier that is still named in at least half of its cases, with all
    /// stronger ones; nothing if not even the strongest is.
    pub limit_counts: Option<f64>,
    /// The same in per cent of Coulomb friction.
    pub limit_percent_of_coulomb: Option<f64>,
}

/// Power against size, effect by effect.
pub fn power(judged: &[Judged]) -> BTreeMap<String, Power> {
    type Tiers = BTreeMap<String, (Share, Vec<f64>, Vec<f64>)>;
    let mut sizes: BTreeMap<String, Tiers> = BTreeMap::new();
    for judged in judged.iter().filter(|judged| judged.truth.kind == Kind::Single) {
        let Some(hidden) = judged.truth.effect.first() else { continue };
        let mut one = Score::default();
        one.add(judged);
        let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        let tier = sizes.entry(hidden.name.clone()).or_default().entry(judged.truth.tier.clone()).or_default();
        tier.0.add(one.in_class.hits > 0);
        tier.1.push(largest(&judged.truth.size_counts));
        tier.2.push(100.0 * largest(&judged.truth.size_of_coulomb));
    }
    let of_effect = |tiers: Tiers| {
        let median = |values: &[f64]| quantile(values, 0.5).unwrap_or(f64::NAN);
        let mut tiers: Vec<(String, Share, f64, f64)> = tiers
            .into_iter()
            .map(|(name, (share, counts, percent))| (name, share, median(&counts), median(&percent)))
            .collect();
        tiers.sort_by(|one, other| other.2.total_cmp(&one.2));
        let weakest =
            tiers.iter().take_while(|(_, share, _, _)| share.value().is_some_and(|share| share >= 0.5)).last();
        let (limit_counts, limit_percent_of_coulomb) =
            (weakest.map(|weakest| weakest.2), weakest.map(|weakest| weakest.3));
        Power { tiers, limit_counts, limit_percent_of_coulomb }
    };
    sizes.into_iter().map(|(name, tiers)| (name, of_effect(tiers))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::answer::Verdict;
    use super::*;

    fn judged(kind: Kind, hidden: &[(&str, &str)], named: &[(&str, &str, &[&str])], verdict: &str) -> Judged {
        let effect = hidden
            .iter()
            .map(|(name, joint)| Hidden {
                name: (*name).to_owned(),
                joint: (*joint).to_owned(),
                parameters: BTreeMap::new(),
            })
            .collect();
        let effects = named
            .iter()
            .map(|(name, joint, class)| Named {
                name: (*name).to_owned(),
                joint: (*joint).to_owned(),
                class: class.iter().map(|name| (*name).to_owned()).collect(),
                parameters: BTreeMap::new(),
            })
            .collect();
        Judged {
            case: "case".to_owned(),
            truth: Truth {
                kind,
                tier: "clear".to_owned(),
                noisy: false,
                size_counts: vec![2.0, 1.0],
                size_of_coulomb: vec![0.1, 0.2],
                effect,
            },
            answer: Answer {
                seconds: 1.0,
                verdict: Some(Verdict { verdict: verdict.to_owned(), effects, gap: None }),
                failure: String::new(),
            },
        }
    }

    fn of(judged: &Judged) -> Score {
        let mut score = Score::default();
        score.add(judged);
        score
    }

    #[test]
    fn a_right_name_on_the_wrong_joint_is_a_right_name_and_a_wrong_joint() {
        let score = of(&judged(Kind::Single, &[("cogging", "2")], &[("cogging", "3", &["cogging"])], "named"));
        assert_eq!((score.right_name.hits, score.in_class.hits, score.wrong_name.hits), (1, 1, 0));
        assert_eq!(score.joint_right, Share { hits: 0, of: 1 });
    }

    #[test]
    fn a_class_counts_if_it_is_small_and_holds_the_truth() {
        let hidden = [("torque-offset", "2")];
        let small: &[&str] = &["asymmetric-friction", "torque-offset"];
        let score = of(&judged(Kind::Single, &hidden, &[("asymmetric-friction", "2", small)], "named"));
        assert_eq!((score.right_name.hits, score.in_class.hits, score.wrong_name.hits), (0, 1, 0));
        let large: &[&str] = &["asymmetric-friction", "torque-offset", "base-tilt", "payload"];
        let score = of(&judged(Kind::Single, &hidden, &[("asymmetric-friction", "2", large)], "named"));
        assert_eq!((score.in_class.hits, score.wrong_name.hits), (0, 0));
        let score = of(&judged(Kind::Single, &hidden, &[("payload", "both", &["payload"])], "named"));
        assert_eq!((score.in_class.hits, score.wrong_name.hits), (0, 1));
    }

    #[test]
    fn one_name_too_many_is_wrong_and_one_too_few_is_not_right() {
        let pair = [("cogging", "2"), ("payload", "both")];
        let both = judged(Kind::Pair, &pair, &[("payload", "both", &[]), ("cogging", "2", &[])], "named");
        assert_eq!(of(&both).right_name.hits, 1);
        let half = of(&judged(Kind::Pair, &pair, &[("payload", "both", &[])], "partial"));
        assert_eq!((half.right_name.hits, half.wrong_name.hits, half.flagged_unknown.hits), (0, 0, 1));
        let more = judged(Kind::Single, &pair[..1], &[("cogging", "2", &[]), ("payload", "both", &[])], "named");
        assert_eq!((of(&more).right_name.hits, of(&more).wrong_name.hits), (0, 1));
    }

    #[test]
    fn names_for_nothing_and_for_the_unknown_are_wrong() {
        assert_eq!(of(&judged(Kind::Null, &[], &[("cogging", "2", &[])], "named")).wrong_name.hits, 1);
        let none = of(&judged(Kind::Null, &[], &[], "none"));
        assert_eq!((none.wrong_name.hits, none.said_none.hits, none.right_name.hits), (0, 1, 1));
        let outside = [("outside:crosstalk", "2")];
        assert_eq!(of(&judged(Kind::Outside, &outside, &[], "unknown")).flagged_unknown.hits, 1);
        let named = of(&judged(Kind::Outside, &outside, &[("backlash", "2", &[])], "partial"));
        assert_eq!((named.flagged_unknown.hits, named.wrong_name.hits), (0, 1));
    }

    /// A spring of −2 N m at 0.3 rad is one of 2 N m at 0.3 + π.
    #[test]
    fn waves_are_compared_whatever_their_sign_and_turns() {
        let mut case = judged(Kind::Single, &[("gravity-spring", "2")], &[("gravity-spring", "2", &[])], "named");
        let truth = [("torque_nm", 2.0), ("angle_rad", 0.3 - std::f64::consts::PI)];
        case.truth.effect[0].parameters = truth.map(|(name, value)| (name.to_owned(), value)).into();
        let found = [("torque_nm", -2.1, 0.1), ("angle_rad", 0.31, 0.004)];
        let named = &mut case.answer.verdict.as_mut().expect("a verdict").effects[0];
        for (name, value, error) in found {
            let estimate = super::super::answer::Estimate { value, standard_error: Some(error) };
            named.parameters.insert(name.to_owned(), estimate);
        }
        let table = parameters(&[case]);
        let of = |name: &str| &table[&("gravity-spring".to_owned(), name.to_owned())];
        assert!((of("torque_nm").relative_errors[0] - 0.05).abs() < 1e-9);
        assert_eq!(of("torque_nm").covered, Share { hits: 1, of: 1 });
        assert_eq!(of("angle_rad").covered, Share { hits: 0, of: 1 });
    }

    #[test]
    fn the_detection_limit_is_the_weakest_tier_that_holds() {
        let mut cases = Vec::new();
        for (tier, counts, right) in [("clear", 4.0, true), ("medium", 1.5, true), ("small", 0.4, false)] {
            let names: &[(&str, &str, &[&str])] = if right { &[("cogging", "2", &[])] } else { &[] };
            let mut case = judged(Kind::Single, &[("cogging", "2")], names, "named");
            case.truth.tier = tier.to_owned();
            case.truth.size_counts = vec![counts, 0.1];
            cases.push(case);
        }
        assert_eq!(power(&cases)["cogging"].limit_counts, Some(1.5));
    }
}

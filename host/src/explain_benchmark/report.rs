//! The scores as sections of a page, which print as text too, and as JSON.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::case::Kind;
use super::interval::{Share, quantile};
use super::score::{Group, Judged, Parameters, Power, Score, confusion, gap_quantiles, groups, parameters, power};
use crate::report::{Cell, Content, Ink, Interval, Intervals, Picture, Section, Table};

/// One method's answers.
pub struct Method<'a> {
    /// Its name.
    pub name: &'a str,
    /// What it answered.
    pub judged: &'a [Judged],
}

/// How each method did on single effects, in a sentence.
pub fn verdict(methods: &[Method<'_>]) -> String {
    let of = |method: &Method<'_>| {
        let all = |group: &Group| group.kind == "single" && group.tier == "all" && group.noise == "all";
        let groups = groups(method.judged);
        let (_, score) = groups.iter().find(|(group, _)| all(group))?;
        let share = |share: &Share| share.value().map(|value| format!("{:.0} %", 100.0 * value));
        Some(format!(
            "{}: {} of {} single effects named or classed rightly, {} wrongly.",
            method.name,
            share(&score.in_class)?,
            score.in_class.of,
            share(&score.wrong_name)?
        ))
    };
    let sentences: Vec<String> = methods.iter().filter_map(of).collect();
    if sentences.is_empty() { "No case has a single effect.".into() } else { sentences.join(" ") }
}

/// The whole report: power against size of all methods, then the scores of each.
pub fn sections(methods: &[Method<'_>]) -> Vec<Section> {
    let mut sections = vec![power_section(methods)];
    for method in methods {
        let of = |what: &str| format!("{}: {what}", method.name);
        sections.push(Section::new(of("scores")).text("Shares with Wilson's 95 % intervals.").table(scores(method)));
        let found = parameters(method.judged);
        if !found.is_empty() {
            sections.push(Section::new(of("parameters of rightly named effects")).table(parameter_table(&found)));
        }
        let failures = method.judged.iter().filter(|judged| judged.answer.verdict.is_none());
        let failures = failures.map(|judged| format!("No answer: {}: {}", judged.case, judged.answer.failure));
        let answers = Section::new(of("answers by what was hidden")).table(answers(method.judged));
        sections.push(answers.list(failures));
    }
    sections
}

/// Sizes of effects, counts rms, that cases are put together by.
const SIZES_COUNTS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

fn power_section(methods: &[Method<'_>]) -> Section {
    let headings = ["effect", "tier", "cases", "size, counts rms", "size, % of Coulomb friction"];
    let mut table = Table::new(headings.into_iter().chain(methods.iter().map(|method| method.name)));
    let powers: Vec<BTreeMap<String, Power>> = methods.iter().map(|method| power(method.judged)).collect();
    // Every method was asked about the same cases.
    for (name, first) in powers.first().into_iter().flatten() {
        for (tier, share, counts, percent) in &first.tiers {
            let hits = powers.iter().map(|of_method| {
                let tiers = of_method.get(name).map_or(&[][..], |power| &power.tiers);
                let same = tiers.iter().find(|(other, ..)| other == tier);
                same.map_or(Cell::Missing, |(_, share, ..)| Cell::count(share.hits))
            });
            let cells = [
                Cell::from(name.as_str()),
                Cell::from(tier.as_str()),
                Cell::count(share.of),
                Cell::fixed(*counts, 2),
                Cell::fixed(*percent, 1),
            ];
            table = table.row(cells.into_iter().chain(hits));
        }
    }
    // There is little room below an axis.
    let mut names = vec![format!("≤ {}", SIZES_COUNTS[0])];
    names.extend(SIZES_COUNTS.windows(2).map(|pair| format!("{}–{}", pair[0], pair[1])));
    names.push(format!("> {}", SIZES_COUNTS[SIZES_COUNTS.len() - 1]));
    let source = |(place, method): (usize, &Method<'_>)| {
        let interval = |share: &Share| {
            let ([low, high], value) = (share.interval()?, share.value()?);
            Some(Interval { low: 100.0 * low, value: 100.0 * value, high: 100.0 * high })
        };
        let intervals = by_size(method.judged, &SIZES_COUNTS).iter().map(interval).collect();
        (method.name.to_string(), Ink::Nth(place), intervals)
    };
    let sources = methods.iter().enumerate().map(source).collect();
    let content = Content::Intervals(Intervals { names, sources, logarithmic: false });
    let picture = Picture::of("Single effects named or classed rightly, by size in counts rms", ["", "%"], content)
        .note("With Wilson's 95 % intervals.");
    Section::new("Power against size")
        .pictures(vec![picture])
        .text("How many of the cases each method named or classed rightly.")
        .table(table)
        .text("Detection limit: the median size of the weakest tier of which at least half are named or classed rightly, as all \
               stronger ones are; – where not even the strongest is.")
        .table(limits(methods, &powers))
}

/// The detection limit of every effect and method, in counts rms and in % of Coulomb friction.
fn limits(methods: &[Method<'_>], powers: &[BTreeMap<String, Power>]) -> Table {
    let of_method = |method: &Method<'_>| [format!("{}: counts rms", method.name), format!("{}: %", method.name)];
    let headings: Vec<String> = methods.iter().flat_map(of_method).collect();
    let mut table = Table::new(std::iter::once("effect").chain(headings.iter().map(String::as_str)));
    for name in powers.first().into_iter().flat_map(BTreeMap::keys) {
        let limits = powers.iter().flat_map(|of_method| {
            let power = of_method.get(name);
            let counts = power.and_then(|power| power.limit_counts);
            let percent = power.and_then(|power| power.limit_percent_of_coulomb);
            [
                Cell::optional(counts, |counts| Cell::fixed(counts, 2)),
                Cell::optional(percent, |percent| Cell::fixed(percent, 1)),
            ]
        });
        table = table.row(std::iter::once(Cell::from(name.as_str())).chain(limits));
    }
    table
}

/// How many single effects were named or classed rightly, by size in counts rms on the joint where it is largest: up to the
/// first of `bounds_counts`, between each and the next, and above the last.
fn by_size(judged: &[Judged], bounds_counts: &[f64]) -> Vec<Share> {
    let mut shares = vec![Share::default(); bounds_counts.len() + 1];
    for one in judged.iter().filter(|one| one.truth.kind == Kind::Single) {
        let counts = one.truth.size_counts.iter().copied().fold(0.0, f64::max);
        let right = groups(std::slice::from_ref(one)).values().any(|score| score.in_class.hits > 0);
        shares[bounds_counts.iter().filter(|bound| counts > **bound).count()].add(right);
    }
    shares
}

fn scores(method: &Method<'_>) -> Table {
    let mut table = Table::new(["cases", "tier", "noise", "what", "hits", "of", "%", "from, %", "to, %"]);
    for (group, score) in groups(method.judged) {
        let row = |what: &str, cells: [Cell; 5]| {
            let names = [group.kind, group.tier.as_str(), group.noise, what].map(Cell::from);
            names.into_iter().chain(cells).collect::<Vec<Cell>>()
        };
        let gaps = |over_floor: &[f64]| gap_quantiles(over_floor).map_or([None; 2], |pair| pair.map(Some));
        let percent = |share: Option<f64>| Cell::optional(share, |share| Cell::fixed(100.0 * share, 1));
        for (what, share) in shares(group.kind, &score) {
            let [low, high] = share.interval().map_or([None; 2], |interval| interval.map(Some));
            let counts = [share.hits, share.of].map(Cell::count);
            let [hits, of] = counts;
            table = table.row(row(what, [hits, of, percent(share.value()), percent(low), percent(high)]));
        }
        let quantities = [
            ("held-out gap over floor: median, 95 %", gaps(&score.gap_over_floor)),
            ("the same where named: median, 95 %", gaps(&score.named_gap_over_floor)),
            ("mean class size", [score.mean_class_size().filter(|_| group.kind != "null"), None]),
            ("time in s: median, longest", [quantile(&score.seconds, 0.5), quantile(&score.seconds, 1.0)]),
        ];
        for (what, [first, second]) in quantities {
            if first.is_some() {
                let [first, second] = [first, second].map(|value| Cell::optional(value, |value| Cell::fixed(value, 3)));
                table = table.row(row(what, [Cell::Missing, Cell::Missing, first, second, Cell::Missing]));
            }
        }
    }
    table
}

fn parameter_table(found: &BTreeMap<(String, String), Parameters>) -> Table {
    let mut table = Table::new(["effect", "parameter", "median relative error, %", "stated 95 % intervals that hold"]);
    for ((effect, name), parameters) in found {
        let error = quantile(&parameters.relative_errors, 0.5).map(|error| 100.0 * error);
        table = table.row([
            Cell::from(effect.as_str()),
            Cell::from(name.as_str()),
            Cell::optional(error, |percent| Cell::fixed(percent, 1)),
            Cell::from(parameters.covered.to_string()),
        ]);
    }
    table
}

fn answers(judged: &[Judged]) -> Table {
    let mut table = Table::new(["hidden", "answered"]);
    for (hidden, answers) in confusion(judged) {
        let mut answers: Vec<(String, usize)> = answers.into_iter().collect();
        answers.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let answers: Vec<String> = answers.into_iter().map(|(answer, count)| format!("{answer} {count}")).collect();
        table = table.row([Cell::from(hidden), Cell::from(answers.join(", "))]);
    }
    table
}

fn shares(kind: &str, score: &Score) -> Vec<(&'static str, Share)> {
    let mut shares = match kind {
        "null" => vec![
            ("false names", score.wrong_name),
            ("said none", score.said_none),
            ("said unknown or partial", score.flagged_unknown),
        ],
        "outside" => vec![
            ("flagged unknown", score.flagged_unknown),
            ("wrong names", score.wrong_name),
            ("said none", score.said_none),
        ],
        _ => vec![
            ("right name", score.right_name),
            ("truth in a class of up to 3", score.in_class),
            ("wrong names", score.wrong_name),
            ("joint right", score.joint_right),
            ("said none", score.said_none),
            ("said unknown or partial", score.flagged_unknown),
        ],
    };
    if score.failed.hits > 0 {
        shares.push(("no answer", score.failed));
    }
    shares
}

/// The whole report as JSON.
pub fn json(methods: &[Method<'_>]) -> Value {
    let share = |share: &Share| json!({"hits": share.hits, "of": share.of, "share": share.value(), "wilson95": share.interval()});
    let of_method = |method: &Method<'_>| {
        let groups: Vec<Value> = groups(method.judged)
            .iter()
            .map(|(group, score)| {
                json!({
                    "kind": group.kind,
                    "tier": group.tier,
                    "noise": group.noise,
                    "right_name": share(&score.right_name),
                    "in_class": share(&score.in_class),
                    "mean_class_size": score.mean_class_size(),
                    "wrong_name": share(&score.wrong_name),
                    "joint_right": share(&score.joint_right),
                    "said_none": share(&score.said_none),
                    "flagged_unknown": share(&score.flagged_unknown),
                    "failed": share(&score.failed),
                    "held_out_gap_over_floor": gap_quantiles(&score.gap_over_floor),
                    "named_held_out_gap_over_floor": gap_quantiles(&score.named_gap_over_floor),
                    "seconds": {"median": quantile(&score.seconds, 0.5), "longest": quantile(&score.seconds, 1.0)},
                })
            })
            .collect();
        let parameters: Vec<Value> = parameters(method.judged)
            .iter()
            .map(|((effect, name), found)| {
                json!({
                    "effect": effect,
                    "parameter": name,
                    "median_relative_error": quantile(&found.relative_errors, 0.5),
                    "covered": share(&found.covered),
                })
            })
            .collect();
        json!({
            "method": method.name,
            "cases": method.judged.len(),
            "groups": groups,
            "power": power(method.judged),
            "parameters": parameters,
            "confusion": confusion(method.judged),
        })
    };
    Value::Array(methods.iter().map(of_method).collect())
}

#[cfg(test)]
mod tests {
    use super::super::answer::{Answer, Named, Verdict};
    use super::super::case::{Hidden, Truth};
    use super::*;

    /// A case with cogging hidden, and named or not.
    fn case(kind: Kind, size_counts: [f64; 2], named: bool) -> Judged {
        let (name, joint) = ("cogging".to_string(), "2".to_string());
        let effects = if named {
            vec![Named { name: name.clone(), joint: joint.clone(), ..Named::default() }]
        } else {
            Vec::new()
        };
        let effect = vec![Hidden { name, joint, parameters: BTreeMap::new() }];
        let verdict = Some(Verdict { verdict: "named".into(), effects, gap: None });
        let (size_counts, size_of_coulomb) = (size_counts.to_vec(), vec![0.1]);
        let truth = Truth { kind, tier: "clear".into(), noisy: false, size_counts, size_of_coulomb, effect };
        Judged { case: "case".into(), truth, answer: Answer { verdict, ..Answer::default() } }
    }

    #[test]
    fn single_effects_are_counted_by_the_size_on_the_joint_where_they_are_largest() {
        let single = Kind::Single;
        let cases = [
            case(single, [0.1, 4.0], true),
            case(single, [1.5, 0.2], true),
            case(single, [0.4, 0.0], false),
            case(Kind::Pair, [9.0, 0.0], true),
        ];
        let share = |hits: usize| Share { hits, of: 1 };
        assert_eq!(by_size(&cases, &[0.4, 2.0]), [share(0), share(1), share(1)]);
    }
}

//! The scores as a table and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::interval::{Share, quantile};
use super::score::{Group, Judged, Score, confusion, groups, parameters, power};

/// One method's answers.
pub struct Method<'a> {
    /// Its name.
    pub name: &'a str,
    /// What it answered.
    pub judged: &'a [Judged],
}

/// The whole report as text.
pub fn text(methods: &[Method<'_>]) -> String {
    let mut text = String::new();
    for method in methods {
        section(&mut text, method);
    }
    text
}

fn section(text: &mut String, method: &Method<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{}: {} cases; shares with Wilson's 95 % intervals", method.name, method.judged.len());
    for (group, score) in groups(method.judged) {
        let Group { kind, tier, noise } = &group;
        let _ = writeln!(text, "  {kind}, {tier}, {noise}");
        for (label, share) in shares(kind, &score) {
            let _ = writeln!(text, "    {label:<28} {share}");
        }
        let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.3}"));
        if let Some([median, high]) = score.gap_quantiles() {
            let _ = writeln!(text, "    held-out gap over floor      median {median:.3}, 95 % {high:.3}");
        }
        if *kind != "null" {
            let _ = writeln!(text, "    mean class size              {}", number(score.mean_class_size()));
        }
        let _ = writeln!(
            text,
            "    time in s                    median {}, longest {}",
            number(quantile(&score.seconds, 0.5)),
            number(quantile(&score.seconds, 1.0))
        );
    }
    let _ =
        writeln!(text, "  power against size (named or classed rightly; size in counts rms | % of Coulomb friction)");
    for (name, power) in power(method.judged) {
        let limit = match (power.limit_counts, power.limit_percent_of_coulomb) {
            (Some(counts), Some(percent)) => format!("limit {counts:.2} | {percent:.1} %"),
            _ => "not even the strongest".to_owned(),
        };
        let _ = write!(text, "    {name:<28} {limit:<28}");
        for (tier, share, counts, percent) in &power.tiers {
            let _ = write!(text, "  {tier} {}/{} at {counts:.2} | {percent:.1}", share.hits, share.of);
        }
        text.push('\n');
    }
    let found = parameters(method.judged);
    if !found.is_empty() {
        let _ = writeln!(
            text,
            "  parameters of rightly named effects: median relative error, stated 95 % intervals that hold"
        );
        for ((effect, name), parameters) in found {
            let error = quantile(&parameters.relative_errors, 0.5).unwrap_or(f64::NAN);
            let _ = writeln!(text, "    {effect:<28} {name:<28} {:5.1} %  {}", 100.0 * error, parameters.covered);
        }
    }
    let _ = writeln!(text, "  answers by what was hidden");
    for (hidden, answers) in confusion(method.judged) {
        let mut answers: Vec<(String, usize)> = answers.into_iter().collect();
        answers.sort_by(|one, other| other.1.cmp(&one.1));
        let answers: Vec<String> = answers.into_iter().map(|(answer, count)| format!("{answer} {count}")).collect();
        let _ = writeln!(text, "    {hidden:<28} {}", answers.join(", "));
    }
    for judged in method.judged.iter().filter(|judged| judged.answer.verdict.is_none()) {
        let _ = writeln!(text, "  no answer: {}: {}", judged.case, judged.answer.failure);
    }
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
                    "held_out_gap_over_floor": score.gap_quantiles(),
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

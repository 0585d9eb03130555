//! What was found, in words.

use super::decide::Case;
use super::findings::{Finding, Gap, force_gap};
use super::instance::Instance;
use super::verdict::{CLOSED, Decision, MOST_TORQUE_NOISE, Verdict};

/// Where the gap of an effect's joint fell most: the part of the recordings with the largest share for its length.
pub fn place(case: &Case, decision: &Decision, instance: &Instance) -> String {
    let train = &case.train;
    let experiment = train.setting.experiment;
    let joint = instance.joint;
    let [_, before, after] = &decision.innovations;
    let fastest =
        |trace: &super::trace::Trace| trace.velocity_rad_s[joint].iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    type Inside = fn(&super::trace::Trace, usize, usize, f64) -> bool;
    let regions: [(&str, Inside); 4] = [
        ("within 0.3 s after its reversals", |trace, joint, k, _| trace.since_reversal_s[joint][k] < 0.3),
        ("at low speed", |trace, joint, k, fastest| trace.velocity_rad_s[joint][k].abs() < 0.25 * fastest),
        ("at high speed", |trace, joint, k, fastest| trace.velocity_rad_s[joint][k].abs() > 0.6 * fastest),
        ("in the later half of the recordings", |trace, _, k, _| 2 * k > trace.time_s.len()),
    ];
    let mut best = (1.3, String::new());
    let mut whole = 0.0;
    for (words, inside) in regions {
        let (mut part, mut all, mut samples, mut total) = (0.0, 0.0, 0.0, 0.0);
        for (index, segment) in experiment.segments.iter().enumerate() {
            let trace = &train.traces[index];
            let fastest = fastest(trace);
            for k in experiment.settled(segment) {
                let gain = before[index][joint][k].powi(2) - after[index][joint][k].powi(2);
                let here = inside(trace, joint, k, fastest);
                part += if here { gain } else { 0.0 };
                samples += f64::from(u8::from(here));
                all += gain;
                total += 1.0;
            }
        }
        whole = all;
        if all > 0.0 && samples > 0.0 {
            let (share, length) = (part / all, samples / total);
            if share / length > best.0 {
                best = (
                    share / length,
                    format!(
                        ", {words} ({:.0} % of the time): {:.0} % of its gain",
                        100.0 * length,
                        100.0 * share.min(1.0)
                    ),
                );
            }
        }
    }
    let name = instance.joint_name(experiment.robot);
    let joint_words = if name == "both" { "both joints".to_string() } else { format!("joint {name}") };
    if whole <= 0.0 {
        // Base parameters can imitate it: it shows in how far they had to move.
        return format!("{joint_words}, by how far the base parameters would have to leave their standard errors");
    }
    format!("{joint_words}{}; {:.0} % of the excess explained", best.1, 100.0 * decision.share)
}

/// What was found, sentence by sentence: `found` are the effects, `known` how many the baseline came with, `priors`
/// whether it came with standard errors.
pub fn sentences(
    case: &Case,
    decision: &Decision,
    found: &[(Finding, Instance)],
    gap: &Gap,
    known: usize,
    priors: bool,
) -> Vec<String> {
    let mut sentences = Vec::new();
    let train = &case.train;
    let robot = train.setting.experiment.robot;
    let gaps = match gap.held_out {
        Some(held_out) => format!(
            "gap on what was kept back {:.3} → {:.3} counts rms, floor {:.3}",
            held_out.before, held_out.after, gap.floor
        ),
        None => format!("gap {:.3} → {:.3} counts rms, floor {:.3}", gap.before, gap.after, gap.floor),
    };
    match decision.verdict {
        Verdict::Named | Verdict::Partial => {
            for (finding, instance) in found {
                let values: Vec<String> = finding
                    .parameters
                    .iter()
                    .filter(|(name, _)| !name.contains("phase"))
                    .map(|(name, parameter)| match parameter.standard_error {
                        Some(error) => format!("{name} = {:.4e} ± {error:.1e}", parameter.value),
                        None => format!("{name} = {:.4e}", parameter.value),
                    })
                    .collect();
                let whose =
                    if finding.joint == "both" { "arm".to_string() } else { format!("joint {}", finding.joint) };
                let class = if finding.class.len() > 1 {
                    format!("; these recordings do not tell it from {}", finding.class[1..].join(" or "))
                } else {
                    String::new()
                };
                sentences.push(format!(
                    "{whose}: {} ({}: {}); shows on {}{class}",
                    instance.kind.phrase,
                    finding.name,
                    values.join(", "),
                    finding.place
                ));
            }
            sentences.push(gaps);
            if decision.verdict == Verdict::Partial {
                sentences.push(format!(
                    "this explains {:.0} % of the excess; the rest is not explained by any effect of the library",
                    100.0 * decision.share
                ));
            }
        }
        Verdict::None => {
            sentences.push(format!(
                "nothing is missing that these recordings could show: the gap of {:.3} counts rms is within {:.0} % of the \
                 floor of {:.3}",
                gap.after,
                100.0 * (CLOSED - 1.0),
                decision.floor
            ));
        }
        Verdict::Unknown => {
            sentences.push(format!(
                "something is missing that no effect of the library explains: the best of them explain {:.0} % of the \
                 excess; {gaps}",
                100.0 * decision.share
            ));
        }
    }
    if let Some([before, after]) = force_gap(case, decision, known, decision.verdict != Verdict::Unknown) {
        sentences.push(format!("closed-loop force gap {before:.3} → {after:.3} N (N m) rms"));
    }
    for (named, left) in robot.joints.iter().zip(&decision.left) {
        if left.is_too_large() {
            sentences.push(format!(
                "joint {}: an irregular torque of {:.1} % of the Coulomb friction is left; no robot is expected to have more \
                 than {:.1} %",
                named.name,
                100.0 * left.share_of_coulomb,
                100.0 * MOST_TORQUE_NOISE
            ));
        }
        if let Some(tone_hz) = left.tone_hz() {
            sentences.push(format!(
                "joint {}: a tone of {tone_hz:.2} Hz is left that noise does not have: something swings or turns",
                named.name
            ));
        }
        if left.is_uneven() {
            sentences.push(format!(
                "joint {}: one recording is left with {:.1} times as much slow power as another; noise is the same in all",
                named.name, left.uneven
            ));
        }
    }
    if !priors {
        sentences.push(
            "no baseline was given: it was identified from these recordings, so changes of inertia, load, friction levels \
             and torque constants are in it already and cannot be named"
                .into(),
        );
    }
    sentences
}

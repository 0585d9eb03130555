//! Round by round: screen the library, refit what leads, take the best, look at all again; and in the end a verdict.

use super::engine::{Engine, Fitted, Free};
use super::held_out::adapted;
use super::hypothesis::Hypothesis;
use super::library::{Instance, kind};
use super::linear::{Base, Column};
use super::noise::{self, Noise};
use super::screen::{self, Feature, Scored};
use super::threshold::null_scores;
use crate::identify::Columns;

/// Effects that are looked for at most.
const MOST_EFFECTS: usize = 5;
/// Candidates of one round that are refitted.
const CONFIRMED: usize = 5;
/// Beyond those, candidates that look like one of them.
const ALIKE: f64 = 0.9;
const ALIKE_AT_MOST: usize = 3;
/// Candidates refitted beside those, while the gap is [`FAR`] from the floor: those that explain most of it in counts.
const PLAINLY: usize = 2;
const FAR: f64 = 1.5;
/// How many such shortlists are gone through until something brings the model nearer.
const SHORTLISTS: usize = 3;
/// By what factor an effect may widen the gap on the recordings it is judged by: chance, not harm.
const WORSE: f64 = 1.02;
/// A score must beat the largest of the null simulations by this factor and this much.
const MARGIN_FACTOR: f64 = 1.25;
const MARGIN: f64 = 10.0;
/// Features are taken out of the noise estimate from this score on.
const CLEANING: f64 = 12.0;
const CLEANED: usize = 6;
/// No robot's unknown torque is larger than this share of its Coulomb friction: what is larger is an effect.
pub const MOST_TORQUE_NOISE: f64 = 0.035;
/// Within this factor of the floor a gap is closed.
pub const CLOSED: f64 = 1.1;
/// Effects that are named together at most: with enough of them anything can be imitated.
const MOST_NAMED: usize = 2;
/// Share of the excess of the recordings kept back from which effects foretell them well.
const FORETOLD: f64 = 0.9;
/// Recordings kept back are closed within this factor: they have nothing fitted to them.
const HELD_OUT_CLOSED: f64 = 1.25;
/// While the gap is this close to the floor nothing more is looked for.
const ENOUGH: f64 = 1.02;
/// Effects together explain at least this share of the excess to be named, and this much to be named in part.
const NAMED_SHARE: f64 = 0.75;
const PARTIAL_SHARE: f64 = 0.5;
/// Candidates within this ΔBIC and this share of the gap are not told apart.
const SAME_BIC: f64 = 6.0;
const SAME_GAP: f64 = 0.03;
/// Members of a class at most.
const CLASS: usize = 3;

/// A candidate that was refitted.
#[derive(Clone, Debug)]
pub struct Rival {
    /// The effect.
    pub instance: Instance,
    /// By how much it betters the model before, less what its parameters cost.
    pub delta_bic: f64,
    /// Gap on the recordings kept back, or on those fitted without any.
    pub held_out_gap: f64,
}

/// An effect that was taken.
#[derive(Clone, Debug)]
pub struct Accepted {
    /// Index of its kind among the hypothesis's effects is by this name and joint.
    pub name: &'static str,
    /// Its joint.
    pub joint: usize,
    /// Names that cannot be told from it, its own first.
    pub class: Vec<&'static str>,
    /// Its score when it was taken.
    pub delta_bic: f64,
}

/// The verdicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The effects explain what was wrong.
    Named,
    /// Nothing is wrong.
    None,
    /// Something is wrong that no effect of the library explains.
    Unknown,
    /// The effects explain part of it.
    Partial,
}

/// Where the rounds ended.
pub struct Decision {
    /// The verdict.
    pub verdict: Verdict,
    /// The final model.
    pub fitted: Fitted,
    /// What it was named by, in the order of acceptance.
    pub accepted: Vec<Accepted>,
    /// Everything refitted on the way.
    pub rivals: Vec<Rival>,
    /// Noise of the recordings.
    pub noise: Noise,
    /// Innovations of baseline, null refit and final model.
    pub innovations: [Columns; 3],
    /// Largest null score, and the threshold made of it.
    pub null_score: f64,
    /// See above.
    pub threshold: f64,
    /// Gaps in counts rms: floor, of the baseline, of the final model.
    pub floor: f64,
    /// Of the baseline as given.
    pub before: f64,
    /// Of the final model.
    pub after: f64,
    /// On the recordings kept back: of the baseline as given and of the final model.
    pub held_out: Option<[f64; 2]>,
    /// Share of the excess χ² that the effects explain.
    pub share: f64,
}

/// What an explanation works on.
pub struct Case<'a> {
    /// Recordings to fit.
    pub train: Engine<'a>,
    /// Recordings kept back.
    pub check: Option<Engine<'a>>,
    /// Seed of the null simulations.
    pub seed: u64,
    /// Told of every step.
    pub progress: &'a (dyn Fn(&'static str) + Sync),
}

impl Case<'_> {
    /// Rounds and verdict. `known` are the effects the baseline came with; none if the baseline itself is impossible.
    pub fn decide(&self, known: &[Instance]) -> Option<Decision> {
        let train = &self.train;
        let rows = train.setting.rows;
        (self.progress)("refitting the baseline");
        let start = Hypothesis::baseline(train.baseline, known);
        let baseline_innovations = train.innovations(&start);
        let before = train.gap(&baseline_innovations);
        let flat: Noise = rows.white_power(&baseline_innovations).map(|power| {
            let rounding = if train.setting.experiment.robot.quantised { 1.0 / 12.0 } else { 1e-6 };
            noise::JointNoise::white(if power.is_finite() { power.max(rounding) } else { rounding })
        });
        let first = train.refit(&start, &train.weights(&flat), &[], Free::All, 5)?;
        let first_noise = noise::most_likely(rows, &first.residual.motion, flat.map(|n| n.white_counts2), 6.0);
        let mut current = train.refit(&first.hypothesis, &train.weights(&first_noise), &first.columns, Free::All, 3)?;
        let mut noise = first_noise;
        let mut accepted: Vec<Accepted> = Vec::new();
        let mut rivals = Vec::new();
        let mut null: Option<Fitted> = None;
        let mut null_innovations = Columns::new();
        let (mut null_score, mut threshold) = (0.0, f64::INFINITY);
        let white: Noise = flat;
        let mut most_gap = f64::INFINITY;
        for round in 0..=MOST_EFFECTS {
            let innovations = train.innovations(&current.hypothesis);
            if round > 0 && train.gap(&innovations) <= ENOUGH * train.floor(&white) {
                // Nothing but rounding is left: no noise either.
                noise = noise::most_likely(rows, &current.residual.motion, white.map(|n| n.white_counts2), 6.0);
                break;
            }
            let stage = train.stage(&current, &innovations);
            (self.progress)("screening the library");
            let features = screen::features(&stage, &train.weights(&noise));
            let cleaned = screen::cleaned_noise(&stage, &features, CLEANING, CLEANED);
            noise = train.plausible(&cleaned, MOST_TORQUE_NOISE);
            let weights = train.weights(&noise);
            // The same model under the weights that everything is judged by.
            if let Some(again) = train.refit(&current.hypothesis, &weights, &current.columns, Free::All, 2) {
                current = again;
            }
            if round == 0 {
                (self.progress)("simulating robots that lack nothing");
                let plausible = train.plausible(&noise, MOST_TORQUE_NOISE);
                let scores = null_scores(train, &current, &features, &plausible, self.seed);
                null_score = largest_but_outliers(scores);
                threshold = MARGIN_FACTOR * null_score + MARGIN;
                null = Some(current.clone());
                null_innovations = innovations.clone();
            }
            if round == MOST_EFFECTS {
                break;
            }
            let floor = train.floor(&train.plausible(&noise, MOST_TORQUE_NOISE));
            if round > 0 && train.gap(&innovations) <= ENOUGH * floor {
                break;
            }
            let innovations = train.innovations(&current.hypothesis);
            let stage = train.stage(&current, &innovations);
            let (precisions, offsets) = screen::priors(&stage);
            let base = Base::new(&current.columns, &current.residual, &weights, &precisions, &offsets);
            let scored = screen::score(&base, &features, rows.count());
            // Far from the floor the noise says little about what is wrong; what the arm does in counts says more.
            let gap = train.gap(&innovations);
            let mut leading: Vec<&Scored> = Vec::new();
            if gap > FAR * floor {
                let plain = train.weights(&[noise::JointNoise::white(gap * gap); 2]);
                let base = Base::new(&current.columns, &current.residual, &plain, &precisions, &offsets);
                let kind = |one: &Scored| (features[one.feature].kind.name, features[one.feature].joint);
                for one in screen::score(&base, &features, rows.count()) {
                    if leading.len() == PLAINLY || one.delta_bic <= 0.0 {
                        break;
                    }
                    if leading.iter().all(|other| kind(other) != kind(&one)) {
                        leading.extend(scored.iter().find(|other| kind(other) == kind(&one)));
                    }
                }
            }
            let most = CONFIRMED + leading.len();
            let scored: Vec<&Scored> = leading.into_iter().chain(&scored).collect();
            (self.progress)("refitting what leads");
            if round == 0 {
                let reached = self.judging_gap(&current.hypothesis).min(self.judging_gap(&start));
                // Near the floor the gap hardly tells; far from it an effect that does not narrow it explains nothing.
                most_gap = reached * if gap > FAR * floor { 1.0 - SAME_GAP } else { WORSE };
            }
            let mut confirmed: Vec<(Rival, Fitted)> = Vec::new();
            for _ in 0..SHORTLISTS {
                let starts = shortlist(&base, &features, &scored, threshold, &weights, &confirmed, most);
                if starts.is_empty() {
                    break;
                }
                let tried = self.confirm(&current, starts, &weights, round == 0);
                rivals.extend(tried.iter().map(|(rival, _)| rival.clone()));
                confirmed.extend(tried);
                confirmed.sort_by(|a, b| b.0.delta_bic.total_cmp(&a.0.delta_bic));
                // What lies further down is looked at only where nothing that leads brings the model nearer.
                if confirmed.iter().any(|(rival, _)| rival.delta_bic >= threshold && rival.held_out_gap <= most_gap) {
                    break;
                }
            }
            // An effect may weigh more where the noise is small and still lead the model away from the motion.
            confirmed.retain(|(rival, _)| rival.held_out_gap <= most_gap);
            let Some((best, best_fitted)) = confirmed.first().cloned() else { break };
            if best.delta_bic < threshold {
                break;
            }
            let class = class(&confirmed);
            accepted.push(Accepted {
                name: best.instance.kind.name,
                joint: best.instance.joint,
                class,
                delta_bic: best.delta_bic,
            });
            // Everything once more, nothing taken from before.
            current = train.refit(&best_fitted.hypothesis, &weights, &[], Free::All, 4).unwrap_or(best_fitted);
            self.take_back(&mut current, &mut accepted, known.len(), &weights, threshold);
        }
        let null = null?;
        Some(self.verdict(
            start,
            null,
            null_innovations,
            baseline_innovations,
            current,
            accepted,
            rivals,
            noise,
            before,
            (null_score, threshold),
        ))
    }

    /// Refits the shortlisted effects beside `current`, best first.
    fn confirm(
        &self,
        current: &Fitted,
        starts: Vec<Instance>,
        weights: &[f64],
        from_baseline: bool,
    ) -> Vec<(Rival, Fitted)> {
        let train = &self.train;
        let penalty = (train.setting.rows.count() as f64).ln();
        let mut confirmed: Vec<(Rival, Fitted)> = Vec::new();
        for start in starts {
            let mut hypothesis = current.hypothesis.with(start);
            if from_baseline {
                // The refit without the effect may have swallowed it: with the base where that left it, an effect of
                // the same kind has nothing to explain.
                hypothesis.base = train.baseline.values.of(&train.baseline.free);
            }
            let Some(alone) = train.refit(&hypothesis, weights, &current.columns, Free::Last, 3) else { continue };
            let Some(fitted) = train.refit(&alone.hypothesis, weights, &current.columns, Free::All, 4) else {
                continue;
            };
            let Some(instance) = fitted.hypothesis.named.last().cloned() else { continue };
            let parameters = instance.flat().len() as f64;
            let delta_bic = current.cost - fitted.cost - parameters * penalty;
            let key = (instance.kind.name, instance.joint);
            let same = |rival: &Rival| (rival.instance.kind.name, rival.instance.joint) == key;
            let rival = Rival { instance, delta_bic, held_out_gap: f64::NAN };
            match confirmed.iter_mut().find(|(other, _)| same(other)) {
                Some(other) if other.0.delta_bic < delta_bic => *other = (rival, fitted),
                Some(_) => {}
                None => confirmed.push((rival, fitted)),
            }
        }
        confirmed.sort_by(|a, b| b.0.delta_bic.total_cmp(&a.0.delta_bic));
        for (rival, fitted) in &mut confirmed {
            rival.held_out_gap = self.judging_gap(&fitted.hypothesis);
        }
        confirmed
    }

    /// The gap on the recordings kept back, or on those fitted without any.
    fn judging_gap(&self, hypothesis: &Hypothesis) -> f64 {
        match &self.check {
            Some(check) => check.gap(&check.innovations(&adapted(check, hypothesis, &check_weights(check)))),
            None => self.train.gap(&self.train.innovations(hypothesis)),
        }
    }

    /// Drops accepted effects that the later ones have made superfluous.
    fn take_back(
        &self,
        current: &mut Fitted,
        accepted: &mut Vec<Accepted>,
        known: usize,
        weights: &[f64],
        threshold: f64,
    ) {
        let penalty = (self.train.setting.rows.count() as f64).ln();
        while accepted.len() > 1 {
            let mut weakest: Option<(f64, usize, Fitted)> = None;
            for index in 0..accepted.len() - 1 {
                let mut without = current.hypothesis.clone();
                let parameters = without.named[known + index].flat().len() as f64;
                without.named.remove(known + index);
                let Some(fitted) = self.train.refit(&without, weights, &[], Free::All, 3) else { continue };
                let loss = fitted.cost - current.cost - parameters * penalty;
                if weakest.as_ref().is_none_or(|(least, ..)| loss < *least) {
                    weakest = Some((loss, index, fitted));
                }
            }
            match weakest {
                Some((loss, index, fitted)) if loss < threshold => {
                    accepted.remove(index);
                    *current = fitted;
                }
                _ => break,
            }
        }
    }

    #[expect(clippy::too_many_arguments, reason = "everything the rounds have found")]
    fn verdict(
        &self,
        start: Hypothesis,
        null: Fitted,
        null_innovations: Columns,
        baseline_innovations: Columns,
        fitted: Fitted,
        accepted: Vec<Accepted>,
        rivals: Vec<Rival>,
        noise: Noise,
        before: f64,
        (null_score, threshold): (f64, f64),
    ) -> Decision {
        let train = &self.train;
        let plausible = train.plausible(&noise, MOST_TORQUE_NOISE);
        let weights = train.weights(&plausible);
        let mut floor = train.floor(&plausible);
        let final_innovations = train.innovations(&fitted.hypothesis);
        let after = train.gap(&final_innovations);
        let mut held_out = None;
        let mut foretold = share_unknown();
        if let Some(check) = &self.check {
            let weights = check.weights(&plausible);
            let best = adapted(check, &fitted.hypothesis, &weights);
            let first = adapted(check, &start, &weights);
            let best_innovations = check.innovations(&best);
            held_out = Some([check.gap(&check.innovations(&first)), check.gap(&best_innovations)]);
            // A few seconds of slow noise are louder or quieter by chance: the floor is that of the louder recordings,
            // as far as it can be noise at all.
            let rows = check.setting.rows.of(&best_innovations);
            let own = noise::most_likely(check.setting.rows, &rows, plausible.map(|n| n.white_counts2), 0.0);
            floor = floor.max(check.floor(&check.plausible(&own, MOST_TORQUE_NOISE)));
            // What the effects bring beyond base parameters alone, where nothing was fitted.
            let alone = check.gap(&check.innovations(&adapted(check, &null.hypothesis, &weights)));
            let after = check.gap(&best_innovations);
            let excess = alone * alone - floor * floor;
            foretold = if excess > 0.0 { (alone * alone - after * after) / excess } else { 1.0 };
        }
        // What noise like this leaves of χ².
        let current = |fitted: &Fitted| fitted.residual.current.iter().map(|x| x * x).sum::<f64>();
        let expected = train.setting.rows.count() as f64 + current(&fitted).min(current(&null));
        let (null_cost, final_cost) = (train.cost(&null, &weights), train.cost(&fitted, &weights));
        let excess = null_cost - expected.min(final_cost);
        let share = if excess > 0.0 { ((null_cost - final_cost) / excess).clamp(0.0, 1.0) } else { 0.0 };
        let prior_cost = train.prior_cost(&fitted.hypothesis);
        let known = train.baseline.standard_error.iter().filter(|error| error.is_finite()).count() as f64;
        let priors_complain = prior_cost > known + 10.0 * (2.0 * known).sqrt();
        let gap_complains = after > CLOSED * floor;
        let closes = held_out_agrees(held_out, floor)
            && (!gap_complains || (accepted.len() == 1 && foretold >= FORETOLD && after <= HELD_OUT_CLOSED * floor));
        let verdict = if accepted.is_empty() {
            if gap_complains || priors_complain { Verdict::Unknown } else { Verdict::None }
        } else if share >= NAMED_SHARE && closes && accepted.len() <= MOST_NAMED {
            Verdict::Named
        } else if share >= PARTIAL_SHARE
            && foretold >= if accepted.len() <= MOST_NAMED { PARTIAL_SHARE } else { FORETOLD }
        {
            Verdict::Partial
        } else {
            Verdict::Unknown
        };
        Decision {
            verdict,
            fitted,
            accepted,
            rivals,
            noise: plausible,
            innovations: [baseline_innovations, null_innovations, final_innovations],
            null_score,
            threshold,
            floor,
            before,
            after,
            held_out,
            share,
        }
    }
}

/// The largest of the null scores but for two: a simulated start that happens to stick far off is no measure of chance.
fn largest_but_outliers(mut scores: Vec<f64>) -> f64 {
    scores.sort_by(|a, b| b.total_cmp(a));
    scores.get(2).copied().unwrap_or(0.0).max(0.0)
}

/// Without recordings kept back nothing speaks against the effects.
fn share_unknown() -> f64 {
    1.0
}

/// Whether the recordings kept back are closed as well, or nearly, and no worse than with the baseline.
fn held_out_agrees(held_out: Option<[f64; 2]>, floor: f64) -> bool {
    held_out.is_none_or(|[before, after]| after <= HELD_OUT_CLOSED * floor && after <= before.max(CLOSED * floor))
}

/// Weights that phases and instants of other recordings are found by.
fn check_weights(check: &Engine) -> Vec<f64> {
    let rounding = if check.setting.experiment.robot.quantised { 1.0 / 12.0 } else { 1.0 };
    check.weights(&[noise::JointNoise::white(rounding); 2])
}

/// The effects to refit: the best start of each of the leading ones, two of those whose refits get stuck, and what looks
/// like one of them; without those `tried` before.
fn shortlist(
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
        if one.delta_bic < 0.5 * threshold.min(2.0 * MARGIN) {
            break;
        }
        let feature = &features[one.feature];
        if is_tried(feature) {
            continue;
        }
        let stuck = matches!(feature.kind.name, "backlash" | "joint-flexibility");
        let key = kinds.iter_mut().find(|(name, joint, _)| *name == feature.kind.name && *joint == feature.joint);
        match key {
            Some((_, _, count)) if *count >= if stuck { 3 } else { 1 } => continue,
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

/// The names that cannot be told from the best candidate, its own first.
fn class(confirmed: &[(Rival, Fitted)]) -> Vec<&'static str> {
    let Some((best, _)) = confirmed.first() else { return Vec::new() };
    let mut class = vec![best.instance.kind.name];
    for name in best.instance.kind.equivalent {
        if !class.contains(name) && kind(name).is_some() {
            class.push(name);
        }
    }
    for (rival, _) in &confirmed[1..] {
        let near = best.delta_bic - rival.delta_bic <= SAME_BIC
            && (rival.held_out_gap - best.held_out_gap).abs() <= SAME_GAP * best.held_out_gap;
        let name = rival.instance.kind.name;
        if near && class.len() < CLASS && !class.contains(&name) {
            class.push(name);
        }
    }
    class
}

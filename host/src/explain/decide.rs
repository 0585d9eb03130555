//! Round by round: screen the library, refit what leads, take the best, look at all again.

use std::path::Path;

use super::engine::{Engine, Fitted, Free};
use super::held_out::{adapted, kept_back_floor};
use super::hypothesis::Hypothesis;
use super::instance::Instance;
use super::linear::{Base, inner};
use super::noise::{self, Noise};
use super::screen::{self, Scored};
use super::shortlist::{SAME_GAP, class, preferred_first, shortlist};
use super::teeth;
use super::threshold::kept_null_scores;
use super::verdict::{
    CLOSED, Decision, FORETELLS, FORETOLD_IN_PART, KEPT, MOST_NAMED, PROVEN, Rounds, Verdict, priors_complain,
};
use crate::identify::Columns;

/// Effects that are looked for at most.
const MOST_EFFECTS: usize = 5;
/// Candidates of one round that are refitted.
const CONFIRMED: usize = 5;
/// Candidates refitted beside those, while the gap is [`FAR`] from the floor: those that explain most of it in counts.
const PLAINLY: usize = 2;
const FAR: f64 = 1.5;
/// Far from the floor so many of those that lead are refitted to their end: one of two effects, or a large one, is a long way
/// from where it begins.
const LEADERS: usize = 4;
/// Gaps within this factor of the least are about as near.
const AS_NEAR: f64 = 1.2;
/// What brings this share of the most is about as much.
const AS_MUCH: f64 = 0.5;
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
/// While effects are looked for no unknown torque is taken for larger than this share of the Coulomb friction: weighing by
/// a noise that is too small brings out the small faults that every model has.
const MOST_TORQUE_NOISE: f64 = 0.035;
/// While the gap is this close to the floor nothing more is looked for.
const ENOUGH: f64 = 1.02;
/// Where the gap is closed this far, one more effect has to bring this share of what the ones before brought: every
/// model is a little wrong, and what that leaves always resembles something.
const NEARLY_CLOSED: f64 = 1.25;
const MORE: f64 = 0.01;
/// The same where noise alone leaves as much as is left: then it has to be no small fault of what was found.
const MORE_THAN_NOISE: f64 = 0.1;
/// What narrows the gap on recordings kept back by this share is worth it whatever the ones before brought; and where little
/// but rounding is left, nothing is that does not narrow it by the lesser one.
const PLAINLY_NARROWER: f64 = 0.05;
const NARROWER: f64 = 0.015;
/// Where a gap on recordings kept back is within this factor of what noise leaves of them, it is noise.
const AS_NOISE: f64 = 1.05;
/// How often noise and model are found anew from each other after an effect is taken.
const TURNS: usize = 3;
/// Iterations of such a turn at most, and where there are instants, which creep.
const SETTLED_AFTER: usize = 4;
const INSTANTS_SETTLED_AFTER: usize = 12;
/// A refit that widens the gap by this factor has gone astray.
const ASTRAY: f64 = 1.1;

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

/// What an explanation works on.
pub struct Case<'a> {
    /// Recordings to fit.
    pub train: Engine<'a>,
    /// Recordings kept back.
    pub check: Option<Engine<'a>>,
    /// Seed of the null simulations.
    pub seed: u64,
    /// Folder to keep the scores of null simulations in.
    pub kept_thresholds: Option<&'a Path>,
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
        let flat: Noise = rows.white_counts2(&baseline_innovations).map(noise::JointNoise::white);
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
        let (mut most_gap, mut noise_gap) = (f64::INFINITY, f64::INFINITY);
        let mut first: Option<(Fitted, Accepted, Noise)> = None;
        for round in 0..=MOST_EFFECTS {
            let innovations = train.innovations(&current.hypothesis);
            let settled = round > 0 && !priors_complain(train, &current.hypothesis);
            if settled && train.gap(&innovations) <= ENOUGH * train.floor(&white) {
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
                let scores = kept_null_scores(train, &current, &features, &plausible, self.seed, self.kept_thresholds);
                null_score = largest_but_outliers(scores);
                threshold = MARGIN_FACTOR * null_score + MARGIN;
                null = Some(current.clone());
                null_innovations = innovations.clone();
            }
            if round == MOST_EFFECTS {
                break;
            }
            let floor = train.floor(&train.plausible(&noise, MOST_TORQUE_NOISE));
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
                noise_gap = CLOSED * self.kept_back_floor(&current, &noise);
            }
            // Base parameters far from what was known of them imitate another effect still to be found, which recordings
            // kept back show whatever is taken first: then what closes the gap where it was fitted counts.
            let bent = round == 0 && priors_complain(train, &current.hypothesis);
            let closes = |fitted: &Fitted| train.gap(&train.innovations(&fitted.hypothesis)) <= CLOSED * floor;
            // Near the floor noise makes gaps wider or narrower: there it is weighed what shows in the recordings kept back.
            let near = round == 0 && gap <= FAR * floor && self.check.is_some();
            let unfitted = if near { train.refit(&start, &weights, &[], Free::All, 0) } else { None };
            let nearer = |rival: &Rival, fitted: &Fitted| {
                if near {
                    // A gap that the refit widens says nothing against what explains most of the motion that it was not
                    // fitted to, against the refit without it and the baseline alike.
                    let no_wider = rival.held_out_gap <= most_gap.max(noise_gap);
                    let plain = || unfitted.iter().all(|start| self.foretells(start, fitted, &noise));
                    self.shows_in_kept_back(&current, fitted, &noise) && (no_wider || plain())
                } else {
                    rival.held_out_gap <= most_gap
                }
            };
            let leads_on = |rival: &Rival, fitted: &Fitted| {
                rival.delta_bic >= threshold && (nearer(rival, fitted) || bent && closes(fitted))
            };
            let mut confirmed: Vec<(Rival, Fitted)> = Vec::new();
            for _ in 0..SHORTLISTS {
                let starts = shortlist(&base, &features, &scored, threshold, &weights, &confirmed, most);
                if starts.is_empty() {
                    break;
                }
                // A refit without the effect may have swallowed it: with the base where that left it, an effect of the same
                // kind has nothing to explain.
                let mut bases = Vec::new();
                if round == 0 || !settled && gap <= FAR * floor {
                    bases.push(train.baseline.values.of(&train.baseline.free));
                }
                if round > 0 {
                    bases.push(current.hypothesis.base.clone());
                }
                let leaders = if gap > FAR * floor { LEADERS } else { 0 };
                let tried = self.confirm(&current, &starts, &bases, &weights, leaders);
                rivals.extend(tried.iter().map(|(rival, _)| rival.clone()));
                confirmed.extend(tried);
                confirmed.sort_by(|a, b| b.0.delta_bic.total_cmp(&a.0.delta_bic));
                // What lies further down is looked at only where nothing that leads brings the model nearer.
                if confirmed.iter().any(|(rival, fitted)| leads_on(rival, fitted)) {
                    break;
                }
            }
            // An effect may weigh more where the noise is small and still lead the model away from the motion.
            let any = confirmed.iter().any(|(rival, fitted)| leads_on(rival, fitted));
            confirmed.retain(|(rival, fitted)| {
                // Where none does, noise may leave as much of what was kept back, and says nothing against any; but what is
                // looked for at instants of its own is found in noise as well.
                let anywhere = rival.instance.has_instants();
                let may_be = !any && !anywhere && rival.delta_bic >= threshold && rival.held_out_gap <= noise_gap;
                (may_be || leads_on(rival, fitted))
                    && !self.is_first_play(rival, &accepted)
                    && !teeth::is_their_fault(rival, &accepted)
            });
            if round > 0 && gap <= FAR * floor && !confirmed.is_empty() {
                // Far from the floor there are others still to be found, and only all of them together narrow it.
                let reached = self.judging_gap(&current.hypothesis);
                let may_widen = |rival: &Rival| teeth::has_to_narrow(rival, &accepted).unwrap_or(WORSE);
                confirmed.retain(|(rival, _)| rival.held_out_gap <= may_widen(rival) * reached);
                // It has to show there in counts, or else where they are weighed by the noise.
                let shows = |(rival, fitted): &(Rival, Fitted)| {
                    // Instants are found anew there, so that some always narrow it a little.
                    let narrows = rival.held_out_gap < reached && !rival.instance.has_instants();
                    narrows || self.shows_in_kept_back(&current, fitted, &noise)
                };
                let first = confirmed.iter().position(shows).unwrap_or(confirmed.len());
                confirmed.drain(..first);
            }
            // While nothing comes near the floor, what is left is no noise, and weighing by noise means little: it decides
            // only among those that come about as near as any that explains about as much.
            let most = confirmed.first().map_or(0.0, |(best, _)| best.delta_bic);
            let as_much = confirmed.iter().filter(|(rival, _)| rival.delta_bic >= AS_MUCH * most);
            let nearest = as_much.map(|(rival, _)| rival.held_out_gap).fold(f64::INFINITY, f64::min);
            if nearest > FAR * floor {
                confirmed.retain(|(rival, _)| rival.held_out_gap <= AS_NEAR * nearest);
            }
            preferred_first(&mut confirmed);
            let Some((best, best_fitted)) = confirmed.first().cloned() else { break };
            if settled && !self.is_worth_it(&best, &current, &accepted, [gap, floor], &noise) {
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
            let (fitted, less_noise) = self.settle(best_fitted, noise);
            (current, noise) = (self.with_better_orders(fitted, known.len(), &train.weights(&less_noise)), less_noise);
            if let [only] = &accepted[..] {
                first = Some((current.clone(), only.clone(), noise));
            }
            self.take_back(&mut current, &mut accepted, known.len(), &train.weights(&noise), threshold);
            // An arm's verdict names no more of them: the rest of the way would end in "unknown" only later.
            if train.setting.experiment.robot.joints.len() > 1 && teeth::count(&accepted) > MOST_NAMED {
                break;
            }
        }
        let rounds = Rounds {
            start,
            null: null?,
            null_innovations,
            baseline_innovations,
            fitted: current,
            accepted,
            rivals,
            noise,
            before,
            scores: [null_score, threshold],
        };
        // With many effects anything can be imitated. Where one alone explains enough, the others were its own faults.
        if teeth::count(&rounds.accepted) > MOST_NAMED
            && let Some((fitted, accepted, noise)) = first
        {
            let alone = self.judge(Rounds { fitted, accepted: vec![accepted], noise, ..rounds.clone() });
            if alone.verdict == Verdict::Named {
                return Some(alone);
            }
        }
        Some(self.judge(rounds))
    }

    /// A model with an effect just taken, refitted, with the noise that is left: what was there before the effect was
    /// known may have been taken for noise.
    fn settle(&self, mut fitted: Fitted, mut noise: Noise) -> (Fitted, Noise) {
        let train = &self.train;
        let instants = fitted.hypothesis.named.iter().any(Instance::has_instants);
        let iterations = if instants { INSTANTS_SETTLED_AFTER } else { SETTLED_AFTER };
        for _ in 0..TURNS {
            let white = noise.map(|joint| joint.white_counts2);
            let left = noise::most_likely(train.setting.rows, &fitted.residual.motion, white, 6.0);
            let less = train.floor(&left) < train.floor(&noise);
            if less {
                noise = left;
            }
            let gap = |fitted: &Fitted| train.gap(&train.innovations(&fitted.hypothesis));
            match train.refit(&fitted.hypothesis, &train.weights(&noise), &[], Free::All, iterations) {
                Some(again) if gap(&again) <= ASTRAY * gap(&fitted) => fitted = again,
                _ => break,
            }
            if !less {
                break;
            }
        }
        (fitted, noise)
    }

    /// The gap on the recordings kept back, or on those fitted without any.
    pub fn judging_gap(&self, hypothesis: &Hypothesis) -> f64 {
        match &self.check {
            Some(check) => check.gap(&check.innovations(&adapted(check, hypothesis, &check_weights(check)))),
            None => self.train.gap(&self.train.innovations(hypothesis)),
        }
    }

    /// Whether what an effect brings in the motion that it was fitted to shows in the recordings kept back as well.
    fn shows_in_kept_back(&self, without: &Fitted, with: &Fitted, noise: &Noise) -> bool {
        let Some([gained, kept]) = self.gains(without, with, noise) else { return true };
        // What currents or prior knowledge tell need not show in the motion, but must not spoil it.
        let by_motion = gained > 0.5 * (without.cost - with.cost);
        let searched = with.hypothesis.named.last().is_some_and(Instance::has_instants);
        kept >= if by_motion { least_kept(gained * self.kept_share(), searched) } else { -PROVEN }
    }

    /// Whether an effect explains of the recordings kept back a good part of what it does of those it was fitted to.
    fn foretells(&self, without: &Fitted, with: &Fitted, noise: &Noise) -> bool {
        self.gains(without, with, noise)
            .is_some_and(|[gained, kept]| kept >= FORETELLS.max(FORETOLD_IN_PART * gained * self.kept_share()))
    }

    /// By how much χ² of the motion falls from one model to another: of what was fitted, and of what was kept back.
    fn gains(&self, without: &Fitted, with: &Fitted, noise: &Noise) -> Option<[f64; 2]> {
        let check = self.check.as_ref()?;
        let weights = self.train.weights(noise);
        let of_motion = |fitted: &Fitted| inner(&fitted.residual.motion, &fitted.residual.motion, &weights);
        let kept_weights = check.weights(noise);
        let of_kept_back = |fitted: &Fitted| {
            let rows = check.setting.rows.of(&check.innovations(&adapted(check, &fitted.hypothesis, &kept_weights)));
            inner(&rows, &rows, &kept_weights)
        };
        Some([of_motion(without) - of_motion(with), of_kept_back(without) - of_kept_back(with)])
    }

    /// Samples kept back over samples fitted.
    fn kept_share(&self) -> f64 {
        self.check.as_ref().map_or(0.0, |check| check.length() / self.train.length())
    }

    /// Whether one effect more brings enough beside those `accepted`, which leave this gap over this floor of what was fitted.
    fn is_worth_it(
        &self,
        more: &Rival,
        left: &Fitted,
        accepted: &[Accepted],
        [gap, floor]: [f64; 2],
        noise: &Noise,
    ) -> bool {
        let reached = self.judging_gap(&left.hypothesis);
        let kept_back = reached / self.kept_back_floor(left, noise).max(floor);
        let nearly_closed = gap <= NEARLY_CLOSED * floor && kept_back <= NEARLY_CLOSED;
        if !nearly_closed || more.held_out_gap <= (1.0 - PLAINLY_NARROWER) * reached {
            return true;
        }
        let noise_left = gap <= floor && kept_back <= AS_NOISE;
        let share = if noise_left { MORE_THAN_NOISE } else { MORE };
        let rounding = self.train.floor(&noise.map(|joint| noise::JointNoise::white(joint.white_counts2)));
        let shows = more.held_out_gap <= (1.0 - NARROWER) * reached || reached > CLOSED * rounding;
        shows && more.delta_bic >= share * accepted.iter().map(|accepted| accepted.delta_bic).sum::<f64>()
    }

    /// What may be left of the recordings kept back by a model that is right, in counts rms; 0 without any.
    fn kept_back_floor(&self, fitted: &Fitted, noise: &Noise) -> f64 {
        self.check.as_ref().map_or(0.0, |check| kept_back_floor(&self.train, fitted, noise, check))
    }

    /// Whether a rival is a count that seems to be lost while a joint with backlash has not yet turned round: where in the
    /// gap the motor stood at the start nobody knows, and its first way through it looks like that.
    fn is_first_play(&self, rival: &Rival, accepted: &[Accepted]) -> bool {
        let instance = &rival.instance;
        let plays = |other: &Accepted| other.name == "backlash" && other.joint == instance.joint;
        if instance.kind.name != "count-loss" || !accepted.iter().any(plays) {
            return false;
        }
        let period_s = self.train.setting.experiment.robot.record_period_s;
        self.train.traces.iter().zip(&instance.records).all(|(trace, values)| {
            let velocity = &trace.velocity_rad_s[instance.joint];
            let fastest = velocity.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            let moving = |v: &&f64| v.abs() > 0.1 * fastest;
            let Some(first) = velocity.iter().find(moving) else { return true };
            let turned = velocity.iter().position(|v| v * first < 0.0 && v.abs() > 0.1 * fastest);
            let turned_s = turned.map_or(f64::INFINITY, |sample| sample as f64 * period_s);
            values.iter().all(|&instant_s| instant_s < turned_s)
        })
    }

    /// Drops accepted effects that the later ones have made superfluous; where there are instants, the last one too: its refit
    /// found them anew, and what it seemed to bring may be theirs.
    fn take_back(
        &self,
        current: &mut Fitted,
        accepted: &mut Vec<Accepted>,
        known: usize,
        weights: &[f64],
        threshold: f64,
    ) {
        while accepted.len() > 1 {
            let mut weakest: Option<(f64, usize, Fitted)> = None;
            let anew = current.hypothesis.named[known..].iter().any(Instance::has_instants);
            for index in 0..accepted.len() - usize::from(!anew) {
                let mut without = current.hypothesis.clone();
                without.named.remove(known + index);
                let Some(fitted) = self.train.refit(&without, weights, &[], Free::All, 3) else { continue };
                let loss = fitted.cost - current.cost - self.train.price(current, known + index, weights);
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
}

/// By how much an effect has to lower χ² of what was kept back where `expected` of it would be as much as of what was fitted.
/// An instant that was `searched` for there anew brings what the best of many by chance does, and has to bring more.
pub fn least_kept(expected: f64, searched: bool) -> f64 {
    if searched { PROVEN + FORETELLS.min(FORETOLD_IN_PART * expected) } else { PROVEN.min(KEPT * expected) }
}

/// The largest of the null scores but for two: a simulated start that happens to stick far off is no measure of chance.
fn largest_but_outliers(mut scores: Vec<f64>) -> f64 {
    scores.sort_by(|a, b| b.total_cmp(a));
    scores.get(2).copied().unwrap_or(0.0).max(0.0)
}

/// Weights that phases and instants of other recordings are found by.
fn check_weights(check: &Engine) -> Vec<f64> {
    let rounding = if check.setting.experiment.robot.quantised { 1.0 / 12.0 } else { 1.0 };
    check.weights(&[noise::JointNoise::white(rounding); 2])
}

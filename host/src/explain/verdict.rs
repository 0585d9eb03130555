//! What the rounds come to: whether the effects found explain what was wrong, on recordings they were not fitted to too.

use super::decide::{Accepted, Case, Rival};
use super::engine::{Engine, Fitted, Free};
use super::held_out::{adapted, kept_back_floor};
use super::hypothesis::Hypothesis;
use super::linear::inner;
use super::noise::Noise;
use super::remainder::{Remainder, remainders};
use super::teeth;
use crate::identify::Columns;

/// No robot's unknown torque is larger than this share of its Coulomb friction: what is larger is an effect.
pub const MOST_TORQUE_NOISE: f64 = 0.025;
/// Within this factor of the floor a gap is closed.
pub const CLOSED: f64 = 1.1;
/// Effects that are named together at most: with enough of them anything can be imitated.
pub const MOST_NAMED: usize = 2;
/// Share of the excess of the recordings kept back from which effects foretell them well, and in part.
const FORETOLD: f64 = 0.9;
/// See [`FORETOLD`].
pub const FORETOLD_IN_PART: f64 = 0.5;
/// Recordings kept back are closed within this factor: they have nothing fitted to them.
const HELD_OUT_CLOSED: f64 = 1.25;
/// Effects together explain at least this share of the excess to be named.
const NAMED_SHARE: f64 = 0.75;
/// Share that makes a part worth naming on a single axis.
const PARTIAL_SHARE: f64 = 0.5;
/// Share of the gain per sample that has to show in the recordings kept back.
pub const KEPT: f64 = 0.2;
/// A gain in χ² that chance does not bring, however large it was elsewhere.
pub const PROVEN: f64 = 10.0;
/// A gain in χ² of recordings kept back that stands for the share of what was fitted.
pub const FORETELLS: f64 = 25.0;
/// A score this many times the threshold is no chance, whether its effect is the right one or not.
const STRONG: f64 = 4.0;
/// χ² of noise alone is known only up to so many of its standard deviations: less than that is no excess.
const CHANCE: f64 = 2.0;

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

/// What the rounds found.
#[derive(Clone)]
pub struct Rounds {
    /// The baseline as given.
    pub start: Hypothesis,
    /// Its refit without effects.
    pub null: Fitted,
    /// Innovations of that refit.
    pub null_innovations: Columns,
    /// Innovations of the baseline.
    pub baseline_innovations: Columns,
    /// The final model.
    pub fitted: Fitted,
    /// Its effects, in the order of acceptance.
    pub accepted: Vec<Accepted>,
    /// Everything refitted on the way.
    pub rivals: Vec<Rival>,
    /// Noise of the recordings.
    pub noise: Noise,
    /// Gap of the baseline in counts rms.
    pub before: f64,
    /// Largest null score, and the threshold made of it.
    pub scores: [f64; 2],
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
    /// What is left in each joint: by the final model where its effects count, else by the refit without any.
    pub left: Vec<Remainder>,
}

impl Decision {
    /// Whether nothing was found, nothing is wrong with what was fitted, and something is with what was kept back.
    pub fn shows_elsewhere(&self) -> bool {
        let wrong = self.held_out.is_some_and(|[_, after]| after > HELD_OUT_CLOSED * self.floor);
        self.verdict == Verdict::Unknown && self.accepted.is_empty() && wrong && self.after <= CLOSED * self.floor
    }
}

/// What recordings kept back say.
struct HeldOut {
    /// Gaps of the baseline as given and of the final model.
    gaps: [f64; 2],
    /// Gap of the refit without effects.
    alone: f64,
    /// What noise, and what the fit could not know, leaves in them.
    floor: f64,
    /// Share of their excess over the floor that the effects take away beyond what base parameters do alone.
    foretold: f64,
    /// By how much the effects lower χ² of the motion beyond base parameters alone.
    gain: f64,
    /// Their length in samples.
    length: f64,
}

impl Case<'_> {
    /// The verdict.
    pub fn judge(&self, rounds: Rounds) -> Decision {
        let train = &self.train;
        let noise = train.plausible(&rounds.noise, MOST_TORQUE_NOISE);
        let weights = train.weights(&noise);
        let final_innovations = train.innovations(&rounds.fitted.hypothesis);
        let after = train.gap(&final_innovations);
        let held_out = self.check.as_ref().map(|check| held_out(train, check, &rounds, &noise));
        let count = teeth::count(&rounds.accepted);
        // While effects were looked for, whatever resembled any was taken out of the noise; where some are found, what is left
        // beside them is noise as far as it can be.
        let own = if count > 0 { train.own_noise(&rounds.fitted, &rounds.noise) } else { noise };
        let kept_back = held_out.as_ref().map_or(0.0, |held_out| held_out.floor);
        let floor = kept_back.max(train.floor(&noise)).max(train.floor(&own));

        // What noise like this leaves of χ².
        let current = |fitted: &Fitted| fitted.residual.current.iter().map(|x| x * x).sum::<f64>();
        let rows = train.setting.rows.count() as f64 + current(&rounds.fitted).min(current(&rounds.null));
        let expected = rows + CHANCE * (2.0 * rows).sqrt();
        let (null_cost, final_cost) = (train.cost(&rounds.null, &weights), train.cost(&rounds.fitted, &weights));
        let share_of = |expected: f64| {
            let excess = null_cost - expected.min(final_cost);
            if excess > 0.0 { ((null_cost - final_cost) / excess).clamp(0.0, 1.0) } else { 0.0 }
        };
        let (share, least_share) = (share_of(expected), share_of(rows));

        let complains = |gap: f64, hypothesis: &Hypothesis| gap > CLOSED * floor || priors_complain(train, hypothesis);
        let elsewhere = held_out.as_ref().is_some_and(|held_out| held_out.alone > HELD_OUT_CLOSED * floor);
        let noise_alone = |fitted: &Fitted| {
            remainders(train, fitted, &rounds.noise).iter().all(|left| !left.is_no_noise() && !left.has_a_line())
        };
        let strong = rounds.rivals.iter().any(|rival| rival.delta_bic > STRONG * rounds.scores[1]);
        let nothing_wrong = !elsewhere
            && !strong
            && !complains(train.gap(&rounds.null_innovations), &rounds.null.hypothesis)
            && noise_alone(&rounds.null);
        let gaps = held_out.as_ref().map(|held_out| held_out.gaps);
        // Without recordings kept back nothing speaks against the effects.
        let foretold = held_out.as_ref().map_or(1.0, |held_out| held_out.foretold);
        // A gain in the motion, rather than in current or in what was known beforehand, has to show in what was kept back.
        let of_motion = |fitted: &Fitted| inner(&fitted.residual.motion, &fitted.residual.motion, &weights);
        let gained = of_motion(&rounds.null) - of_motion(&rounds.fitted);
        let by_motion = gained > 0.5 * (null_cost - final_cost);
        let kept = held_out.as_ref().is_none_or(|held_out| {
            let least = f64::min(KEPT * gained * held_out.length / train.length(), PROVEN);
            !by_motion || held_out.gain >= least
        });
        let closes = kept
            && held_out_agrees(held_out.as_ref())
            && (after <= CLOSED * floor || (count == 1 && foretold >= FORETOLD && after <= HELD_OUT_CLOSED * floor));
        // An axis has half as many effects to choose from as an arm, so that more of them imitate less.
        let arm = train.setting.experiment.robot.joints.len() > 1;
        let in_part =
            if arm { least_share >= NAMED_SHARE && count <= MOST_NAMED } else { least_share >= PARTIAL_SHARE };
        // Where the excess is little, its share hangs on how well the noise is known; what was kept back tells as well.
        let foretells =
            held_out.as_ref().is_some_and(|held_out| held_out.foretold >= FORETOLD && held_out.gain >= FORETELLS);
        let explained = share >= NAMED_SHARE || (foretells && after <= CLOSED * floor);
        let as_noise = !remainders(train, &rounds.fitted, &rounds.noise).iter().any(Remainder::is_no_noise);
        let verdict = if count > 0 && explained && closes && as_noise && count <= MOST_NAMED {
            Verdict::Named
        } else if nothing_wrong {
            Verdict::None
        } else if count > 0 && kept && in_part && foretold >= FORETOLD_IN_PART {
            Verdict::Partial
        } else {
            Verdict::Unknown
        };
        let effects_count = matches!(verdict, Verdict::Named | Verdict::Partial);
        let left = remainders(train, if effects_count { &rounds.fitted } else { &rounds.null }, &rounds.noise);
        Decision {
            verdict,
            fitted: rounds.fitted,
            accepted: rounds.accepted,
            rivals: rounds.rivals,
            noise,
            innovations: [rounds.baseline_innovations, rounds.null_innovations, final_innovations],
            null_score: rounds.scores[0],
            threshold: rounds.scores[1],
            floor,
            before: rounds.before,
            after,
            held_out: gaps,
            share,
            left,
        }
    }
}

fn held_out(train: &Engine, check: &Engine, rounds: &Rounds, noise: &Noise) -> HeldOut {
    let weights = check.weights(noise);
    let best = adapted(check, &rounds.fitted.hypothesis, &weights);
    let first = adapted(check, &rounds.start, &weights);
    let null = adapted(check, &rounds.null.hypothesis, &weights);
    let best_innovations = check.innovations(&best);
    let after = check.gap(&best_innovations);
    let floor = kept_back_floor(train, &rounds.fitted, noise, check);
    let alone = check.gap(&check.innovations(&null));
    let excess = alone * alone - floor * floor;
    let of_data = |hypothesis: &Hypothesis| {
        let left = check.refit(hypothesis, &weights, &[], Free::OfRecords, 0);
        left.map_or(f64::INFINITY, |left| inner(&left.residual.motion, &left.residual.motion, &weights))
    };
    HeldOut {
        gaps: [check.gap(&check.innovations(&first)), after],
        alone,
        floor,
        foretold: if excess > 0.0 { (alone * alone - after * after) / excess } else { 1.0 },
        gain: of_data(&null) - of_data(&best),
        length: check.length(),
    }
}

/// Whether the base parameters have left what was known about them.
pub fn priors_complain(engine: &Engine, hypothesis: &Hypothesis) -> bool {
    let known = engine.baseline.standard_error.iter().filter(|error| error.is_finite()).count() as f64;
    engine.prior_cost(hypothesis) > known + 10.0 * (2.0 * known).sqrt()
}

/// Whether the recordings kept back are closed as well, or nearly, and no worse than with the baseline, or better once they are
/// weighed by the noise.
fn held_out_agrees(held_out: Option<&HeldOut>) -> bool {
    held_out.is_none_or(|held_out| {
        let ([before, after], floor) = (held_out.gaps, held_out.floor);
        after <= HELD_OUT_CLOSED * floor && (after <= before.max(CLOSED * floor) || held_out.gain >= FORETELLS)
    })
}

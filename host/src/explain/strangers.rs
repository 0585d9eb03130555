//! Effects that are in no library and resemble some that are: each is tried in the place of the effects it could be
//! mistaken for. Where it does better, the name would be wrong, and the verdict is "unknown" with what it resembles.

use shared::effects::JointEffects;

use super::decide::Case;
use super::engine::{Engine, Fitted, Free};
use super::hypothesis::Hypothesis;
use super::instance::Instance;
use super::library::{self, ANY, Kind, Parameter, Place, Search, size};
use super::trace::Trace;
use super::verdict::{Decision, Verdict};

/// By how much χ², less what parameters cost, a stranger has to do better than the effects it takes the place of:
/// odds of seven to one.
const BETTER: f64 = 4.0;

/// A gap beside a spring that brings this much, and this share of what the spring brought, says that it stiffens as it is
/// wound: a linear one leaves a gap nothing to explain.
const STIFFENS_BY: f64 = 12.0;
/// See [`STIFFENS_BY`].
const STIFFENS: f64 = 0.1;
/// Gaps in rad that are tried beside a spring.
const GAPS_RAD: [f64; 4] = [3e-5, 1e-4, 3e-4, 1e-3];

/// An effect outside the library that did better than those inside.
#[derive(Clone, Debug)]
pub struct Stranger {
    /// What it is called in a sentence.
    pub phrase: &'static str,
    /// Its values.
    pub instance: Instance,
    /// Name of the effect whose place it took.
    pub instead_of: &'static str,
    /// By how much it does better.
    pub delta_bic: f64,
}

struct LookAlike {
    kind: Kind,
    mistaken_for: &'static [&'static str],
    /// Values to begin with, from the effect that was named.
    starts: fn(&Engine, &Instance) -> Vec<Vec<f64>>,
}

const fn joint(
    name: &'static str,
    unit: &'static str,
    place: fn(&mut JointEffects<f64>) -> &mut f64,
    step: f64,
    range: [f64; 2],
) -> Parameter {
    size(name, unit, Place::Joint(place), step, range)
}

const fn kind(name: &'static str, phrase: &'static str, parameters: &'static [Parameter]) -> Kind {
    // How it is looked for is said by its starts.
    Kind { name, of_arm: false, parameters, search: Search::Finite(&[]), equivalent: &[], phrase }
}

static LOOK_ALIKES: [LookAlike; 4] = [
    LookAlike {
        kind: kind(
            "current-slew",
            "a current whose rate is limited",
            &[joint("slew_a_per_s", "A/s", |effects| &mut effects.current_slew_a_per_s, 0.5, [1.0, 1e6])],
        ),
        mistaken_for: &["current-lag"],
        starts: slew_starts,
    },
    LookAlike {
        kind: kind(
            "torque-constant-drift",
            "a torque constant that changes in time, as of a motor that warms up",
            &[joint("rate_per_s", "1/s", |effects| &mut effects.torque_constant_drift_per_s, 1e-4, [-0.1, 0.1])],
        ),
        mistaken_for: &["torque-constant", "friction-drift"],
        starts: |_, _| vec![vec![-1e-3]],
    },
    LookAlike {
        kind: kind(
            "crosstalk",
            "torque that follows the other motor's current",
            &[joint("share", "1", |effects| &mut effects.crosstalk_share, 1e-3, ANY)],
        ),
        mistaken_for: &["torque-constant", "external-contact", "payload", "gravity-spring"],
        starts: |_, _| vec![vec![1e-3]],
    },
    LookAlike {
        kind: kind(
            "slack-spring",
            "a spring with slack",
            &[
                joint("stiffness_nm_per_rad", "N m/rad", |effects| &mut effects.slack_spring_nm_per_rad, 1e-2, ANY),
                joint("centre_rad", "rad", |effects| &mut effects.slack_centre_rad, 1e-3, [-7.0, 7.0]),
                joint("half_slack_rad", "rad", |effects| &mut effects.half_slack_rad, 1e-3, [0.0, 7.0]),
            ],
        ),
        mistaken_for: &["gravity-spring", "position-dependent-friction"],
        starts: spring_starts,
    },
];

/// The stranger of this name, for simulations that hide one.
#[cfg(test)]
pub fn kind_of(name: &str) -> Option<&'static Kind> {
    LOOK_ALIKES.iter().map(|alike| &alike.kind).find(|kind| kind.name == name)
}

/// Rates below the fastest that was asked for: where none is in the way, nothing tells.
fn slew_starts(engine: &Engine, named: &Instance) -> Vec<Vec<f64>> {
    let experiment = engine.setting.experiment;
    let period_s = experiment.robot.record_period_s;
    let changes = experiment.segments.iter().flat_map(|segment| segment.command_a.windows(2));
    let fastest =
        changes.map(|pair| (pair[1][named.joint] - pair[0][named.joint]).abs()).fold(0.0, f64::max) / period_s;
    [0.7, 0.4, 0.2, 0.1, 0.05].iter().map(|share| vec![share * fastest]).collect()
}

/// Slack of several widths about several angles, as stiff as the spring that was named.
fn spring_starts(engine: &Engine, named: &Instance) -> Vec<Vec<f64>> {
    let positions = |trace: &Trace| trace.position_rad[named.joint].clone();
    let all: Vec<f64> = engine.traces.iter().flat_map(positions).collect();
    let (low, high) = all.iter().fold((f64::MAX, f64::MIN), |(low, high), q| (low.min(*q), high.max(*q)));
    let stiffness = if named.kind.name == "gravity-spring" { named.flat()[0].1.abs() } else { 1.0 };
    let starts = [0.3, 0.5, 0.7].iter().flat_map(|&centre| {
        [0.1, 0.3].iter().map(move |&half| vec![stiffness, low + centre * (high - low), half * (high - low)])
    });
    starts.collect()
}

impl Case<'_> {
    /// The look-alike that does better than the effects of a decision that names some.
    pub fn stranger(&self, decision: &Decision, known: usize) -> Option<Stranger> {
        if !matches!(decision.verdict, Verdict::Named | Verdict::Partial) {
            return None;
        }
        let train = &self.train;
        let two_links = train.setting.experiment.robot.joints.len() > 1;
        let weights = train.weights(&decision.noise);
        let named = train.refit(&decision.fitted.hypothesis, &weights, &[], Free::All, 2)?;
        let per_parameter = (train.setting.rows.count() as f64).ln();
        let price = |fitted: &Fitted| -> f64 {
            (0..fitted.hypothesis.named.len()).map(|index| train.price(fitted, index, &weights)).sum()
        };
        let paid = named.cost + price(&named);
        let mut best: Option<Stranger> = None;
        for (index, effect) in named.hypothesis.named.iter().enumerate().skip(known) {
            let alike = LOOK_ALIKES.iter().filter(|alike| alike.mistaken_for.contains(&effect.kind.name));
            for alike in alike.filter(|alike| two_links || alike.kind.name == "current-slew") {
                // In the place of this effect, and of all; and on either joint, where the one's torque constant is much the
                // same as the other's.
                let mut beside = named.hypothesis.clone();
                beside.named.remove(index);
                let mut alone = named.hypothesis.clone();
                alone.named.truncate(known);
                let places = if beside.named.len() > known { vec![beside, alone] } else { vec![alone] };
                let joints = if effect.kind.name == "torque-constant" { 0..2 } else { effect.joint..effect.joint + 1 };
                for (place, joint) in places.iter().flat_map(|place| joints.clone().map(move |joint| (place, joint))) {
                    let starts = (alike.starts)(train, effect);
                    let Some(fitted) = self.best_start(place, &alike.kind, joint, &starts, &weights) else {
                        continue;
                    };
                    let delta_bic = paid - fitted.cost - price(&fitted);
                    if delta_bic > best.as_ref().map_or(BETTER, |best| best.delta_bic)
                        && let Some(instance) = fitted.hypothesis.named.last()
                    {
                        let (phrase, instead_of) = (alike.kind.phrase, effect.kind.name);
                        best = Some(Stranger { phrase, instance: instance.clone(), instead_of, delta_bic });
                    }
                }
            }
        }
        best.or_else(|| self.stiffening(decision, &named, known, &weights, per_parameter))
    }

    /// A spring of `named` that stiffens as it is wound.
    fn stiffening(
        &self,
        decision: &Decision,
        named: &Fitted,
        known: usize,
        weights: &[f64],
        per_parameter: f64,
    ) -> Option<Stranger> {
        let effects = &named.hypothesis.named;
        let gap = library::kind("backlash")?;
        for spring in effects.iter().skip(known).filter(|effect| effect.kind.name == "joint-flexibility") {
            let of_shaft = |name: &str, joint: usize| name == gap.name && joint == spring.joint;
            if effects.iter().any(|other| of_shaft(other.kind.name, other.joint)) {
                continue;
            }
            let mut accepted = decision.accepted.iter();
            let brought = accepted.find(|one| one.name == spring.kind.name && one.joint == spring.joint)?.delta_bic;
            // The spring knows the motor's inertia already.
            let starts: Vec<Vec<f64>> = GAPS_RAD.iter().map(|&gap_rad| vec![gap_rad]).collect();
            let Some(fitted) = self.best_start(&named.hypothesis, gap, spring.joint, &starts, weights) else {
                continue;
            };
            let delta_bic = named.cost - fitted.cost - per_parameter;
            if delta_bic > STIFFENS_BY.max(STIFFENS * brought) {
                let instance = fitted.hypothesis.named.last()?.clone();
                let phrase = "a spring that stiffens as it is wound, almost a gap";
                return Some(Stranger { phrase, instance, instead_of: spring.kind.name, delta_bic });
            }
        }
        None
    }

    /// The best refit beside `place` from any of the starts.
    fn best_start(
        &self,
        place: &Hypothesis,
        kind: &'static Kind,
        joint: usize,
        starts: &[Vec<f64>],
        weights: &[f64],
    ) -> Option<Fitted> {
        let records = self.train.setting.experiment.segments.len();
        let begun = starts.iter().filter_map(|values| {
            let hypothesis = place.with(Instance::new(kind, joint, values, records));
            self.train.refit(&hypothesis, weights, &[], Free::Last, 3)
        });
        let nearest = begun.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        self.train.refit(&nearest.hypothesis, weights, &[], Free::All, 4)
    }
}

impl Stranger {
    /// What it says about the verdict.
    pub fn sentence(&self, joint: &str) -> String {
        let values: Vec<String> =
            self.instance.flat().iter().map(|(parameter, value)| format!("{} = {value:.4e}", parameter.name)).collect();
        format!(
            "joint {joint}: it behaves like {} ({}), which no effect of the library is: that explains it better than {} \
             does, by a ΔBIC of {:.0}",
            self.phrase,
            values.join(", "),
            self.instead_of,
            self.delta_bic
        )
    }
}

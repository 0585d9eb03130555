//! What was found, in numbers and sentences.

use std::collections::BTreeMap;

use serde::Serialize;

use super::curves::{Curve, curves};
use super::decide::Case;
use super::hypothesis::Hypothesis;
use super::instance::Instance;
use super::library::{LIBRARY, Role};
use super::motor_share;
use super::next::{NextTrajectory, next_trajectory};
use super::report::pictures;
use super::sentences::{place, sentences};
use super::teeth;
use super::verdict::{Decision, Verdict};
use crate::identify::Parameter;
use crate::model::{Effect, Model};
use crate::report::Picture;
use crate::robot::{Kind, Robot};

/// A parameter of a named effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundParameter {
    /// Value.
    pub value: f64,
    /// Standard error; none where the recordings do not tell.
    pub standard_error: Option<f64>,
    /// Unit.
    pub unit: &'static str,
}

/// An effect that was named.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Its contract name.
    pub name: &'static str,
    /// The joint's name, or "both".
    pub joint: String,
    /// Names that cannot be told from it, itself among them.
    pub class: Vec<&'static str>,
    /// Its parameters.
    pub parameters: BTreeMap<String, FoundParameter>,
    /// Where it shows.
    #[serde(rename = "where")]
    pub place: String,
    /// By how much χ² fell, less what its parameters cost.
    pub delta_bic: f64,
}

/// Gaps before and after.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BeforeAfter {
    /// With the baseline as given.
    pub before: f64,
    /// With the named effects.
    pub after: f64,
}

/// How far simulation and measurement are apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// Unit of all of it.
    pub unit: &'static str,
    /// What rounding and torque noise alone leave.
    pub floor: f64,
    /// With the baseline as given, on the recordings fitted.
    pub before: f64,
    /// With the named effects, on the recordings fitted.
    pub after: f64,
    /// On the recordings kept back.
    pub held_out: Option<BeforeAfter>,
}

/// An effect that was tried.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Its name.
    pub name: &'static str,
    /// Its joint.
    pub joint: String,
    /// Its score.
    pub delta_bic: f64,
    /// The gap it leaves on the recordings kept back, counts rms.
    pub held_out_gap: f64,
}

/// What is left in the motion of one joint, where noise alone should be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Left {
    /// Its joint.
    pub joint: String,
    /// The irregular torque that would leave it, as a share of the Coulomb friction.
    pub share_of_coulomb: f64,
    /// Whether that is more than any robot is expected to have.
    pub is_more_than_noise: bool,
    /// A tone that noise does not have, in Hz.
    pub tone_hz: Option<f64>,
    /// Slow power of the loudest recording over that of the quietest.
    pub uneven: f64,
    /// Whether that is more than chance brings.
    pub is_uneven: bool,
}

/// Everything that is reported.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The verdict.
    pub verdict: Verdict,
    /// The effects, in the order they were taken.
    pub effects: Vec<Finding>,
    /// The gaps.
    pub gap: Gap,
    /// Everything that was refitted.
    pub candidates: Vec<Candidate>,
    /// The model with the named effects.
    pub model: Model,
    /// One sentence a finding, and what else there is to say.
    pub sentences: Vec<String>,
    /// Share of the excess that the effects explain, 0 to 1.
    pub explained_share: f64,
    /// Whether the recordings are explained one by one, each by base parameters of its own, but not together.
    pub recordings_disagree: bool,
    /// Whether the recordings given as kept back were fitted, and the first of the others kept back: only they showed it.
    pub recordings_exchanged: bool,
    /// Largest score of the null simulations, and the threshold made of it.
    pub threshold: [f64; 2],
    /// Estimated torque noise in N m at the motors.
    pub torque_noise_nm: [f64; 2],
    /// What is left in each joint beside the effects, judged as noise.
    pub left: Vec<Left>,
    /// The shape of what is left, the quantity it follows best first.
    pub shape: Vec<Curve>,
    /// Effects that the screen ruled out in every round.
    pub ruled_out: Vec<String>,
    /// Pictures for the report.
    pub pictures: Vec<Picture>,
    /// Closed-loop force gap in N (N m) rms per joint, before and after, where the recording holds the command itself.
    pub force_gap_rms: Option<[f64; 2]>,
    /// The movement that best tells the members of a class apart, where that was asked for and there is a class.
    pub next_trajectory: Option<NextTrajectory>,
    /// The seed of the null simulations.
    pub seed: u64,
}

impl Verdict {
    /// As in the JSON.
    pub fn word(self) -> &'static str {
        match self {
            Self::Named => "named",
            Self::None => "none",
            Self::Unknown => "unknown",
            Self::Partial => "partial",
        }
    }
}

impl Explanation {
    /// The contract's object.
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::json!({
            "verdict": self.verdict.word(),
            "effects": self.effects,
            "gap": self.gap,
            "candidates": self.candidates,
            "next_trajectory": self.next_trajectory.as_ref().map(|next| {
                serde_json::json!({ "between": next.between, "distance_chi2": next.distance, "toml": next.toml })
            }),
            "explained_share": self.explained_share,
            "recordings_disagree": self.recordings_disagree,
            "recordings_exchanged": self.recordings_exchanged,
            "largest_null_score": self.threshold[0],
            "threshold": self.threshold[1],
            "torque_noise_nm": self.torque_noise_nm,
            "left": self.left,
            "shape": self.shape,
            "force_gap_rms": self.force_gap_rms,
            "seed": self.seed,
        })
    }
}

/// A curve that foretells less than this of the residual torque says nothing.
const LEAST_FORETOLD: f64 = 0.1;

/// Puts a decision into words.
pub fn explanation(case: &Case, decision: &Decision, model: &Model, known: usize, priors: bool) -> Explanation {
    let train = &case.train;
    let robot = train.setting.experiment.robot;
    let weights = train.weights(&decision.noise);
    let errors = train.standard_errors(&decision.fitted, &weights);
    let mut at = decision.fitted.hypothesis.base.len();
    let mut found: Vec<(Finding, Instance)> = Vec::new();
    let mut error_lists: Vec<Vec<f64>> = Vec::new();
    for instance in &decision.fitted.hypothesis.named {
        let count = instance.flat().len();
        error_lists.push(errors[at..at + count].to_vec());
        at += count;
    }
    for (accepted, (instance, errors)) in
        decision.accepted.iter().zip(decision.fitted.hypothesis.named.iter().zip(&error_lists).skip(known))
    {
        let parameters = parameters(&instance.upright(), errors);
        let finding = Finding {
            name: accepted.name,
            joint: instance.joint_name(robot),
            class: accepted.class.clone(),
            parameters,
            place: place(case, decision, instance),
            delta_bic: accepted.delta_bic,
        };
        found.push((finding, instance.clone()));
    }
    let found = teeth::merged(found);
    let named = matches!(decision.verdict, Verdict::Named | Verdict::Partial);
    let gap = Gap {
        unit: "counts_rms",
        floor: decision.floor,
        before: decision.before,
        after: if named || decision.accepted.is_empty() {
            decision.after
        } else {
            decision.before.min(null_gap(case, decision))
        },
        held_out: decision.held_out.map(|[before, after]| BeforeAfter { before, after }),
    };
    let candidates = decision
        .rivals
        .iter()
        .map(|rival| Candidate {
            name: rival.instance.kind.name,
            joint: rival.instance.joint_name(robot),
            delta_bic: rival.delta_bic,
            held_out_gap: rival.held_out_gap,
        })
        .collect();
    let after = if named { &decision.innovations[2] } else { &decision.innovations[1] };
    let shape = curves(train, after);
    let pictures = pictures(train, &decision.innovations[0], after, &shape);
    let tried = |name: &str| decision.rivals.iter().any(|rival| rival.instance.kind.name == name);
    let ruled_out = LIBRARY.iter().filter(|kind| !tried(kind.name)).map(|kind| kind.name.to_string()).collect();
    let mut sentences = sentences(case, decision, &found, &gap, known, priors);
    if matches!(decision.verdict, Verdict::Unknown | Verdict::Partial)
        && let Some(curve) = shape.first()
    {
        sentences.push(if curve.foretold > LEAST_FORETOLD {
            format!(
                "what is left follows the {} of joint {} best: a curve over it foretells {:.0} % of another recording's \
                 residual torque",
                curve.over,
                curve.joint,
                100.0 * curve.foretold
            )
        } else {
            "what is left follows neither position nor speed, torque, time or the time since a reversal".into()
        });
    }
    let mut extended =
        if named { extended(robot, case, decision, model, &errors, &error_lists) } else { model.clone() };
    let mut effects: Vec<Finding> =
        if named { found.into_iter().map(|(finding, _)| finding).collect() } else { Vec::new() };
    sentences.extend(motor_share::told_as_taken(&mut extended, &mut effects, robot));
    Explanation {
        verdict: decision.verdict,
        effects,
        gap,
        candidates,
        model: extended,
        sentences,
        explained_share: decision.share,
        recordings_disagree: false,
        recordings_exchanged: false,
        threshold: [decision.null_score, decision.threshold],
        torque_noise_nm: train.torque_noise_nm(&decision.noise),
        left: (robot.joints.iter().zip(&decision.left))
            .map(|(joint, left)| Left {
                joint: joint.name.clone(),
                share_of_coulomb: left.share_of_coulomb,
                is_more_than_noise: left.is_too_large(),
                tone_hz: left.tone_hz(),
                uneven: left.uneven,
                is_uneven: left.is_uneven(),
            })
            .collect(),
        shape,
        ruled_out,
        pictures,
        force_gap_rms: force_gap(case, decision, known, named),
        next_trajectory: None,
        seed: case.seed,
    }
}

fn null_gap(case: &Case, decision: &Decision) -> f64 {
    case.train.gap(&decision.innovations[1])
}

fn parameters(instance: &Instance, errors: &[f64]) -> BTreeMap<String, FoundParameter> {
    let mut parameters = BTreeMap::new();
    let own = instance.kind.parameters.iter().filter(|parameter| parameter.per_record).count();
    let common = instance.common.iter().flatten().count();
    for (index, ((parameter, value), error)) in instance.flat().into_iter().zip(errors).enumerate() {
        // What every recording has for itself is numbered from the first.
        let name = if parameter.per_record {
            format!("{}_{}", parameter.name, (index - common) / own.max(1) + 1)
        } else {
            parameter.name.to_string()
        };
        let value = if parameter.role == Role::Phase { turned(value) } else { value };
        let standard_error = error.is_finite().then_some(*error);
        parameters.insert(name, FoundParameter { value, standard_error, unit: parameter.unit });
    }
    parameters
}

/// An angle within ±π.
fn turned(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}

/// The baseline with what was found.
fn extended(
    robot: &Robot,
    case: &Case,
    decision: &Decision,
    model: &Model,
    errors: &[f64],
    error_lists: &[Vec<f64>],
) -> Model {
    let mut extended = model.clone();
    let hypothesis = &decision.fitted.hypothesis;
    let baseline = case.train.baseline;
    for ((&parameter, &value), &error) in baseline.free.iter().zip(&hypothesis.base).zip(errors) {
        let joints = robot.joints.len();
        match parameter {
            Parameter::F(index) => {
                extended.f[index] = value;
                extended.f_standard_error.get_or_insert([0.0; 9])[index] = error;
            }
            Parameter::Viscous(joint) => {
                extended.viscous_nm_s_per_rad[joint] = value;
                extended.viscous_standard_error.get_or_insert(vec![0.0; joints])[joint] = error;
            }
            Parameter::Coulomb(joint) => {
                extended.coulomb_nm[joint] = value;
                extended.coulomb_standard_error.get_or_insert(vec![0.0; joints])[joint] = error;
            }
            Parameter::TorqueOffset(_) | Parameter::Gain(_) | Parameter::Lead(_) => {}
        }
    }
    extended.effects = hypothesis
        .named
        .iter()
        .zip(error_lists)
        .map(|(instance, errors)| {
            let instance = instance.upright();
            let common = instance.kind.parameters.iter().zip(&instance.common);
            let first = instance.records.first();
            let mut own = first.into_iter().flatten();
            let parameters = common
                .filter_map(|(parameter, value)| {
                    // What every recording has for itself: the first one's, where the next search begins.
                    let value = value.or_else(|| own.next().copied())?;
                    let value = if parameter.role == Role::Phase { turned(value) } else { value };
                    Some((parameter.name.to_string(), value))
                })
                .collect();
            let shared = instance.flat().into_iter().zip(errors).filter(|((p, _), e)| !p.per_record && e.is_finite());
            Effect {
                name: instance.kind.name.into(),
                joint: instance.joint_name(robot),
                parameters,
                standard_error: shared.map(|((p, _), e)| (p.name.to_string(), *e)).collect(),
            }
        })
        .collect();
    if robot.kind == Kind::SingleAxis {
        let index = baseline.free.iter().position(|parameter| matches!(parameter, Parameter::TorqueOffset(_)));
        if let Some(index) = index {
            extended.effects.insert(
                0,
                Effect {
                    name: "torque-offset".into(),
                    joint: robot.joints[0].name.clone(),
                    parameters: [("torque_nm".to_string(), hypothesis.base[index])].into(),
                    standard_error: [("torque_nm".to_string(), errors[index])].into(),
                },
            );
        }
    }
    let text = |text: &str| toml::Value::String(text.into());
    extended.provenance.insert("explained_by".into(), text(crate::TOOL_VERSION));
    extended.provenance.insert("explain_verdict".into(), text(decision.verdict.word()));
    extended
}

/// The movement that best tells the first named effect from another member of its class.
pub fn next(case: &Case, decision: &Decision, explanation: &Explanation) -> Option<NextTrajectory> {
    let accepted = decision.accepted.iter().find(|accepted| accepted.class.len() > 1)?;
    let same = |instance: &Instance| instance.kind.name == accepted.name && instance.joint == accepted.joint;
    let own = decision.fitted.hypothesis.named.iter().find(|instance| same(instance))?;
    let others = decision.rivals.iter().map(|rival| &rival.instance);
    let other = others.into_iter().find(|instance| !same(instance) && accepted.class.contains(&instance.kind.name))?;
    let base = &decision.fitted.hypothesis.base;
    let with = |instance: &Instance| Hypothesis { base: base.clone(), named: vec![instance.clone()] };
    let robot = case.train.setting.experiment.robot;
    let (one, two) = (with(own), with(other));
    let mut next = next_trajectory(robot, case.train.baseline, [&one, &two], &decision.noise, explanation.seed)?;
    next.between = [own.kind.name, other.kind.name];
    Some(next)
}

/// Closed-loop force gap of the baseline and of the final model, over all joints, where the recordings hold the command
/// itself.
pub fn force_gap(case: &Case, decision: &Decision, known: usize, named: bool) -> Option<[f64; 2]> {
    let train = &case.train;
    let experiment = train.setting.experiment;
    if !experiment.robot.current_is_command {
        return None;
    }
    let known = &decision.fitted.hypothesis.named[..known];
    let before = Hypothesis::baseline(train.baseline, known);
    let after = if named { decision.fitted.hypothesis.clone() } else { before.clone() };
    let of = |hypothesis: &Hypothesis| -> Option<f64> {
        let candidate = hypothesis.candidate(train.baseline, experiment)?;
        let (mut sum, mut count) = (0.0, 0.0);
        for (index, segment) in experiment.segments.iter().enumerate() {
            let settled = experiment.settled(segment);
            for (k, command) in super::simulate::closed_loop_commands(experiment, index, &candidate).iter().enumerate()
            {
                for (joint, robot) in experiment.robot.joints.iter().enumerate().filter(|_| settled.contains(&k)) {
                    let difference = segment.command_a[k][joint] - command[joint];
                    sum += (difference * robot.torque_constant_nm_per_a).powi(2);
                    count += 1.0;
                }
            }
        }
        Some(f64::sqrt(sum / f64::max(count, 1.0)))
    };
    Some([of(&before)?, of(&after)?])
}

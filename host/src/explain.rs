//! Finding what a model lacks: where simulation and measurement disagree, which effect of the library does it, and how
//! much smaller the gap is with it.
//!
//! ```text
//! recordings → audit → null refit ─→ screen ─→ confirm ─→ accept ─┐→ verdict, findings, extended model
//!                         │ innovations  ↑ thresholds              │
//!                         └── noise      └─ null simulations ←─────┘ once more for the next effect
//! ```
//!
//! Everything is decided on innovations (see [`shared::replay`]): what the model did not foresee under the recorded
//! command. At the true parameters they are the rounding of the encoder and the robot's own torque noise.

mod agreement;
mod audit;
mod confirm;
mod contacts;
mod curves;
mod decide;
mod engine;
mod findings;
mod fit;
mod held_out;
mod hypothesis;
mod instance;
mod instants;
mod kept_thresholds;
mod library;
mod linear;
mod lobes;
mod motor_share;
mod next;
mod noise;
mod nulls;
mod remainder;
mod report;
mod resolution;
mod response;
mod rows;
mod scan;
mod screen;
mod sentences;
mod shortlist;
mod simulate;
mod strangers;
mod teeth;
mod threshold;
pub(crate) mod trace;
mod verdict;

#[cfg(test)]
mod tests;

pub use audit::AuditError;
pub use curves::Curve;
pub use findings::{BeforeAfter, Candidate, Explanation, Finding, FoundParameter, Gap};
pub use next::NextTrajectory;
pub use verdict::Verdict;

use std::path::PathBuf;

use crate::identify::{self, Experiment, IdentifyError, Parameter, Values};
use crate::model::Model;
use crate::recording::Recording;
use crate::robot::{Kind, Robot};
use decide::Case;
use engine::Engine;
use fit::Setting;
use hypothesis::{Baseline, Hypothesis};
use instance::Instance;
use strangers::Stranger;

/// What stops an explanation.
#[derive(Debug, thiserror::Error)]
pub enum ExplainError {
    /// The recordings are of no use.
    #[error(transparent)]
    Recordings(#[from] IdentifyError),
    /// Nothing can be concluded from the recordings.
    #[error(transparent)]
    Audit(#[from] AuditError),
    /// The model file names an effect that is not in the library.
    #[error(
        "the model has an effect \"{name}\" on joint \"{joint}\", which this tool does not know; remove it or update"
    )]
    UnknownEffect {
        /// Its name.
        name: String,
        /// Its joint.
        joint: String,
    },
    /// The baseline is no arm.
    #[error("the baseline describes no possible arm; identify it again")]
    Impossible,
}

/// Torque offset that no robot is free of, as a share of the Coulomb friction: its standard deviation.
const USUAL_OFFSET: f64 = 0.003;

/// What to do beside explaining.
#[derive(Clone, Debug)]
pub struct Options {
    /// Seed of the null simulations, of the search of a baseline and of the movements tried.
    pub seed: u64,
    /// Whether to look for the movement that tells the members of a class apart.
    pub design_next: bool,
    /// Folder to keep the scores of null simulations in, so that the same experiment is simulated once; it is made if it
    /// is missing. Without one nothing is kept.
    pub kept_thresholds: Option<PathBuf>,
}

/// Relative standard error below which no baseline is believed: mass changes with dust.
const LEAST_RELATIVE_ERROR: f64 = 2e-4;

/// Explains `recordings`, fitted to, and judges on `check`, kept back.
///
/// Where something is wrong with the recordings kept back alone, as a current limit is that only a faster movement reaches,
/// they are fitted and the first of the others is kept back.
///
/// Without a `model` the baseline is identified from the recordings first; whatever base parameters can imitate is then
/// hidden. `progress` is told of every step. A run is repeatable for a seed.
pub fn explain(
    robot: &Robot,
    recordings: &[Recording],
    check: &[Recording],
    model: Option<&Model>,
    options: &Options,
    progress: &(dyn Fn(&'static str) + Sync),
) -> Result<Explanation, ExplainError> {
    let asked = Asked { robot, model, options, progress };
    let (explanation, shows_elsewhere) = asked.explain(recordings, check)?;
    if !shows_elsewhere || explanation.recordings_disagree {
        return Ok(explanation);
    }
    let (kept_back, others) = recordings.split_at(1);
    let fitted: Vec<Recording> = others.iter().chain(check).cloned().collect();
    let (mut turned, _) = asked.explain(&fitted, kept_back)?;
    if turned.verdict != Verdict::Named {
        return Ok(explanation);
    }
    turned.recordings_exchanged = true;
    turned.sentences.push(format!(
        "only what was to be kept back shows it, so that was fitted, and {} kept back",
        kept_back[0].path.display()
    ));
    Ok(turned)
}

/// What is asked, whichever recordings are fitted and whichever kept back.
struct Asked<'a> {
    robot: &'a Robot,
    model: Option<&'a Model>,
    options: &'a Options,
    progress: &'a (dyn Fn(&'static str) + Sync),
}

impl Asked<'_> {
    /// Explains `recordings` and judges on `check`; and whether something is wrong with `check` alone.
    fn explain(&self, recordings: &[Recording], check: &[Recording]) -> Result<(Explanation, bool), ExplainError> {
        let Self { robot, model, options, progress } = *self;
        let seed = options.seed;
        if recordings.is_empty() {
            return Err(IdentifyError::NoRecording.into());
        }
        let experiment = Experiment::new(robot, recordings)?;
        let kept_back = if check.is_empty() { None } else { Some(Experiment::new(robot, check)?) };
        progress("checking the recordings");
        let all: Vec<&Recording> = recordings.iter().chain(check).collect();
        audit::audit(&experiment, &all, &trace::traces(&experiment))?;
        let identified;
        let (model, priors) = match model {
            Some(model) => (model, true),
            None => {
                progress("identifying a baseline");
                let options = identify::Options { seed, ..identify::Options::default() };
                let found = identify::identify(robot, recordings, &[], &options, &|_| ())?;
                let provenance = crate::identified_model::provenance(robot, recordings, "full", seed);
                identified = crate::identified_model::from_identification(robot, &found, provenance);
                (&identified, false)
            }
        };
        let baseline = baseline(robot, model, priors);
        let known = known_effects(robot, model, experiment.segments.len())?;

        let start = Hypothesis::baseline(&baseline, &known).candidate(&baseline, &experiment);
        let rows_of =
            |experiment: &Experiment| rows::Rows::new(experiment).with_rounding_of(experiment, start.as_ref(), seed);
        let rows = rows_of(&experiment);
        let current_sigma_a = audit::current_sigma(&experiment);
        let train = Engine::new(Setting { experiment: &experiment, rows: &rows, current_sigma_a }, &baseline);
        let check_rows = kept_back.as_ref().map(rows_of);
        let check = match (&kept_back, &check_rows) {
            (Some(experiment), Some(rows)) => {
                Some(Engine::new(Setting { experiment, rows, current_sigma_a: None }, &baseline))
            }
            _ => None,
        };
        let kept_thresholds = options.kept_thresholds.as_deref();
        let case = Case { train, check, seed, kept_thresholds, progress };
        let known = match held_out::adapted_to_train(&case.train, &baseline, &known) {
            Some(known) => known,
            None => known,
        };
        let mut decision = case.decide(&known).ok_or(ExplainError::Impossible)?;
        progress("trying what resembles the effects found");
        let stranger = case.stranger(&decision, known.len());
        let coarse = resolution::coarse_encoders(robot, &all);
        if !coarse.is_empty() || stranger.is_some() {
            // What steps of the encoder leave resembles effects; before it is mended none can be named.
            decision.verdict = Verdict::Unknown;
        }
        progress("writing down what was found");
        let mut explanation = findings::explanation(&case, &decision, model, known.len(), priors);
        if priors && matches!(explanation.verdict, Verdict::Named | Verdict::Partial) {
            let fitted = crate::identified_model::provenance(robot, recordings, "full", seed).remove("recordings");
            let provenance = &mut explanation.model.provenance;
            let of_baseline = fitted.and_then(|fitted| provenance.insert("recordings".into(), fitted));
            provenance.extend(of_baseline.map(|recordings| ("baseline_recordings".to_string(), recordings)));
        }
        let joint = |stranger: &Stranger| stranger.instance.joint_name(robot);
        explanation.sentences.extend(stranger.iter().map(|stranger| stranger.sentence(&joint(stranger))));
        explanation.sentences.extend(coarse.iter().map(|coarse| coarse.sentence(robot)));
        if explanation.verdict == Verdict::Unknown
            && agreement::only_each_by_itself(robot, &all, &baseline, &decision.noise, decision.floor)
        {
            explanation.recordings_disagree = true;
            explanation.sentences.push(
            "each recording by itself is explained by base parameters of its own, all of them together are not: they are \
             of different robots, or load or friction changed in between; explain recordings of one robot in one state"
                .into(),
        );
        }
        if options.design_next {
            progress("looking for the next movement");
            explanation.next_trajectory = findings::next(&case, &decision, &explanation);
        }
        Ok((explanation, decision.shows_elsewhere()))
    }
}

fn baseline(robot: &Robot, model: &Model, priors: bool) -> Baseline {
    let mut values = Values::of_robot(robot);
    values.f = model.f;
    let joints = robot.joints.len();
    for joint in 0..joints {
        values.viscous_nm_s_per_rad[joint] = model.viscous_nm_s_per_rad[joint];
        values.coulomb_nm[joint] = model.coulomb_nm[joint];
    }
    let mut free: Vec<(Parameter, f64)> = Vec::new();
    let mut add = |parameter: Parameter, value: f64, error: Option<f64>| {
        // What has a standard error of exactly 0 is known.
        if priors && error == Some(0.0) {
            return;
        }
        let error = error.filter(|error| priors && error.is_finite());
        free.push((parameter, error.map_or(f64::INFINITY, |error| error.max(LEAST_RELATIVE_ERROR * value.abs()))));
    };
    let of = |errors: &Option<Vec<f64>>, joint: usize| errors.as_ref().map(|errors| errors[joint]);
    match robot.kind {
        Kind::TwoLink => {
            for index in 0..model.f.len() {
                add(Parameter::F(index), model.f[index], model.f_standard_error.map(|errors| errors[index]));
            }
        }
        Kind::SingleAxis => add(Parameter::F(6), model.f[6], model.f_standard_error.map(|errors| errors[6])),
    }
    for joint in 0..joints {
        add(Parameter::Viscous(joint), model.viscous_nm_s_per_rad[joint], of(&model.viscous_standard_error, joint));
        add(Parameter::Coulomb(joint), model.coulomb_nm[joint], of(&model.coulomb_standard_error, joint));
    }
    if robot.kind == Kind::SingleAxis {
        // The offset of an axis is part of its structure, and in the model file an effect.
        let offset = model.effects.iter().find(|effect| effect.name == "torque-offset");
        let value = offset.and_then(|offset| offset.parameters.get("torque_nm")).copied().unwrap_or(0.0);
        values.torque_offset_nm[0] = value;
        add(Parameter::TorqueOffset(0), value, offset.and_then(|o| o.standard_error.get("torque_nm")).copied());
    }
    if robot.kind == Kind::TwoLink {
        // Every amplifier and every cable has a little offset; what is larger is an effect.
        for joint in 0..joints {
            let little = USUAL_OFFSET * model.coulomb_nm[joint];
            if little > 0.0 {
                free.push((Parameter::TorqueOffset(joint), little));
            }
        }
    }
    let (free, standard_error) = free.into_iter().unzip();
    Baseline { values, free, standard_error }
}

/// The effects that the model came with.
fn known_effects(robot: &Robot, model: &Model, records: usize) -> Result<Vec<Instance>, ExplainError> {
    let mut known = Vec::new();
    let mut off = crate::effects::off(robot);
    for effect in &model.effects {
        if robot.kind == Kind::SingleAxis && effect.name == "torque-offset" {
            continue;
        }
        let refuse = || ExplainError::UnknownEffect { name: effect.name.clone(), joint: effect.joint.clone() };
        let kind = library::kind(&effect.name).ok_or_else(refuse)?;
        let joint = robot.joints.iter().position(|joint| joint.name == effect.joint);
        let joint = if kind.of_arm { 0 } else { joint.ok_or_else(refuse)? };
        let values: Vec<f64> = kind
            .parameters
            .iter()
            .map(|parameter| {
                effect.parameters.get(parameter.name).copied().unwrap_or_else(|| *parameter.of(&mut off, joint))
            })
            .collect();
        known.push(Instance::new(kind, joint, &values, records));
    }
    Ok(known)
}

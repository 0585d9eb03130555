//! `armid identify`.

use std::path::PathBuf;

use armid::identified_model;
use armid::identify::{
    Experiment, FrictionMode, Identification, Method, Options, Parameter, Prior, Sought, Values, identify,
};
use armid::links::ArmBounds;
use armid::model::Model;
use armid::number_text::significant;
use armid::prior;
use armid::recording::Recording;
use armid::report::FileRole;
use armid::robot::{Kind, Law, Robot};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::ProgressBar;
use serde_json::{Value, json};
use shared::arm::PARAMETERS;
use shared::genetic::Coding;

use super::common::{RobotArguments, advise, check_distinct, print, print_json, read_recordings, with_sidecars};
use super::outputs::{FileKind, check_outputs};
use super::page::{self, ReportArguments};
use super::ranges::Verdict;
use super::{CommandError, progress};

const EXAMPLES: &str = "Examples:
  armid identify slow.csv fast.csv --out model.toml
  armid identify run.csv --robot robot.toml --filter 15 --identify-lead";

/// Arguments of `identify`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Identify {
    /// Recordings to identify from, made under the position loop
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    robot: RobotArguments,
    /// Recording kept out of the fit, to judge it by; may be given several times
    #[arg(long, value_name = "FILE")]
    check: Vec<PathBuf>,
    /// How f1..f9 are sought
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// How friction enters
    #[arg(long, value_enum, default_value_t)]
    friction: FrictionMode,
    /// Seek the position gains too, as a factor on each; recorded currents count as measurements of it
    #[arg(long, group = "seeks_the_loop")]
    identify_gain: bool,
    /// Seek the leads of the position loops too, one for all recordings, instead of believing manifests and robot file;
    /// recorded commands or currents say where to start, and count as measurements of it
    #[arg(long)]
    identify_lead: bool,
    /// With --identify-gain or --identify-lead: do not take the recorded currents for measurements
    #[arg(long, requires = "seeks_the_loop")]
    ignore_current: bool,
    /// Length of the upper arm in m: f3 and f4 then follow from f5 and f6 (f3 = a3 f5, f4 = a3 f6)
    #[arg(long, value_name = "METRES", value_parser = length)]
    a3: Option<f64>,
    /// What is known beforehand: a model file, taken with its standard errors, or lines NAME = [MEAN, STANDARD DEVIATION]
    #[arg(long, value_name = "FILE")]
    prior: Option<PathBuf>,
    /// Bounds on masses, centres and inertias, as `ranges` takes them: tell whether any links within them give this f
    #[arg(long, value_name = "FILE")]
    bounds: Option<PathBuf>,
    /// Seed of the searches
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// With --method paper: how the genetic algorithm reads the bits of a gene [default: binary, as in the paper]
    #[arg(long, value_parser = PossibleValuesParser::new(["binary", "gray"]).map(|name| match name.as_str() {
        "gray" => Coding::Gray,
        _ => Coding::Binary,
    }))]
    coding: Option<Coding>,
    /// Low-pass both the recorded and the simulated signals, without phase, before they are compared: against
    /// oscillations the model does not have, such as those of a flexible joint; in Hz
    #[arg(long, value_name = "HZ")]
    filter: Option<f64>,
    /// Use every sample as recorded: mend no corrupted samples, cut out no stretches at a limit or a stop
    #[arg(long)]
    as_recorded: bool,
    /// Accept recordings with gaps
    #[arg(long)]
    allow_gaps: bool,
    /// Model file to write
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Identify {
    pub fn run(&self) -> Result<(), CommandError> {
        if self.coding.is_some() && self.method != Method::Paper {
            return Err(CommandError::Usage("--coding is for --method paper; leave one out or add the other".into()));
        }
        check_distinct(self.recordings.iter().chain(&self.check))?;
        let mut robot = self.robot.read_for_simulation()?;
        let bounds = self.bounds.as_deref().map(|path| ArmBounds::read(path, &robot)).transpose()?;
        let mut recordings = read_recordings(&self.recordings, &robot, self.allow_gaps)?;
        let mut held_out = read_recordings(&self.check, &robot, self.allow_gaps)?;
        let mut priors = Vec::new();
        if self.identify_lead {
            let of_leads = prior::leads_from_current(&mut robot, &mut recordings, &mut held_out)?;
            priors.extend(of_leads.into_iter().filter(|_| !self.ignore_current));
        }
        for recording in recordings.iter().chain(&held_out) {
            recording.check_conditions(&robot).map_err(CommandError::Repeating)?;
            advise_other_gains(recording, &robot);
        }
        let inputs = [with_sidecars(&self.recordings), with_sidecars(&self.check)].concat();
        let inputs =
            || inputs.iter().chain(&self.robot.robot).chain(&self.prior).chain(&self.bounds).map(PathBuf::as_path);
        check_outputs(self.out.as_deref().map(|out| (out, FileKind::Model)), inputs())?;
        self.report.check(self.out.as_deref(), inputs())?;
        let sought = Sought {
            friction: self.friction,
            gain: self.identify_gain,
            lead: self.identify_lead,
            upper_arm_m: self.a3,
        };
        priors.extend(self.priors(&robot, &recordings)?);
        let options = Options {
            method: self.method,
            sought,
            seed: self.seed,
            priors,
            filter_hz: self.filter,
            coding: self.coding,
            as_recorded: self.as_recorded,
        };
        let found = with_progress(&robot, &recordings, &held_out, &options)?;
        let model = to_model(&robot, &recordings, &found, &options);
        let feasible = bounds.map(|bounds| Feasible::of(&robot, &recordings, &bounds, &found)).transpose()?;
        match &self.out {
            Some(path) => model.write(path)?,
            None => advise("the model was not kept; pass --out model.toml to write it"),
        }
        if self.json {
            let mut object = to_json(&robot, &found, &model, self.seed);
            object["lead"] = leads_to_json(&robot, &found);
            object["feasible"] = feasible.as_ref().map_or(Value::Null, |feasible| feasible.to_json());
            print_json(&object)?;
        } else {
            let feasible = feasible.as_ref().map(|feasible| format!("\n{}", feasible.text())).unwrap_or_default();
            print(format!("{}{feasible}", report(&robot, &found)))?;
        }
        self.report.write(|| {
            let identified = page::identify::Identified {
                robot: &robot,
                recordings: &recordings,
                held_out: &held_out,
                as_recorded: self.as_recorded,
                found: &found,
                remarks: feasible.iter().map(Feasible::text).collect(),
            };
            let provenance = page::provenance()
                .seed(self.seed)
                .robot(&robot)
                .model(&robot, &model)
                .recordings(FileRole::Read, recordings.iter().chain(&held_out))
                .files(FileRole::Read, inputs())
                .files(FileRole::Written, self.out.as_deref());
            identified.page(&provenance)
        })
    }
}

impl Identify {
    fn priors(&self, robot: &Robot, recordings: &[Recording]) -> Result<Vec<Prior>, CommandError> {
        let mut priors = self.prior.as_deref().map_or_else(|| Ok(Vec::new()), |path| prior::read(path, robot))?;
        if self.identify_gain && !self.ignore_current {
            priors.extend(prior::gains_from_current(robot, recordings));
        }
        Ok(priors)
    }
}

/// Tells that a recording is repeated with other gains than the robot file's.
fn advise_other_gains(recording: &Recording, robot: &Robot) {
    for (noted, joint) in recording.manifest.iter().flat_map(|manifest| &manifest.joint).zip(&robot.joints) {
        if let Law::Proportional(file) = joint.law {
            let in_force = noted.in_force(&file);
            if in_force != file {
                advise(format!(
                    "{}: joint {} ran with {} A/count and lead {}, as its manifest says, not with the robot file's {} and {}",
                    recording.path.display(),
                    joint.name,
                    in_force.gain_a_per_count,
                    in_force.lead,
                    file.gain_a_per_count,
                    file.lead
                ));
            }
        }
    }
}

/// Whether links within bounds give the f found, and what the nearest f that they give costs.
struct Feasible {
    verdict: Verdict,
    /// Closed-loop difference per joint with the nearest f, counts rms.
    nearest_rms_counts: Option<Vec<f64>>,
    rms_counts: Vec<f64>,
}

impl Feasible {
    fn of(
        robot: &Robot,
        recordings: &[Recording],
        bounds: &ArmBounds,
        found: &Identification,
    ) -> Result<Self, CommandError> {
        let verdict = Verdict::of(bounds, &found.values.f, &found.f_information());
        let experiment = Experiment::new(robot, recordings)?;
        let of =
            |f: [f64; PARAMETERS]| experiment.closed_loop_rms_counts(&Values { f, upper_arm_m: None, ..found.values });
        let nearest_rms_counts = verdict.nearest.map(|nearest| of(nearest.f));
        Ok(Self { verdict, nearest_rms_counts, rms_counts: found.rms_counts.clone() })
    }

    fn text(&self) -> String {
        let list = |values: &[f64]| values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(" / ");
        let cost = self.nearest_rms_counts.as_ref().map(|rms| {
            format!(
                "\nwith it the closed-loop difference is {} instead of {} counts rms",
                list(rms),
                list(&self.rms_counts)
            )
        });
        format!("{}{}", self.verdict.text(), cost.unwrap_or_default())
    }

    fn to_json(&self) -> Value {
        let mut object = self.verdict.to_json();
        object["nearest_rms_counts"] = json!(self.nearest_rms_counts);
        object
    }
}

/// A length in metres.
fn length(text: &str) -> Result<f64, String> {
    let length = text.parse().ok().filter(|&length: &f64| length > 0.0 && length < 10.0);
    length.ok_or_else(|| format!("\"{text}\" is not a length above 0 and below 10 m"))
}

/// Identifies with a progress bar.
pub fn with_progress(
    robot: &Robot,
    recordings: &[Recording],
    held_out: &[Recording],
    options: &Options,
) -> Result<Identification, CommandError> {
    let bar: ProgressBar = progress::bar("identify", 0);
    let found = identify(robot, recordings, held_out, options, &|step| {
        bar.set_length(step.total as u64);
        bar.set_position(step.done as u64);
        bar.set_message(step.stage);
    })?;
    bar.finish_and_clear();
    for finding in &found.findings {
        advise(finding);
    }
    if found.lack_of_fit {
        advise(
            "the model leaves far more than noise: something is missing from it, and the standard errors tell only how far \
             the best fit is determined, not how far it is true",
        );
    }
    if !found.not_identifiable.is_empty() {
        let names: Vec<String> = found.not_identifiable.iter().map(|parameter| parameter.name(robot)).collect();
        advise(format!("not identifiable from these recordings: {}", names.join(", ")));
    }
    for direction in &found.weak_directions {
        advise(direction.sentence(robot));
    }
    if !found.touched_bounds.is_empty() {
        advise(format!(
            "at the edge of what a machine can be: {}; the recordings alone would have gone beyond, so that something is \
             missing from the model or the recordings say little",
            found.touched_bounds.join(", ")
        ));
    }
    Ok(found)
}

/// The model found, with where it comes from.
pub fn to_model(robot: &Robot, recordings: &[Recording], found: &Identification, options: &Options) -> Model {
    let method = match options.method {
        Method::Full => "full",
        Method::Paper => "paper",
        Method::Linear => "linear",
        Method::Didim => "didim",
    };
    let provenance = identified_model::provenance(robot, recordings, method, options.seed);
    identified_model::from_identification(robot, found, provenance)
}

fn to_json(robot: &Robot, found: &Identification, model: &Model, seed: u64) -> Value {
    let parameters: Vec<Value> = found
        .free
        .iter()
        .copied()
        .chain(unsought(found))
        .map(|parameter| {
            json!({
                "name": parameter.name(robot),
                "value": found.values.get(parameter),
                "standard_error": found.standard_error(parameter),
                "identifiable": !found.not_identifiable.contains(&parameter),
            })
        })
        .collect();
    let names = |parameters: &[Parameter]| parameters.iter().map(|p| p.name(robot)).collect::<Vec<String>>();
    let mut object = json!({
        "f": model.f,
        "standard_error": model.f_standard_error,
        "friction": {
            "viscous_nm_s_per_rad": model.viscous_nm_s_per_rad,
            "viscous_standard_error": model.viscous_standard_error,
            "coulomb_nm": model.coulomb_nm,
            "coulomb_standard_error": model.coulomb_standard_error,
        },
        "parameters": parameters,
        "correlations": found.correlations,
        "correlation_order": names(&found.free),
        "not_identifiable": names(&found.not_identifiable),
        "condition_number": found.condition_number.filter(|number| number.is_finite()),
        "weak_directions": found.weak_directions.iter().map(|direction| json!({
            "components": direction.components.iter()
                .map(|&(parameter, by)| json!({"name": parameter.name(robot), "by": by})).collect::<Vec<_>>(),
            "common_scale": direction.common_scale,
            "sentence": direction.sentence(robot),
        })).collect::<Vec<_>>(),
        "touched_bounds": found.touched_bounds,
        "left_out": found.left_out.iter().map(|left_out| json!({
            "rms_counts": left_out.rms_counts, "innovation_rms_counts": left_out.innovation_rms_counts,
        })).collect::<Vec<_>>(),
        "repeats": found.repeats.iter().map(|repeats| json!({
            "recordings": repeats.recordings, "scatter": repeats.scatter, "standard_errors": repeats.standard_errors,
            "ratio": repeats.ratio(),
        })).collect::<Vec<_>>(),
        "objective_counts2": found.objective_counts2,
        "least_objective_counts2": found.least_objective_counts2(),
        "rms_counts": found.rms_counts,
        "held_out_rms_counts": found.held_out_rms_counts,
        "innovation_rms_counts": found.innovation_rms_counts,
        "held_out_innovation_rms_counts": found.held_out_innovation_rms_counts,
        "lack_of_fit": found.lack_of_fit,
        "force_gap_rms": found.force_gap_rms,
        "samples": found.samples,
        "findings": found.findings,
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "seed": seed,
    });
    if robot.kind == Kind::SingleAxis {
        object["mass"] = json!(model.f[6]);
        object["torque_offset_nm"] = json!(found.values.torque_offset_nm[0]);
    }
    object
}

/// What was not sought itself, but follows from what was, or is shown by nothing.
pub fn unsought(found: &Identification) -> impl Iterator<Item = Parameter> {
    let is_tied = found.values.upper_arm_m.is_some();
    let tied = [Parameter::F(2), Parameter::F(3)].into_iter().filter(move |_| is_tied);
    tied.chain(found.not_identifiable.iter().copied().filter(|parameter| !found.free.contains(parameter)))
}

/// The leads that were sought, joint by joint: null where none was.
fn leads_to_json(robot: &Robot, found: &Identification) -> Value {
    let lead = |joint: usize| {
        let parameter = Parameter::Lead(joint);
        found
            .free
            .contains(&parameter)
            .then(|| json!({"value": found.values.get(parameter), "standard_error": found.standard_error(parameter)}))
    };
    let leads: Vec<Option<Value>> = (0..robot.joints.len()).map(lead).collect();
    if leads.iter().all(Option::is_none) { Value::Null } else { json!(leads) }
}

/// The result for people.
fn report(robot: &Robot, found: &Identification) -> String {
    let mut lines = vec![format!("{:<22} {:>14} {:>14}  {}", "parameter", "value", "standard error", "relative")];
    for parameter in found.free.iter().copied().chain(unsought(found)) {
        let value = found.values.get(parameter);
        let (error, relative) = match found.standard_error(parameter) {
            Some(error) => (format!("{error:.3e}"), format!("{:.3} %", 100.0 * (error / value).abs())),
            None => ("–".into(), String::new()),
        };
        let verdict = if found.not_identifiable.contains(&parameter) { "not identifiable" } else { "" };
        let name = parameter.name(robot);
        lines.push(
            format!("{name:<22} {:>14} {error:>14}  {relative:>8} {verdict}", significant(value, 6))
                .trim_end()
                .to_string(),
        );
    }
    let list = |values: &[f64]| values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(" / ");
    let rounding = if robot.quantised { " (rounding alone: 0.29)" } else { "" };
    lines.push(format!(
        "closed-loop difference {} counts rms (Y = {:.0} counts²); innovations {} counts rms{rounding}",
        list(&found.rms_counts),
        found.objective_counts2,
        list(&found.innovation_rms_counts)
    ));
    if let (Some(least), true) = (found.least_objective_counts2(), found.standard_errors.is_some()) {
        lines.push(format!("least Y found within a few standard errors: {least:.0} counts²"));
    }
    if !found.held_out_rms_counts.is_empty() {
        lines.push(format!(
            "held out: closed-loop difference {} counts rms; innovations {} counts rms",
            list(&found.held_out_rms_counts),
            list(&found.held_out_innovation_rms_counts)
        ));
    }
    for (index, left_out) in found.left_out.iter().enumerate() {
        lines.push(format!(
            "recording {} foretold by the others: closed-loop difference {} counts rms; innovations {} counts rms",
            index + 1,
            list(&left_out.rms_counts),
            list(&left_out.innovation_rms_counts)
        ));
    }
    for repeats in &found.repeats {
        let numbers: Vec<String> = repeats.recordings.iter().map(|index| (index + 1).to_string()).collect();
        lines.push(format!(
            "recordings {} repeat one movement: each fitted alone, they scatter by {:.2} of the standard errors",
            numbers.join(", "),
            repeats.ratio()
        ));
    }
    if let Some(gap) = &found.force_gap_rms {
        lines.push(format!("force gap {} N (N m) rms", list(gap)));
    }
    if let Some(number) = found.condition_number {
        lines.push(format!("condition number of the scaled information matrix: {number:.3e}"));
    }
    if let Some(correlated) = strongest_correlation(robot, found) {
        lines.push(correlated);
    }
    lines.push(format!("{} samples, {} simulations, {:.1} s", found.samples, found.evaluations, found.seconds));
    lines.join("\n")
}

/// The two parameters whose errors go together most.
fn strongest_correlation(robot: &Robot, found: &Identification) -> Option<String> {
    let correlations = found.correlations.as_ref()?;
    let pairs = (0..found.free.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let (i, j) = pairs.max_by(|&(a, b), &(c, d)| correlations[a][b].abs().total_cmp(&correlations[c][d].abs()))?;
    Some(format!(
        "strongest correlation: {} with {}, {:.3}",
        found.free[j].name(robot),
        found.free[i].name(robot),
        correlations[i][j]
    ))
}

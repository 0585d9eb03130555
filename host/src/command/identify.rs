//! `armid identify`.

use std::path::PathBuf;

use armid::identified_model;
use armid::identify::{FrictionMode, Identification, Method, Options, Parameter, identify};
use armid::model::Model;
use armid::recording::Recording;
use armid::robot::{Kind, Robot};
use clap::Args;
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::common::{RobotArguments, advise, check_outputs, print, print_json, read_recordings, with_sidecars};
use super::{CommandError, progress};

/// Arguments of `identify`.
#[derive(Debug, Args)]
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
    /// Seed of the genetic algorithm
    #[arg(long, default_value_t = 1)]
    seed: u64,
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
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Identify {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read_for_simulation()?;
        let recordings = read_recordings(&self.recordings, &robot, self.allow_gaps)?;
        let held_out = read_recordings(&self.check, &robot, self.allow_gaps)?;
        for recording in recordings.iter().chain(&held_out) {
            recording.check_conditions(&robot)?;
        }
        if let Some(out) = &self.out {
            let inputs = [with_sidecars(&self.recordings), with_sidecars(&self.check)].concat();
            check_outputs([out.as_path()], inputs.iter().chain(&self.robot.robot).map(PathBuf::as_path))?;
        }
        let options = Options {
            method: self.method,
            friction: self.friction,
            seed: self.seed,
            filter_hz: self.filter,
            as_recorded: self.as_recorded,
        };
        let found = with_progress(&robot, &recordings, &held_out, &options)?;
        let model = to_model(&robot, &recordings, &found, &options);
        match &self.out {
            Some(path) => model.write(path)?,
            None => advise("the model was not kept; pass --out model.toml to write it"),
        }
        if self.json { print_json(&to_json(&robot, &found, &model, self.seed)) } else { print(report(&robot, &found)) }
    }
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
        .map(|&parameter| {
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
        "objective_counts2": found.objective_counts2,
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

/// The result for people.
fn report(robot: &Robot, found: &Identification) -> String {
    let mut lines = vec![format!("{:<22} {:>14} {:>14}  {}", "parameter", "value", "standard error", "relative")];
    for &parameter in &found.free {
        let value = found.values.get(parameter);
        let (error, relative) = match found.standard_error(parameter) {
            Some(error) => (format!("{error:.3e}"), format!("{:.3} %", 100.0 * (error / value).abs())),
            None => ("–".into(), String::new()),
        };
        let verdict = if found.not_identifiable.contains(&parameter) { "not identifiable" } else { "" };
        let name = parameter.name(robot);
        lines.push(format!("{name:<22} {value:>14.6} {error:>14}  {relative:>8} {verdict}").trim_end().to_string());
    }
    let list = |values: &[f64]| values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(" / ");
    let rounding = if robot.quantised { " (rounding alone: 0.29)" } else { "" };
    lines.push(format!(
        "closed-loop difference {} counts rms (Y = {:.0} counts²); innovations {} counts rms{rounding}",
        list(&found.rms_counts),
        found.objective_counts2,
        list(&found.innovation_rms_counts)
    ));
    if !found.held_out_rms_counts.is_empty() {
        lines.push(format!(
            "held out: closed-loop difference {} counts rms; innovations {} counts rms",
            list(&found.held_out_rms_counts),
            list(&found.held_out_innovation_rms_counts)
        ));
    }
    if let Some(gap) = &found.force_gap_rms {
        lines.push(format!("force gap {} N (N m) rms", list(gap)));
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

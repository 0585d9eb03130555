//! Models side by side: f and friction with their standard errors, and how well each repeats given recordings.

use std::path::PathBuf;

use armid::effects::BOTH_JOINTS;
use armid::identified_model;
use armid::identify::Experiment;
use armid::model::Model;
use armid::number_text::significant;
use armid::recording::Recording;
use armid::robot::Robot;
use serde_json::{Value, json};

use super::super::CommandError;
use super::super::common::{print, print_json, read_model};
use super::super::page::{self, ReportArguments};

/// How well a model repeats recordings, per joint in counts rms.
pub struct Gap {
    pub closed_loop_rms_counts: Vec<f64>,
    pub innovation_rms_counts: Vec<f64>,
}

/// One parameter of a model.
#[derive(Clone)]
pub struct Entry {
    pub name: String,
    pub value: f64,
    pub standard_error: Option<f64>,
}

/// One of the models.
pub struct Compared {
    pub path: PathBuf,
    pub model: Model,
    /// f and friction.
    pub entries: Vec<Entry>,
    /// How well it repeats the recordings, where there are any.
    pub gap: Option<Gap>,
}

/// Prints the models at `paths`, compared with the first.
pub fn compare(
    robot: &Robot,
    paths: &[PathBuf],
    recordings: &[Recording],
    as_json: bool,
    report: &ReportArguments,
) -> Result<(), CommandError> {
    let models = paths.iter().map(|path| read_model(path, robot)).collect::<Result<Vec<Model>, _>>()?;
    let experiment = (!recordings.is_empty()).then(|| Experiment::new(robot, recordings)).transpose()?;
    let compared: Vec<Compared> = paths
        .iter()
        .zip(models)
        .map(|(path, model)| {
            let gap = experiment.as_ref().map(|experiment| {
                let values = identified_model::values(robot, &model);
                Gap {
                    closed_loop_rms_counts: experiment.closed_loop_rms_counts(&values),
                    innovation_rms_counts: experiment.innovation_rms_counts(&values),
                }
            });
            Compared { path: path.clone(), entries: entries(robot, &model), model, gap }
        })
        .collect();
    if as_json { print_json(&to_json(&compared)) } else { print(table(robot, &compared)) }?;
    report.write(|| page::compare::of_models(robot, &compared, recordings, page::provenance().robot(robot)))
}

fn entries(robot: &Robot, model: &Model) -> Vec<Entry> {
    let mut entries: Vec<Entry> = model
        .f
        .iter()
        .enumerate()
        .map(|(index, &value)| Entry {
            name: format!("f{}", index + 1),
            value,
            standard_error: model.f_standard_error.map(|errors| errors[index]),
        })
        .collect();
    let frictions = [
        ("viscous friction", &model.viscous_nm_s_per_rad, &model.viscous_standard_error),
        ("Coulomb friction", &model.coulomb_nm, &model.coulomb_standard_error),
    ];
    for (kind, values, errors) in frictions {
        for (index, (joint, &value)) in robot.joints.iter().zip(values).enumerate() {
            let standard_error = errors.as_ref().map(|errors| errors[index]);
            entries.push(Entry { name: format!("{kind} {}", joint.name), value, standard_error });
        }
    }
    entries
}

/// How far `entry` is from `first`, in standard errors of the difference; nothing where one of them has none.
pub fn in_standard_errors(first: &Entry, entry: &Entry) -> Option<f64> {
    let together = first.standard_error?.hypot(entry.standard_error?);
    (together > 0.0).then(|| (entry.value - first.value) / together)
}

/// Every parameter of an effect that any of the models has: effect, joint and parameter.
pub fn effect_parameters(compared: &[Compared]) -> Vec<(String, String, String)> {
    let mut all = Vec::new();
    for effect in compared.iter().flat_map(|one| &one.model.effects) {
        for parameter in effect.parameters.keys() {
            let name = (effect.name.clone(), effect.joint.clone(), parameter.clone());
            if !all.contains(&name) {
                all.push(name);
            }
        }
    }
    all
}

/// A parameter of an effect and its standard error; nothing where the model has no such effect.
pub fn effect_parameter(
    model: &Model,
    (effect, joint, parameter): &(String, String, String),
) -> Option<(f64, Option<f64>)> {
    let effect = model.effects.iter().find(|candidate| candidate.name == *effect && candidate.joint == *joint)?;
    Some((*effect.parameters.get(parameter)?, effect.standard_error.get(parameter).copied()))
}

fn method(model: &Model) -> &str {
    model.provenance.get("method").and_then(|method| method.as_str()).unwrap_or("")
}

/// How wide a model's column is.
const WIDTH: usize = 34;

fn table(robot: &Robot, compared: &[Compared]) -> String {
    let row = |name: &str, cells: Vec<String>| {
        let cells: String = cells.iter().map(|cell| format!(" {cell:>WIDTH$}")).collect();
        format!("{name:<20}{cells}").trim_end().to_string()
    };
    let first = &compared[0].entries;
    let mut lines = vec![row("model", compared.iter().map(|one| one.path.display().to_string()).collect())];
    lines.push(row("method", compared.iter().map(|one| method(&one.model).to_string()).collect()));
    for (index, named) in first.iter().enumerate() {
        let cell = |of_model: &Compared| {
            let entry = &of_model.entries[index];
            let error = entry.standard_error.map_or_else(String::new, |error| format!(" ± {error:.1e}"));
            let apart = in_standard_errors(named, entry);
            let apart = apart.filter(|_| !std::ptr::eq(of_model, &compared[0]));
            let apart = apart.map_or_else(String::new, |apart| format!(" ({apart:+.1})"));
            format!("{}{error}{apart}", significant(entry.value, 6))
        };
        lines.push(row(&named.name, compared.iter().map(cell).collect()));
    }
    let gaps: Vec<&Gap> = compared.iter().filter_map(|one| one.gap.as_ref()).collect();
    if !gaps.is_empty() {
        let list = |values: &[f64]| values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(" / ");
        lines.push(row("closed-loop gap", gaps.iter().map(|gap| list(&gap.closed_loop_rms_counts)).collect()));
        lines.push(row("innovations", gaps.iter().map(|gap| list(&gap.innovation_rms_counts)).collect()));
    }
    for name in effect_parameters(compared) {
        let cell = |one: &Compared| {
            let Some((value, error)) = effect_parameter(&one.model, &name) else { return "–".to_string() };
            format!("{}{}", significant(value, 6), error.map_or_else(String::new, |error| format!(" ± {error:.1e}")))
        };
        let cells = compared.iter().map(cell).collect();
        let (effect, joint, parameter) = name;
        let whose = if joint == BOTH_JOINTS { String::new() } else { format!(" {joint}") };
        lines.push(row(&format!("{effect}{whose} {parameter}"), cells));
    }
    lines.push("in brackets: difference from the first model in standard errors of the difference".into());
    if !gaps.is_empty() {
        let rounding = if robot.quantised { "; rounding alone leaves innovations of 0.29" } else { "" };
        lines.push(format!("gaps in counts rms per joint{rounding}"));
    }
    lines.join("\n")
}

fn to_json(compared: &[Compared]) -> Value {
    let of_model = |one: &Compared| {
        let parameters: Vec<Value> = one
            .entries
            .iter()
            .zip(&compared[0].entries)
            .map(|(entry, first)| {
                json!({
                    "name": entry.name, "value": entry.value, "standard_error": entry.standard_error,
                    "difference": entry.value - first.value,
                    "difference_standard_errors": in_standard_errors(first, entry),
                })
            })
            .collect();
        let gap = one.gap.as_ref().map(|gap| {
            json!({
                "closed_loop_rms_counts": gap.closed_loop_rms_counts,
                "innovation_rms_counts": gap.innovation_rms_counts,
            })
        });
        json!({"model": one.path, "method": method(&one.model), "parameters": parameters, "effects": one.model.effects, "gap": gap})
    };
    json!({"models": compared.iter().map(of_model).collect::<Vec<Value>>()})
}

//! Models side by side: f and friction with their standard errors, and how well each repeats given recordings.

use std::path::PathBuf;

use armid::identified_model;
use armid::identify::Experiment;
use armid::model::Model;
use armid::recording::Recording;
use armid::robot::Robot;
use serde_json::{Value, json};

use super::super::CommandError;
use super::super::common::{print, print_json, read_model};

/// How well a model repeats recordings, per joint in counts rms.
struct Gap {
    closed_loop_rms_counts: Vec<f64>,
    innovation_rms_counts: Vec<f64>,
}

/// One parameter of a model.
#[derive(Clone)]
struct Entry {
    name: String,
    value: f64,
    standard_error: Option<f64>,
}

/// Prints the models at `paths`, compared with the first.
pub fn compare(robot: &Robot, paths: &[PathBuf], recordings: &[Recording], as_json: bool) -> Result<(), CommandError> {
    let models = paths.iter().map(|path| read_model(path, robot)).collect::<Result<Vec<Model>, _>>()?;
    let experiment = (!recordings.is_empty()).then(|| Experiment::new(robot, recordings)).transpose()?;
    let gaps: Option<Vec<Gap>> = experiment.map(|experiment| {
        let gap = |model: &Model| {
            let values = identified_model::values(robot, model);
            Gap {
                closed_loop_rms_counts: experiment.closed_loop_rms_counts(&values),
                innovation_rms_counts: experiment.innovation_rms_counts(&values),
            }
        };
        models.iter().map(gap).collect()
    });
    let entries: Vec<Vec<Entry>> = models.iter().map(|model| entries(robot, model)).collect();
    if as_json {
        return print_json(&to_json(paths, &models, &entries, gaps.as_deref()));
    }
    print(table(robot, paths, &models, &entries, gaps.as_deref()))
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
fn in_standard_errors(first: &Entry, entry: &Entry) -> Option<f64> {
    let together = first.standard_error?.hypot(entry.standard_error?);
    (together > 0.0).then(|| (entry.value - first.value) / together)
}

fn method(model: &Model) -> &str {
    model.provenance.get("method").and_then(|method| method.as_str()).unwrap_or("")
}

/// How wide a model's column is.
const WIDTH: usize = 34;

fn table(robot: &Robot, paths: &[PathBuf], models: &[Model], entries: &[Vec<Entry>], gaps: Option<&[Gap]>) -> String {
    let row = |name: &str, cells: Vec<String>| {
        let cells: String = cells.iter().map(|cell| format!(" {cell:>WIDTH$}")).collect();
        format!("{name:<20}{cells}").trim_end().to_string()
    };
    let mut lines = vec![row("model", paths.iter().map(|path| path.display().to_string()).collect())];
    lines.push(row("method", models.iter().map(|model| method(model).to_string()).collect()));
    for index in 0..entries[0].len() {
        let cell = |of_model: &Vec<Entry>| {
            let entry = &of_model[index];
            let error = entry.standard_error.map_or_else(String::new, |error| format!(" ± {error:.1e}"));
            let apart = in_standard_errors(&entries[0][index], entry);
            let apart = apart.filter(|_| !std::ptr::eq(of_model, &entries[0]));
            let apart = apart.map_or_else(String::new, |apart| format!(" ({apart:+.1})"));
            format!("{:.6}{error}{apart}", entry.value)
        };
        lines.push(row(&entries[0][index].name, entries.iter().map(cell).collect()));
    }
    if let Some(gaps) = gaps {
        let list = |values: &[f64]| values.iter().map(|value| format!("{value:.3}")).collect::<Vec<_>>().join(" / ");
        lines.push(row("closed-loop gap", gaps.iter().map(|gap| list(&gap.closed_loop_rms_counts)).collect()));
        lines.push(row("innovations", gaps.iter().map(|gap| list(&gap.innovation_rms_counts)).collect()));
    }
    lines.push("in brackets: difference from the first model in standard errors of the difference".into());
    if gaps.is_some() {
        let rounding = if robot.quantised { "; rounding alone leaves innovations of 0.29" } else { "" };
        lines.push(format!("gaps in counts rms per joint{rounding}"));
    }
    lines.join("\n")
}

fn to_json(paths: &[PathBuf], models: &[Model], entries: &[Vec<Entry>], gaps: Option<&[Gap]>) -> Value {
    let of_model = |index: usize| {
        let parameters: Vec<Value> = entries[index]
            .iter()
            .zip(&entries[0])
            .map(|(entry, first)| {
                json!({
                    "name": entry.name, "value": entry.value, "standard_error": entry.standard_error,
                    "difference": entry.value - first.value,
                    "difference_standard_errors": in_standard_errors(first, entry),
                })
            })
            .collect();
        let gap = gaps.map(|gaps| {
            json!({
                "closed_loop_rms_counts": gaps[index].closed_loop_rms_counts,
                "innovation_rms_counts": gaps[index].innovation_rms_counts,
            })
        });
        json!({"model": paths[index], "method": method(&models[index]), "parameters": parameters, "gap": gap})
    };
    json!({"models": (0..models.len()).map(of_model).collect::<Vec<Value>>()})
}

//! The pages of `compare`: models side by side, or recordings one over the other.

use std::ops::Range;
use std::path::{Path, PathBuf};

use armid::identified_model;
use armid::recording::Recording;
use armid::report::{Cell, Content, FileRole, Ink, Interval, Intervals, Page, Picture, Provenance, Section, Table};
use armid::robot::Robot;

use super::super::CommandError;
use super::super::compare::models::{Compared, Entry, effect_parameter, effect_parameters, in_standard_errors};
use super::super::compare::recordings::{Difference, pictures};
use super::identify::repeated;
use super::per_joint;

/// The page of models compared with the first, and of how the first and the last repeat the recordings.
pub fn of_models(
    robot: &Robot,
    compared: &[Compared],
    recordings: &[Recording],
    provenance: Provenance,
) -> Result<Page, CommandError> {
    let names: Vec<String> = compared.iter().map(|one| one.path.display().to_string()).collect();
    let mut sections = vec![values(compared, &names)];
    sections.extend(effects(compared, &names));
    if let Some(gaps) = gaps(robot, compared, &names) {
        sections.push(gaps);
    }
    if !recordings.is_empty() {
        for (one, name) in compared.iter().zip(&names) {
            for mut section in repeated(robot, recordings, &identified_model::values(robot, &one.model), true)? {
                section.title = format!("{}: {name}", section.title);
                sections.push(section);
            }
        }
    }
    let models: Vec<&Path> = compared.iter().map(|one| one.path.as_path()).collect();
    sections.push(provenance.files(FileRole::Read, models).recordings(FileRole::Read, recordings).section());
    let gap = |one: &Compared| {
        let gap = one.gap.as_ref()?;
        Some(format!(
            "{}: closed-loop difference {}, innovations {} counts rms.",
            one.path.display(),
            per_joint(&gap.closed_loop_rms_counts, 3),
            per_joint(&gap.innovation_rms_counts, 3)
        ))
    };
    let verdict: Vec<String> = compared.iter().filter_map(gap).collect();
    let verdict =
        if verdict.is_empty() { format!("{} against {}.", names[1..].join(", "), names[0]) } else { verdict.join(" ") };
    Ok(Page { command: "compare".into(), title: robot.name.clone(), verdict, sections })
}

/// Every value with its distance from the first model's.
fn values(compared: &[Compared], names: &[String]) -> Section {
    let mut headings = vec!["parameter".to_string()];
    for (index, name) in names.iter().enumerate() {
        headings.extend([name.clone(), format!("± ({})", index + 1)]);
        if index > 0 {
            headings.push(format!("({}) less (1), standard errors", index + 1));
        }
    }
    let mut table = Table { headings, rows: Vec::new() };
    for (place, first) in compared[0].entries.iter().enumerate() {
        let mut cells = vec![Cell::from(first.name.as_str())];
        for (index, one) in compared.iter().enumerate() {
            let entry = &one.entries[place];
            cells.extend([Cell::significant(entry.value), Cell::optional(entry.standard_error, Cell::scientific)]);
            if index > 0 {
                cells.push(Cell::optional(in_standard_errors(first, entry), |apart| Cell::fixed(apart, 1)));
            }
        }
        table.rows.push(cells);
    }
    let title = |of: &str| format!("{of}: difference from {}, 95 % intervals", compared[0].path.display());
    let f = compared[0].entries.iter().filter(|entry| !entry.name.contains(FRICTION)).count();
    let pictures = [differences(title("f1..f9"), compared, names, 0..f)].into_iter().chain([differences(
        title("friction"),
        compared,
        names,
        f..compared[0].entries.len(),
    )]);
    Section::new("Parameters").table(table).pictures(pictures.flatten().collect())
}

/// What the models have beyond f and friction, parameter by parameter; nothing where none has anything.
fn effects(compared: &[Compared], names: &[String]) -> Option<Section> {
    let mut headings = ["effect", "joint", "parameter"].map(String::from).to_vec();
    headings.extend(names.iter().enumerate().flat_map(|(index, name)| [name.clone(), format!("± ({})", index + 1)]));
    let mut table = Table { headings, rows: Vec::new() };
    for parameter in effect_parameters(compared) {
        let found = compared.iter().map(|one| effect_parameter(&one.model, &parameter));
        let of_models: Vec<Cell> = found
            .flat_map(|found| {
                let error = found.and_then(|(_, error)| error);
                let value = found.map(|(value, _)| value);
                [Cell::optional(value, Cell::significant), Cell::optional(error, Cell::scientific)]
            })
            .collect();
        let (effect, joint, parameter) = parameter;
        table.rows.push([effect, joint, parameter].map(Cell::from).into_iter().chain(of_models).collect());
    }
    (!table.rows.is_empty()).then(|| Section::new("Effects").table(table))
}

/// What the names of friction parameters have and those of f do not.
const FRICTION: &str = " friction";

/// How far some of the parameters are from the first model's; nothing where no standard error says what is far.
fn differences(title: String, compared: &[Compared], names: &[String], of: Range<usize>) -> Option<Picture> {
    let first = &compared[0].entries[of.clone()];
    let interval = |(first, entry): (&Entry, &Entry)| {
        let apart = in_standard_errors(first, entry)?;
        Some(Interval { low: apart - 1.96, value: apart, high: apart + 1.96 })
    };
    let sources = compared.iter().zip(names).enumerate().skip(1).map(|(index, (one, name))| {
        let apart = first.iter().zip(&one.entries[of.clone()]).map(interval);
        (name.clone(), Ink::Nth(index - 1), apart.collect::<Vec<_>>())
    });
    let sources: Vec<_> = sources.collect();
    if sources.iter().all(|(_, _, intervals)| intervals.iter().all(Option::is_none)) {
        return None;
    }
    // There is little room below an axis.
    let names = first.iter().map(|entry| entry.name.replace(FRICTION, "")).collect();
    let content = Content::Intervals(Intervals { names, sources, logarithmic: false });
    Some(Picture::of(title, ["", "standard errors"], content))
}

fn gaps(robot: &Robot, compared: &[Compared], names: &[String]) -> Option<Section> {
    let mut table = Table::new(["model", "joint", "closed-loop difference, counts rms", "innovations, counts rms"]);
    for (one, name) in compared.iter().zip(names) {
        let gap = one.gap.as_ref()?;
        for (index, joint) in robot.joints.iter().enumerate() {
            table = table.row([
                Cell::from(name.as_str()),
                Cell::from(joint.name.as_str()),
                Cell::fixed(gap.closed_loop_rms_counts[index], 4),
                Cell::fixed(gap.innovation_rms_counts[index], 4),
            ]);
        }
    }
    Some(Section::new("How well each repeats the recordings").table(table))
}

/// The page of recordings compared with the first.
pub fn of_recordings(
    robot: &Robot,
    recordings: &[Recording],
    differences: &[Vec<Difference>],
    provenance: Provenance,
) -> Page {
    let mut table = Table::new([
        "recording",
        "joint",
        "samples",
        "largest difference, counts",
        "difference, counts rms",
        "references differ by, counts",
    ]);
    let mut verdict = Vec::new();
    for (recording, differences) in recordings[1..].iter().zip(differences) {
        let rms: Vec<f64> = differences.iter().map(|difference| difference.rms_counts).collect();
        verdict.push(format!("{}: {} counts rms apart.", recording.path.display(), per_joint(&rms, 2)));
        for (joint, difference) in robot.joints.iter().zip(differences) {
            table = table.row([
                Cell::from(recording.path.display().to_string()),
                Cell::from(joint.name.as_str()),
                Cell::count(difference.samples),
                Cell::fixed(difference.max_counts, 1),
                Cell::fixed(difference.rms_counts, 2),
                Cell::fixed(difference.reference_max_counts, 1),
            ]);
        }
    }
    let against = format!("Tracking errors against those of {}.", recordings[0].path.display());
    Page {
        command: "compare".into(),
        title: robot.name.clone(),
        verdict: verdict.join(" "),
        sections: vec![
            Section::new("Differences").text(against).table(table).pictures(pictures(robot, recordings)),
            provenance.recordings(FileRole::Read, recordings).section(),
        ],
    }
}

/// What is read: models and recordings with their sidecars.
pub fn inputs(models: &[PathBuf], recordings: &[PathBuf]) -> Vec<PathBuf> {
    models.iter().cloned().chain(super::super::common::with_sidecars(recordings)).collect()
}

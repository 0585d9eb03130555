//! The pages of the demonstrations.

use std::path::Path;

use armid::explain::Explanation;
use armid::hidden_robot::HiddenRobot;
use armid::model::{Effect, Model};
use armid::recording::Recording;
use armid::report::{Cell, FileRole, Page, Provenance, Section, Table};
use armid::robot::Robot;

use super::super::CommandError;
use super::super::track::Compared;
use super::identify::Identified;
use super::track;

/// The page of the whole chain.
pub fn chain(
    identified: &Identified,
    truth: &HiddenRobot,
    model: &Model,
    compared: &[Compared],
    provenance: Provenance,
) -> Result<Page, CommandError> {
    let robot = identified.robot;
    let mut sections = track::sections(robot, compared);
    sections.push(truth_and_model(robot, truth, model));
    sections.extend(identified.sections()?);
    let tracked: Vec<&Recording> = compared.iter().map(|one| &one.recording).collect();
    let provenance =
        provenance.recordings(FileRole::Written, identified.recordings).recordings(FileRole::Written, tracked);
    sections.push(provenance.model(robot, model).section());
    Ok(Page {
        command: "demo".into(),
        title: "A hidden robot, identified and tracked".into(),
        verdict: track::verdict(compared),
        sections,
    })
}

/// True and found parameters side by side.
fn truth_and_model(robot: &Robot, truth: &HiddenRobot, model: &Model) -> Section {
    let mut table = Table::new(["parameter", "true", "found", "error", "± standard error"]);
    let mut row = |name: String, truth: f64, found: f64, standard_error: Option<f64>| {
        let numbers = [truth, found, found - truth].map(Cell::significant);
        let error = Cell::optional(standard_error, Cell::scientific);
        table.rows.push([Cell::from(name)].into_iter().chain(numbers).chain([error]).collect());
    };
    for (index, (truth, found)) in truth.f.iter().zip(model.f).enumerate() {
        row(format!("f{}", index + 1), *truth, found, model.f_standard_error.map(|errors| errors[index]));
    }
    let frictions = [
        ("viscous friction", truth.viscous_nm_s_per_rad, &model.viscous_nm_s_per_rad, &model.viscous_standard_error),
        ("Coulomb friction", truth.coulomb_nm, &model.coulomb_nm, &model.coulomb_standard_error),
    ];
    for (kind, truth, found, errors) in frictions {
        for (index, joint) in robot.joints.iter().enumerate().take(2) {
            let error = errors.as_ref().and_then(|errors| errors.get(index)).copied();
            row(format!("{kind} {}", joint.name), truth[index], found[index], error);
        }
    }
    Section::new("True and found").table(table)
}

/// The page of a robot that changed: what changed, as found and in truth, and tracking before and after.
pub fn explained(
    robot: &Robot,
    truth: &Effect,
    recognised: &str,
    explanation: &Explanation,
    compared: &[Compared],
    provenance: Provenance,
) -> Page {
    let mut sections = track::sections(robot, compared);
    let mut table = Table::new(["parameter", "true"]);
    for (name, &value) in &truth.parameters {
        table = table.row([Cell::from(name.as_str()), Cell::significant(value)]);
    }
    let sentence = format!("Hidden was {} ({}): {recognised}.", truth.name, super::explain::place(&truth.joint));
    sections.push(Section::new("The truth").text(sentence).table(table));
    let of_explanation = super::explain::page(robot, explanation, &Provenance::default());
    // Its own provenance is this page's.
    let kept = of_explanation.sections.len() - 1;
    sections.extend(of_explanation.sections.into_iter().take(kept));
    let recordings: Vec<&Recording> = compared.iter().map(|one| &one.recording).collect();
    sections.push(provenance.recordings(FileRole::Written, recordings).section());
    Page {
        command: "demo explain".into(),
        title: "A robot that changed, explained and tracked".into(),
        verdict: format!("{} {}", of_explanation.verdict, track::verdict(compared)),
        sections,
    }
}

/// Files of the output folder, in their order.
pub fn written(provenance: Provenance, folder: &Path, names: &[&str]) -> Provenance {
    let paths: Vec<_> = names.iter().map(|name| folder.join(name)).collect();
    provenance.files(FileRole::Written, paths.iter().map(|path| path.as_path()))
}

//! The page of `track`: the position loop against computed torque.

use armid::capture::tracking_quality;
use armid::model::Model;
use armid::recording::Recording;
use armid::report::{self, FileRole, Page, Provenance, Section};
use armid::robot::Robot;

use super::super::track::Compared;
use super::per_joint;

/// The page of movements compared; `written` says whether their recordings were kept.
pub fn page(
    robot: &Robot,
    compared: &[Compared],
    model: Option<&Model>,
    written: bool,
    mut provenance: Provenance,
) -> Page {
    let mut sections = sections(robot, compared);
    if let Some(model) = model {
        sections.push(report::parameters(robot, "model", &report::of_model(robot, model)));
        provenance = provenance.model(robot, model);
    }
    let recordings: Vec<Recording> = compared
        .iter()
        .map(|one| {
            let kept = one.recording.clone();
            if written { kept } else { Recording { path: Default::default(), ..kept } }
        })
        .collect();
    sections.push(provenance.recordings(FileRole::Written, &recordings).section());
    Page { command: "track".into(), title: robot.name.clone(), verdict: verdict(compared), sections }
}

/// Tracking errors and currents of each.
pub fn sections(robot: &Robot, compared: &[Compared]) -> Vec<Section> {
    let runs: Vec<(&Recording, &str)> = compared.iter().map(|one| (&one.recording, one.label)).collect();
    let named: Vec<Recording> =
        compared.iter().map(|one| Recording { path: one.label.into(), ..one.recording.clone() }).collect();
    vec![
        Section::new("Tracking")
            .text(
                "Errors as recorded: reference less actual count, both truncated toward zero. Torque at the motor, as \
                 commanded. The green lines are the goal, ±1 count.",
            )
            .table(report::quality(robot, &runs))
            .pictures(report::tracking_pictures(robot, &runs)),
        report::currents(robot, &named),
    ]
}

/// The largest errors of each in a sentence.
pub fn verdict(compared: &[Compared]) -> String {
    let of = |one: &Compared| {
        let quality = tracking_quality(&one.recording);
        let largest: Vec<f64> = quality.iter().map(|joint| joint.max_abs_error_counts).collect();
        let within: Vec<f64> = quality.iter().map(|joint| joint.within_one_count_percent).collect();
        format!(
            "{}: at most {} counts, {} % of samples within ±1 count",
            one.label,
            per_joint(&largest, 0),
            per_joint(&within, 2)
        )
    };
    let text = compared.iter().map(of).collect::<Vec<_>>().join("; ") + ".";
    // Labels begin small: elsewhere they stand within a line.
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

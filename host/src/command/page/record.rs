//! The page of `record`, and of `report` where there is no model.

use armid::capture::tracking_quality;
use armid::recording::Recording;
use armid::report::{self, FileRole, Page, Provenance, Section};
use armid::robot::Robot;

use super::per_joint;

/// The page of recordings just made or read.
pub fn page(command: &str, robot: &Robot, recordings: &[Recording], role: FileRole, provenance: Provenance) -> Page {
    let mut sections = sections(robot, recordings);
    sections.push(provenance.recordings(role, recordings).section());
    Page { command: command.into(), title: robot.name.clone(), verdict: verdict(recordings), sections }
}

/// Tracking errors and currents as measured.
pub fn sections(robot: &Robot, recordings: &[Recording]) -> Vec<Section> {
    vec![report::measured(robot, recordings), report::currents(robot, recordings)]
}

/// Each recording in a sentence.
pub fn verdict(recordings: &[Recording]) -> String {
    let of = |recording: &Recording| {
        let quality = tracking_quality(recording);
        let largest: Vec<f64> = quality.iter().map(|joint| joint.max_abs_error_counts).collect();
        let rms: Vec<f64> = quality.iter().map(|joint| joint.rms_error_counts).collect();
        let partial = recording.manifest.as_ref().and_then(|manifest| manifest.partial.as_ref());
        let partial = partial.map_or_else(String::new, |reason| format!(" Only part of the movement: {reason}."));
        format!(
            "{}: largest tracking error {} counts, {} rms.{partial}",
            recording.path.display(),
            per_joint(&largest, 0),
            per_joint(&rms, 2)
        )
    };
    recordings.iter().map(of).collect::<Vec<_>>().join(" ")
}

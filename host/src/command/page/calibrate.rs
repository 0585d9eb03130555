//! The page of `calibrate`.

use armid::calibrate::{JointCalibration, Source};
use armid::recording::Recording;
use armid::report::{Cell, FileRole, Ink, Line, Page, Picture, Provenance, Section, Table, thinned};
use armid::robot::Robot;

/// The page of a calibration.
pub fn page(robot: &Robot, recordings: &[Recording], found: &[JointCalibration], provenance: Provenance) -> Page {
    let mut table = Table::new([
        "joint",
        "gain, A/count",
        "± standard error",
        "lead, ticks",
        "offset, mA",
        "residual, mA rms",
        "from",
        "samples",
        "robot file's gain, A/count",
        "robot file",
    ]);
    for joint in found {
        table = table.row([
            Cell::from(joint.joint.as_str()),
            Cell::fixed(joint.position_gain_a_per_count.value, 6),
            Cell::scientific(joint.position_gain_a_per_count.standard_error),
            Cell::optional(joint.lead.map(|lead| lead.value), |lead| Cell::fixed(lead, 4)),
            Cell::fixed(1e3 * joint.offset_a.value, 2),
            Cell::fixed(1e3 * joint.residual_a_rms, 2),
            Cell::from(match joint.source {
                Source::Command => "commanded current",
                Source::Measured => "measured current",
            }),
            Cell::count(joint.samples),
            Cell::fixed(joint.file_gain_a_per_count, 6),
            Cell::from(if joint.agrees { "agrees" } else { "disagrees" }),
        ]);
    }
    let agree = found.iter().all(|joint| joint.agrees);
    let verdict = if agree {
        "The robot file's gains are those of the recordings."
    } else {
        "The robot file's gains are not those of the recordings."
    };
    Page {
        command: "calibrate".into(),
        title: robot.name.clone(),
        verdict: verdict.into(),
        sections: vec![
            Section::new("Position loop").table(table).pictures(pictures(robot, recordings, found)),
            provenance.recordings(FileRole::Read, recordings).section(),
        ],
    }
}

/// The current of each recording, and what the law found makes of its errors.
fn pictures(robot: &Robot, recordings: &[Recording], found: &[JointCalibration]) -> Vec<Picture> {
    let mut pictures = Vec::new();
    for recording in recordings {
        for (index, joint) in found.iter().enumerate() {
            let commanded = recording.command_a.as_ref().filter(|_| joint.source == Source::Command);
            let column = commanded.unwrap_or(&recording.current_a);
            let errors = &recording.error_counts[index];
            let (gain, lead) =
                (joint.position_gain_a_per_count.value, joint.lead.map_or(0.0, |estimate| estimate.value));
            let law = |k: usize| {
                let before = errors[k.saturating_sub(1)];
                gain * (errors[k] + lead * (errors[k] - before)) + joint.offset_a.value
            };
            let over_time = |name: &str, ink: Ink, value: &dyn Fn(usize) -> f64| {
                let at = |k: usize| f64::from(recording.tick[k]) * robot.record_period_s;
                Line::new(name, ink, thinned((0..errors.len()).map(|k| (at(k), value(k))).collect()))
            };
            let name = if commanded.is_some() { "commanded" } else { "measured" };
            let lines = vec![
                over_time(name, Ink::Measured, &|k| column[index][k]),
                over_time("the law found, from the errors", Ink::Simulated, &law),
            ];
            let title = format!("joint {}, {}", joint.joint, recording.path.display());
            pictures.push(Picture::lines(title, ["time, s", "current, A"], lines));
        }
    }
    pictures
}

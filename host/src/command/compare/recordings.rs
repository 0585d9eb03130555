//! Recordings tick by tick: how far their tracking errors are apart, and one picture of all.

use std::collections::HashMap;
use std::path::Path;

use armid::recording::Recording;
use armid::report::{self, Ink, Line, Picture, staircase, thinned};
use armid::robot::Robot;
use serde_json::json;

use super::super::CommandError;
use super::super::common::{print, print_json, with_sidecars};
use super::super::outputs::{FileKind, check_outputs};
use super::super::page::{self, ReportArguments};

const WIDTH: u32 = 1100;
const PANEL_HEIGHT: u32 = 300;

/// One joint of a recording against the same of the first.
pub struct Difference {
    /// Ticks that both have.
    pub samples: usize,
    pub max_counts: f64,
    pub rms_counts: f64,
    pub reference_max_counts: f64,
}

/// Prints how far `recordings` are from the first, and draws them to `plot`.
pub fn compare(
    robot: &Robot,
    recordings: &[Recording],
    plot: Option<&Path>,
    as_json: bool,
    report: &ReportArguments,
) -> Result<(), CommandError> {
    if let Some(plot) = plot {
        let paths: Vec<_> = recordings.iter().map(|recording| recording.path.clone()).collect();
        check_outputs([(plot, FileKind::Picture)], with_sidecars(&paths).iter().map(std::path::PathBuf::as_path))?;
    }
    let differences: Vec<Vec<Difference>> = recordings[1..]
        .iter()
        .map(|recording| (0..robot.joints.len()).map(|joint| difference(&recordings[0], recording, joint)).collect())
        .collect();
    if let Some(empty) = differences.iter().position(|of| of.iter().any(|difference| difference.samples == 0)) {
        let [first, other] = [&recordings[0], &recordings[empty + 1]].map(|recording| recording.path.display());
        return Err(CommandError::Failed(format!("{first} and {other} have no tick in common")));
    }
    if let Some(path) = plot {
        let svg = draw(robot, recordings)?;
        armid::write_file(path, svg.as_bytes())?;
    }
    if as_json {
        let of_recording = |(recording, differences): (&Recording, &Vec<Difference>)| {
            let joints: Vec<_> = robot
                .joints
                .iter()
                .zip(differences)
                .map(|(joint, difference)| {
                    json!({
                        "joint": joint.name, "samples": difference.samples,
                        "error_max_counts": difference.max_counts, "error_rms_counts": difference.rms_counts,
                        "reference_max_counts": difference.reference_max_counts,
                    })
                })
                .collect();
            json!({"recording": recording.path, "joints": joints})
        };
        let others: Vec<_> = recordings[1..].iter().zip(&differences).map(of_recording).collect();
        print_json(&json!({"first": recordings[0].path, "differences": others, "plot": plot}))?;
    } else {
        print(table(robot, recordings, &differences))?;
    }
    report.write(|| {
        let provenance = page::provenance().robot(robot);
        Ok(page::compare::of_recordings(robot, recordings, &differences, provenance))
    })
}

fn table(robot: &Robot, recordings: &[Recording], differences: &[Vec<Difference>]) -> String {
    let mut lines = vec![
        format!("tracking errors against those of {}, in counts", recordings[0].path.display()),
        format!(
            "{:<30} {:>5} {:>8} {:>10} {:>10} {:>22}",
            "recording", "joint", "samples", "max", "rms", "references differ by"
        ),
    ];
    for (recording, differences) in recordings[1..].iter().zip(differences) {
        for (joint, difference) in robot.joints.iter().zip(differences) {
            lines.push(format!(
                "{:<30} {:>5} {:>8} {:>10.1} {:>10.2} {:>22.1}",
                recording.path.display(),
                joint.name,
                difference.samples,
                difference.max_counts,
                difference.rms_counts,
                difference.reference_max_counts
            ));
        }
    }
    lines.join("\n")
}

fn difference(first: &Recording, other: &Recording, joint: usize) -> Difference {
    let rows: HashMap<u32, usize> = first.tick.iter().enumerate().map(|(row, &tick)| (tick, row)).collect();
    let mut difference = Difference { samples: 0, max_counts: 0.0, rms_counts: 0.0, reference_max_counts: 0.0 };
    for (row, tick) in other.tick.iter().enumerate() {
        let Some(&of_first) = rows.get(tick) else { continue };
        let apart =
            |columns: fn(&Recording) -> &Vec<Vec<f64>>| columns(other)[joint][row] - columns(first)[joint][of_first];
        let error_counts = apart(|recording| &recording.error_counts);
        difference.samples += 1;
        difference.max_counts = difference.max_counts.max(error_counts.abs());
        difference.rms_counts += error_counts * error_counts;
        difference.reference_max_counts =
            difference.reference_max_counts.max(apart(|recording| &recording.reference_counts).abs());
    }
    difference.rms_counts = (difference.rms_counts / difference.samples.max(1) as f64).sqrt();
    difference
}

/// The tracking errors of all recordings, one panel a joint; gives the SVG's text.
fn draw(robot: &Robot, recordings: &[Recording]) -> Result<String, CommandError> {
    report::sheet("Tracking errors", &pictures(robot, recordings), 1, (WIDTH, PANEL_HEIGHT))
        .map_err(|error| CommandError::Failed(error.to_string()))
}

/// One picture a joint, with the tracking errors of all recordings.
pub fn pictures(robot: &Robot, recordings: &[Recording]) -> Vec<Picture> {
    let of_joint = |index: usize| {
        let line = |(place, recording): (usize, &Recording)| {
            let start_s = f64::from(recording.tick[0]) * robot.record_period_s;
            let points = staircase(&recording.error_counts[index], robot.record_period_s);
            let shifted = points.into_iter().map(|(time_s, error)| (start_s + time_s, error)).collect();
            Line::new(recording.path.display().to_string(), Ink::Nth(place), thinned(shifted))
        };
        let lines = recordings.iter().enumerate().map(line).collect();
        let title = format!("joint {}", robot.joints[index].name);
        Picture::lines(title, ["time, s", "error, counts"], lines).symmetric(2.0)
    };
    (0..robot.joints.len()).map(of_joint).collect()
}

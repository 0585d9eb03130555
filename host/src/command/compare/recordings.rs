//! Recordings tick by tick: how far their tracking errors are apart, and one picture of all.

use std::collections::HashMap;
use std::error::Error;
use std::path::Path;

use armid::recording::Recording;
use armid::robot::Robot;
use plotters::prelude::*;
use serde_json::json;

use super::super::CommandError;
use super::super::common::{check_outputs, print, print_json, with_sidecars};
use super::super::drawing::staircase;

const WIDTH: u32 = 1100;
const PANEL_HEIGHT: u32 = 300;

/// Colours that can be told apart by everyone (Okabe & Ito 2008).
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// One joint of a recording against the same of the first.
struct Difference {
    /// Ticks that both have.
    samples: usize,
    max_counts: f64,
    rms_counts: f64,
    reference_max_counts: f64,
}

/// Prints how far `recordings` are from the first, and draws them to `plot`.
pub fn compare(
    robot: &Robot,
    recordings: &[Recording],
    plot: Option<&Path>,
    as_json: bool,
) -> Result<(), CommandError> {
    if let Some(plot) = plot {
        let paths: Vec<_> = recordings.iter().map(|recording| recording.path.clone()).collect();
        check_outputs([plot], with_sidecars(&paths).iter().map(std::path::PathBuf::as_path))?;
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
        let svg = draw(robot, recordings).map_err(|error| CommandError::Failed(format!("no picture: {error}")))?;
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
        return print_json(&json!({"first": recordings[0].path, "differences": others, "plot": plot}));
    }
    let mut lines = vec![
        format!("tracking errors against those of {}, in counts", recordings[0].path.display()),
        format!(
            "{:<30} {:>5} {:>8} {:>10} {:>10} {:>22}",
            "recording", "joint", "samples", "max", "rms", "references differ by"
        ),
    ];
    for (recording, differences) in recordings[1..].iter().zip(&differences) {
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
    print(lines.join("\n"))
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
fn draw(robot: &Robot, recordings: &[Recording]) -> Result<String, Box<dyn Error>> {
    let joints = robot.joints.len();
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (WIDTH, PANEL_HEIGHT * joints as u32 + 40)).into_drawing_area();
        area.fill(&WHITE)?;
        let area = area.titled("Tracking errors", ("sans-serif", 22))?;
        for (index, panel) in area.split_evenly((joints, 1)).iter().enumerate() {
            let errors = || recordings.iter().flat_map(|recording| recording.error_counts[index].iter());
            let largest = errors().fold(2.0, |largest: f64, error| largest.max(error.abs())) * 1.15;
            let last = recordings.iter().filter_map(|recording| recording.tick.last()).max().copied().unwrap_or(1);
            let duration_s = f64::from(last) * robot.record_period_s;
            let mut chart = ChartBuilder::on(panel)
                .caption(format!("joint {}", robot.joints[index].name), ("sans-serif", 16))
                .margin(10)
                .x_label_area_size(34)
                .y_label_area_size(60)
                .build_cartesian_2d(0.0..duration_s, -largest..largest)?;
            chart.configure_mesh().light_line_style(WHITE).x_desc("time, s").y_desc("error, counts").draw()?;
            for (recording, colour) in recordings.iter().zip(COLOURS.iter().cycle()) {
                let start_s = f64::from(recording.tick[0]) * robot.record_period_s;
                let points = staircase(&recording.error_counts[index], robot.record_period_s);
                let shifted = points.into_iter().map(move |(time_s, error)| (start_s + time_s, error));
                let style = colour.stroke_width(1);
                chart
                    .draw_series(LineSeries::new(shifted, style))?
                    .label(recording.path.display().to_string())
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
            }
            chart.configure_series_labels().background_style(WHITE).border_style(BLACK).draw()?;
        }
        area.present()?;
    }
    Ok(svg)
}

//! The demo's picture: tracking errors before and after, one panel a joint and controller, as SVG.
//!
//! The text is left to the viewer's own sans-serif font, so nothing has to be installed where the picture is made.

use std::error::Error;

use armid::recording::Recording;
use armid::robot::Robot;
use plotters::prelude::*;

const WIDTH: u32 = 1000;
const HEIGHT: u32 = 640;

/// Draws the tracking errors of one movement run twice, under the controllers named; gives the SVG's text.
pub fn tracking(robot: &Robot, runs: [(&Recording, &str); 2]) -> Result<String, Box<dyn Error>> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        area.fill(&WHITE)?;
        let area =
            area.titled("Tracking error on the paper's movement (green: ±1 encoder count)", ("sans-serif", 22))?;
        let panels = area.split_evenly((2, 2));
        for (row, joint) in robot.joints.iter().enumerate().take(2) {
            for (column, (recording, controller)) in runs.into_iter().enumerate() {
                let title = format!("joint {}, {controller}", joint.name);
                panel(&panels[2 * row + column], &title, &recording.error_counts[row], robot.record_period_s)?;
            }
        }
        area.present()?;
    }
    Ok(svg)
}

fn panel(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    title: &str,
    error_counts: &[f64],
    period_s: f64,
) -> Result<(), Box<dyn Error>> {
    let largest = error_counts.iter().fold(2.0, |largest: f64, error| largest.max(error.abs())) * 1.15;
    let duration_s = error_counts.len() as f64 * period_s;
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(34)
        .y_label_area_size(50)
        .build_cartesian_2d(0.0..duration_s, -largest..largest)?;
    chart.configure_mesh().light_line_style(WHITE).x_desc("time, s").y_desc("error, counts").draw()?;
    // The paper's goal.
    for bound in [-1.0, 1.0] {
        chart.draw_series(LineSeries::new([(0.0, bound), (duration_s, bound)], GREEN.stroke_width(1)))?;
    }
    chart.draw_series(LineSeries::new(staircase(error_counts, period_s), BLUE.stroke_width(1)))?;
    Ok(())
}

/// The signal as held between samples, without the samples that change nothing: a third of the file's size.
pub fn staircase(error_counts: &[f64], period_s: f64) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (index, &error) in error_counts.iter().enumerate() {
        let time_s = index as f64 * period_s;
        if let Some(&(_, previous)) = points.last() {
            if previous == error && index + 1 < error_counts.len() {
                continue;
            }
            points.push((time_s, previous));
        }
        points.push((time_s, error));
    }
    points
}

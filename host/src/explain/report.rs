//! The report page: one HTML file with its pictures inside.

use std::fmt::Write as _;

use plotters::prelude::*;

use super::curves::Curve;
use super::engine::Engine;
use super::findings::Explanation;
use super::trace::residual_torque;
use crate::identify::Columns;

/// Points of a line at most: more are not seen.
const POINTS: usize = 1500;

/// One line of a picture.
#[derive(Clone, Debug)]
pub struct Line {
    /// What it shows.
    pub name: &'static str,
    /// Its points.
    pub points: Vec<(f64, f64)>,
}

/// One picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Its title.
    pub title: String,
    /// What lies along and upward.
    pub axes: [String; 2],
    /// Before and after, or a band.
    pub lines: Vec<Line>,
}

/// Pictures of what a model leaves before and after.
pub fn pictures(engine: &Engine, before: &Columns, after: &Columns, curves: &[Curve]) -> Vec<Picture> {
    let experiment = engine.setting.experiment;
    let mut pictures = Vec::new();
    let arm = engine.baseline.values.arm(experiment.robot);
    let torque = [before, after].map(|innovations| residual_torque(experiment, &engine.traces, &arm, innovations));
    for (joint, named) in experiment.robot.joints.iter().enumerate() {
        let ratio = named.gear_ratio;
        for segment in 0..experiment.segments.len() {
            let trace = &engine.traces[segment];
            let settled = experiment.settled(&experiment.segments[segment]);
            let over_time = |values: &[f64]| -> Vec<(f64, f64)> {
                thinned(settled.clone().map(|k| (trace.time_s[k], values[k])).collect())
            };
            pictures.push(Picture {
                title: format!("joint {}: innovations, recording {}", named.name, segment + 1),
                axes: ["time, s".into(), "counts".into()],
                lines: before_and_after(over_time(&before[segment][joint]), over_time(&after[segment][joint])),
            });
            pictures.push(Picture {
                title: format!("joint {}: torque the model lacks, recording {}", named.name, segment + 1),
                axes: ["time, s".into(), "N m at the motor".into()],
                lines: before_and_after(over_time(&torque[0][segment][joint]), over_time(&torque[1][segment][joint])),
            });
        }
        let spectrum = |columns: &Columns| -> Vec<(f64, f64)> {
            let rows = engine.setting.rows.of(columns);
            let series = engine.setting.rows.series.iter().find(|series| series.joint == joint);
            let Some(series) = series else { return Vec::new() };
            let lines = series.rows.clone().skip(1).step_by(2);
            lines
                .filter(|&row| row + 1 < series.rows.end)
                .map(|row| (engine.setting.rows.frequency_hz[row], rows[row].hypot(rows[row + 1])))
                .filter(|point| point.0 <= 60.0)
                .collect()
        };
        pictures.push(Picture {
            title: format!("joint {}: spectrum of the innovations", named.name),
            axes: ["Hz".into(), "counts per root of line".into()],
            lines: before_and_after(spectrum(before), spectrum(after)),
        });
        let orders = |of: usize| -> Vec<(f64, f64)> {
            (1..=280)
                .map(|step| {
                    let order = f64::from(step) * 0.05;
                    let (mut cosine, mut sine, mut count) = (0.0, 0.0, 0.0);
                    for (segment, trace) in engine.traces.iter().enumerate() {
                        for k in experiment.settled(&experiment.segments[segment]).step_by(4) {
                            let angle = order * ratio * trace.position_rad[joint][k];
                            cosine += torque[of][segment][joint][k] * angle.cos();
                            sine += torque[of][segment][joint][k] * angle.sin();
                            count += 1.0;
                        }
                    }
                    (order, 2.0 * f64::hypot(cosine, sine) / f64::max(count, 1.0))
                })
                .collect()
        };
        pictures.push(Picture {
            title: format!("joint {}: residual torque over orders of the motor's angle", named.name),
            axes: ["periods per motor turn".into(), "amplitude, N m".into()],
            lines: before_and_after(orders(0), orders(1)),
        });
    }
    for curve in curves {
        let of = |sign: f64| curve.points.iter().map(|p| (p[0], p[1] + sign * p[2])).collect();
        pictures.push(Picture {
            title: format!(
                "joint {}: what is left over {} (foretells {:.0} % of another recording)",
                curve.joint,
                curve.over,
                100.0 * curve.foretold.max(0.0)
            ),
            axes: [format!("{}, {}", curve.over, curve.unit), "N m at the motor".into()],
            lines: vec![
                Line { name: "band", points: of(-1.0) },
                Line { name: "band", points: of(1.0) },
                Line { name: "mean", points: of(0.0) },
            ],
        });
    }
    pictures
}

fn before_and_after(before: Vec<(f64, f64)>, after: Vec<(f64, f64)>) -> Vec<Line> {
    vec![Line { name: "before", points: before }, Line { name: "after", points: after }]
}

/// At most [`POINTS`] points: of each stretch the least and the greatest.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let stretch = points.len().div_ceil(POINTS / 2).max(1);
    let ends = |part: &[(f64, f64)]| {
        let least = part.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
        let most = part.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
        let mut both: Vec<(f64, f64)> = least.into_iter().chain(most).collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both
    };
    points.chunks(stretch).flat_map(ends).collect()
}

impl Explanation {
    /// The report as one HTML page.
    pub fn to_html(&self, robot: &str) -> Result<String, Box<dyn std::error::Error>> {
        let mut page = String::from(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>What the model lacks</title><style>\
             body{font:16px/1.5 sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem}table{border-collapse:collapse}\
             td,th{border-bottom:1px solid #ccc;padding:.25rem .8rem;text-align:right}td:first-child,th:first-child\
             {text-align:left}svg{max-width:100%;height:auto}</style></head><body>",
        );
        write!(page, "<h1>{}</h1><p>Verdict: <strong>{}</strong></p><ul>", escaped(robot), self.verdict.word())?;
        for sentence in &self.sentences {
            write!(page, "<li>{}</li>", escaped(sentence))?;
        }
        page.push_str(
            "</ul><h2>Gap, counts rms</h2><table><tr><th></th><th>before</th><th>after</th><th>floor</th></tr>",
        );
        let row = |name: &str, before: f64, after: f64| {
            format!("<tr><td>{name}</td><td>{before:.4}</td><td>{after:.4}</td><td>{:.4}</td></tr>", self.gap.floor)
        };
        page.push_str(&row("recordings fitted", self.gap.before, self.gap.after));
        if let Some(held_out) = self.gap.held_out {
            page.push_str(&row("recordings kept back", held_out.before, held_out.after));
        }
        page.push_str("</table><h2>What was tried</h2>");
        write!(
            page,
            "<p>An effect is named from &Delta;BIC {:.1} on; robots that lack nothing reach {:.1} in this experiment.</p>\
             <table><tr><th>effect</th><th>joint</th><th>&Delta;BIC</th><th>gap on what was kept back</th></tr>",
            self.threshold[1], self.threshold[0]
        )?;
        for candidate in &self.candidates {
            write!(
                page,
                "<tr><td>{}</td><td>{}</td><td>{:.1}</td><td>{:.4}</td></tr>",
                candidate.name,
                escaped(&candidate.joint),
                candidate.delta_bic,
                candidate.held_out_gap
            )?;
        }
        page.push_str("</table>");
        if !self.ruled_out.is_empty() {
            write!(page, "<h2>Ruled out by the screen</h2><p>{}</p>", escaped(&self.ruled_out.join(", ")))?;
        }
        page.push_str("<h2>Pictures</h2>");
        for picture in &self.pictures {
            page.push_str(&drawn(picture)?);
        }
        page.push_str("</body></html>");
        Ok(page)
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn drawn(picture: &Picture) -> Result<String, Box<dyn std::error::Error>> {
    let mut svg = String::new();
    let all = || picture.lines.iter().flat_map(|line| &line.points).filter(|p| p.0.is_finite() && p.1.is_finite());
    let range = |of: fn(&(f64, f64)) -> f64| {
        let (low, high) = all().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(of(p)), h.max(of(p))));
        if low < high { low..high } else { low - 1.0..low + 1.0 }
    };
    if all().next().is_none() {
        return Ok(svg);
    }
    {
        let area = SVGBackend::with_string(&mut svg, (980, 260)).into_drawing_area();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&area)
            .caption(&picture.title, ("sans-serif", 16))
            .margin(8)
            .x_label_area_size(34)
            .y_label_area_size(70)
            .build_cartesian_2d(range(|p| p.0), range(|p| p.1))?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_desc(picture.axes[0].as_str())
            .y_desc(picture.axes[1].as_str())
            .draw()?;
        for line in &picture.lines {
            let colour = match line.name {
                "before" => RGBColor(200, 80, 60),
                "band" => RGBColor(170, 190, 220),
                _ => RGBColor(30, 90, 170),
            };
            chart.draw_series(LineSeries::new(line.points.iter().copied(), colour.stroke_width(1)))?;
        }
        area.present()?;
    }
    Ok(svg)
}

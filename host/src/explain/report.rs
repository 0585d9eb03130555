//! What goes onto the report page of an explanation.

use super::curves::Curve;
use super::engine::Engine;
use super::findings::Explanation;
use super::trace::residual_torque;
use crate::identify::Columns;
use crate::report::{Band, Cell, Content, Ink, Line, Picture, Section, Table, thinned};

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
            pictures.push(Picture::lines(
                format!("joint {}: innovations, recording {}", named.name, segment + 1),
                ["time, s", "counts"],
                before_and_after(over_time(&before[segment][joint]), over_time(&after[segment][joint])),
            ));
            pictures.push(Picture::lines(
                format!("joint {}: torque the model lacks, recording {}", named.name, segment + 1),
                ["time, s", "N m at the motor"],
                before_and_after(over_time(&torque[0][segment][joint]), over_time(&torque[1][segment][joint])),
            ));
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
        pictures.push(Picture::lines(
            format!("joint {}: spectrum of the innovations", named.name),
            ["Hz", "counts per root of line"],
            before_and_after(spectrum(before), spectrum(after)),
        ));
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
        pictures.push(Picture::lines(
            format!("joint {}: residual torque over orders of the motor's angle", named.name),
            ["periods per motor turn", "amplitude, N m"],
            before_and_after(orders(0), orders(1)),
        ));
    }
    pictures.extend(curves.iter().map(of_curve));
    pictures
}

/// The shape of what is left over one quantity.
fn of_curve(curve: &Curve) -> Picture {
    let band = curve.points.iter().map(|[x, mean, half]| [*x, mean - half, mean + half]).collect();
    let content = Content::Lines(
        vec![Band { name: "95 % interval".into(), ink: Ink::Measured, points: band }],
        vec![Line::new("mean", Ink::Measured, curve.points.iter().map(|point| (point[0], point[1])).collect())],
    );
    let foretold = 100.0 * curve.foretold.max(0.0);
    let title = format!(
        "joint {}: what is left over {} (foretells {foretold:.0} % of another recording)",
        curve.joint, curve.over
    );
    Picture::of(title, [&format!("{}, {}", curve.over, curve.unit), "N m at the motor"], content)
}

fn before_and_after(before: Vec<(f64, f64)>, after: Vec<(f64, f64)>) -> Vec<Line> {
    vec![Line::new("before", Ink::Simulated, before), Line::new("after", Ink::Measured, after)]
}

impl Explanation {
    /// The page's sections: what was found, the gaps, what was tried, and pictures.
    pub fn sections(&self) -> Vec<Section> {
        let mut sections = vec![Section::new("Findings").list(self.sentences.iter().cloned()), self.effects_section()];
        let mut gaps = Table::new(["", "before, counts rms", "after, counts rms", "floor, counts rms"]);
        let row = |name: &str, before: f64, after: f64| {
            [Cell::from(name), Cell::fixed(before, 4), Cell::fixed(after, 4), Cell::fixed(self.gap.floor, 4)]
        };
        gaps = gaps.row(row("recordings fitted", self.gap.before, self.gap.after));
        if let Some(held_out) = self.gap.held_out {
            gaps = gaps.row(row("recordings kept back", held_out.before, held_out.after));
        }
        sections.push(Section::new("Gap").table(gaps));
        let mut tried = Table::new(["effect", "joint", "ΔBIC", "gap on what was kept back, counts rms"]);
        for candidate in &self.candidates {
            tried = tried.row([
                Cell::from(candidate.name),
                Cell::from(candidate.joint.as_str()),
                Cell::fixed(candidate.delta_bic, 1),
                Cell::fixed(candidate.held_out_gap, 4),
            ]);
        }
        let named_from = format!(
            "An effect is named from ΔBIC {:.1} on; robots that lack nothing reach {:.1} in this experiment.",
            self.threshold[1], self.threshold[0]
        );
        sections.push(Section::new("What was tried").text(named_from).table(tried));
        let ruled_out = if self.ruled_out.is_empty() { "None.".into() } else { self.ruled_out.join(", ") };
        sections.push(Section::new("Ruled out by the screen").text(ruled_out));
        sections.push(Section::new("Pictures").pictures(self.pictures.clone()));
        sections
    }

    /// The parameters of every effect named.
    fn effects_section(&self) -> Section {
        let mut table =
            Table::new(["effect", "joint", "cannot be told from", "parameter", "value", "± standard error", "unit"]);
        for finding in &self.effects {
            let others: Vec<&str> = finding.class.iter().copied().filter(|name| *name != finding.name).collect();
            for (name, parameter) in &finding.parameters {
                table = table.row([
                    Cell::from(finding.name),
                    Cell::from(finding.joint.as_str()),
                    Cell::from(if others.is_empty() { "–".into() } else { others.join(", ") }),
                    Cell::from(name.as_str()),
                    Cell::significant(parameter.value),
                    Cell::optional(parameter.standard_error, Cell::scientific),
                    Cell::from(parameter.unit),
                ]);
            }
        }
        let section = Section::new("Effects named");
        if self.effects.is_empty() { section.text("None.") } else { section.table(table) }
    }
}

//! The page of `excite`.

use armid::excite::{Design, USED_SHARE};
use armid::report::{Cell, Ink, Line, Page, Picture, Provenance, Section, Table};
use armid::robot::Robot;

use super::super::excite::of_paper;

/// Points of a curve.
const POINTS: u64 = 600;

/// The page of a movement designed.
pub fn page(robot: &Robot, design: &Design, provenance: &Provenance) -> Page {
    let worst = |(parameter, error): (armid::identify::Parameter, f64)| {
        format!("{} {:.4} %", parameter.name(robot), 100.0 * error)
    };
    let designed = &design.designed;
    let verdict = match of_paper(design) {
        Some((name, paper)) => format!(
            "Worst of f: {} with {name}, {} with this movement, {:.2} times better. Condition number {:.0} instead of {:.0}.",
            worst(paper.worst),
            worst(designed.worst),
            paper.worst.1 / designed.worst.1,
            designed.condition,
            paper.condition
        ),
        None => format!("Worst of f: {}. Condition number {:.0}.", worst(designed.worst), designed.condition),
    };
    Page {
        command: "excite".into(),
        title: robot.name.clone(),
        verdict,
        sections: vec![promised(robot, design), movement(robot, design), margins(robot, design), provenance.section()],
    }
}

fn promised(robot: &Robot, design: &Design) -> Section {
    let of_paper = of_paper(design);
    let mut headings = vec!["parameter", "this movement", "this movement, %"];
    if let Some((name, _)) = &of_paper {
        headings.extend([name.as_str(), "times better"]);
    }
    let mut table = Table::new(headings);
    for (index, &parameter) in design.free.iter().enumerate() {
        let designed = design.designed.standard_errors[index];
        let mut cells = vec![
            Cell::from(parameter.name(robot)),
            Cell::scientific(designed),
            Cell::fixed(100.0 * designed / design.magnitudes[index], 4),
        ];
        if let Some((_, paper)) = &of_paper {
            let of_paper = paper.standard_errors[index];
            cells.extend([Cell::scientific(of_paper), Cell::fixed(of_paper / designed, 2)]);
        }
        table = table.row(cells);
    }
    Section::new("Predicted standard errors")
        .text("From rounding alone, in the parameter's own unit and relative to its magnitude.")
        .table(table)
}

fn movement(robot: &Robot, design: &Design) -> Section {
    let duration_ns = design.trajectory.duration_ns();
    let mut pictures = Vec::new();
    for (joint, named) in robot.joints.iter().enumerate().take(2) {
        let over_time = |of: fn(&shared::control::JointReference<f64>, usize) -> f64| -> Vec<(f64, f64)> {
            let at = |k: u64| {
                let time_ns = duration_ns * k / POINTS;
                (time_ns as f64 * 1e-9, of(&design.trajectory.reference(time_ns), joint))
            };
            (0..=POINTS).map(at).collect()
        };
        for (name, unit, points) in [
            ("angle", "rad", over_time(|reference, joint| reference.position_rad[joint])),
            ("speed", "rad/s", over_time(|reference, joint| reference.velocity_rad_s[joint])),
        ] {
            let lines = vec![Line::new("", Ink::Measured, points)];
            pictures.push(Picture::lines(format!("joint {}: {name}", named.name), ["time, s", unit], lines));
        }
    }
    Section::new("Movement").pictures(pictures)
}

fn margins(robot: &Robot, design: &Design) -> Section {
    let mut table = Table::new(["joint", "quantity", "unit", "peak", "limit", "left"]);
    for row in &design.margins.rows {
        table = table.row([
            Cell::from(robot.joints[usize::from(row.joint)].name.as_str()),
            Cell::from(row.quantity.name()),
            Cell::from(row.quantity.unit()),
            Cell::fixed(f64::from(row.peak), 4),
            Cell::fixed(f64::from(row.limit), 4),
            Cell::fixed(f64::from(row.left()), 4),
        ]);
    }
    for margin in &design.loop_margins {
        table = table.row([
            Cell::from(margin.joint.as_str()),
            Cell::from(format!("{}, by the model", margin.quantity)),
            Cell::from(margin.unit),
            Cell::fixed(margin.peak, 4),
            Cell::fixed(margin.limit, 4),
            Cell::fixed(USED_SHARE * margin.limit - margin.peak, 4),
        ]);
    }
    let share = 100.0 * USED_SHARE;
    Section::new("Margins")
        .text(format!("Of the limits of current and following error {share:.0} % may be used."))
        .table(table)
}

//! The page of `excite`.

use armid::excite::{Design, USED_SHARE};
use armid::report::{Cell, Ink, Line, Page, Picture, Provenance, Section, Table};
use armid::robot::Robot;

/// Points of a curve.
const POINTS: u64 = 600;

/// The page of a movement designed; `paper` says which movements of the paper it is compared with.
pub fn page(robot: &Robot, design: &Design, paper: &str, provenance: &Provenance) -> Page {
    let worst = |(parameter, error): (armid::identify::Parameter, f64)| {
        format!("{} {:.4} %", parameter.name(robot), 100.0 * error)
    };
    let verdict = format!(
        "Worst of f: {} with {paper}, {} with this movement, {:.2} times better. Condition number {:.0} instead of {:.0}.",
        worst(design.paper.worst),
        worst(design.designed.worst),
        design.paper.worst.1 / design.designed.worst.1,
        design.designed.condition,
        design.paper.condition
    );
    Page {
        command: "excite".into(),
        title: robot.name.clone(),
        verdict,
        sections: vec![
            promised(robot, design, paper),
            movement(robot, design),
            margins(robot, design),
            provenance.section(),
        ],
    }
}

fn promised(robot: &Robot, design: &Design, paper: &str) -> Section {
    let mut table = Table::new(["parameter", paper, "this movement", "this movement, %", "times better"]);
    for (index, &parameter) in design.free.iter().enumerate() {
        let [paper, designed] = [&design.paper, &design.designed].map(|expected| expected.standard_errors[index]);
        table = table.row([
            Cell::from(parameter.name(robot)),
            Cell::scientific(paper),
            Cell::scientific(designed),
            Cell::fixed(100.0 * designed / design.magnitudes[index], 4),
            Cell::fixed(paper / designed, 2),
        ]);
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

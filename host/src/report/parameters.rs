//! Parameters with error bars, beside those of the paper where the robot is the paper's.

use shared::arm::PARAMETERS;

use super::page::Section;
use super::picture::{Content, Ink, Interval, Intervals, Picture};
use super::table::{Cell, Table};
use crate::model::Model;
use crate::robot::{Kind, Robot};

/// f1..f9 as the paper identified them, with its drill tool: f1, f2, f3, f4, f7 in kg m²; f5, f6, f8, f9 in kg m.
pub const PAPER_F: [f64; PARAMETERS] = [1.68, 1.39, -0.29, -1.40, -0.08, -1.94, 6.67, 0.06, 10.2];

/// How far the paper's own runs scattered, in ± percent of [`PAPER_F`].
pub const PAPER_SCATTER_PERCENT: [f64; PARAMETERS] = [10.0, 21.0, 80.0, 30.0, 16.0, 14.0, 11.0, 40.0, 3.0];

/// Half a 95 % interval in standard errors.
const HALF_INTERVAL: f64 = 1.96;

/// One parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
    /// Its standard error, where it has one.
    pub standard_error: Option<f64>,
    /// Which of f1..f9 it is, by index, if it is one.
    pub f: Option<usize>,
    /// What else to say of it.
    pub remark: String,
}

/// Whether a robot is the paper's: its gears and encoders. Whose arm it is the paper's values do not say.
pub fn is_paper_robot(robot: &Robot) -> bool {
    let drives = |robot: &Robot| -> Vec<[f64; 2]> {
        robot.joints.iter().map(|joint| [joint.gear_ratio, joint.counts_per_rev]).collect()
    };
    robot.kind == Kind::TwoLink && drives(robot) == drives(&Robot::paper())
}

/// The unit of f1..f9, by index.
fn unit_of_f(robot: &Robot, index: usize) -> &'static str {
    match (robot.kind, index) {
        (Kind::SingleAxis, _) => "kg (kg m²)",
        (Kind::TwoLink, 4 | 5 | 7 | 8) => "kg m",
        (Kind::TwoLink, _) => "kg m²",
    }
}

impl Row {
    /// A parameter as an identification or a model has it.
    pub fn of(robot: &Robot, parameter: crate::identify::Parameter, value: f64, standard_error: Option<f64>) -> Self {
        use crate::identify::Parameter;
        let (unit, f) = match parameter {
            Parameter::F(index) => (unit_of_f(robot, index), Some(index)),
            Parameter::Viscous(_) => ("N m s/rad", None),
            Parameter::Coulomb(_) | Parameter::TorqueOffset(_) => ("N m", None),
            Parameter::Gain(_) => ("", None),
            Parameter::Lead(_) => ("ticks", None),
        };
        Self { name: parameter.name(robot), unit, value, standard_error, f, remark: String::new() }
    }
}

/// The parameters of a model file: f, friction, and the effects' own.
pub fn of_model(robot: &Robot, model: &Model) -> Vec<Row> {
    use crate::identify::Parameter;
    let mut rows = Vec::new();
    for (index, &value) in model.f.iter().enumerate() {
        // A single axis has its moving mass alone.
        if robot.kind == Kind::TwoLink || index == 6 {
            let error = model.f_standard_error.map(|errors| errors[index]);
            rows.push(Row::of(robot, Parameter::F(index), value, error));
        }
    }
    let at = |errors: &Option<Vec<f64>>, joint: usize| errors.as_ref().and_then(|errors| errors.get(joint)).copied();
    for (joint, &value) in model.viscous_nm_s_per_rad.iter().enumerate().take(robot.joints.len()) {
        rows.push(Row::of(robot, Parameter::Viscous(joint), value, at(&model.viscous_standard_error, joint)));
    }
    for (joint, &value) in model.coulomb_nm.iter().enumerate().take(robot.joints.len()) {
        rows.push(Row::of(robot, Parameter::Coulomb(joint), value, at(&model.coulomb_standard_error, joint)));
    }
    for effect in &model.effects {
        for (name, &value) in &effect.parameters {
            rows.push(Row {
                name: format!("{}, joint {}: {name}", effect.name, effect.joint),
                unit: "",
                value,
                standard_error: effect.standard_error.get(name).copied(),
                f: None,
                remark: "effect".into(),
            });
        }
    }
    rows
}

/// The section of parameters; `source` says whose they are, such as "identified".
pub fn parameters(robot: &Robot, source: &str, rows: &[Row]) -> Section {
    let paper = is_paper_robot(robot);
    let remarks = rows.iter().any(|row| !row.remark.is_empty());
    let mut headings = vec!["parameter", "value", "± standard error", "relative, %", "unit"];
    if paper {
        headings.extend(["the paper's", "its scatter, ±%"]);
    }
    if remarks {
        headings.push("remark");
    }
    let mut table = Table::new(headings);
    for row in rows {
        let mut cells = vec![
            Cell::from(row.name.as_str()),
            Cell::significant(row.value),
            Cell::optional(row.standard_error, Cell::scientific),
            Cell::optional(row.standard_error.map(|error| 100.0 * (error / row.value).abs()), |percent| {
                Cell::fixed(percent, 3)
            }),
            Cell::from(row.unit),
        ];
        if paper {
            cells.push(Cell::optional(row.f.map(|index| PAPER_F[index]), |value| Cell::fixed(value, 2)));
            cells.push(Cell::optional(row.f.map(|index| PAPER_SCATTER_PERCENT[index]), |percent| {
                Cell::fixed(percent, 0)
            }));
        }
        if remarks {
            cells.push(Cell::from(row.remark.as_str()));
        }
        table = table.row(cells);
    }
    let section = Section::new("Parameters").table(table);
    let section = if paper {
        section.text(
            "The paper's values are those it identified on its own arm with a drill tool; its scatter is that of its \
             genetic algorithm's runs. They are shown to compare, not as the truth of this arm.",
        )
    } else {
        section
    };
    if robot.kind == Kind::SingleAxis { section } else { section.pictures(pictures(robot, source, rows, paper)) }
}

/// f1..f9 within the search range, and how well each is known.
fn pictures(robot: &Robot, source: &str, rows: &[Row], paper: bool) -> Vec<Picture> {
    let of_f: Vec<(usize, &Row)> = rows.iter().filter_map(|row| Some((row.f?, row))).collect();
    let names: Vec<String> = of_f.iter().map(|(_, row)| row.name.clone()).collect();
    let width = |index: usize| robot.search[index][1] - robot.search[index][0];
    let share = |index: usize, value: f64| (value - robot.search[index][0]) / width(index);
    let around = |index: usize, value: f64, half: f64| Interval {
        low: share(index, value - half),
        value: share(index, value),
        high: share(index, value + half),
    };
    let half = |row: &Row| row.standard_error.filter(|error| error.is_finite()).map(|error| HALF_INTERVAL * error);
    let own = of_f.iter().map(|&(index, row)| Some(around(index, row.value, half(row).unwrap_or(0.0)))).collect();
    let bounded = of_f.iter().any(|(_, row)| half(row).is_some());
    let name = if bounded { format!("{source}, 95 % interval") } else { source.to_string() };
    let mut values = vec![(name, Ink::Measured, own)];
    let relative =
        of_f.iter().map(|&(_, row)| half(row).map(|half| single(100.0 * (half / row.value).abs()))).collect();
    let mut certainty = vec![(format!("{source}, 1.96 standard errors"), Ink::Measured, relative)];
    if paper {
        let scatter = |index: usize| PAPER_SCATTER_PERCENT[index];
        let of_paper = |index: usize| around(index, PAPER_F[index], (PAPER_F[index] * scatter(index) / 100.0).abs());
        values.push((
            "the paper's, its scatter".into(),
            Ink::Simulated,
            of_f.iter().map(|&(index, _)| Some(of_paper(index))).collect(),
        ));
        certainty.push((
            "the paper's scatter".into(),
            Ink::Simulated,
            of_f.iter().map(|&(index, _)| Some(single(scatter(index)))).collect(),
        ));
    }
    let picture = |title: &str, axis: &str, sources, logarithmic| {
        Picture::of(title, ["", axis], Content::Intervals(Intervals { names: names.clone(), sources, logarithmic }))
    };
    let mut pictures = vec![picture("f1..f9 within their search ranges", "0 = lowest, 1 = highest", values, false)];
    if bounded {
        pictures.push(picture("How well each is known", "± % of the value", certainty, true));
    }
    pictures
}

/// A value without bounds.
fn single(value: f64) -> Interval {
    Interval { low: value, value, high: value }
}

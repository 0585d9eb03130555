//! `armid excite`.

use std::path::PathBuf;

use armid::excite::{Criterion, Design, Expectation, Settings, USED_SHARE, default_repeats, design};
use armid::identify::Parameter;
use armid::report::FileRole;
use armid::robot::Robot;
use armid::trajectory_file;
use clap::Args;
use serde_json::{Value, json};
use shared::arm::REFERENCE_F;

use super::common::{RobotArguments, advise, print, print_json, read_model};
use super::outputs::{FileKind, check_outputs};
use super::page::{self, ReportArguments};
use super::{CommandError, progress, wording};

const EXAMPLES: &str = "Examples:
  armid excite --out movement.toml
  armid excite --model model.toml --duration 10 --criterion d --out movement.toml";

/// Arguments of `excite`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Excite {
    #[command(flatten)]
    robot: RobotArguments,
    /// Model to design for; without it, the arm that the robot file makes expect
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// How long the movement lasts, in s
    #[arg(long, value_name = "SECONDS", default_value_t = 7.3)]
    duration: f64,
    /// Periods of the series within the duration; without it, periods of at most 4.5 s
    #[arg(long, value_name = "N")]
    repeats: Option<u32>,
    /// Harmonics of the series
    #[arg(long, value_name = "N", default_value_t = 5)]
    harmonics: usize,
    /// What is made small
    #[arg(long, value_enum, default_value_t)]
    criterion: Criterion,
    /// Generations of the search, 16 movements each
    #[arg(long, value_name = "N", default_value_t = 80)]
    generations: usize,
    /// Seed of the search
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trajectory file to write, for record --trajectory
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Excite {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read_for_motion()?;
        let model = self.model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
        let inputs = || [&self.robot.robot, &self.model].into_iter().filter_map(Option::as_deref);
        check_outputs(self.out.as_deref().map(|out| (out, FileKind::Movement)), inputs())?;
        self.report.check(self.out.as_deref(), inputs())?;
        if model.is_none() {
            let arm = if robot.expected_f() == REFERENCE_F {
                "the reference robot"
            } else {
                "the arm in the middle of the robot file's [search]"
            };
            advise(format!(
                "designed for {arm}; once a model is identified, design again with --model for movements made for this arm"
            ));
        }
        let settings = Settings {
            duration_s: self.duration,
            repeats: self.repeats.unwrap_or_else(|| default_repeats(self.duration)),
            harmonics: self.harmonics,
            criterion: self.criterion,
            generations: self.generations,
            seed: self.seed,
        };
        let bar = progress::bar("excite", 0);
        let design = design(&robot, model.as_ref(), &settings, &|done, planned| {
            bar.set_length(planned as u64);
            bar.set_position(done as u64);
        })?;
        bar.finish_and_clear();
        match &self.out {
            Some(path) => trajectory_file::write(path, &design.trajectory, &heading(&robot, &settings))?,
            None => advise("the movement was not kept; pass --out movement.toml to write it"),
        }
        if self.json { print_json(&to_json(&robot, &design, &settings)) } else { print(report(&robot, &design)) }?;
        self.report.write(|| {
            let provenance = page::provenance()
                .seed(self.seed)
                .robot(&robot)
                .files(FileRole::Read, inputs())
                .files(FileRole::Written, self.out.as_deref());
            Ok(page::excite::page(&robot, &design, &provenance))
        })
    }
}

/// What the trajectory file says of itself.
fn heading(robot: &Robot, settings: &Settings) -> String {
    format!(
        "Made by {} for the robot \"{}\": excite --duration {} --repeats {} --harmonics {} --criterion {} --generations {} \
         --seed {}",
        armid::TOOL_VERSION,
        robot.name,
        settings.duration_s,
        settings.repeats,
        settings.harmonics,
        name(settings.criterion),
        settings.generations,
        settings.seed
    )
}

fn name(criterion: Criterion) -> &'static str {
    match criterion {
        Criterion::D => "d",
        Criterion::Condition => "condition",
        Criterion::Worst => "worst",
    }
}

/// The paper's movements of the design's duration in words, and what is expected of them; nothing where the robot cannot
/// make them.
pub fn of_paper(design: &Design) -> Option<(String, &Expectation)> {
    let periods: Vec<String> = design.paper_periods_s.iter().map(|period_s| format!("{period_s:.2} s")).collect();
    design.paper.as_ref().map(|paper| (format!("paper, T = {}", periods.join(" and ")), paper))
}

/// The result for people.
fn report(robot: &Robot, design: &Design) -> String {
    let mut lines = vec![
        "predicted standard errors from rounding alone, in the parameter's unit and relative to its magnitude"
            .to_string(),
    ];
    let (of_paper, designed) = (of_paper(design), &design.designed);
    let paper_heading = of_paper.as_ref().map_or_else(String::new, |(name, _)| format!(" {name:>28} {:>8}", "ratio"));
    lines.push(format!("{:<22} {:>24}{paper_heading}", "parameter", "this movement"));
    for (index, &parameter) in design.free.iter().enumerate() {
        let cell = |error: f64| format!("{error:.2e} ({:.4} %)", 100.0 * error / design.magnitudes[index]);
        let error = designed.standard_errors[index];
        let paper = of_paper.as_ref().map_or_else(String::new, |(_, paper)| {
            let of_paper = paper.standard_errors[index];
            format!(" {:>28} {:>8.2}", cell(of_paper), of_paper / error)
        });
        lines.push(format!("{:<22} {:>24}{paper}", parameter.name(robot), cell(error)));
    }
    let worst = |(parameter, error): (Parameter, f64)| format!("{} {:.4} %", parameter.name(robot), 100.0 * error);
    match of_paper {
        Some((_, paper)) => {
            lines.push(format!(
                "worst of f: {} with the paper's, {} with this movement: {:.2} times better",
                worst(paper.worst),
                worst(designed.worst),
                paper.worst.1 / designed.worst.1
            ));
            lines.push(format!(
                "all together (D): {:.2} times better per parameter; condition number {:.0} instead of {:.0}",
                paper.volume_per_parameter / designed.volume_per_parameter,
                designed.condition,
                paper.condition
            ));
        }
        None => {
            lines.push(format!("worst of f: {}; condition number {:.0}", worst(designed.worst), designed.condition))
        }
    }
    lines.push("margins:".to_string());
    lines.extend(design.margins.rows.iter().map(|row| format!("  {}", wording::in_its_words(&row.to_string()))));
    for margin in &design.loop_margins {
        lines.push(format!(
            "  joint {} {}: {:.4} {} by the model, limit {:.4}, of which {:.0} % may be used, left {:.4}",
            margin.joint,
            margin.quantity,
            margin.peak,
            margin.unit,
            margin.limit,
            100.0 * USED_SHARE,
            USED_SHARE * margin.limit - margin.peak
        ));
    }
    lines.push(format!("{} movements simulated", design.evaluations));
    lines.join("\n")
}

fn to_json(robot: &Robot, design: &Design, settings: &Settings) -> Value {
    let parameters: Vec<Value> = design
        .free
        .iter()
        .enumerate()
        .map(|(index, &parameter)| {
            json!({
                "name": parameter.name(robot),
                "magnitude": design.magnitudes[index],
                "standard_error": design.designed.standard_errors[index],
                "paper_standard_error": design.paper.as_ref().map(|paper| paper.standard_errors[index]),
            })
        })
        .collect();
    let margins: Vec<Value> = design
        .margins
        .rows
        .iter()
        .map(|row| {
            json!({
                "joint": robot.joints[usize::from(row.joint)].name, "quantity": row.quantity.name(),
                "unit": row.quantity.unit(), "peak": row.peak, "limit": row.limit, "left": row.left(),
            })
        })
        .collect();
    let expectation = |e: &Expectation| {
        json!({
            "worst": {"name": e.worst.0.name(robot), "relative_standard_error": e.worst.1},
            "condition": e.condition, "volume_per_parameter": e.volume_per_parameter,
        })
    };
    json!({
        "criterion": name(settings.criterion),
        "duration_s": settings.duration_s,
        "repeats": settings.repeats,
        "harmonics": settings.harmonics,
        "generations": settings.generations,
        "seed": settings.seed,
        "parameters": parameters,
        "designed": expectation(&design.designed),
        // null where the robot cannot make the paper's movements.
        "paper": design.paper.as_ref().map(expectation),
        "paper_periods_s": design.paper_periods_s,
        "worst_ratio": design.paper.as_ref().map(|paper| paper.worst.1 / design.designed.worst.1),
        "margins": margins,
        "loop_margins": design.loop_margins,
        "evaluations": design.evaluations,
    })
}

//! `armid bench paper`: the paper's experiment on a simulated robot, many times over.
//!
//! The loop runs every 50 µs at gains that hold ±10 counts, recorded every 0.7 ms, T = 3.65 s: the paper's figures.
//! The paper's genetic algorithm, started from many seeds on one recording, scatters by what the optimiser leaves
//! undone. `full` gives the same result whatever the seed, so it is run on as many robots instead.

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{FrictionMode, Identification, Method, Options, Parameter, Sought, identify};
use armid::link::SimulatedBoard;
use armid::recording::{Mode, Recording};
use armid::report::{Cell, Content, Ink, Interval, Intervals, Line, PAPER_SCATTER_PERCENT, Picture, Section, Table};
use armid::robot::{Law, Robot};
use clap::Args;
use serde_json::json;
use shared::arm::PARAMETERS;

use super::super::common::TrajectoryArguments;
use super::super::run::Run;
use super::super::{CommandError, page, progress};
use super::{Measured, seeds};

/// The paper's gains in N m of motor torque per count: they hold ±10 counts, and only a fast loop survives them.
const GAINS_NM_PER_COUNT: [f64; 2] = [0.096, 0.094];
/// Period of the loop in s: fast enough for these gains.
const LOOP_PERIOD_S: f64 = 50e-6;
/// The paper's movement in s.
const PERIOD_S: f64 = 3.65;

/// What the paper reports: best objective of the first generation and at the end, in counts², low and high.
const PAPER_FIRST_COUNTS2: [f64; 2] = [38e3, 45e3];
const PAPER_FINAL_COUNTS2: [f64; 2] = [23e3, 25e3];

const EXAMPLES: &str = "Example:
  armid bench paper --runs 20";

/// Arguments of `bench paper`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Paper {
    /// How many seeds of the paper's algorithm, and how many robots for `full`
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(2..=1000))]
    runs: u64,
    /// Seed of the first hidden robot and run; the others take the ones after it
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Paper {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        let mut robot = Robot::paper();
        robot.loop_period_s = LOOP_PERIOD_S;
        for (joint, gain) in robot.joints.iter_mut().zip(GAINS_NM_PER_COUNT) {
            if let Law::Proportional(position_loop) = &mut joint.law {
                position_loop.gain_a_per_count = gain / joint.torque_constant_nm_per_a;
            }
        }
        let truth = HiddenRobot::draw(&robot, self.seed);
        // The paper measured friction on the motors beforehand.
        let mut known = robot.clone();
        for (index, joint) in known.joints.iter_mut().enumerate() {
            joint.viscous_friction_nm_s_per_rad = Some(truth.viscous_nm_s_per_rad[index]);
            joint.coulomb_friction_nm = Some(truth.coulomb_nm[index]);
        }

        let bar = progress::bar("bench paper", 2 * self.runs);
        let recording = self.recording(&robot, &truth)?;
        let mut of_paper = Vec::new();
        let mut of_full = Vec::new();
        let sought = Sought { friction: FrictionMode::Known, ..Sought::default() };
        for seed in self.seed..self.seed + self.runs {
            let options = Options { method: Method::Paper, sought, seed, ..Options::default() };
            let found = identify(&known, std::slice::from_ref(&recording), &[], &options, &|_| ())?;
            of_paper.push(Judged { found, truth: truth.clone() });
            bar.inc(1);
            let truth = HiddenRobot::draw(&robot, seed);
            let recording = self.recording(&robot, &truth)?;
            let found = identify(&robot, &[recording], &[], &Options { seed, ..Options::default() }, &|_| ())?;
            of_full.push(Judged { found, truth });
            bar.inc(1);
        }
        bar.finish_and_clear();

        let paper = Summary::of(&of_paper);
        let full = Summary::of(&of_full);
        let courses = of_paper.iter().map(|run| run.course()).collect();
        Ok(Measured {
            title: "The paper's experiment, many times over".into(),
            verdict: format!(
                "The paper ends at {}; its genetic algorithm here at {}, full at {}.",
                thousands(PAPER_FINAL_COUNTS2),
                thousands(paper.final_counts2),
                thousands(full.final_counts2)
            ),
            sections: vec![self.objectives(&paper, &full, courses), parameters(&truth, &paper, &full)],
            json: json!({
                "runs": self.runs,
                "seed": self.seed,
                "true_f": truth.f,
                "paper": paper.to_json(),
                "full": full.to_json(),
            }),
            provenance: page::provenance().robot(&robot).fact("seeds", seeds(self.seed, self.runs)),
        })
    }

    /// One recording of the movement.
    fn recording(&self, robot: &Robot, truth: &HiddenRobot) -> Result<Recording, CommandError> {
        let configuration = armid::board_setup::configuration(robot)?;
        let board = SimulatedBoard::new(robot, truth.clone(), self.seed);
        let mut client = Client::connect(Box::new(board))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
        let movement = TrajectoryArguments::paper(PERIOD_S).prepare(robot)?;
        let run = Run { robot, movement: &movement, mode: Mode::P, seed: Some(self.seed), path: "bench.csv".into() };
        run.on(&mut client)?.whole()
    }

    /// The objective of the paper, of its algorithm here with the `courses` of its runs, and of `full`.
    fn objectives(&self, paper: &Summary, full: &Summary, courses: Vec<Line>) -> Section {
        let here = format!("its genetic algorithm, {} seeds on one robot", self.runs);
        let rows = [
            ("the paper".into(), Some(PAPER_FIRST_COUNTS2), PAPER_FINAL_COUNTS2),
            (here, Some(paper.first_counts2), paper.final_counts2),
            (format!("full, {} robots", self.runs), None, full.final_counts2),
        ];
        let mut table = Table::new(["", "first generation, counts²", "at the end, counts²"]);
        for (name, first, last) in rows {
            let first = first.map_or(Cell::Missing, |range| Cell::from(thousands(range)));
            table = table.row([Cell::from(name), first, Cell::from(thousands(last))]);
        }
        let generations = courses.iter().map(|line: &Line| line.points.len()).max().unwrap_or(1);
        let bound = |counts2: f64| {
            let points = [0.0, (generations - 1) as f64].map(|at| (at, counts2));
            Line::new("where the paper ends", Ink::Simulated, points.to_vec())
        };
        let lines = courses.into_iter().chain(PAPER_FINAL_COUNTS2.map(bound)).collect();
        let axes = ["generation", "Y, counts²"];
        let picture = Picture::of("Least Y so far, seed by seed", axes, Content::LogarithmicLines(lines));
        Section::new("Objective").table(table).pictures(vec![picture])
    }
}

/// A range of the objective.
fn thousands([low, high]: [f64; 2]) -> String {
    format!("{:.1}–{:.1} thousand", low / 1e3, high / 1e3)
}

/// Errors and scatter of f in per cent of the first robot's.
fn parameters(truth: &HiddenRobot, paper: &Summary, full: &Summary) -> Section {
    let percent = |values: &[f64; PARAMETERS]| -> [f64; PARAMETERS] {
        std::array::from_fn(|index| 100.0 * values[index] / truth.f[index].abs())
    };
    let (scatter, of_paper, of_full) = (percent(&paper.scatter), percent(&paper.error), percent(&full.error));
    let stated = full.standard_error.as_ref().map(percent);
    let mut table = Table::new([
        "",
        "true",
        "the paper's scatter, ±%",
        "its GA here, ±%",
        "its GA here, error, %",
        "full, error, %",
        "full, stated error, %",
        "full, error over stated",
    ]);
    for index in 0..PARAMETERS {
        let stated = stated.map(|stated| stated[index]);
        table = table.row([
            Cell::from(format!("f{}", index + 1)),
            Cell::fixed(truth.f[index], 4),
            Cell::fixed(PAPER_SCATTER_PERCENT[index], 0),
            Cell::fixed(scatter[index], 1),
            Cell::fixed(of_paper[index], 1),
            Cell::fixed(of_full[index], 2),
            Cell::optional(stated, |stated| Cell::fixed(stated, 2)),
            Cell::optional(stated.map(|stated| of_full[index] / stated), |ratio| Cell::fixed(ratio, 2)),
        ]);
    }
    let source = |name: &str, ink: Ink, values: &[f64; PARAMETERS]| {
        let single = |&value: &f64| Some(Interval { low: value, value, high: value });
        (name.to_string(), ink, values.iter().map(single).collect::<Vec<_>>())
    };
    let sources = vec![
        source("the paper's scatter", Ink::Simulated, &PAPER_SCATTER_PERCENT),
        source("its genetic algorithm here, error", Ink::Left, &of_paper),
        source("full, error", Ink::Measured, &of_full),
    ];
    let names = (1..=PARAMETERS).map(|f| format!("f{f}")).collect();
    let content = Content::Intervals(Intervals { names, sources, logarithmic: true });
    Section::new("Parameters")
        .table(table)
        .text(
            "Errors are root mean squares over the runs, in per cent of the first robot's value; ±% is the standard \
             deviation over the seeds; stated is the standard error that full gives.",
        )
        .pictures(vec![Picture::of("How far f is off", ["", "% of the value"], content)])
}

/// A run with the truth it sought.
struct Judged {
    found: Identification,
    truth: HiddenRobot,
}

impl Judged {
    /// The least objective after each generation.
    fn course(&self) -> Line {
        let best = self.found.generations.iter().enumerate();
        Line::new(
            "its genetic algorithm here",
            Ink::Measured,
            best.map(|(k, one)| (k as f64, one.best_counts2)).collect(),
        )
    }
}

/// What many runs of one method gave.
struct Summary {
    first_counts2: [f64; 2],
    final_counts2: [f64; 2],
    /// Standard deviation of each f over the runs.
    scatter: [f64; PARAMETERS],
    /// Root mean square error of each f.
    error: [f64; PARAMETERS],
    /// Root mean square of the standard errors stated.
    standard_error: Option<[f64; PARAMETERS]>,
}

impl Summary {
    fn of(runs: &[Judged]) -> Self {
        let count = runs.len() as f64;
        let extent = |value: &dyn Fn(&Identification) -> f64| {
            let values = runs.iter().map(|run| value(&run.found));
            [values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max)]
        };
        let scatter = std::array::from_fn(|i| {
            let mean = runs.iter().map(|run| run.found.values.f[i]).sum::<f64>() / count;
            let squares: f64 = runs.iter().map(|run| (run.found.values.f[i] - mean).powi(2)).sum();
            (squares / (count - 1.0)).sqrt()
        });
        let stated = |i: usize| {
            let squares: Option<Vec<f64>> =
                runs.iter().map(|run| run.found.standard_error(Parameter::F(i)).map(|error| error * error)).collect();
            squares.map(|squares| (squares.iter().sum::<f64>() / count).sqrt())
        };
        let standard_errors: Option<Vec<f64>> = (0..PARAMETERS).map(stated).collect();
        Self {
            first_counts2: extent(&|run| run.generations.first().map_or(f64::NAN, |first| first.best_counts2)),
            final_counts2: extent(&|run| run.objective_counts2),
            scatter,
            error: std::array::from_fn(|i| {
                let squares: f64 = runs.iter().map(|run| (run.found.values.f[i] - run.truth.f[i]).powi(2)).sum();
                (squares / count).sqrt()
            }),
            standard_error: standard_errors.and_then(|errors| errors.try_into().ok()),
        }
    }

    fn to_json(&self) -> serde_json::Value {
        json!({
            "first_counts2": self.first_counts2,
            "final_counts2": self.final_counts2,
            "scatter_f": self.scatter,
            "rms_error_f": self.error,
            "standard_error_f": self.standard_error,
        })
    }
}

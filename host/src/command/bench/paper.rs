//! `armid bench paper`: the paper's experiment on a simulated robot, many times over.
//!
//! The loop runs every 50 µs at gains that hold ±10 counts, recorded every 0.7 ms, T = 3.65 s: the paper's figures.
//! The paper's genetic algorithm, started from many seeds on one recording, scatters by what the optimiser leaves
//! undone. `full` gives the same result for every seed, so it is run on as many recordings, which differ in the pose
//! at rest that the loop's rounding starts from and in the robot's noise.

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{FrictionMode, Identification, Method, Options, Parameter, identify};
use armid::link::SimulatedBoard;
use armid::recording::{Mode, Recording};
use armid::robot::{Law, Robot};
use clap::Args;
use serde_json::json;
use shared::arm::PARAMETERS;

use super::super::common::{paper_name, print, print_json};
use super::super::run::Run;
use super::super::{CommandError, progress};

/// The paper's gains in N m of motor torque per count: they hold ±10 counts, and only a fast loop survives them.
const GAINS_NM_PER_COUNT: [f64; 2] = [0.096, 0.094];
/// Period of the loop in s: fast enough for these gains.
const LOOP_PERIOD_S: f64 = 50e-6;
/// The paper's movement in s.
const PERIOD_S: f64 = 3.65;
/// How long the arm stands before a movement, in ns; recordings differ by a little more each.
const SETTLE_NS: u64 = 2_000_000_000;
const SETTLE_STEP_NS: u64 = 35_000_000;

/// What the paper reports: best objective of the first generation and at the end, in counts², low and high.
const PAPER_FIRST_COUNTS2: [f64; 2] = [38e3, 45e3];
const PAPER_FINAL_COUNTS2: [f64; 2] = [23e3, 25e3];
/// Scatter of f1..f9 the paper saw, in per cent.
const PAPER_SCATTER_PERCENT: [f64; PARAMETERS] = [10.0, 21.0, 80.0, 30.0, 16.0, 14.0, 11.0, 40.0, 3.0];

/// Arguments of `bench paper`.
#[derive(Debug, Args)]
pub struct Paper {
    /// How many seeds (and, for `full`, recordings)
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(2..=1000))]
    runs: u64,
    /// Seed of the hidden robot; the runs take this seed and the ones after it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Paper {
    pub fn run(&self) -> Result<(), CommandError> {
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
        let first = self.recording(&robot, &truth, 0)?;
        let mut of_paper = Vec::new();
        for run in 0..self.runs {
            let options = Options { method: Method::Paper, friction: FrictionMode::Known, seed: self.seed + run };
            of_paper.push(identify(&known, std::slice::from_ref(&first), &[], &options, &|_| ())?);
            bar.inc(1);
        }
        let mut of_full = Vec::new();
        for run in 0..self.runs {
            let recording = if run == 0 { first.clone() } else { self.recording(&robot, &truth, run)? };
            let options = Options { seed: self.seed + run, ..Options::default() };
            of_full.push(identify(&robot, &[recording], &[], &options, &|_| ())?);
            bar.inc(1);
        }
        bar.finish_and_clear();

        let paper = Summary::of(&of_paper, &truth);
        let full = Summary::of(&of_full, &truth);
        if self.json {
            return print_json(&json!({
                "runs": self.runs,
                "seed": self.seed,
                "true_f": truth.f,
                "paper": paper.to_json(),
                "full": full.to_json(),
            }));
        }
        print(self.table(&truth, &paper, &full))
    }

    /// One recording of the movement, after a standing time that makes it differ from the others.
    fn recording(&self, robot: &Robot, truth: &HiddenRobot, index: u64) -> Result<Recording, CommandError> {
        let configuration = armid::board_setup::configuration(robot)?;
        let board = SimulatedBoard::new(robot, truth.clone(), self.seed + index);
        let mut client = Client::connect(Box::new(board))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
        let trajectory = armid::trajectory_file::paper(PERIOD_S)
            .ok_or_else(|| CommandError::Failed(format!("{PERIOD_S} s is no period")))?;
        let run = Run {
            robot,
            trajectory: &trajectory,
            trajectory_name: paper_name(PERIOD_S),
            mode: Mode::P,
            settle_ns: SETTLE_NS + index * SETTLE_STEP_NS,
            seed: Some(self.seed + index),
            path: "bench.csv".into(),
        };
        run.on(&mut client)?.whole()
    }

    fn table(&self, truth: &HiddenRobot, paper: &Summary, full: &Summary) -> String {
        let range = |[low, high]: [f64; 2]| format!("{:.1}–{:.1} thousand", low / 1e3, high / 1e3);
        let mut lines = vec![
            format!("Objective Y over {} runs, counts²", self.runs),
            format!("{:<34} {:>24} {:>24}", "", "first generation, best", "at the end"),
            format!("{:<34} {:>24} {:>24}", "the paper", range(PAPER_FIRST_COUNTS2), range(PAPER_FINAL_COUNTS2)),
            format!(
                "{:<34} {:>24} {:>24}",
                "its genetic algorithm, here",
                range(paper.first_counts2),
                range(paper.final_counts2)
            ),
            format!("{:<34} {:>24} {:>24}", "full, here", "–", range(full.final_counts2)),
            String::new(),
            format!(
                "{:<4} {:>10} | {:>10} {:>10} | {:>11} {:>10} {:>11} | {:>11} {:>10} {:>11} {:>10}",
                "",
                "true",
                "paper's ±%",
                "",
                "GA, mean",
                "± %",
                "error, %",
                "full, mean",
                "± %",
                "error, %",
                "st. err."
            ),
        ];
        for index in 0..PARAMETERS {
            let truth = truth.f[index];
            let percent = |value: f64| 100.0 * value / truth.abs();
            let of = |summary: &Summary| {
                let (mean, deviation) = (summary.mean[index], summary.deviation[index]);
                format!("{mean:>11.4} {:>10.2} {:>11.2}", percent(deviation), percent(mean - truth))
            };
            let standard_error = full.standard_error.map_or(f64::NAN, |errors| errors[index]);
            lines.push(format!(
                "f{:<3} {truth:>10.4} | {:>10.0} {:>10} | {} | {} {standard_error:>10.5}",
                index + 1,
                PAPER_SCATTER_PERCENT[index],
                "",
                of(paper),
                of(full)
            ));
        }
        lines.push(
            "± is the standard deviation over the runs; st. err. the mean standard error that one run of full states."
                .into(),
        );
        lines.join("\n")
    }
}

/// What many runs of one method gave.
struct Summary {
    first_counts2: [f64; 2],
    final_counts2: [f64; 2],
    mean: [f64; PARAMETERS],
    deviation: [f64; PARAMETERS],
    standard_error: Option<[f64; PARAMETERS]>,
    largest_error: [f64; PARAMETERS],
}

impl Summary {
    fn of(runs: &[Identification], truth: &HiddenRobot) -> Self {
        let count = runs.len() as f64;
        let extent = |value: &dyn Fn(&Identification) -> f64| {
            let values = runs.iter().map(value);
            [values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max)]
        };
        let mean = std::array::from_fn(|i| runs.iter().map(|run| run.values.f[i]).sum::<f64>() / count);
        let deviation = std::array::from_fn(|i| {
            let squares: f64 = runs.iter().map(|run| (run.values.f[i] - mean[i]).powi(2)).sum();
            (squares / (count - 1.0)).sqrt()
        });
        let stated = |i: usize| {
            let errors: Option<Vec<f64>> = runs.iter().map(|run| run.standard_error(Parameter::F(i))).collect();
            errors.map(|errors| errors.iter().sum::<f64>() / count)
        };
        let standard_errors: Option<Vec<f64>> = (0..PARAMETERS).map(stated).collect();
        Self {
            first_counts2: extent(&|run| run.generations.first().map_or(f64::NAN, |first| first.best_counts2)),
            final_counts2: extent(&|run| run.objective_counts2),
            mean,
            deviation,
            standard_error: standard_errors.and_then(|errors| errors.try_into().ok()),
            largest_error: std::array::from_fn(|i| {
                runs.iter().map(|run| (run.values.f[i] - truth.f[i]).abs()).fold(0.0, f64::max)
            }),
        }
    }

    fn to_json(&self) -> serde_json::Value {
        json!({
            "first_counts2": self.first_counts2,
            "final_counts2": self.final_counts2,
            "mean_f": self.mean,
            "standard_deviation_f": self.deviation,
            "standard_error_f": self.standard_error,
            "largest_error_f": self.largest_error,
        })
    }
}

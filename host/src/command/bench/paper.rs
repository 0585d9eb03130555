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
use armid::report::PAPER_SCATTER_PERCENT;
use armid::robot::{Law, Robot};
use clap::Args;
use serde_json::json;
use shared::arm::PARAMETERS;

use super::super::common::{TrajectoryArguments, print, print_json};
use super::super::run::Run;
use super::super::{CommandError, progress};

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

    fn table(&self, truth: &HiddenRobot, paper: &Summary, full: &Summary) -> String {
        let range = |[low, high]: [f64; 2]| format!("{:.1}–{:.1} thousand", low / 1e3, high / 1e3);
        let objective = |name: &str, first: String, last: String| format!("{name:<44} {first:>22} {last:>22}");
        let mut lines = vec![
            objective("Objective Y, counts²", "first generation".into(), "at the end".into()),
            objective("the paper", range(PAPER_FIRST_COUNTS2), range(PAPER_FINAL_COUNTS2)),
            objective(
                &format!("its genetic algorithm, {} seeds on one robot", self.runs),
                range(paper.first_counts2),
                range(paper.final_counts2),
            ),
            objective(&format!("full, {} robots", self.runs), "–".into(), range(full.final_counts2)),
            String::new(),
            format!(
                "{:<4} {:>9} | {:>11} | {:>9} {:>11} | {:>11} {:>11} {:>9}",
                "", "", "the paper", "its GA,", "here", "full, here", "stated", "error /"
            ),
            format!(
                "{:<4} {:>9} | {:>11} | {:>9} {:>11} | {:>11} {:>11} {:>9}",
                "", "true", "scatter, ±%", "±%", "error, %", "error, %", "error, %", "stated"
            ),
        ];
        for index in 0..PARAMETERS {
            let percent = |value: f64| 100.0 * value / truth.f[index].abs();
            let stated = full.standard_error.map_or(f64::NAN, |errors| errors[index]);
            lines.push(format!(
                "f{:<3} {:>9.4} | {:>11.0} | {:>9.1} {:>11.1} | {:>11.2} {:>11.2} {:>9.2}",
                index + 1,
                truth.f[index],
                PAPER_SCATTER_PERCENT[index],
                percent(paper.scatter[index]),
                percent(paper.error[index]),
                percent(full.error[index]),
                percent(stated),
                full.error[index] / stated,
            ));
        }
        lines.push(
            "Errors are root mean squares over the runs, in per cent of the first robot's value; ±% is the standard\n\
             deviation over the seeds; stated is the standard error that full gives."
                .into(),
        );
        lines.join("\n")
    }
}

/// A run with the truth it sought.
struct Judged {
    found: Identification,
    truth: HiddenRobot,
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

//! `armid bench identify`: how many candidates a second identification judges, and how exactly.
//!
//! The candidates reach from next to the robot's own values to anywhere in the search ranges. Rates are the best of
//! several short rounds in which all ways of judging take turns, so that what else the machine does hits them alike.

use std::process::Command;
use std::time::{Duration, Instant};

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{
    Experiment, FrictionMode, Method, Options, Parameter, SEARCH_LANES, Sought, Values, identify, instructions,
};
use armid::link::SimulatedBoard;
use armid::recording::{Mode, Recording};
use armid::report::{Cell, Content, Ink, Interval, Intervals, Picture, Section, Table};
use armid::robot::Robot;
use clap::Args;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::json;
use shared::arm::PARAMETERS;
use shared::plant::Plant;

use super::super::common::TrajectoryArguments;
use super::super::run::Run;
use super::super::{CommandError, page, progress};
use super::{Measured, seeds};

/// The paper's movement in s: 5214 samples.
const PERIOD_S: f64 = 3.65;
/// Candidates judged in one call: a few vectors for every core.
const CANDIDATES: usize = 1024;
/// Candidates whose objective is compared with the plain plant's.
const COMPARED: usize = 256;
/// How long each way of judging runs in a round.
const TURN: Duration = Duration::from_millis(60);
/// Runs of the paper's algorithm that are timed.
const PAPER_RUNS: u64 = 5;

const EXAMPLES: &str = "Example:
  armid bench identify --baseline ./plain-c";

/// Arguments of `bench identify`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Identify {
    /// Seed of the hidden robot and of the candidates
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Rounds of which the best rate is taken
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Program to compare with, run in every round: it must print a line `evals_per_s X`
    #[arg(long, value_name = "PROGRAM")]
    baseline: Option<String>,
}

impl Identify {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        let mut robot = Robot::paper();
        let truth = HiddenRobot::draw(&robot, self.seed);
        // The paper measured friction on the motors beforehand and sought f alone.
        robot = truth.with_known_friction(&robot);
        let recording = self.recording(&robot, &truth)?;
        let recordings = std::slice::from_ref(&recording);
        let experiment = Experiment::new(&robot, recordings)?;
        let candidates = self.candidates(&robot, &truth);
        let plants: Vec<Plant<f64>> = candidates.iter().map(|values| values.plant(&robot)).collect();

        let bar = progress::bar("bench identify", u64::from(self.rounds) + PAPER_RUNS);
        let mut rates = Rates::default();
        for _ in 0..self.rounds {
            rates.scalar.turn(|| {
                std::hint::black_box(experiment.objective_counts2(&candidates[0]));
                1
            });
            rates.double.turn(|| experiment.objectives_counts2(&plants).len());
            rates.search.turn(|| experiment.search_objectives_counts2(&plants).len());
            if let Some(command) = &self.baseline {
                rates.baseline = rates.baseline.max(baseline_rate(command)?);
            }
            bar.inc(1);
        }
        let mut paper_s = f64::INFINITY;
        let mut generations = 0;
        let sought = Sought { friction: FrictionMode::Known, ..Sought::default() };
        for seed in self.seed..self.seed + PAPER_RUNS {
            let options = Options { method: Method::Paper, sought, seed, ..Options::default() };
            let found = identify(&robot, recordings, &[], &options, &|_| ())?;
            paper_s = paper_s.min(found.seconds);
            generations = found.generations.len() - 1;
            bar.inc(1);
        }
        bar.finish_and_clear();
        let compared = Comparison::new(&experiment, &candidates[..COMPARED], &plants[..COMPARED]);
        let (lanes, instructions) = (SEARCH_LANES, instructions());
        let mut object = json!({
            "evals_per_s": rates.search.best,
            "f64_evals_per_s": rates.double.best,
            "scalar_evals_per_s": rates.scalar.best,
            "max_relative_objective_error": compared.search,
            "samples": experiment.samples(),
            "lanes": lanes,
            "threads": rayon::current_num_threads(),
            "f64_max_relative_objective_error": compared.double,
            "instructions": instructions,
            "paper_run_s": paper_s,
        });
        if self.baseline.is_some() {
            object["baseline_evals_per_s"] = json!(rates.baseline);
            object["ratio"] = json!(rates.search.best / rates.baseline);
            object["f64_ratio"] = json!(rates.double.best / rates.baseline);
        }
        let ways = [
            (format!("search, {lanes} lanes, all cores"), "search", rates.search.best, Some(compared.search)),
            ("double precision, all cores".into(), "double precision", rates.double.best, Some(compared.double)),
            ("one at a time, one core".into(), "one at a time", rates.scalar.best, None),
        ];
        let given = self.baseline.as_ref().map(|command| (command.clone(), "program given", rates.baseline, None));
        let ways: Vec<_> = ways.into_iter().chain(given).collect();
        let section = Section::new("Candidates a second")
            .table(rate_table(&ways, rates.baseline))
            .list([
                format!(
                    "{} samples; {} threads; {instructions}; error: of the objective against one at a time, relative, the \
                     worst of {COMPARED}.",
                    experiment.samples(),
                    rayon::current_num_threads()
                ),
                format!("The paper's whole run, 4 × 20 individuals and {generations} generations: {paper_s:.3} s."),
            ])
            .pictures(vec![rate_picture(&ways)]);
        Ok(Measured {
            title: "How fast candidates are judged, and how exactly".into(),
            verdict: format!(
                "A search judges {:.0} candidates a second, each objective within {:.1e} of it.",
                rates.search.best, compared.search
            ),
            sections: vec![section],
            json: object,
            provenance: page::provenance()
                .robot(&robot)
                .fact("seeds", seeds(self.seed, PAPER_RUNS))
                .fact("threads", rayon::current_num_threads().to_string())
                .fact("instructions", instructions),
        })
    }

    fn recording(&self, robot: &Robot, truth: &HiddenRobot) -> Result<Recording, CommandError> {
        let configuration = armid::board_setup::configuration(robot)?;
        let mut client = Client::connect(Box::new(SimulatedBoard::new(robot, truth.clone(), self.seed)))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
        let movement = TrajectoryArguments::paper(PERIOD_S).prepare(robot)?;
        let run = Run { robot, movement: &movement, mode: Mode::P, seed: Some(self.seed), path: "bench.csv".into() };
        run.on(&mut client)?.whole()
    }

    /// Every second candidate anywhere in the search ranges, every other around the truth, from a ten-thousandth of
    /// its values to a fifth.
    fn candidates(&self, robot: &Robot, truth: &HiddenRobot) -> Vec<Values> {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let mut uniform = move || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let plant = truth.plant(robot);
        let mut known = Values::of_robot(robot);
        known.f = plant.arm.f;
        for joint in 0..robot.joints.len() {
            known.set(Parameter::Viscous(joint), plant.drives[joint].viscous_friction_nm_s_per_rad);
            known.set(Parameter::Coulomb(joint), plant.drives[joint].coulomb_friction_nm);
            known.set(Parameter::TorqueOffset(joint), plant.drives[joint].torque_offset_nm);
        }
        let mut candidates = vec![known];
        while candidates.len() < CANDIDATES {
            let mut values = known;
            let spread = 10f64.powf(-4.0 + 3.3 * uniform());
            let anywhere = candidates.len().is_multiple_of(2);
            for index in 0..PARAMETERS {
                let [low, high] = robot.search[index];
                values.f[index] = if anywhere {
                    low + (high - low) * uniform()
                } else {
                    known.f[index] * (1.0 + spread * (2.0 * uniform() - 1.0))
                };
            }
            if values.arm(robot).check_inertia().is_ok() {
                candidates.push(values);
            }
        }
        candidates
    }
}

/// A way of judging: in words, in short, its rate, and the error of its objectives.
type Way = (String, &'static str, f64, Option<f64>);

fn rate_table(ways: &[Way], baseline: f64) -> Table {
    let compared = baseline > 0.0;
    let headings = ["", "candidates a second", "error"].into_iter();
    let mut table = Table::new(headings.chain(compared.then_some("over the program given")));
    for (name, _, rate, error) in ways {
        let cells =
            [Cell::from(name.as_str()), Cell::fixed(*rate, 0), Cell::optional(*error, Cell::scientific)].into_iter();
        table = table.row(cells.chain(compared.then(|| Cell::fixed(rate / baseline, 1))));
    }
    table
}

fn rate_picture(ways: &[Way]) -> Picture {
    let rate = |(_, _, rate, _): &Way| Some(Interval { low: *rate, value: *rate, high: *rate });
    let sources = vec![(String::new(), Ink::Measured, ways.iter().map(rate).collect())];
    let names = ways.iter().map(|(_, short, ..)| short.to_string()).collect();
    let content = Content::Intervals(Intervals { names, sources, logarithmic: true });
    Picture::of("Candidates a second", ["", "candidates a second"], content)
}

/// The best rate of one way of judging.
#[derive(Default)]
struct Rate {
    best: f64,
}

impl Rate {
    /// Judges for one turn; `judge` gives how many it judged.
    fn turn(&mut self, mut judge: impl FnMut() -> usize) {
        let began = Instant::now();
        while began.elapsed() < TURN {
            let started = Instant::now();
            let judged = judge();
            self.best = self.best.max(judged as f64 / started.elapsed().as_secs_f64());
        }
    }
}

#[derive(Default)]
struct Rates {
    scalar: Rate,
    double: Rate,
    search: Rate,
    baseline: f64,
}

/// The largest relative errors of the objective against the plain plant's.
struct Comparison {
    search: f64,
    double: f64,
}

impl Comparison {
    fn new(experiment: &Experiment, candidates: &[Values], plants: &[Plant<f64>]) -> Self {
        let plain: Vec<f64> = candidates.iter().map(|values| experiment.objective_counts2(values)).collect();
        let worst = |objectives: Vec<f64>| {
            let pairs = plain.iter().zip(objectives).filter(|(plain, _)| plain.is_finite());
            pairs.map(|(plain, other)| ((other - plain) / plain).abs()).fold(0.0, f64::max)
        };
        Self {
            search: worst(experiment.search_objectives_counts2(plants)),
            double: worst(experiment.objectives_counts2(plants)),
        }
    }
}

/// Runs a program and reads its rate.
fn baseline_rate(command: &str) -> Result<f64, CommandError> {
    let cannot =
        |why: &str| CommandError::Failed(format!("the baseline {command:?} cannot be run: {why}; check its path"));
    let output = Command::new("sh").args(["-c", command]).output().map_err(|error| cannot(&error.to_string()))?;
    // What a shell answers for a program that is not there, or is none.
    if matches!(output.status.code(), Some(126 | 127)) {
        return Err(cannot(String::from_utf8_lossy(&output.stderr).trim()));
    }
    let printed = String::from_utf8_lossy(&output.stdout);
    let rate = printed.lines().find_map(|line| line.strip_prefix("evals_per_s ")?.trim().parse().ok());
    rate.ok_or_else(|| {
        CommandError::Failed(format!(
            "the baseline {command:?} did not print a line `evals_per_s X`; run it by hand to see why"
        ))
    })
}

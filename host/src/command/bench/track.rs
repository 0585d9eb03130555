//! `armid bench track`: how near computed torque keeps arms to their movements, what limits it, and what its bandwidths
//! were chosen by.
//!
//! Arms are drawn around the reference robot. Each makes the two movements that `track` identifies from under the position
//! loop of a simulated board, is identified from them, and then tracks on that board with the model found: nothing here
//! knows the truth. What limits it is asked of the same arms outside the board, where errors are seen exactly.

mod study;

use armid::capture::{self, Circumstances, efforts, tracking_quality};
use armid::client::{Client, MovementPlan, Pose};
use armid::compensation::board_model;
use armid::excite;
use armid::identified_model;
use armid::identify::{Options, identify};
use armid::link::SimulatedBoard;
use armid::model::Model;
use armid::random::Random;
use armid::recording::{Mode, Recording};
use armid::report::{Cell, Content, Ink, Interval, Intervals, Picture, Section, Table};
use armid::robot::Robot;
use armid::trajectory_file::paper;
use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};
use shared::protocol::ControlLaw;
use shared::trajectory::Trajectory;

use super::super::own_model::TRAINING_PERIODS_S;
use super::super::{CommandError, page, progress};
use super::Measured;

/// Designed movements to track, and how long the first is and how much longer each next one, in s.
const DESIGNED: u64 = 10;
const SHORTEST_S: f64 = 3.5;
const LONGER_S: f64 = 0.4;

/// How long the arm stands at the start of each movement, in ns.
const SETTLE_NS: u64 = 1_000_000_000;

/// How far every f of the wrong models is off, at most.
const WRONG_F_SHARE: f64 = 0.05;

const EXAMPLES: &str = "Example:
  armid bench track --robots 10";

/// Arguments of `bench track`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct TrackStudy {
    /// How many arms
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    robots: u64,
    /// Seed of the first arm, the others take the ones after it; and of the errors of models
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl TrackStudy {
    pub fn measure(&self) -> Result<Measured, CommandError> {
        let robot = Robot::paper();
        let designed = designed(&robot)?;
        let seeds: Vec<u64> = (self.seed..self.seed + self.robots).collect();
        let bar = progress::bar("bench track: board", self.robots * (2 + 3 * (DESIGNED + 1)));
        let tracked: Vec<Vec<Tracked>> = seeds
            .par_iter()
            .map(|&seed| track_one(&robot, seed, &designed, &|| bar.inc(1)))
            .collect::<Result<_, CommandError>>()?;
        bar.finish_and_clear();
        let rows = rows(&tracked.concat());
        let study = study::Study::new(&robot, &seeds, &designed);
        let board = Section::new("On simulated boards")
            .text(format!(
                "Arms within ±10 % of the reference robot ({}), identified from two movements; errors in counts.",
                self.robots
            ))
            .table(table(&rows))
            .pictures(vec![errors(&rows)]);
        let worst = |row: &Row| (row.controller == Controller::Identified).then_some(row.worst_within_percent);
        let worst = rows.iter().filter_map(worst).fold(100.0, f64::min);
        Ok(Measured {
            title: "Tracking with identified models on arms never seen".into(),
            verdict: format!(
                "With the identified model at least {worst:.2} % of the samples of every movement are within ±1 count."
            ),
            sections: vec![board, study.limits(), study.bandwidths()],
            json: json!({
                "robots": self.robots,
                "seed": self.seed,
                "board": rows.iter().map(Row::to_json).collect::<Vec<_>>(),
                "limits": study.limits_to_json(),
                "settings": study.settings_to_json(),
            }),
            provenance: page::provenance().robot(&robot).fact("seeds", super::seeds(self.seed, self.robots)),
        })
    }
}

/// Movements of different durations, each designed for the identification of the reference robot, that no
/// identification here uses.
fn designed(robot: &Robot) -> Result<Vec<Trajectory>, CommandError> {
    let bar = progress::bar("bench track: movements", DESIGNED);
    let designed: Result<Vec<Trajectory>, CommandError> = (0..DESIGNED)
        .map(|index| {
            let duration_s = SHORTEST_S + LONGER_S * index as f64;
            let settings =
                excite::Settings { generations: 1, seed: index, ..excite::Settings::of_duration(duration_s) };
            let design = excite::design(robot, None, &settings, &|_, _| ())?;
            bar.inc(1);
            Ok(design.trajectory)
        })
        .collect();
    bar.finish_and_clear();
    designed
}

/// What ran on a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Controller {
    Position,
    Identified,
    WrongF,
}

impl Controller {
    const ALL: [Self; 3] = [Self::Position, Self::Identified, Self::WrongF];

    fn name(self) -> &'static str {
        match self {
            Self::Position => "position loop",
            Self::Identified => "computed torque, identified model",
            Self::WrongF => "computed torque, every f up to 5 % off",
        }
    }

    fn field(self) -> &'static str {
        match self {
            Self::Position => "p",
            Self::Identified => "ctc",
            Self::WrongF => "ctc_wrong_f",
        }
    }
}

/// One joint in one movement.
#[derive(Clone, Copy, Debug)]
struct Tracked {
    joint: usize,
    controller: Controller,
    /// On the paper's movement, or on a designed one.
    paper: bool,
    max_counts: f64,
    rms_counts: f64,
    within_percent: f64,
    torque_rms_nm: f64,
    time_in_limits_s: f64,
}

/// Identifies one arm on its board, and lets it track every movement three ways; `done` is told of each movement.
fn track_one(
    robot: &Robot,
    seed: u64,
    designed: &[Trajectory],
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Tracked>, CommandError> {
    let board = SimulatedBoard::hidden(robot, seed);
    let mut client = Client::connect(Box::new(board))?;
    client.prepare(&armid::board_setup::configuration(robot)?, Pose::DefaultsTo([0.0; 2]), false)?;
    let record = |client: &mut Client, movement: &Trajectory, mode: Mode| -> Result<Recording, CommandError> {
        client.load_trajectory(movement)?;
        let law = if mode == Mode::P { ControlLaw::Position } else { ControlLaw::ComputedTorque };
        let movement = client.run(&MovementPlan { law, settle_ns: SETTLE_NS }, &mut |_| ())?;
        if let Some(reason) = movement.partial {
            return Err(CommandError::Incomplete { reason, board_lost: false });
        }
        done();
        let board = client.info().clone();
        let circumstances = Circumstances { robot, mode, trajectory: "bench".into(), board, seed: Some(seed) };
        Ok(capture::recording(&movement, &circumstances, "bench.csv".into()))
    };
    let training: Vec<Recording> = TRAINING_PERIODS_S
        .into_iter()
        .filter_map(paper)
        .map(|movement| record(&mut client, &movement, Mode::P))
        .collect::<Result<_, CommandError>>()?;
    let found = identify(robot, &training, &[], &Options { seed, ..Options::default() }, &|_| ())?;
    let model = identified_model::from_identification(robot, &found, toml::Table::new());

    let mut random = Random::new(seed, 20);
    let mut tracked = Vec::new();
    let of_paper = paper(TRAINING_PERIODS_S[0]);
    for (index, movement) in of_paper.iter().chain(designed).enumerate() {
        for controller in Controller::ALL {
            let used = match controller {
                Controller::Position | Controller::Identified => model.clone(),
                Controller::WrongF => {
                    let f = model.f.map(|f| f * (1.0 + random.between(-WRONG_F_SHARE, WRONG_F_SHARE)));
                    Model { f, ..model.clone() }
                }
            };
            client.upload(&board_model(robot, &used)?)?;
            let mode = if controller == Controller::Position { Mode::P } else { Mode::Ctc };
            let recording = record(&mut client, movement, mode)?;
            let joints = tracking_quality(&recording).into_iter().zip(efforts(&recording, robot)).enumerate();
            tracked.extend(joints.map(|(joint, (quality, effort))| Tracked {
                joint,
                controller,
                paper: index == 0,
                max_counts: quality.max_abs_error_counts,
                rms_counts: quality.rms_error_counts,
                within_percent: quality.within_one_count_percent,
                torque_rms_nm: effort.torque_rms_nm,
                time_in_limits_s: effort.time_in_limits_s,
            }));
        }
    }
    Ok(tracked)
}

/// All arms' movements of one kind under one controller.
struct Row {
    paper: bool,
    controller: Controller,
    joint: usize,
    movements: usize,
    /// Largest error of any, counts.
    max_counts: f64,
    /// Mean over movements of the rms error, counts.
    rms_counts: f64,
    /// Percentage of all samples, and of the worst movement's.
    within_percent: f64,
    worst_within_percent: f64,
    torque_rms_nm: f64,
    time_in_limits_s: f64,
}

fn rows(tracked: &[Tracked]) -> Vec<Row> {
    let mut rows = Vec::new();
    for paper in [true, false] {
        for joint in 0..2 {
            for controller in Controller::ALL {
                let of: Vec<&Tracked> = tracked
                    .iter()
                    .filter(|one| one.paper == paper && one.joint == joint && one.controller == controller)
                    .collect();
                let mean = |value: fn(&Tracked) -> f64| of.iter().map(|one| value(one)).sum::<f64>() / of.len() as f64;
                let most = |value: fn(&Tracked) -> f64| of.iter().map(|one| value(one)).fold(f64::MIN, f64::max);
                rows.push(Row {
                    paper,
                    controller,
                    joint,
                    movements: of.len(),
                    max_counts: most(|one| one.max_counts),
                    rms_counts: mean(|one| one.rms_counts),
                    within_percent: mean(|one| one.within_percent),
                    worst_within_percent: -most(|one| -one.within_percent),
                    torque_rms_nm: mean(|one| one.torque_rms_nm),
                    time_in_limits_s: most(|one| one.time_in_limits_s),
                });
            }
        }
    }
    rows
}

impl Row {
    fn movements_name(&self) -> &'static str {
        if self.paper { "paper's" } else { "designed" }
    }

    fn to_json(&self) -> Value {
        json!({
            "movement": if self.paper { "paper" } else { "designed" },
            "controller": self.controller.field(),
            "joint": self.joint + 2,
            "movements": self.movements,
            "max_abs_error_counts": self.max_counts,
            "rms_error_counts": self.rms_counts,
            "within_one_count": self.within_percent,
            "worst_within_one_count": self.worst_within_percent,
            "torque_rms_nm": self.torque_rms_nm,
            "most_time_in_limits_s": self.time_in_limits_s,
        })
    }
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new([
        "movements",
        "joint",
        "controller",
        "largest error",
        "rms error",
        "within ±1, %",
        "the worst movement, %",
        "torque rms, N m",
        "in limits, s",
    ]);
    for row in rows {
        table = table.row([
            Cell::from(row.movements_name()),
            Cell::count(row.joint + 2),
            Cell::from(row.controller.name()),
            Cell::fixed(row.max_counts, 0),
            Cell::fixed(row.rms_counts, 3),
            Cell::fixed(row.within_percent, 3),
            Cell::fixed(row.worst_within_percent, 2),
            Cell::fixed(row.torque_rms_nm, 4),
            Cell::fixed(row.time_in_limits_s, 3),
        ]);
    }
    table
}

/// The errors of each controller, from the mean rms to the largest.
fn errors(rows: &[Row]) -> Picture {
    let of = |controller: Controller| rows.iter().filter(move |row| row.controller == controller);
    let names = of(Controller::Position).map(|row| format!("{}, {}", row.movements_name(), row.joint + 2));
    let sources = Controller::ALL.iter().enumerate().map(|(place, &controller)| {
        let interval = |row: &Row| Some(Interval { low: row.rms_counts, value: row.rms_counts, high: row.max_counts });
        (controller.name().to_string(), Ink::Nth(place), of(controller).map(interval).collect())
    });
    let intervals = Intervals { names: names.collect(), sources: sources.collect(), logarithmic: true };
    let title = "Tracking errors by movement and joint: rms, and up to the largest";
    Picture::of(title, ["", "error, counts"], Content::Intervals(intervals))
}

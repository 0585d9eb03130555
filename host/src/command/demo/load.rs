//! `armid demo load`: a load is picked up and dropped while the arm moves; the board finds it each time.

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::link::{LoadChange, SimulatedBoard};
use armid::load::{self, Listener, Told};
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::report::{
    self, Assumed, Cell, FileRole, Ink, Line, Picture, Section, Table, assumed_load, staircase, thinned,
};
use armid::robot::{Gripper, Robot};
use clap::Args;
use serde_json::json;
use shared::load::LoadNews;

use super::super::common::{TrajectoryArguments, advise, for_board, print, print_json};
use super::super::load::sentence;
use super::super::run::Run;
use super::super::track::{self, Compared};
use super::super::{CommandError, own_model, page};
use super::{Common, draw};

/// Period T of the movement, s.
const PERIOD_S: f64 = 5.0;
/// When the load is picked up, and when it is dropped, s after the start of the recording.
const PICKED_AT_S: f64 = 1.5;
const DROPPED_AT_S: f64 = 3.4;
/// Masses that are drawn, kg.
const MASSES_KG: [f64; 2] = [0.5, 2.3];

/// What is written into the output folder.
const FILES: [&str; 5] = ["robot.toml", "model.toml", "unaware.csv", "aware.csv", "load.svg"];

const EXAMPLES: &str =
    "Mass of the load and robot are drawn from the seed. The board knows neither; the truth is printed \
    beside what it found.

Examples:
  armid demo load
  armid demo load --mass-kg 1.72 --seed 3 --json";

/// Arguments of `demo load`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct LoadDemo {
    /// Mass to pick up instead of a drawn one, kg: 0.2 to 2.4
    #[arg(long, value_name = "KG")]
    mass_kg: Option<f64>,
    #[command(flatten)]
    common: Common,
}

impl LoadDemo {
    pub fn run(&self) -> Result<(), CommandError> {
        let seed = self.common.seed;
        let [low, high] = MASSES_KG;
        // A golden-ratio sequence: neighbouring seeds give masses far apart.
        let mass_kg = self.mass_kg.unwrap_or(low + (high - low) * (0.618_033_988_75 * seed as f64).fract());
        if !(0.2..=2.4).contains(&mass_kg) {
            return Err(CommandError::Usage(format!("--mass-kg {mass_kg} is not from 0.2 to 2.4 kg")));
        }
        self.common.begin(&FILES)?;
        let robot = Robot::paper();
        robot.write(&self.common.out.join("robot.toml"))?;
        let hidden = HiddenRobot::draw(&robot, seed);
        let configuration = armid::board_setup::configuration(&robot)?;
        let changes = [
            LoadChange { at_s: PICKED_AT_S, load: Gripper::REFERENCE.holding(mass_kg) },
            LoadChange { at_s: DROPPED_AT_S, load: Gripper::REFERENCE.holding(0.0) },
        ];
        let board = SimulatedBoard::new(&robot, hidden, seed).with_load(Gripper::REFERENCE.holding(0.0), &changes);
        let mut client = Client::connect(Box::new(board))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;

        advise("1/3 identifying the empty arm");
        let model =
            own_model::identified(&mut client, &robot, &TrajectoryArguments::paper(PERIOD_S).prepare(&robot)?, seed)?;
        model.write(&self.common.out.join("model.toml"))?;
        client.upload(&for_board(&robot, &model)?)?;

        advise(format!(
            "2/3 computed torque that knows of no load; one is picked up after {PICKED_AT_S} s and dropped after \
             {DROPPED_AT_S} s"
        ));
        let (unaware, _) = self.movement(&mut client, &robot, "unaware.csv")?;

        advise("3/3 the same with the identification on the board");
        client.identify_load(&load::settings(&robot, &model, &Gripper::REFERENCE))?;
        let (aware, told) = self.movement(&mut client, &robot, "aware.csv")?;

        let duration_s = aware.samples() as f64 * robot.record_period_s;
        let mut pictures = vec![Picture {
            title: "mass carried (orange) and assumed by computed torque (blue)".into(),
            ..assumed_load(
                &Assumed::course(Gripper::REFERENCE.maximum_load_kg, &told),
                duration_s,
                Some(carried_course(mass_kg, duration_s)),
            )
        }];
        pictures.extend(errors(&robot, &unaware, &aware));
        let pictures: Vec<Picture> = pictures.into_iter().map(Picture::unnamed).collect();
        let path = self.common.out.join("load.svg");
        draw(&path, "A load picked up and dropped mid-motion", &pictures, 1, (1000, 260))?;
        let compared = [
            Compared { label: "knows of no load", field: "ctc_unaware", recording: unaware },
            Compared { label: "identifies the load", field: "ctc", recording: aware },
        ];
        self.report(&robot, &model, mass_kg, &compared, &told)?;
        self.common.report.write(|| Ok(self.page(&robot, &model, mass_kg, &compared, &told)))
    }

    fn page(
        &self,
        robot: &Robot,
        model: &Model,
        mass_kg: f64,
        compared: &[Compared; 2],
        told: &[Told],
    ) -> report::Page {
        let [unaware, aware] = compared;
        let duration_s = aware.recording.samples() as f64 * robot.record_period_s;
        let runs = [(&unaware.recording, unaware.label), (&aware.recording, aware.label)];
        let carried = page::load::Carried {
            robot,
            told,
            maximum_kg: Gripper::REFERENCE.maximum_load_kg,
            carried: Some(carried_course(mass_kg, duration_s)),
            runs: &runs,
            errors: errors(robot, &unaware.recording, &aware.recording),
        };
        let mut table = Table::new(["time, s", "found, kg", "± standard error, kg", "true, kg"]);
        for (at_s, found_kg, error_kg, true_kg) in found(told, mass_kg) {
            table = table.row([at_s, found_kg, error_kg, true_kg].map(|value| Cell::fixed(value, 3)));
        }
        let provenance = page::provenance()
            .seed(self.common.seed)
            .robot(robot)
            .model(robot, model)
            .recordings(FileRole::Written, runs.map(|(recording, _)| recording));
        let rest = vec![
            report::parameters(robot, "empty arm", &report::of_model(robot, model)),
            page::demo::written(provenance, &self.common.out, &FILES).section(),
        ];
        let verdict = format!(
            "{mass_kg:.3} kg picked up at {PICKED_AT_S} s and dropped at {DROPPED_AT_S} s. {}",
            page::track::verdict(compared)
        );
        let mut page = carried.page(verdict, Some(Section::new("Found and true").table(table)), rest);
        page.command = "demo load".into();
        page.title = "A load picked up and dropped mid-motion".into();
        page
    }

    /// The movement under computed torque, and what the board told about the load, in s from its first row.
    fn movement(&self, client: &mut Client, robot: &Robot, file: &str) -> Result<(Recording, Vec<Told>), CommandError> {
        let movement = TrajectoryArguments::paper(PERIOD_S).prepare(robot)?;
        let path = self.common.out.join(file);
        let run = Run { robot, movement: &movement, mode: Mode::Ctc, seed: Some(self.common.seed), path };
        let mut show = |told: &Told| advise(format!("    {}", sentence(robot, &told.news)));
        let mut listener = Listener::new(robot, &mut show);
        let mut ran = run.watched(client, &mut listener)?;
        ran.write(robot)?;
        // The first row is too early to tell of motion, so that is told with it.
        let start_s = listener.told.first().map_or(0.0, |told| told.at_s);
        let told = listener.told.iter().map(|told| Told { at_s: told.at_s - start_s, ..*told }).collect();
        Ok((ran.whole()?, told))
    }

    fn report(
        &self,
        robot: &Robot,
        model: &Model,
        mass_kg: f64,
        compared: &[Compared],
        told: &[Told],
    ) -> Result<(), CommandError> {
        let found = found(told, mass_kg);
        if self.common.json {
            let mut object = track::to_json(robot, compared);
            object["seed"] = json!(self.common.seed);
            object["true_mass_kg"] = json!(mass_kg);
            object["picked_at_s"] = json!(PICKED_AT_S);
            object["dropped_at_s"] = json!(DROPPED_AT_S);
            object["f"] = json!(model.f);
            object["found"] = found
                .iter()
                .map(|(at_s, found_kg, error_kg, true_kg)| {
                    json!({"at_s": at_s, "mass_kg": found_kg, "standard_error_kg": error_kg, "true_mass_kg": true_kg})
                })
                .collect();
            object["events"] =
                told.iter().map(|told| json!({"at_s": told.at_s, "news": sentence(robot, &told.news)})).collect();
            object["out"] = json!(self.common.out);
            return print_json(&object);
        }
        let events: Vec<String> =
            told.iter().map(|told| format!("{:>8.3} s  {}", told.at_s, sentence(robot, &told.news))).collect();
        let results: Vec<String> = found
            .iter()
            .map(|(at_s, found_kg, error_kg, true_kg)| {
                format!("{at_s:>8.3} s  found {found_kg:.3} ± {error_kg:.3} kg, true {true_kg:.3} kg")
            })
            .collect();
        print(format!(
            "\nWhat the board told ({mass_kg:.3} kg picked up at {PICKED_AT_S} s, dropped at {DROPPED_AT_S} s)\n{}\n\nFound \
             and true\n{}\n\nTracking under computed torque\n{}\n\nFiles in {}: {}",
            events.join("\n"),
            results.join("\n"),
            track::table(robot, compared),
            self.common.out.display(),
            FILES.join(", ")
        ))
    }
}

/// What is carried at a time.
fn carried_kg(at_s: f64, mass_kg: f64) -> f64 {
    if (PICKED_AT_S..DROPPED_AT_S).contains(&at_s) { mass_kg } else { 0.0 }
}

/// What was found: when, s, the mass and its standard error, and the true mass then, kg.
fn found(told: &[Told], mass_kg: f64) -> Vec<(f64, f64, f64, f64)> {
    let of = |told: &Told| match told.news {
        LoadNews::Found(found) => Some((
            told.at_s,
            f64::from(found.mass_kg),
            f64::from(found.standard_error_kg),
            carried_kg(told.at_s, mass_kg),
        )),
        _ => None,
    };
    told.iter().filter_map(of).collect()
}

/// The mass carried over the movement, as a line.
fn carried_course(mass_kg: f64, duration_s: f64) -> Vec<(f64, f64)> {
    vec![
        (0.0, 0.0),
        (PICKED_AT_S, 0.0),
        (PICKED_AT_S, mass_kg),
        (DROPPED_AT_S, mass_kg),
        (DROPPED_AT_S, 0.0),
        (duration_s, 0.0),
    ]
}

/// The tracking errors without and with the identification, one picture a joint.
fn errors(robot: &Robot, unaware: &Recording, aware: &Recording) -> Vec<Picture> {
    let of_joint = |(index, joint): (usize, &armid::robot::Joint)| {
        let lines = [(unaware, "knows of no load", Ink::Simulated), (aware, "identifies it", Ink::Measured)];
        let lines = lines.map(|(recording, name, ink)| {
            Line::new(name, ink, thinned(staircase(&recording.error_counts[index], robot.record_period_s)))
        });
        let title = format!("tracking error of joint {}: knows of no load (orange), identifies it (blue)", joint.name);
        Picture::lines(title, ["time, s", "counts"], lines.to_vec()).symmetric(2.0)
    };
    robot.joints.iter().enumerate().map(of_joint).collect()
}

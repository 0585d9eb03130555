//! `armid demo load`: a load is picked up and dropped while the arm moves; the board finds it each time.

use std::error::Error;

use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::link::{LoadChange, SimulatedBoard};
use armid::load::{self, Listener, Told};
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use clap::Args;
use plotters::prelude::*;
use serde_json::json;
use shared::load::LoadNews;

use super::super::common::{TrajectoryArguments, advise, for_board, print, print_json};
use super::super::load::sentence;
use super::super::run::Run;
use super::super::track::{self, Compared};
use super::super::{CommandError, drawing, own_model};
use super::Common;

/// Period T of the movement, s.
const PERIOD_S: f64 = 5.0;
/// When the load is picked up, and when it is dropped, s after the start of the recording.
const PICKED_AT_S: f64 = 1.5;
const DROPPED_AT_S: f64 = 3.4;
/// Masses that are drawn, kg.
const MASSES_KG: [f64; 2] = [0.5, 2.3];

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
        let robot = Robot::paper();
        robot.write(&self.common.out.join("robot.toml"))?;
        let hidden = HiddenRobot::draw(&robot, seed);
        let configuration = armid::board_setup::configuration(&robot)?;
        let changes = [
            LoadChange { at_s: PICKED_AT_S, load: load::held(mass_kg) },
            LoadChange { at_s: DROPPED_AT_S, load: load::held(0.0) },
        ];
        let board = SimulatedBoard::new(&robot, hidden, seed).with_load(load::held(0.0), &changes);
        let mut client = Client::connect(Box::new(board))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;

        advise("1/3 identifying the empty arm");
        let model = own_model::identified(&mut client, &robot, seed)?;
        model.write(&self.common.out.join("model.toml"))?;
        client.upload(&for_board(&robot, &model)?)?;

        advise(format!(
            "2/3 computed torque that knows of no load; one is picked up after {PICKED_AT_S} s and dropped after \
             {DROPPED_AT_S} s"
        ));
        let (unaware, _) = self.movement(&mut client, &robot, "unaware.csv")?;

        advise("3/3 the same with the identification on the board");
        client.identify_load(&load::settings(&robot, &model, load::MAXIMUM_KG, load::GRASP_M))?;
        let (aware, told) = self.movement(&mut client, &robot, "aware.csv")?;

        let picture = picture(&robot, &unaware, &aware, mass_kg, &told)
            .map_err(|reason| CommandError::Failed(format!("the picture could not be drawn: {reason}")))?;
        armid::write_file(&self.common.out.join("load.svg"), picture.as_bytes())?;
        self.report(&robot, &model, mass_kg, unaware, aware, &told)
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
        unaware: Recording,
        aware: Recording,
        told: &[Told],
    ) -> Result<(), CommandError> {
        let found: Vec<(f64, f64, f64, f64)> = told
            .iter()
            .filter_map(|told| match told.news {
                LoadNews::Found(found) => Some((
                    told.at_s,
                    f64::from(found.mass_kg),
                    f64::from(found.standard_error_kg),
                    carried_kg(told.at_s, mass_kg),
                )),
                _ => None,
            })
            .collect();
        let compared = [
            Compared { label: "knows of no load", field: "ctc_unaware", recording: unaware },
            Compared { label: "identifies the load", field: "ctc", recording: aware },
        ];
        if self.common.json {
            let mut object = track::to_json(robot, &compared);
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
             and true\n{}\n\nTracking under computed torque\n{}\n\nFiles in {}: robot.toml, model.toml, unaware.csv, \
             aware.csv, load.svg",
            events.join("\n"),
            results.join("\n"),
            track::table(robot, &compared),
            self.common.out.display()
        ))
    }
}

/// What is carried at a time.
fn carried_kg(at_s: f64, mass_kg: f64) -> f64 {
    if (PICKED_AT_S..DROPPED_AT_S).contains(&at_s) { mass_kg } else { 0.0 }
}

/// Mass carried and assumed over the movement, and the errors below it; as SVG.
fn picture(
    robot: &Robot,
    unaware: &Recording,
    aware: &Recording,
    mass_kg: f64,
    told: &[Told],
) -> Result<String, Box<dyn Error>> {
    let period_s = robot.record_period_s;
    let duration_s = aware.samples() as f64 * period_s;
    let mut assumed = vec![(0.0, 0.5 * load::MAXIMUM_KG)];
    for told in told {
        let now_kg = match told.news {
            LoadNews::Found(found) => f64::from(found.mass_kg),
            LoadNews::Changed { assumed_kg, .. } => f64::from(assumed_kg),
            _ => continue,
        };
        let before_kg = assumed.last().map_or(0.0, |&(_, kg)| kg);
        assumed.extend([(told.at_s, before_kg), (told.at_s, now_kg)]);
    }
    assumed.push((duration_s, assumed.last().map_or(0.0, |&(_, kg)| kg)));
    let carried = [
        (0.0, 0.0),
        (PICKED_AT_S, 0.0),
        (PICKED_AT_S, mass_kg),
        (DROPPED_AT_S, mass_kg),
        (DROPPED_AT_S, 0.0),
        (duration_s, 0.0),
    ];
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1000, 800)).into_drawing_area();
        area.fill(&WHITE)?;
        let area = area.titled("A load picked up and dropped mid-motion", ("sans-serif", 22))?;
        let panels = area.split_evenly((3, 1));
        let mut chart = ChartBuilder::on(&panels[0])
            .caption("mass carried (grey) and assumed by computed torque (blue)", ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(34)
            .y_label_area_size(50)
            .build_cartesian_2d(0.0..duration_s, -0.1..load::MAXIMUM_KG)?;
        chart.configure_mesh().light_line_style(WHITE).x_desc("time, s").y_desc("kg").draw()?;
        chart.draw_series(LineSeries::new(carried, BLACK.mix(0.4).stroke_width(4)))?;
        chart.draw_series(LineSeries::new(assumed, BLUE.stroke_width(2)))?;
        for (joint, panel) in panels[1..].iter().enumerate() {
            let (without, with) = (&unaware.error_counts[joint], &aware.error_counts[joint]);
            let largest = without.iter().chain(with).fold(2.0, |largest: f64, error| largest.max(error.abs())) * 1.15;
            let name = &robot.joints[joint].name;
            let mut chart = ChartBuilder::on(panel)
                .caption(
                    format!("tracking error of joint {name}: knows of no load (red), identifies it (blue)"),
                    ("sans-serif", 16),
                )
                .margin(10)
                .x_label_area_size(34)
                .y_label_area_size(50)
                .build_cartesian_2d(0.0..duration_s, -largest..largest)?;
            chart.configure_mesh().light_line_style(WHITE).x_desc("time, s").y_desc("counts").draw()?;
            for (errors, colour) in [(without, RED), (with, BLUE)] {
                chart.draw_series(LineSeries::new(drawing::staircase(errors, period_s), colour.stroke_width(1)))?;
            }
        }
        area.present()?;
    }
    Ok(svg)
}

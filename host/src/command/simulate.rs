//! `armid simulate`.

use std::path::PathBuf;

use armid::capture::tracking_quality;
use armid::client::{Client, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::link::SimulatedBoard;
use armid::model::ROBOT_IDENTITY;
use clap::Args;
use serde_json::json;

use super::CommandError;
use super::common::{
    RobotArguments, TrajectoryArguments, for_simulation, print, print_json, read_model, with_effects, with_sidecars,
};
use super::outputs::{Existing, FileKind, check_apart, check_outputs, check_recording_outputs};
use super::record::Controller;
use super::run::Run;

const EXAMPLES: &str = "Examples:
  armid simulate --seed 4 --out run.csv --truth truth.toml
  armid simulate --effect backlash:joint=3,gap_rad=0.002 --out loose.csv";

/// Arguments of `simulate`.
#[derive(Debug, Args)]
#[command(after_long_help = format!("{EXAMPLES}\n\n{}", armid::effects::library_text()))]
pub struct Simulate {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    trajectory: TrajectoryArguments,
    /// Model of the robot to simulate; without it, one is drawn from the seed around the arm that the robot file makes
    /// expect: the reference robot, or the middle of its search ranges
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Effect that the simulated robot has beyond its model, NAME:joint=JOINT,PARAMETER=VALUE,…; may be repeated
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// Seed of a drawn robot and of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Controller; computed torque runs with the true model, or with --controller-model
    #[arg(long, value_enum, default_value_t = Controller::P)]
    mode: Controller,
    /// Model that computed torque runs with
    #[arg(long, value_name = "FILE")]
    controller_model: Option<PathBuf>,
    /// Recording to write; its manifest goes beside it with the ending .toml
    #[arg(long, value_name = "FILE", default_value = "simulated.csv")]
    out: PathBuf,
    /// Replace a recording that is there already
    #[arg(long)]
    force: bool,
    /// Write the truth, as a model file
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Simulate {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read_for_motion()?;
        let movement = self.trajectory.prepare(&robot)?;
        let configuration = armid::board_setup::configuration(&robot)?;
        let inputs = [&self.robot.robot, &self.model, &self.controller_model].map(Option::as_deref);
        let inputs = || inputs.into_iter().chain([self.trajectory.file()]).flatten();
        check_recording_outputs(&self.out, Existing::with_force(self.force), inputs())?;
        if let Some(truth) = &self.truth {
            let recording = with_sidecars(std::slice::from_ref(&self.out));
            check_apart(truth, recording.iter().map(PathBuf::as_path), "the truth", "--truth")?;
            check_outputs([(truth.as_path(), FileKind::Model)], inputs())?;
        }
        let truth = match &self.model {
            Some(path) => HiddenRobot::from_model(&read_model(path, &robot)?, &robot)?,
            None => HiddenRobot::draw(&robot, self.seed),
        };
        let truth = with_effects(truth, &self.effects, &robot)?;
        let truth_model = truth.to_model(toml::Table::from_iter([
            ("tool".to_string(), toml::Value::String(armid::TOOL_VERSION.into())),
            ("what".to_string(), toml::Value::String("the simulated robot itself".into())),
            (ROBOT_IDENTITY.to_string(), toml::Value::String(robot.identity())),
        ]));
        let mut client = Client::connect(Box::new(SimulatedBoard::new(&robot, truth, self.seed)))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
        if self.mode == Controller::Ctc {
            let model = match &self.controller_model {
                Some(path) => read_model(path, &robot)?,
                None => truth_model.clone(),
            };
            client.upload(&for_simulation(&robot, &model)?)?;
        }
        let run = Run {
            robot: &robot,
            movement: &movement,
            mode: self.mode.into(),
            seed: Some(self.seed),
            path: self.out.clone(),
        };
        let mut ran = run.on(&mut client)?;
        ran.write(&robot)?;
        if let Some(path) = &self.truth {
            truth_model.write(path)?;
        }
        let quality = tracking_quality(&ran.recording);
        let max: Vec<f64> = quality.iter().map(|joint| joint.max_abs_error_counts).collect();
        if self.json {
            print_json(&json!({
                "recording": self.out, "samples": ran.recording.samples(), "seed": self.seed, "max_abs_error_counts": max,
                "truth": {"f": truth_model.f, "viscous_nm_s_per_rad": truth_model.viscous_nm_s_per_rad,
                          "coulomb_nm": truth_model.coulomb_nm, "effects": truth_model.effects},
            }))?;
        } else {
            let max: Vec<String> = max.iter().map(|max| format!("{max:.0}")).collect();
            let samples = ran.recording.samples();
            print(format!("{}: {samples} samples; largest errors {} counts", self.out.display(), max.join(" / ")))?;
        }
        ran.whole().map(drop)
    }
}

//! `armid record`.

use std::path::PathBuf;

use armid::capture::tracking_quality;
use armid::recording::{Mode, Recording};
use clap::{Args, ValueEnum};
use serde_json::json;

use super::CommandError;
use super::common::{
    BoardArguments, RobotArguments, TrajectoryArguments, check_recording_outputs, print, print_json, read_model,
};
use super::run::{Ran, Run};

const IF_THE_LINK_BREAKS: &str = "Should this tool end or the cable be pulled during a movement, the board switches off \
    within a second; what was received is written and marked as partial in the manifest.";

/// Arguments of `record`.
#[derive(Debug, Args)]
#[command(after_help = IF_THE_LINK_BREAKS)]
pub struct Record {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    #[command(flatten)]
    trajectory: TrajectoryArguments,
    /// Controller
    #[arg(long, value_enum, default_value_t = Controller::P)]
    mode: Controller,
    /// Model to upload first; computed torque needs one on the board
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Recording to write; its manifest goes beside it with the ending .toml
    #[arg(long, value_name = "FILE", default_value = "recording.csv")]
    out: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Controllers by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Controller {
    /// The position loop
    P,
    /// Computed torque
    Ctc,
}

impl From<Controller> for Mode {
    fn from(controller: Controller) -> Self {
        match controller {
            Controller::P => Self::P,
            Controller::Ctc => Self::Ctc,
        }
    }
}

impl Record {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read_for_motion()?;
        let model = self.model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
        let movement = self.trajectory.prepare(&robot)?;
        let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
        check_recording_outputs(&self.out, inputs.into_iter().flatten())?;
        movement.advise_margins();
        let mut client = self.board.connect_ready(&robot)?;
        if let Some(model) = &model {
            client.upload(&armid::board_setup::board_model(&robot, model)?)?;
        }
        let run = Run {
            robot: &robot,
            movement: &movement,
            mode: self.mode.into(),
            seed: self.board.simulated_seed(),
            path: self.out.clone(),
        };
        let ran = run.on(&mut client)?;
        ran.recording.write(&self.out, &robot)?;
        self.report(&ran)?;
        ran.whole().map(drop)
    }

    fn report(&self, ran: &Ran) -> Result<(), CommandError> {
        let samples = ran.recording.samples();
        let quality = tracking_quality(&ran.recording);
        let max: Vec<f64> = quality.iter().map(|joint| joint.max_abs_error_counts).collect();
        let rms: Vec<f64> = quality.iter().map(|joint| joint.rms_error_counts).collect();
        let manifest = Recording::manifest_path(&self.out);
        if self.json {
            return print_json(&json!({
                "recording": self.out, "manifest": manifest, "samples": samples,
                "partial": ran.partial(), "max_abs_error_counts": max, "rms_error_counts": rms,
            }));
        }
        let joints: Vec<String> =
            max.iter().zip(&rms).map(|(max, rms)| format!("max {max:.0}, rms {rms:.1}")).collect();
        print(format!(
            "{}: {samples} samples{}; tracking error in counts: {}\n{}: manifest",
            self.out.display(),
            if ran.partial().is_some() { " (partial)" } else { "" },
            joints.join(" / "),
            manifest.display()
        ))
    }
}

//! `armid record`.

use std::path::PathBuf;

use armid::board_setup;
use armid::capture::{self, Circumstances, tracking_quality};
use armid::client::Unwatched;
use armid::margins::ArmLoop;
use armid::recording::{Mode, Recording};
use armid::report::FileRole;
use armid::robot::Robot;
use clap::{Args, ValueEnum};
use serde_json::json;

use super::common::{BoardArguments, RobotArguments, TrajectoryArguments, for_board, print, print_json, read_model};
use super::outputs::{Existing, check_recording_outputs, check_unfinished};
use super::page::{self, ReportArguments};
use super::run::Run;
use super::{CommandError, progress};

const IF_THE_LINK_BREAKS: &str = "Ctrl-C stops the arm along its path, Ctrl-C again switches it off. Should the cable be pulled during a movement, the \
    board switches off within a second. What was received is written and marked as partial in the manifest.

Examples:
  armid record --board sim --period 5 --out slow.csv
  armid record --pose 0,0 --trajectory movement.toml --out designed.csv";

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
    /// Replace a recording that is there already
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    report: ReportArguments,
    /// Move nothing: read the board's last recording from its memory once more
    #[arg(long, conflicts_with_all = ["trajectory", "period", "settle", "model", "mode", "pose"])]
    last: bool,
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
        if self.last {
            return self.read_last();
        }
        let robot = self.robot.read_for_motion()?;
        let model = self.model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
        let movement = self.trajectory.prepare(&robot)?;
        let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
        check_recording_outputs(&self.out, self.existing(), inputs.into_iter().flatten())?;
        check_unfinished(&self.out)?;
        self.check_report()?;
        let model = model.map(|model| for_board(&robot, &model)).transpose()?;
        movement.advise_margins();
        let mut client = self.board.connect_ready(&robot)?;
        if let Some(model) = &model {
            client.upload(model)?;
        } else if matches!(self.mode, Controller::Ctc)
            && let Some(active) = client.active_model()?
        {
            // The model that the board kept was checked with the robot file of its day.
            ArmLoop::of_board(&robot, &active).check(&robot)?;
        }
        let run = Run {
            robot: &robot,
            movement: &movement,
            mode: self.mode.into(),
            seed: self.board.simulated_seed(),
            path: self.out.clone(),
        };
        let mut ran = run.recorded(&mut client, &mut Unwatched)?;
        ran.write(&robot)?;
        self.tell(&robot, &ran.recording)?;
        ran.whole().map(drop)
    }

    fn existing(&self) -> Existing {
        Existing::with_force(self.force)
    }

    /// The board's memory outlives a link that broke and a disk that was full.
    fn read_last(&self) -> Result<(), CommandError> {
        let robot = self.robot.read()?;
        check_recording_outputs(&self.out, self.existing(), self.robot.robot.as_deref())?;
        self.check_report()?;
        let mut client = self.board.connect(&robot)?;
        let mut show = progress::of_movement("last movement");
        let movement = client.last_movement(&mut show)?;
        let Some((movement, info)) = movement.and_then(|movement| movement.recording.map(|info| (movement, info)))
        else {
            return Err(CommandError::Failed("the board holds no recording: none was made since it started".into()));
        };
        let expected = board_setup::configuration(&robot)?.crc();
        if info.configuration_crc != expected {
            return Err(CommandError::Usage(format!(
                "the movement was made with other robot constants (CRC {:08x}) than those of the robot file (CRC \
                 {expected:08x}); pass the one it was made with as --robot",
                info.configuration_crc
            )));
        }
        let board = client.info().clone();
        let circumstances = Circumstances {
            robot: &robot,
            mode: if info.model_crc.is_some() { Mode::Ctc } else { Mode::P },
            trajectory: format!("read again from the board: movement {}", info.movement),
            board,
            seed: None,
        };
        let recording = capture::recording(&movement, &circumstances, self.out.clone());
        recording.write(&self.out, &robot)?;
        self.tell(&robot, &recording)
    }

    fn check_report(&self) -> Result<(), CommandError> {
        let sidecar = Recording::manifest_path(&self.out);
        let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
        self.report.check([self.out.as_path(), sidecar.as_path()], inputs.into_iter().flatten())
    }

    /// Prints the result, and writes the page.
    fn tell(&self, robot: &Robot, recording: &Recording) -> Result<(), CommandError> {
        self.print(recording)?;
        if recording.samples() == 0 {
            return Ok(());
        }
        self.report.write(|| {
            let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
            let provenance = page::provenance().robot(robot).files(FileRole::Read, inputs.into_iter().flatten());
            Ok(page::record::page("record", robot, std::slice::from_ref(recording), FileRole::Written, provenance))
        })
    }

    fn print(&self, recording: &Recording) -> Result<(), CommandError> {
        let partial = recording.manifest.as_ref().and_then(|manifest| manifest.partial.as_deref());
        let samples = recording.samples();
        if samples == 0 {
            return Ok(());
        }
        let quality = tracking_quality(recording);
        let max: Vec<f64> = quality.iter().map(|joint| joint.max_abs_error_counts).collect();
        let rms: Vec<f64> = quality.iter().map(|joint| joint.rms_error_counts).collect();
        let manifest = Recording::manifest_path(&self.out);
        if self.json {
            return print_json(&json!({
                "recording": self.out, "manifest": manifest, "samples": samples,
                "partial": partial, "max_abs_error_counts": max, "rms_error_counts": rms,
            }));
        }
        let joints: Vec<String> =
            max.iter().zip(&rms).map(|(max, rms)| format!("max {max:.0}, rms {rms:.1}")).collect();
        print(format!(
            "{}: {samples} samples{}; tracking error in counts: {}\n{}: manifest",
            self.out.display(),
            if partial.is_some() { " (partial)" } else { "" },
            joints.join(" / "),
            manifest.display()
        ))
    }
}

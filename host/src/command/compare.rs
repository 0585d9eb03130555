//! `armid compare`.

pub mod models;
pub mod recordings;

use std::path::{Path, PathBuf};

use clap::Args;

use super::CommandError;
use super::common::{RobotArguments, read_recordings};
use super::page::{self, ReportArguments};

const WHAT_IS_COMPARED: &str =
    "Files ending in .toml are models, all others recordings. Models are compared with the first, difference by \
    difference, and, where recordings are given too, by how well each repeats them. Recordings alone are compared with \
    the first, tick by tick.

Examples:
  armid compare model.toml other.toml run.csv        models side by side, and how each repeats a recording
  armid compare slow.csv fast.csv --plot errors.svg";

/// Arguments of `compare`.
#[derive(Debug, Args)]
#[command(after_help = WHAT_IS_COMPARED)]
pub struct Compare {
    /// Models and recordings
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    robot: RobotArguments,
    /// Accept recordings with gaps
    #[arg(long)]
    allow_gaps: bool,
    /// Picture of the recordings' tracking errors, one over the other, to write as SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Compare {
    pub fn run(&self) -> Result<(), CommandError> {
        let is_model = |path: &Path| path.extension().is_some_and(|extension| extension == "toml");
        let (models, recordings): (Vec<PathBuf>, Vec<PathBuf>) =
            self.files.iter().cloned().partition(|path| is_model(path));
        let least = if models.is_empty() { recordings.len() } else { models.len() };
        if least < 2 && (models.is_empty() || recordings.is_empty()) {
            return Err(CommandError::Usage(
                "give two models, two recordings, or models with recordings to judge them by".into(),
            ));
        }
        let inputs = page::compare::inputs(&models, &recordings);
        let inputs = inputs.iter().chain(&self.robot.robot).map(PathBuf::as_path);
        self.report.check(self.plot.as_deref(), inputs)?;
        if models.is_empty() {
            let robot = self.robot.read()?;
            let read = read_recordings(&recordings, &robot, self.allow_gaps)?;
            return recordings::compare(&robot, &read, self.plot.as_deref(), self.json, &self.report);
        }
        if self.plot.is_some() {
            return Err(CommandError::Usage("--plot draws recordings; give no models with it".into()));
        }
        let robot = if recordings.is_empty() { self.robot.read()? } else { self.robot.read_for_simulation()? };
        let read = read_recordings(&recordings, &robot, self.allow_gaps)?;
        for recording in &read {
            recording.check_conditions(&robot)?;
        }
        models::compare(&robot, &models, &read, self.json, &self.report)
    }
}

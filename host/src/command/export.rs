//! `armid export`.

use std::path::{Path, PathBuf};

use armid::export::{model_json, model_urdf, recording_csv, recording_mcap};
use armid::links::ArmBounds;
use clap::{Args, ValueEnum};
use serde_json::json;

use super::CommandError;
use super::common::{RobotArguments, print, print_json, read_model, read_recordings, with_sidecars};
use super::outputs::{FileKind, check_outputs};

const EXAMPLES: &str = "Examples:
  armid export slow.csv --out slow.mcap             for Foxglove and PlotJuggler
  armid export slow.csv --out slow_si.csv           for pandas and spreadsheets, in SI units
  armid export model.toml --out arm.urdf            for simulators
  armid export model.toml --format json             to stdout";

/// Arguments of `export`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Export {
    /// Recording (for csv, mcap) or model file (for urdf, json)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    robot: RobotArguments,
    /// Format; without it, what the ending of --out says
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// File to write; without it, stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// urdf: bounds on the links, as `armid ranges` reads them; without it, what f leaves open is chosen like uniform rods
    #[arg(long, value_name = "FILE")]
    bounds: Option<PathBuf>,
    /// Accept recordings with gaps
    #[arg(long)]
    allow_gaps: bool,
    /// Print one JSON object saying what was written; needs --out
    #[arg(long, requires = "out")]
    json: bool,
}

/// What to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A recording as a table in SI units
    Csv,
    /// A recording for viewers: JSON messages on /joint_states, /tracking_errors and /drives
    Mcap,
    /// A model as bodies and joints
    Urdf,
    /// A model with its units
    Json,
}

impl Format {
    fn of_ending(path: &Path) -> Option<Self> {
        Self::from_str(path.extension()?.to_str()?, true).ok()
    }

    /// What a file of it holds.
    fn kind(self) -> FileKind {
        match self {
            Self::Csv => FileKind::SiTable,
            Self::Mcap => FileKind::Mcap,
            Self::Urdf => FileKind::Urdf,
            Self::Json => FileKind::JsonModel,
        }
    }

    fn is_of_recordings(self) -> bool {
        matches!(self, Self::Csv | Self::Mcap)
    }
}

impl Export {
    pub fn run(&self) -> Result<(), CommandError> {
        let format = self.format.or_else(|| self.out.as_deref().and_then(Format::of_ending)).ok_or_else(|| {
            CommandError::Usage("no format: give --format, or an --out that ends in .csv, .mcap, .urdf or .json".into())
        })?;
        let is_model = self.file.extension().is_some_and(|ending| ending == "toml");
        if is_model == format.is_of_recordings() {
            return Err(CommandError::Usage(format!(
                "{} is {}; recordings (.csv) become csv or mcap, models (.toml) urdf or json",
                self.file.display(),
                if is_model { "a .toml file, not a recording" } else { "not a .toml file, so no model" }
            )));
        }
        if self.bounds.is_some() && format != Format::Urdf {
            return Err(CommandError::Usage("--bounds is for the format urdf".into()));
        }
        if format == Format::Mcap && self.out.is_none() {
            return Err(CommandError::Usage("mcap is not text; give --out".into()));
        }
        let robot = self.robot.read()?;
        if let Some(out) = &self.out {
            let read = with_sidecars(std::slice::from_ref(&self.file));
            let also = [&self.robot.robot, &self.bounds].into_iter().flatten();
            check_outputs([(out.as_path(), format.kind())], read.iter().chain(also).map(PathBuf::as_path))?;
        }
        let bytes = if format.is_of_recordings() {
            let recording = read_recordings(std::slice::from_ref(&self.file), &robot, self.allow_gaps)?.remove(0);
            match format {
                Format::Mcap => {
                    recording_mcap(&recording, &robot).map_err(|error| CommandError::Failed(error.to_string()))?
                }
                _ => recording_csv(&recording, &robot).into_bytes(),
            }
        } else {
            let model = read_model(&self.file, &robot)?;
            let bounds = self.bounds.as_deref().map(|path| ArmBounds::read(path, &robot)).transpose()?;
            match format {
                Format::Urdf => model_urdf(&model, &robot, bounds.as_ref())
                    .map_err(|error| CommandError::Failed(error.to_string()))?
                    .into_bytes(),
                _ => format!("{:#}\n", model_json(&model, &robot)).into_bytes(),
            }
        };
        self.put(format, bytes)
    }

    fn put(&self, format: Format, bytes: Vec<u8>) -> Result<(), CommandError> {
        let Some(out) = &self.out else {
            return print(String::from_utf8_lossy(&bytes));
        };
        armid::write_file(out, &bytes)?;
        if self.json {
            let format = format!("{format:?}").to_lowercase();
            return print_json(&json!({"file": self.file, "out": out, "format": format, "bytes": bytes.len()}));
        }
        print(format!("{}: {} bytes", out.display(), bytes.len()))
    }
}

//! A recording: what one movement looked like, one sample a record period.

mod manifest;
mod plausible;
mod read;
mod sound;
mod write;

use std::path::{Path, PathBuf};

use shared::control::PositionLoop;

pub use manifest::{Manifest, ManifestCsv, ManifestJoint, Mode};
pub use sound::{Finding, SoundPart};

use crate::file_error::FileError;
use crate::robot::{Law, Robot};

/// The least samples a recording may have: below 35 ms at 0.7 ms nothing can be told from it.
pub const LEAST_SAMPLES: usize = 50;

/// One movement's samples, joint by joint, with its manifest.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The file it was read from, or will be written to.
    pub path: PathBuf,
    /// Record periods since the start, rising by 1 unless gaps were allowed.
    pub tick: Vec<u32>,
    /// Reference at the motor in counts: `[joint][sample]`.
    pub reference_counts: Vec<Vec<f64>>,
    /// Tracking error at the motor in counts, reference less actual.
    pub error_counts: Vec<Vec<f64>>,
    /// Current in A measured at the sample's instant, so it shows the command of the tick before.
    pub current_a: Vec<Vec<f64>>,
    /// Current commanded at this tick, in A as sent, if recorded.
    pub command_a: Option<Vec<Vec<f64>>>,
    /// A known torque added to the command after the controller, in command units, if any.
    pub added_torque: Option<Vec<Vec<f64>>>,
    /// The sidecar, if there is one.
    pub manifest: Option<Manifest>,
    /// What the reader noticed and could live with, for the user to see.
    pub notes: Vec<String>,
}

/// How strict to be in reading a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Accept missing ticks, a first tick other than 0, and a cut last line (which is left out).
    pub allow_gaps: bool,
}

impl Recording {
    /// Reads the recording at `path` of `robot`, with its sidecar if there is one.
    pub fn read(path: &Path, robot: &Robot, options: ReadOptions) -> Result<Self, FileError> {
        read::read(path, robot, options)
    }

    /// Parses a recording's bytes; `path` only names them in errors.
    pub fn from_bytes(
        path: &Path,
        bytes: &[u8],
        robot: &Robot,
        options: ReadOptions,
        manifest: Option<Manifest>,
    ) -> Result<Self, FileError> {
        read::from_bytes(path, bytes, robot, options, manifest)
    }

    /// Writes the recording to `path`, and its manifest, if any, beside it with the ending `.toml`.
    ///
    /// The manifest tells which CSV it was written with, so that whatever interrupts this leaves the old pair, the new pair,
    /// or two files that are not taken for a recording. A device or a named pipe gets the CSV alone.
    pub fn write(&self, path: &Path, robot: &Robot) -> Result<(), FileError> {
        write::write(self, path, robot)
    }

    /// The lines of its samples as they stand in the file, to be added to one that has others already.
    pub fn rows_to_csv(&self) -> String {
        write::rows(self)
    }

    /// How many samples.
    pub fn samples(&self) -> usize {
        self.tick.len()
    }

    /// Under which controller it was made: the manifest's, or P without one.
    pub fn mode(&self) -> Mode {
        self.manifest.as_ref().map_or(Mode::P, |manifest| manifest.mode)
    }

    /// The position loop each joint ran under: the manifest's gains, else the robot file's; nothing where the
    /// controller was another one.
    pub fn position_loops(&self, robot: &Robot) -> Option<Vec<PositionLoop<f64>>> {
        if self.mode() != Mode::P {
            return None;
        }
        if let Some(manifest) = self.manifest.as_ref().filter(|manifest| manifest.joint.len() == robot.joints.len()) {
            return Some(manifest.joint.iter().map(ManifestJoint::position_loop).collect());
        }
        robot
            .joints
            .iter()
            .map(|joint| match joint.law {
                Law::Proportional(position_loop) => Some(position_loop),
                Law::Cascade { .. } => None,
            })
            .collect()
    }

    /// Refuses a recording whose manifest contradicts the robot file: another controller or period, or an unstable gain.
    ///
    /// For whoever repeats the recording with the robot file's loop; `calibrate` only wants the periods.
    pub fn check_conditions(&self, robot: &Robot) -> Result<(), FileError> {
        self.manifest.as_ref().map_or(Ok(()), |manifest| manifest.check_loop(&Self::manifest_path(&self.path), robot))
    }

    /// Refuses a recording whose manifest names other periods than the robot file.
    pub fn check_periods(&self, robot: &Robot) -> Result<(), FileError> {
        self.manifest
            .as_ref()
            .map_or(Ok(()), |manifest| manifest.check_periods(&Self::manifest_path(&self.path), robot))
    }

    /// The path of the sidecar of a recording at `path`: `run.csv` has `run.toml`.
    ///
    /// Any other name gets `.toml` appended, so that `run.1` and `run.2` do not share one sidecar and a recording is
    /// never its own.
    pub fn manifest_path(path: &Path) -> PathBuf {
        if path.extension().is_some_and(|extension| extension == "csv") {
            return path.with_extension("toml");
        }
        let mut name = path.as_os_str().to_os_string();
        name.push(".toml");
        name.into()
    }
}

/// The header a robot's recordings have: the columns that must be there, and the two optional groups.
pub(crate) fn header(robot: &Robot, command: bool, added: bool) -> String {
    let mut columns = vec!["tick".to_string()];
    let mut group = |prefix: &str| columns.extend(robot.joints.iter().map(|joint| format!("{prefix}{}", joint.name)));
    group("ref");
    group("err");
    group("cur");
    if command {
        group("cmd");
    }
    if added {
        group("add");
    }
    columns.join(",")
}

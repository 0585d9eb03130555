//! The sidecar of a recording: how it was made.

use std::path::Path;

use crc::{CRC_32_ISO_HDLC, Crc};
use serde::{Deserialize, Serialize};
use shared::control::PositionLoop;

use crate::file_error::{FileError, Problem};
use crate::robot::{Law, Robot};
use crate::toml_text::TomlText;

/// Which controller ran.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// The decentralised position loop.
    P,
    /// Computed-torque control.
    Ctc,
}

impl std::fmt::Display for Mode {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            Self::P => "p",
            Self::Ctc => "ctc",
        })
    }
}

/// How a recording was made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Rows of the CSV that the manifest was written with; 0 where rows were to come, as in a journal. Only in files, first of
    /// all keys, and [`Self::csv`] last: a manifest that was cut off has one without the other, and one without both goes with
    /// any CSV.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<usize>,
    /// Which controller ran.
    pub mode: Mode,
    /// The robot's name.
    #[serde(default)]
    pub robot: String,
    /// The movement, as given on the command line.
    #[serde(default)]
    pub trajectory: String,
    /// Tool that wrote the recording, with its version.
    #[serde(default)]
    pub tool: String,
    /// Firmware that ran the movement, with its version.
    #[serde(default)]
    pub firmware: String,
    /// Time between two samples in s, if noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record_period_s: Option<f64>,
    /// Time between two ticks of the loop in s, if noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loop_period_s: Option<f64>,
    /// Seed of a simulated robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// What a board calls the model that computed torque ran with: its CRC-32, in hexadecimal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_crc: Option<String>,
    /// Rows that were lost on the way from the board and read from its memory after the movement, if noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows_read_again: Option<u32>,
    /// Why the recording ends early, where it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub partial: Option<String>,
    /// The gains in force, joint by joint.
    #[serde(default)]
    pub joint: Vec<ManifestJoint>,
    /// That CSV's contents. Only in files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub csv: Option<ManifestCsv>,
}

/// The contents of the CSV that a manifest was written with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestCsv {
    /// Their CRC-32, in hexadecimal, carriage returns left out: another system's line ends are no other contents.
    pub crc32: String,
}

impl ManifestCsv {
    /// That of a CSV's bytes.
    pub(super) fn of(csv: &[u8]) -> Self {
        let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC);
        let mut digest = crc.digest();
        csv.split(|byte| *byte == b'\r').for_each(|piece| digest.update(piece));
        Self { crc32: format!("{:08x}", digest.finalize()) }
    }
}

/// The gains of one joint's position loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestJoint {
    /// The joint's name.
    pub name: String,
    /// A per count of tracking error.
    pub position_gain_a_per_count: f64,
    /// Lead β.
    #[serde(default)]
    pub lead: f64,
}

impl ManifestJoint {
    /// The gains as a control law.
    pub fn position_loop(&self) -> PositionLoop<f64> {
        PositionLoop { gain_a_per_count: self.position_gain_a_per_count, lead: self.lead }
    }

    /// The loop that was in force: the noted one, or that of the robot `file` where the two differ by no more than a
    /// calibration does, which knows better than who set it.
    pub fn in_force(&self, file: &PositionLoop<f64>) -> PositionLoop<f64> {
        let noted = self.position_loop();
        let gain = (noted.gain_a_per_count / file.gain_a_per_count - 1.0).abs() <= CALIBRATED_GAIN_SHARE;
        let lead = (noted.lead - file.lead).abs() <= CALIBRATED_LEAD;
        if gain && lead { *file } else { noted }
    }
}

impl Manifest {
    /// Reads a sidecar.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = TomlText::read(path)?;
        let manifest: Self = text.parse()?;
        if manifest.rows.is_some() != manifest.csv.is_some() {
            let missing = if manifest.rows.is_some() { "[csv] with crc32, the manifest's end," } else { "rows" };
            return Err(text.error(
                None,
                Problem::Missing { field: missing.into() },
                "the manifest was cut off or edited: copy it again whole, or, where the recording was changed on purpose, remove \
                 both `rows` and `[csv]`",
            ));
        }
        for joint in &manifest.joint {
            for (field, value) in [("position_gain_a_per_count", joint.position_gain_a_per_count), ("lead", joint.lead)]
            {
                if !(value.is_finite() && value >= 0.0) {
                    let problem = Problem::Value {
                        field: format!("{field} of joint \"{}\"", joint.name),
                        value: value.to_string(),
                        limit: "a finite number, 0 or above".into(),
                    };
                    return Err(text.error(
                        None,
                        problem,
                        "correct the manifest, or remove it to use the robot file's gains",
                    ));
                }
            }
        }
        Ok(manifest)
    }

    /// Accepts the manifest at `path` only if it is of the robot file's joints, in their order, or names none.
    pub(super) fn check_joints(&self, path: &Path, robot: &Robot) -> Result<(), FileError> {
        let list = |names: Vec<&str>| names.join(", ");
        let noted = list(self.joint.iter().map(|joint| joint.name.as_str()).collect());
        let expected = list(robot.joints.iter().map(|joint| joint.name.as_str()).collect());
        if self.joint.is_empty() || noted == expected {
            return Ok(());
        }
        Err(FileError {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::Value {
                field: "the list of [[joint]] names".into(),
                value: noted,
                limit: format!("{expected} as in the robot file"),
            },
            remedy:
                "use the robot file the recording was made with, or remove the manifest if it is another recording's"
                    .into(),
        })
    }

    /// Accepts the manifest at `path` only if it names the robot file's periods, or none.
    pub(super) fn check_periods(&self, path: &Path, robot: &Robot) -> Result<(), FileError> {
        let periods = [
            ("record_period_s", self.record_period_s, robot.record_period_s),
            ("loop_period_s", self.loop_period_s, robot.loop_period_s),
        ];
        for (field, noted, expected) in periods {
            if let Some(noted) = noted {
                agree(path, field.into(), noted, expected, 1e-6)?;
            }
        }
        Ok(())
    }

    /// Accepts the manifest at `path` only if the recording was made with the robot file's position loop.
    pub(super) fn check_loop(&self, path: &Path, robot: &Robot) -> Result<(), FileError> {
        self.check_periods(path, robot)?;
        if self.mode != Mode::P {
            return Err(FileError {
                path: path.to_path_buf(),
                line: None,
                problem: Problem::Value { field: "mode".into(), value: self.mode.to_string(), limit: "p".into() },
                remedy: "the error does not follow from the position loop; record with --mode p".into(),
            });
        }
        // No recording comes from an unstable loop.
        let mut as_recorded = robot.clone();
        for (noted, joint) in self.joint.iter().zip(&mut as_recorded.joints) {
            if let Law::Proportional(position_loop) = &mut joint.law {
                *position_loop = noted.in_force(position_loop);
            }
        }
        as_recorded.check_gains().map_err(|error| FileError {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::Unstable { joint: error.joint, source: error.source },
            remedy: "correct the manifest, or remove it to use the robot file's gains".into(),
        })?;
        Ok(())
    }

    /// Compares the CSV of these rows and bytes at `csv_path` with the one that the manifest at `path` was written with, where
    /// it says so. Another number of rows is refused: the CSV was cut, or is of another movement; with `gaps` allowed, rows may
    /// be missing. Rows that were changed since are told in what is returned: people mend and cut their recordings.
    pub(super) fn check_csv(
        &self,
        path: &Path,
        csv_path: &Path,
        (rows, csv): (usize, &[u8]),
        gaps: bool,
    ) -> Result<Option<String>, FileError> {
        // No recording is written without a row: a manifest of none is older than the rows.
        let (Some(stated_rows @ 1..), Some(stated)) = (self.rows, &self.csv) else { return Ok(None) };
        let found = ManifestCsv::of(csv);
        if stated_rows == rows && *stated == found {
            return Ok(None);
        }
        if rows == stated_rows || gaps && rows < stated_rows {
            let manifest = path.display();
            return Ok(Some(format!(
                "these are not the rows that {manifest} was written with ({rows} of {stated_rows}): they were changed since, or \
                 are of another movement"
            )));
        }
        Err(FileError {
            path: csv_path.to_path_buf(),
            line: None,
            problem: Problem::OtherManifest { manifest: path.to_path_buf(), stated: stated_rows, found: rows },
            remedy: format!(
                "copy both again whole, or record again; where rows are missing on purpose, --allow-gaps takes what is there, as \
                 does {} without `rows` and `[csv]`",
                path.display()
            ),
        })
    }

    /// The text of the sidecar of a CSV of so many rows and these bytes.
    pub(crate) fn to_toml(&self, rows: usize, csv: &[u8]) -> Result<String, toml::ser::Error> {
        toml::to_string(&Self { rows: Some(rows), csv: Some(ManifestCsv::of(csv)), ..self.clone() })
    }
}

/// A noted gain or lead that differs from the robot file's by no more is the one that was set before a calibration.
const CALIBRATED_GAIN_SHARE: f64 = 0.01;
const CALIBRATED_LEAD: f64 = 0.05;

/// Accepts a noted value only within `tolerance` of the robot file's, as a share of it.
fn agree(path: &Path, field: String, noted: f64, expected: f64, tolerance: f64) -> Result<(), FileError> {
    if (noted - expected).abs() <= tolerance * expected.abs() {
        return Ok(());
    }
    Err(FileError {
        path: path.to_path_buf(),
        line: None,
        problem: Problem::Value { field, value: noted.to_string(), limit: format!("{expected} as in the robot file") },
        remedy: "use the robot file the recording was made with".into(),
    })
}

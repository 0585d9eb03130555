//! What can be wrong with a file: always the file, the place, the value, the limit and what to do about it.

use std::path::{Path, PathBuf};

use shared::arm::ArmError;
use shared::control::GainError;

use crate::effects::EffectError;
use crate::robot::FrictionError;

/// A file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {problem}; {remedy}", path.display(), line_suffix(*line))]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// The line, counted from 1, where the problem has one.
    pub line: Option<usize>,
    /// What is wrong.
    pub problem: Problem,
    /// What to do about it.
    pub remedy: String,
}

fn line_suffix(line: Option<usize>) -> String {
    line.map(|line| format!(":{line}")).unwrap_or_default()
}

impl FileError {
    /// The file at `path` cannot be opened or read.
    pub(crate) fn unreadable(path: &Path, source: std::io::Error) -> Self {
        Self { path: path.to_path_buf(), line: None, problem: Problem::Read(source), remedy: "check the path".into() }
    }

    /// The file at `path` cannot be written.
    pub(crate) fn unwritable(path: &Path, source: std::io::Error) -> Self {
        Self {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::Write(source),
            remedy: "check that the folder exists, is writable and has room".into(),
        }
    }

    /// Another program is writing the file at `path`.
    pub(crate) fn being_written(path: &Path) -> Self {
        Self {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::BeingWritten,
            remedy: "wait until that one has ended, or choose another name".into(),
        }
    }

    /// The contents meant for the file at `path` have no text: a fault of this tool.
    pub(crate) fn not_serializable(path: &Path, source: toml::ser::Error) -> Self {
        Self {
            remedy: "report this as a fault of armid".into(),
            ..Self::unwritable(path, std::io::Error::other(source))
        }
    }

    /// True where the fault is not in a file that was read, but in writing a result.
    pub fn is_about_output(&self) -> bool {
        matches!(self.problem, Problem::Write(_) | Problem::BeingWritten)
    }

    /// True where the file is well formed but describes something unsafe to move.
    pub fn is_unsafe(&self) -> bool {
        matches!(self.problem, Problem::Unstable { .. })
    }
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file cannot be opened or read.
    #[error("cannot be read: {0}")]
    Read(std::io::Error),
    /// The file cannot be written.
    #[error("cannot be written: {0}")]
    Write(std::io::Error),
    /// Another program is about to write the file.
    #[error("is being written by another armid")]
    BeingWritten,
    /// The file is not text in UTF-8.
    #[error("is not UTF-8 text (byte {byte})")]
    NotText {
        /// Offset of the first byte that is not UTF-8.
        byte: usize,
    },
    /// The text does not follow the format: TOML syntax, an unknown key, a key of the wrong type.
    #[error("column {column}: {message}")]
    Format {
        /// Column, counted from 1.
        column: usize,
        /// What the parser says.
        message: String,
    },
    /// A key that must be there is not.
    #[error("{field} is missing")]
    Missing {
        /// The key, with its table.
        field: String,
    },
    /// A value is outside its limits.
    #[error("{field} is {value}, but must be {limit}")]
    Value {
        /// The key or column, with its table.
        field: String,
        /// What the file says.
        value: String,
        /// What would be accepted.
        limit: String,
    },
    /// Friction that a drive can never overcome.
    #[error("{0}")]
    Friction(FrictionError),
    /// A position gain the sampled loop would not survive.
    #[error("joint {joint}: {source}")]
    Unstable {
        /// Name of the joint.
        joint: String,
        /// The gain and its limit.
        source: GainError,
    },
    /// An effect cannot be.
    #[error("[[effect]]: {0}")]
    Effect(EffectError),
    /// A model of another robot.
    #[error("is a model of the robot \"{named}\" with identity {found}, but the robot file's is {expected}")]
    OtherRobot {
        /// The name of the model's robot.
        named: String,
        /// Its identity.
        found: String,
        /// That of the robot file.
        expected: String,
    },
    /// f1..f9 cannot be an arm.
    #[error("f.value: {0}")]
    NotAnArm(ArmError),
    /// The recording's first line is not the header of the contract.
    #[error("the header is \"{found}\", but must be \"{expected}\"")]
    Header {
        /// The line found.
        found: String,
        /// The header the robot file calls for.
        expected: String,
    },
    /// A recording and a manifest that were not written together.
    #[error("does not belong to its manifest {}, which states {stated} rows; here are {found}", manifest.display())]
    OtherManifest {
        /// The manifest.
        manifest: PathBuf,
        /// Rows that it states.
        stated: usize,
        /// Rows of the recording.
        found: usize,
    },
    /// Columns or contents belong to another joint than their name says.
    #[error("the joints look swapped: {evidence}")]
    SwappedJoints {
        /// What shows it.
        evidence: String,
    },
    /// The measured current runs against the tracking error.
    #[error(
        "{current} falls when {error} rises (correlation {correlation:.2}), but under the position loop it must follow \
         it (correlation near 1)"
    )]
    CurrentAgainstError {
        /// Name of the current column.
        current: String,
        /// Name of the error column.
        error: String,
        /// Correlation of the two.
        correlation: f64,
    },
    /// A line has too many or too few columns.
    #[error("{found} columns, but the header has {expected}")]
    ColumnCount {
        /// Columns in this line.
        found: usize,
        /// Columns in the header.
        expected: usize,
    },
    /// The last line ends in the middle.
    #[error("the last line is cut off: \"{text}\"")]
    Truncated {
        /// The line.
        text: String,
    },
    /// Record periods are missing.
    #[error("tick jumps from {from} to {to}: {missing} samples are missing")]
    Gap {
        /// Tick before the gap.
        from: u32,
        /// Tick after it.
        to: u32,
        /// How many are missing.
        missing: u32,
    },
    /// Ticks repeat or run backwards.
    #[error("tick {to} follows tick {from}, but ticks must rise")]
    TickOrder {
        /// Tick of the line before.
        from: u32,
        /// Tick of this line.
        to: u32,
    },
    /// Too few samples.
    #[error("{samples} samples, but at least {least} are needed")]
    TooShort {
        /// Samples found.
        samples: usize,
        /// Samples needed.
        least: usize,
    },
}

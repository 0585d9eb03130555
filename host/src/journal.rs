//! A recording on disk while it is being made: what a program leaves that is killed in the middle of a movement.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use shared::protocol::Sample;

use crate::capture::{self, Circumstances};
use crate::client::Movement;
use crate::file_error::FileError;
use crate::recording::Recording;

/// Rows that are written at once: 70 ms of them at 0.7 ms.
const ROWS_AT_ONCE: usize = 100;

/// Why a recording that a journal left is only part of its movement.
pub const UNFINISHED: &str = "the program ended during the movement";

/// The rows that came so far, in a recording of its own beside the one that is to be. Written as they come, not all at once
/// as every other file, and removed once the recording is whole.
#[derive(Debug)]
pub struct Journal<'a> {
    path: PathBuf,
    file: fs::File,
    circumstances: Circumstances<'a>,
    waiting: Vec<Sample>,
    /// Whether it is of use once the program has ended: rows came, and are nowhere else.
    wanted: bool,
    failed: Option<FileError>,
}

impl<'a> Journal<'a> {
    /// Where the journal of a recording is: `run.unfinished.csv` of `run.csv`.
    pub fn path_of(recording: &Path) -> PathBuf {
        recording.with_extension("unfinished.csv")
    }

    /// Begins the journal of `recording`: manifest and header, both whole on disk before the first row. Missing folders are
    /// made.
    pub fn begin(recording: &Path, circumstances: Circumstances<'a>) -> Result<Self, FileError> {
        let path = Self::path_of(recording);
        let nothing = part(Vec::new(), &circumstances, &path);
        nothing.write(&path, circumstances.robot)?;
        let file = fs::File::options().append(true).open(&path);
        let file = file.map_err(|source| FileError::unwritable(&path, source))?;
        Ok(Self { path, file, circumstances, waiting: Vec::new(), wanted: false, failed: None })
    }

    /// Takes in the next row. A disk that is full does not disturb the movement; [`Self::failure`] tells of it.
    pub fn push(&mut self, sample: &Sample) {
        self.waiting.push(*sample);
        self.wanted = true;
        if self.waiting.len() >= ROWS_AT_ONCE {
            self.write_waiting();
        }
    }

    fn write_waiting(&mut self) {
        if self.failed.is_some() {
            return;
        }
        let rows = part(std::mem::take(&mut self.waiting), &self.circumstances, &self.path).rows_to_csv();
        if let Err(source) = self.file.write_all(rows.as_bytes()) {
            self.failed = Some(FileError::unwritable(&self.path, source));
        }
    }

    /// Why rows could not be written, if any could not.
    pub fn failure(&self) -> Option<&FileError> {
        self.failed.as_ref()
    }

    /// The recording itself is on disk: the journal is no longer wanted.
    pub fn remove(mut self) {
        self.wanted = false;
    }

    /// The rows in the journal that a program left of `recording`, if it left any.
    pub fn rows_left(recording: &Path) -> Option<usize> {
        // What cannot be read as text is nobody's empty journal either.
        let text = fs::read(Self::path_of(recording)).ok()?;
        let lines = text.iter().filter(|byte| **byte == b'\n').count();
        lines.checked_sub(1).filter(|rows| *rows > 0)
    }
}

impl Drop for Journal<'_> {
    fn drop(&mut self) {
        if self.wanted {
            return self.write_waiting();
        }
        // What stays of it is only untidy.
        let _ = fs::remove_file(&self.path);
        let _ = fs::remove_file(Recording::manifest_path(&self.path));
    }
}

fn part(samples: Vec<Sample>, circumstances: &Circumstances<'_>, path: &Path) -> Recording {
    let movement = Movement {
        planned_rows: 0,
        recording: None,
        streamed_rows: samples.len() as u32,
        reread_rows: 0,
        differing_rows: 0,
        partial: Some(UNFINISHED.into()),
        samples,
    };
    capture::recording(&movement, circumstances, path.to_path_buf())
}

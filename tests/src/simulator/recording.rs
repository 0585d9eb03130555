//! A recording in memory and as a file.

use std::fmt::Write as _;
use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

use super::plant::State;

/// First line of a recording of the two PUMA joints (design.md §8).
pub const HEADER: &str = "tick,ref2,ref3,err2,err3,cur2,cur3";

/// Columns of equal length, one entry per record tick. Joint "2" is entry 0 of every pair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Record periods since the start.
    pub tick: Vec<u32>,
    /// Reference in whole counts.
    pub reference_counts: [Vec<i32>; 2],
    /// Reference less actual position in whole counts.
    pub error_counts: [Vec<i32>; 2],
    /// Measured current in A at the instant of the error.
    pub current_a: [Vec<f64>; 2],
    /// Current commanded from this error in A, limited, exact. Not in the file; empty in a recording read from one.
    pub command_a: [Vec<f64>; 2],
    /// True joint angles in radians and speeds in rad/s. Not in the file; empty in a recording read from one.
    pub true_state: Vec<State>,
}

impl Recording {
    pub(super) fn with_capacity(ticks: usize) -> Self {
        Self {
            tick: Vec::with_capacity(ticks),
            reference_counts: std::array::from_fn(|_| Vec::with_capacity(ticks)),
            error_counts: std::array::from_fn(|_| Vec::with_capacity(ticks)),
            current_a: std::array::from_fn(|_| Vec::with_capacity(ticks)),
            command_a: std::array::from_fn(|_| Vec::with_capacity(ticks)),
            true_state: Vec::with_capacity(ticks),
        }
    }

    pub(super) fn push(
        &mut self,
        reference_counts: [i32; 2],
        error_counts: [i32; 2],
        current_a: [f64; 2],
        command_a: [f64; 2],
        state: &State,
    ) {
        self.tick.push(self.tick.len() as u32);
        for joint in 0..2 {
            self.reference_counts[joint].push(reference_counts[joint]);
            self.error_counts[joint].push(error_counts[joint]);
            self.current_a[joint].push(current_a[joint]);
            self.command_a[joint].push(command_a[joint]);
        }
        self.true_state.push(*state);
    }

    /// Root-mean-square difference of the errors of two recordings of the same length, per joint, in counts.
    ///
    /// # Panics
    /// If the lengths differ.
    #[must_use]
    pub fn gap_rms_counts(&self, other: &Self) -> [f64; 2] {
        std::array::from_fn(|joint| {
            let (ours, theirs) = (&self.error_counts[joint], &other.error_counts[joint]);
            assert_eq!(ours.len(), theirs.len(), "recordings of different length");
            let squares = ours.iter().zip(theirs).map(|(our, their)| f64::from(our - their).powi(2)).sum::<f64>();
            (squares / ours.len() as f64).sqrt()
        })
    }

    /// The recording in the format of design.md §8.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for (row, tick) in self.tick.iter().enumerate() {
            let [reference2, reference3] = [0, 1].map(|joint| self.reference_counts[joint][row]);
            let [error2, error3] = [0, 1].map(|joint| self.error_counts[joint][row]);
            let [current2, current3] = [0, 1].map(|joint| self.current_a[joint][row]);
            writeln!(text, "{tick},{reference2},{reference3},{error2},{error3},{current2:.4},{current3:.4}")
                .expect("writing to a string cannot fail");
        }
        text
    }

    /// Writes the recording as a file in the format of design.md §8.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_csv(&self, path: impl AsRef<Path>) -> Result<()> {
        fs::write(path, self.to_csv())
    }

    /// Reads a recording of the two PUMA joints. The true state and the commands stay empty.
    ///
    /// # Errors
    /// If the file cannot be read or is not such a recording.
    pub fn read_csv(path: impl AsRef<Path>) -> Result<Self> {
        Self::from_csv(&fs::read_to_string(path)?)
    }

    /// Reads a recording from the text of its file.
    ///
    /// # Errors
    /// If the text is not a recording of the two PUMA joints.
    pub fn from_csv(text: &str) -> Result<Self> {
        let mut lines = text.lines();
        if lines.next() != Some(HEADER) {
            return Err(invalid(1, "the header"));
        }
        let mut recording = Self::default();
        for (line, row) in (2..).zip(lines) {
            let columns: Vec<&str> = row.split(',').collect();
            let [tick, reference2, reference3, error2, error3, current2, current3] = columns[..] else {
                return Err(invalid(line, "the number of columns"));
            };
            let whole = |column: &str| column.parse::<i32>().map_err(|_| invalid(line, column));
            let amperes = |column: &str| column.parse::<f64>().map_err(|_| invalid(line, column));
            recording.tick.push(tick.parse().map_err(|_| invalid(line, tick))?);
            recording.reference_counts[0].push(whole(reference2)?);
            recording.reference_counts[1].push(whole(reference3)?);
            recording.error_counts[0].push(whole(error2)?);
            recording.error_counts[1].push(whole(error3)?);
            recording.current_a[0].push(amperes(current2)?);
            recording.current_a[1].push(amperes(current3)?);
        }
        Ok(recording)
    }
}

fn invalid(line: usize, what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, format!("recording, line {line}: cannot use {what}"))
}

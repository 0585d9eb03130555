//! Writing a recording.

use std::fmt::Write as _;
use std::path::Path;

use super::{Recording, header};
use crate::atomic;
use crate::file_error::FileError;
use crate::robot::Robot;

pub(super) fn write(recording: &Recording, path: &Path, robot: &Robot) -> Result<(), FileError> {
    let csv = to_csv(recording, robot);
    // A stream has no place beside it.
    let Some(manifest) = recording.manifest.as_ref().filter(|_| !atomic::is_stream(path)) else {
        return atomic::write(path, csv.as_bytes());
    };
    let manifest_path = Recording::manifest_path(path);
    let text = manifest.to_toml(recording.samples(), csv.as_bytes());
    let text = text.map_err(|error| FileError::not_serializable(&manifest_path, error))?;
    atomic::write_together([(manifest_path.as_path(), text.as_bytes()), (path, csv.as_bytes())])
}

/// The file's text. Numbers are written with the fewest digits that read back the same.
pub(super) fn to_csv(recording: &Recording, robot: &Robot) -> String {
    let mut text = header(robot, recording.command_a.is_some(), recording.added_torque.is_some());
    text.push('\n');
    text + &rows(recording)
}

/// The lines of the samples alone.
pub(super) fn rows(recording: &Recording) -> String {
    let mut text = String::new();
    let groups = [
        Some(&recording.reference_counts),
        Some(&recording.error_counts),
        Some(&recording.current_a),
        recording.command_a.as_ref(),
        recording.added_torque.as_ref(),
    ];
    for (sample, tick) in recording.tick.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(text, "{tick}");
        for column in groups.iter().flatten().flat_map(|group| group.iter()) {
            let _ = write!(text, ",{}", column[sample]);
        }
        text.push('\n');
    }
    text
}

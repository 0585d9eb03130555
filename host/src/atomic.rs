//! Writing files all at once: a reader sees the old file or the new one, never half of either.
//!
//! A symbolic link stays, and its target is written. What is no file but a way to somewhere else, such as a device or a named
//! pipe, is written into.

mod place;

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::file_error::FileError;
use place::{Place, PlaceError};

pub use place::{abandoned, release};

/// Writes `contents` beside `path`, then renames it into place. Missing folders are made.
pub fn write(path: &Path, contents: &[u8]) -> Result<(), FileError> {
    write_together([(path, contents)])
}

/// Writes files that belong together: all are on disk before the first takes its place, so that a full disk leaves the old
/// ones. Missing folders are made.
pub(crate) fn write_together<'a>(files: impl IntoIterator<Item = (&'a Path, &'a [u8])>) -> Result<(), FileError> {
    let mut waiting = Vec::new();
    for (path, contents) in files {
        let written = Waiting::write(path, contents).map_err(|error| unwritable(path, error))?;
        waiting.push((path, written));
    }
    waiting
        .into_iter()
        .try_for_each(|(path, written)| written.take_place().map_err(|source| FileError::unwritable(path, source)))
}

/// Makes sure that [`write()`] will be able to write `path`, before the work whose result goes there, and that until then no
/// other program writes it. Missing folders are made.
pub fn check(path: &Path) -> Result<(), FileError> {
    // A pipe that were opened now would be at its end for who reads it.
    if is_stream(path) {
        return Ok(());
    }
    let held = target(path).map_err(PlaceError::from).and_then(|file| place::hold(&file));
    held.map_err(|error| unwritable(path, error))
}

fn unwritable(path: &Path, error: PlaceError) -> FileError {
    match error {
        PlaceError::Taken => FileError::being_written(path),
        PlaceError::Io(source) => FileError::unwritable(path, source),
    }
}

/// Whether `path` is there but neither a file nor a folder: a device, a named pipe, a terminal.
pub fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Contents that are not in their place yet.
enum Waiting<'a> {
    /// Whole on disk, in the same folder as the file that they become; taken away if they do not.
    Beside { place: Place, file: PathBuf },
    /// For a stream.
    For { stream: &'a Path, contents: &'a [u8] },
}

impl<'a> Waiting<'a> {
    fn write(path: &'a Path, contents: &'a [u8]) -> Result<Self, PlaceError> {
        if is_stream(path) {
            return Ok(Self::For { stream: path, contents });
        }
        let file = target(path)?;
        let mut place = Place::of(&file)?;
        place.fill(contents)?;
        Ok(Self::Beside { place, file })
    }

    fn take_place(self) -> io::Result<()> {
        match self {
            Self::Beside { place, file } => place.become_file(&file),
            Self::For { stream, contents } => fs::File::options().write(true).open(stream)?.write_all(contents),
        }
    }
}

/// What the symbolic links at `path` lead to, there already or not.
fn target(path: &Path) -> io::Result<PathBuf> {
    /// As many as Linux follows.
    const MOST_LINKS: usize = 40;
    let mut target = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let Ok(next) = fs::read_link(&target) else { return Ok(target) };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    Err(io::Error::other("its symbolic links lead round in a circle"))
}

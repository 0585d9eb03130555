//! Writing files all at once: a reader sees the old file or the new one, never half of either.
//!
//! A symbolic link stays, and its target is written. What is no file but a way to somewhere else, such as a device or a named
//! pipe, is written into.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::file_error::FileError;

/// Writes `contents` beside `path`, then renames it into place. Missing folders are made.
pub fn write(path: &Path, contents: &[u8]) -> Result<(), FileError> {
    write_together([(path, contents)])
}

/// Writes files that belong together: all are on disk before the first takes its place, so that a full disk leaves the old
/// ones. Missing folders are made.
pub(crate) fn write_together<'a>(files: impl IntoIterator<Item = (&'a Path, &'a [u8])>) -> Result<(), FileError> {
    let mut waiting = Vec::new();
    for (path, contents) in files {
        let written = Waiting::write(path, contents).map_err(|source| FileError::unwritable(path, source))?;
        waiting.push((path, written));
    }
    waiting
        .into_iter()
        .try_for_each(|(path, written)| written.take_place().map_err(|source| FileError::unwritable(path, source)))
}

/// Makes sure that [`write()`] will be able to write `path`, before the work whose result goes there. Missing folders are
/// made.
pub fn check(path: &Path) -> Result<(), FileError> {
    // A pipe that were opened now would be at its end for who reads it.
    let checked = if is_stream(path) { Ok(()) } else { Waiting::write(path, &[]).map(drop) };
    checked.map_err(|source| FileError::unwritable(path, source))
}

/// Whether `path` is there but neither a file nor a folder: a device, a named pipe, a terminal.
pub fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Contents that are not in their place yet.
enum Waiting<'a> {
    /// Whole on disk, in the same folder as the file that they become; taken away if they do not.
    Beside { temporary: PathBuf, file: PathBuf },
    /// For a stream.
    For { stream: &'a Path, contents: &'a [u8] },
}

impl<'a> Waiting<'a> {
    fn write(path: &'a Path, contents: &'a [u8]) -> io::Result<Self> {
        if is_stream(path) {
            return Ok(Self::For { stream: path, contents });
        }
        let file = target(path)?;
        let waiting = Self::Beside { temporary: temporary(&file)?, file };
        if let Self::Beside { temporary, .. } = &waiting {
            let mut file = fs::File::create(temporary)?;
            file.write_all(contents)?;
            if !contents.is_empty() {
                file.sync_all()?;
            }
        }
        Ok(waiting)
    }

    fn take_place(self) -> io::Result<()> {
        match &self {
            Self::Beside { temporary, file } => fs::rename(temporary, file),
            Self::For { stream, contents } => fs::File::options().write(true).open(stream)?.write_all(contents),
        }
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        if let Self::Beside { temporary, .. } = self {
            // It is not there any more once it has taken its place; a leftover is only untidy.
            let _ = fs::remove_file(temporary);
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

/// Where the contents of `path` stand until they are whole; in the same folder, which is made if it is missing.
fn temporary(path: &Path) -> io::Result<PathBuf> {
    // A path that ends in a separator names a folder, whether it exists or not; the separator is lost in `file_name`.
    let names_folder = path.as_os_str().to_string_lossy().ends_with(std::path::is_separator);
    let name = path.file_name().filter(|_| !names_folder && !path.is_dir());
    let name = name.ok_or_else(|| io::Error::new(io::ErrorKind::IsADirectory, "it is a folder, not a file"))?;
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder)?;
    }
    // The process number keeps two runs that write the same file from sharing one temporary file.
    let mut temporary_name = name.to_os_string();
    temporary_name.push(format!(".{}.part", std::process::id()));
    Ok(path.with_file_name(temporary_name))
}

//! Writing a file all at once: a reader sees the old file or the new one, never half of either.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use crate::file_error::FileError;

/// Writes `contents` beside `path`, then renames it into place. Missing folders are made.
pub fn write(path: &Path, contents: &[u8]) -> Result<(), FileError> {
    let failed = |source| FileError::unwritable(path, source);
    let temporary = temporary(path).map_err(failed)?;
    let written = fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(contents).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&temporary, path));
    written.map_err(|source| {
        // The error that matters is the first one; a leftover temporary file is only untidy.
        let _ = fs::remove_file(&temporary);
        failed(source)
    })
}

/// Makes sure that [`write()`] will be able to write `path`, before the work whose result goes there. Missing folders are
/// made.
pub fn check(path: &Path) -> Result<(), FileError> {
    let failed = |source| FileError::unwritable(path, source);
    let temporary = temporary(path).map_err(failed)?;
    fs::File::create(&temporary).and_then(|_| fs::remove_file(&temporary)).map_err(failed)
}

/// Where the contents of `path` stand until they are whole; in the same folder, which is made if it is missing.
fn temporary(path: &Path) -> std::io::Result<PathBuf> {
    // A path that ends in a separator names a folder, whether it exists or not; the separator is lost in `file_name`.
    let names_folder = path.as_os_str().to_string_lossy().ends_with(std::path::is_separator);
    let name = path.file_name().filter(|_| !names_folder && !path.is_dir());
    let name =
        name.ok_or_else(|| std::io::Error::new(std::io::ErrorKind::IsADirectory, "it is a folder, not a file"))?;
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder)?;
    }
    // The process number keeps two runs that write the same file from sharing one temporary file.
    let mut temporary_name = name.to_os_string();
    temporary_name.push(format!(".{}.part", std::process::id()));
    Ok(path.with_file_name(temporary_name))
}

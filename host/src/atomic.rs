//! Writing a file all at once: a reader sees the old file or the new one, never half of either.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use crate::file_error::{FileError, Problem};

/// Writes `contents` beside `path`, then renames it into place. Missing folders are made.
pub fn write(path: &Path, contents: &[u8]) -> Result<(), FileError> {
    let failed = |source: std::io::Error| FileError {
        path: path.to_path_buf(),
        line: None,
        problem: Problem::Write(source),
        remedy: "check that the folder exists, is writable and has room".into(),
    };
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    let name = path.file_name().ok_or_else(|| failed(std::io::Error::other("the path names no file")))?;
    // The process number keeps two runs that write the same file from sharing one temporary file.
    let mut temporary_name = name.to_os_string();
    temporary_name.push(format!(".{}.part", std::process::id()));
    let temporary = path.with_file_name(temporary_name);
    let written = fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(contents).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&temporary, path));
    written.map_err(|source| {
        // The error that matters is the first one; a leftover temporary file is only untidy.
        let _ = fs::remove_file(&temporary);
        failed(source)
    })
}

//! Reading TOML so that every problem names its line and a mistyped key gets a suggestion.

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::edit_distance::nearest;
use crate::file_error::{FileError, Problem};

/// A TOML file's text, for turning offsets into lines.
pub struct TomlText<'a> {
    path: &'a Path,
    text: String,
}

impl<'a> TomlText<'a> {
    /// Reads the file at `path`.
    pub fn read(path: &'a Path) -> Result<Self, FileError> {
        let bytes = std::fs::read(path).map_err(|source| FileError::unreadable(path, source))?;
        Self::from_bytes(path, bytes)
    }

    /// Takes `bytes` for the contents of the file at `path`.
    pub fn from_bytes(path: &'a Path, bytes: Vec<u8>) -> Result<Self, FileError> {
        let text = String::from_utf8(bytes).map_err(|error| FileError {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::NotText { byte: error.utf8_error().valid_up_to() },
            remedy: "save it as UTF-8 text".into(),
        })?;
        Ok(Self { path, text })
    }

    /// Parses the text into `T`.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, FileError> {
        toml::from_str(&self.text).map_err(|error| {
            let offset = error.span().map(|span| span.start);
            let message = error.message().trim().replace('\n', " ");
            self.error(
                offset,
                Problem::Format { column: offset.map_or(1, |offset| self.column(offset)), message: message.clone() },
                remedy_for(&message),
            )
        })
    }

    /// An error at byte `offset` of the file.
    pub fn error(&self, offset: Option<usize>, problem: Problem, remedy: impl Into<String>) -> FileError {
        FileError {
            path: self.path.to_path_buf(),
            line: offset.map(|offset| self.line(offset)),
            problem,
            remedy: remedy.into(),
        }
    }

    fn before(&self, offset: usize) -> &[u8] {
        &self.text.as_bytes()[..offset.min(self.text.len())]
    }

    fn line(&self, offset: usize) -> usize {
        1 + self.before(offset).iter().filter(|byte| **byte == b'\n').count()
    }

    fn column(&self, offset: usize) -> usize {
        1 + self.before(offset).iter().rev().take_while(|byte| **byte != b'\n').count()
    }
}

/// For an unknown key, the key that was probably meant.
fn remedy_for(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field")
        && let Some(found) = quoted.next()
    {
        return match nearest(found, quoted) {
            Some(meant) => format!("did you mean `{meant}`?"),
            None => "remove the key, or check its spelling and its table".into(),
        };
    }
    if message.starts_with("missing field") { "add the key".into() } else { "correct this line".into() }
}

//! Where everything on a page comes from.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};

use super::page::Section;
use super::table::{Cell, Table};
use crate::recording::Recording;
use crate::robot::{Kind, Robot};
use crate::{board_setup, compensation, model::Model};

/// What a file was to the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileRole {
    /// It was read.
    Read,
    /// It was written.
    Written,
}

/// Where a page comes from. Nothing of it depends on when the page was made, so that the same files under the same
/// command give the same page.
#[derive(Clone, Debug, Default)]
pub struct Provenance {
    facts: Vec<(String, String)>,
    files: Vec<(FileRole, PathBuf)>,
    movements: Vec<Vec<Cell>>,
}

impl Provenance {
    /// Of a command line: the program's arguments as they were given, its own name first.
    pub fn new(command_line: impl IntoIterator<Item = String>) -> Self {
        let words: Vec<String> =
            command_line.into_iter().enumerate().map(|(place, word)| shown(place, &word)).collect();
        Self::default().fact("tool", crate::TOOL_VERSION).fact("command line", words.join(" "))
    }

    /// This with a fact more.
    pub fn fact(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.facts.push((name.into(), value.into()));
        self
    }

    /// This with the seed of everything random.
    pub fn seed(self, seed: u64) -> Self {
        self.fact("seed", seed.to_string())
    }

    /// This with a robot: its name, and what a board calls its constants.
    pub fn robot(self, robot: &Robot) -> Self {
        let named = self.fact("robot", &robot.name);
        match board_setup::configuration(robot) {
            Ok(configuration) if robot.kind == Kind::TwoLink => {
                named.fact("robot constants on a board", format!("CRC {:08x}", configuration.crc()))
            }
            _ => named,
        }
    }

    /// This with a model: what a board calls it.
    pub fn model(self, robot: &Robot, model: &Model) -> Self {
        match compensation::board_model(robot, model) {
            Ok(on_board) if robot.kind == Kind::TwoLink => {
                self.fact("model on a board", format!("CRC {:08x}", on_board.crc()))
            }
            _ => self,
        }
    }

    /// This with files; one that is not there is left out.
    pub fn files<'a>(mut self, role: FileRole, paths: impl IntoIterator<Item = &'a Path>) -> Self {
        for path in paths {
            if !self.files.iter().any(|(_, known)| known == path) {
                self.files.push((role, path.to_path_buf()));
            }
        }
        self
    }

    /// This with recordings: their files, sidecars included, and how they were made.
    pub fn recordings<'a>(mut self, role: FileRole, recordings: impl IntoIterator<Item = &'a Recording>) -> Self {
        for recording in recordings {
            let sidecar = Recording::manifest_path(&recording.path);
            self = self.files(role, [recording.path.as_path(), sidecar.as_path()]);
            let text = |text: Option<&str>| Cell::from(text.filter(|text| !text.is_empty()).unwrap_or("–"));
            let noted = recording.manifest.as_ref();
            let seed = noted.and_then(|manifest| manifest.seed).map(|seed| seed.to_string());
            let mode = noted.map(|manifest| manifest.mode.to_string());
            let path = recording.path.display().to_string();
            self.movements.push(vec![
                Cell::from(if path.is_empty() { "not kept".into() } else { path }),
                Cell::count(recording.samples()),
                text(mode.as_deref()),
                text(noted.map(|manifest| manifest.trajectory.as_str())),
                text(noted.map(|manifest| manifest.firmware.as_str())),
                text(noted.map(|manifest| manifest.tool.as_str())),
                text(seed.as_deref()),
                Cell::from(noted.and_then(|manifest| manifest.partial.clone()).unwrap_or_else(|| "whole".into())),
            ]);
        }
        self
    }

    /// The section. Files are hashed now: whatever the command writes must be written.
    pub fn section(&self) -> Section {
        let mut facts = Table::new(["", ""]);
        for (name, value) in &self.facts {
            facts = facts.row([Cell::from(name.as_str()), Cell::from(value.as_str())]);
        }
        let mut section = Section::new("Provenance").table(facts);
        if !self.movements.is_empty() {
            let headings = ["recording", "samples", "mode", "movement", "board", "written by", "seed", "complete"];
            section = section.table(Table { rows: self.movements.clone(), ..Table::new(headings) });
        }
        let mut files = Table::new(["file", "", "bytes", "SHA-256"]);
        for (role, path) in &self.files {
            let Ok((bytes, digest)) = digest(path) else { continue };
            let role = match role {
                FileRole::Read => "read",
                FileRole::Written => "written",
            };
            let path = path.display().to_string();
            files = files.row([Cell::from(path), Cell::from(role), Cell::count(bytes), Cell::Digest(digest)]);
        }
        if files.rows.is_empty() { section } else { section.table(files) }
    }
}

/// An argument as one would type it; the program's own name without its folder, which is of this machine.
fn shown(place: usize, word: &str) -> String {
    let word = if place == 0 {
        Path::new(word).file_name().map_or(word.into(), |name| name.to_string_lossy())
    } else {
        word.into()
    };
    let plain = |c: char| c.is_alphanumeric() || "-_./:=,@+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.into_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// Length in bytes and SHA-256 of a file.
fn digest(path: &Path) -> io::Result<(usize, String)> {
    if crate::is_stream(path) {
        return Err(io::Error::other("what went through it is gone"));
    }
    let mut file = File::open(path)?;
    let mut hasher = Sha256::new();
    let mut buffer = [0; 1 << 16];
    let mut bytes = 0;
    loop {
        match file.read(&mut buffer)? {
            0 => break,
            read => {
                hasher.update(&buffer[..read]);
                bytes += read;
            }
        }
    }
    Ok((bytes, hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The digest of "abc" is the example of FIPS 180-4.
    #[test]
    fn files_are_hashed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest(&path).unwrap(), (3, expected.to_string()));
    }

    #[test]
    fn a_command_line_is_shown_as_one_would_type_it() {
        let words = ["/somewhere/armid", "explain", "my file.csv", "--effect", "cogging:joint=3,order=4", "it's", ""];
        let shown: Vec<String> = words.iter().enumerate().map(|(place, word)| shown(place, word)).collect();
        assert_eq!(shown.join(" "), "armid explain 'my file.csv' --effect cogging:joint=3,order=4 'it'\\''s' ''");
    }
}

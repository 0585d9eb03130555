//! A case's files, and the truth about it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::file_error::FileError;
use crate::toml_text::TomlText;

/// One case: the files that may be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Name of its folder.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// The baseline model, if the case has one.
    pub model: Option<PathBuf>,
    /// Recordings to fit.
    pub fit: Vec<PathBuf>,
    /// Recordings kept to check.
    pub check: Vec<PathBuf>,
}

/// What was hidden in a case.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct Truth {
    /// Which kind of case.
    pub kind: Kind,
    /// How strong, in a word; empty for a null.
    #[serde(default)]
    pub tier: String,
    /// Whether torque noise was added.
    pub noisy: bool,
    /// What the hidden changes of the error, per joint, in counts rms.
    #[serde(default)]
    pub size_counts: Vec<f64>,
    /// What it changes of the command's torque, per joint, in shares of Coulomb friction, rms.
    #[serde(default)]
    pub size_of_coulomb: Vec<f64>,
    /// What was hidden.
    #[serde(default)]
    pub effect: Vec<Hidden>,
}

/// Kinds of cases.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Nothing hidden.
    Null,
    /// One effect of the library.
    Single,
    /// Two effects of the library.
    Pair,
    /// One fault that the library does not contain.
    Outside,
}

/// One hidden effect.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub struct Hidden {
    /// Its name.
    pub name: String,
    /// Its joint, or "both".
    pub joint: String,
    /// True parameters.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

impl Case {
    /// All complete cases in `folder`, in the order of their names.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn all(folder: &Path) -> std::io::Result<Vec<Self>> {
        let mut cases = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let folder = entry?.path();
            if !folder.join("truth.toml").is_file() || !folder.join("robot.toml").is_file() {
                continue;
            }
            let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)?
                .filter_map(|entry| entry.ok().map(|entry| entry.path()))
                .filter(|path| path.extension().is_some_and(|extension| extension == "csv"))
                .collect();
            files.sort();
            let called = |prefix: &str| {
                let of =
                    |path: &&PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix));
                files.iter().filter(of).cloned().collect::<Vec<_>>()
            };
            let model = Some(folder.join("model.toml")).filter(|path| path.is_file());
            let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            cases.push(Self { name, model, fit: called("fit-"), check: called("check-"), folder });
        }
        cases.sort_by(|one, other| one.name.cmp(&other.name));
        Ok(cases)
    }

    /// Its robot file.
    pub fn robot(&self) -> PathBuf {
        self.folder.join("robot.toml")
    }

    /// Opens the sealed truth. Only to be called when the verdict is there.
    ///
    /// # Errors
    /// If the file cannot be read or is no truth.
    pub fn open_truth(&self) -> Result<Truth, FileError> {
        TomlText::read(&self.folder.join("truth.toml"))?.parse()
    }
}

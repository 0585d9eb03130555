//! What a result may be written over: nothing that is read for it, and nothing of another kind.

use std::fmt;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use armid::journal::{self, Journal};
use armid::recording::Recording;

use super::CommandError;

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    Recording,
    Manifest,
    Robot,
    Model,
    Movement,
    Page,
    Picture,
    Mcap,
    SiTable,
    Urdf,
    JsonModel,
}

impl fmt::Display for FileKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Recording => "a recording",
            Self::Manifest => "a recording's manifest",
            Self::Robot => "a robot file",
            Self::Model => "a model",
            Self::Movement => "a movement",
            Self::Page => "an HTML page",
            Self::Picture => "an SVG picture",
            Self::Mcap => "an MCAP file",
            Self::SiTable => "a recording in SI units",
            Self::Urdf => "a URDF file",
            Self::JsonModel => "a model in JSON",
        })
    }
}

impl FileKind {
    /// That of the file at `path`, by what it holds; nothing where it is of none of them.
    fn of(path: &Path) -> Option<Self> {
        const BEGINNINGS: [(&str, FileKind); 6] = [
            ("tick,", FileKind::Recording),
            ("time_s,", FileKind::SiTable),
            ("<!DOCTYPE html", FileKind::Page),
            ("<svg", FileKind::Picture),
            ("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<robot", FileKind::Urdf),
            ("\u{fffd}MCAP", FileKind::Mcap),
        ];
        const KEYS: [(&str, FileKind); 5] = [
            ("mode", FileKind::Manifest),
            ("joint", FileKind::Robot),
            ("f", FileKind::Model),
            ("fourier", FileKind::Movement),
            ("points", FileKind::Movement),
        ];
        /// Longer than any file that is told by its keys.
        const LONGEST_BYTES: u64 = 1 << 20;
        // A pipe would have to be waited for.
        if !path.is_file() {
            return None;
        }
        let mut bytes = Vec::new();
        std::fs::File::open(path).and_then(|file| file.take(LONGEST_BYTES).read_to_end(&mut bytes)).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        let text = text.trim_start_matches('\u{feff}');
        if let Some((_, kind)) = BEGINNINGS.iter().find(|(beginning, _)| text.starts_with(beginning)) {
            return Some(*kind);
        }
        if text.starts_with('{') && text.contains("\"exported_by\"") {
            return Some(Self::JsonModel);
        }
        let table: toml::Table = text.parse().ok()?;
        KEYS.iter().find(|(key, _)| table.contains_key(*key)).map(|(_, kind)| *kind)
    }
}

/// Makes sure, before the work is done, that its results can be written, that none would destroy what it is made of, and
/// that each replaces only a file of its own kind.
///
/// A recording's sidecar is an input like the recording itself.
pub fn check_outputs<'a, 'b>(
    outputs: impl IntoIterator<Item = (&'b Path, FileKind)>,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), CommandError> {
    let outputs: Vec<(&Path, FileKind)> = outputs.into_iter().collect();
    check_inputs_stay(outputs.iter().map(|(output, _)| *output), inputs)?;
    for (index, (output, kind)) in outputs.iter().enumerate() {
        check_apart(output, outputs[..index].iter().map(|(other, _)| *other), "one result", "name")?;
        check_kind(output, *kind)?;
    }
    Ok(())
}

fn check_kind(output: &Path, kind: FileKind) -> Result<(), CommandError> {
    // Nothing is lost with an empty file, and nothing is replaced in a stream.
    if !std::fs::metadata(output).is_ok_and(|found| found.is_file() && found.len() > 0) {
        return Ok(());
    }
    let there = match FileKind::of(output) {
        Some(found) if found == kind => return Ok(()),
        Some(found) => found.to_string(),
        None => format!("no file that armid knows as {kind}"),
    };
    Err(CommandError::Usage(format!(
        "{} is {there} and would be overwritten by {kind}; choose another name, or move it away",
        output.display()
    )))
}

/// Refuses an output that is also one of `others`; `what` it is to hold, and the `option` to change.
pub fn check_apart<'a>(
    output: &Path,
    others: impl IntoIterator<Item = &'a Path>,
    what: &str,
    option: &str,
) -> Result<(), CommandError> {
    let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    if others.into_iter().any(|other| whole(other) == whole(output)) {
        return Err(CommandError::Usage(format!(
            "{} is to be both {what} and another result; choose another {option}",
            output.display()
        )));
    }
    Ok(())
}

fn check_inputs_stay<'a, 'b>(
    outputs: impl IntoIterator<Item = &'b Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), CommandError> {
    let whole = |path: &Path| path.canonicalize().ok();
    let inputs: Vec<PathBuf> = inputs.into_iter().filter_map(whole).collect();
    for output in outputs {
        if whole(output).is_some_and(|output| inputs.contains(&output)) {
            return Err(CommandError::Usage(format!(
                "{} is read by this command and would be overwritten by its result; choose another --out",
                output.display()
            )));
        }
        armid::check_output(output)?;
    }
    Ok(())
}

/// What may happen to a recording that is there already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It stays: it is of a movement that nobody can repeat exactly.
    Keep,
    /// It is replaced, because that was asked for.
    Replace,
}

impl Existing {
    /// What `--force` makes of it.
    pub fn with_force(force: bool) -> Self {
        if force { Self::Replace } else { Self::Keep }
    }
}

/// A recording about to be written and its sidecar, neither of which may replace a file of another kind, whatever was asked
/// for.
pub fn check_recording_outputs<'a>(
    recording: &Path,
    existing: Existing,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), CommandError> {
    if armid::is_stream(recording) {
        return Ok(());
    }
    let sidecar = Recording::manifest_path(recording);
    check_inputs_stay([recording, sidecar.as_path()], inputs)?;
    let [recording_name, sidecar_name] = [recording, &sidecar].map(Path::display);
    let refuse = |why: String| Err(CommandError::Usage(why));
    let sidecar_is_there = sidecar.exists();
    if sidecar_is_there && FileKind::of(&sidecar) != Some(FileKind::Manifest) {
        return refuse(format!(
            "{sidecar_name} exists and is no recording's manifest, but the manifest of {recording_name} would go there; \
             choose another --out"
        ));
    }
    let other = of_the_same_sidecar(recording);
    if sidecar_is_there && FileKind::of(&other) == Some(FileKind::Recording) {
        return refuse(format!(
            "{sidecar_name} is the manifest of {}, but that of {recording_name} would go there; choose another --out",
            other.display()
        ));
    }
    check_kind(recording, FileKind::Recording)?;
    if existing == Existing::Replace {
        return Ok(());
    }
    if recording.exists() {
        return refuse(format!("{recording_name} exists; choose another --out, or replace it with --force"));
    }
    if sidecar_is_there {
        return refuse(format!(
            "{sidecar_name}, a manifest, exists; choose another --out than {recording_name}, or replace it with --force"
        ));
    }
    Ok(())
}

/// The other name whose recording would have the same sidecar: `run` and `run.csv`.
fn of_the_same_sidecar(recording: &Path) -> PathBuf {
    if recording.extension().is_some_and(|extension| extension == "csv") {
        return recording.with_extension("");
    }
    let mut name = recording.as_os_str().to_os_string();
    name.push(".csv");
    name.into()
}

/// The rows of a movement that a program did not see to its end are nowhere else: nothing replaces them.
pub fn check_unfinished(recording: &Path) -> Result<(), CommandError> {
    let Some(rows) = Journal::rows_left(recording) else { return Ok(()) };
    let unfinished = Journal::path_of(recording);
    Err(CommandError::Usage(format!(
        "{} is there: {}, and these are the {rows} rows that came; move it and {} away, or delete them, which --force does \
         not (a board that was not reset since may still have the whole movement: `armid record --last`)",
        unfinished.display(),
        journal::UNFINISHED,
        Recording::manifest_path(&unfinished).display()
    )))
}

//! Reading a recording, with every problem named by file, line, column, value, limit and remedy.

use std::io;
use std::path::Path;

use super::{LEAST_SAMPLES, Manifest, ReadOptions, Recording, header, plausible};
use crate::file_error::{FileError, Problem};
use crate::robot::Robot;

/// Beyond this a count cannot be told from its neighbour in the 32-bit encoder counters, and is certainly wrong.
const LARGEST_COUNT: f64 = 2_147_483_647.0;
/// No amplifier, and no known torque in command units, comes near this.
const LARGEST_CURRENT_A: f64 = 1e6;

pub(super) fn read(path: &Path, robot: &Robot, options: ReadOptions) -> Result<Recording, FileError> {
    let bytes = std::fs::read(path).map_err(|source| FileError::unreadable(path, source))?;
    let manifest_path = Recording::manifest_path(path);
    let manifest = if is_there(&manifest_path)? { Some(Manifest::read(&manifest_path)?) } else { None };
    if let Some(manifest) = &manifest {
        manifest.check_joints(&manifest_path, robot)?;
    }
    from_bytes(path, &bytes, robot, options, manifest)
}

/// Whether there is a manifest. What stands in its place and is none is refused: the recording would go without its gains.
fn is_there(manifest: &Path) -> Result<bool, FileError> {
    let unreadable = |source: io::Error| FileError {
        remedy: "put the recording's manifest there, or move away what is there".into(),
        ..FileError::unreadable(manifest, source)
    };
    match std::fs::metadata(manifest) {
        Ok(found) if found.is_file() => Ok(true),
        Ok(_) => Err(unreadable(io::Error::other("it should be the recording's manifest, but is no file"))),
        // A link that leads nowhere is there all the same.
        Err(error) if error.kind() == io::ErrorKind::NotFound && manifest.symlink_metadata().is_err() => Ok(false),
        Err(error) => Err(unreadable(error)),
    }
}

/// Which groups of columns a header has.
struct Columns {
    joints: usize,
    names: Vec<String>,
    command: bool,
    added: bool,
}

/// Parses a recording's bytes; `path` only names them in errors.
pub(super) fn from_bytes(
    path: &Path,
    bytes: &[u8],
    robot: &Robot,
    options: ReadOptions,
    manifest: Option<Manifest>,
) -> Result<Recording, FileError> {
    let text = std::str::from_utf8(bytes).map_err(|error| FileError {
        path: path.to_path_buf(),
        line: None,
        problem: Problem::NotText { byte: error.valid_up_to() },
        remedy: "it is not a recording, or it was damaged in copying".into(),
    })?;
    // A spreadsheet's byte order mark is not part of the header.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).flexible(true).quoting(false).from_reader(text.as_bytes());
    let error = |line: u64, problem: Problem, remedy: &str| FileError {
        path: path.to_path_buf(),
        line: Some(line as usize),
        problem,
        remedy: remedy.into(),
    };

    let mut record = csv::StringRecord::new();
    let mut next = |record: &mut csv::StringRecord| -> Result<Option<u64>, FileError> {
        let more = reader.read_record(record).map_err(|source| FileError {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::Read(io::Error::other(source)),
            remedy: "the file is damaged; record again".into(),
        })?;
        Ok(more.then(|| record.position().map_or(0, |position| position.line())))
    };

    let Some(header_line) = next(&mut record)? else {
        let field = format!("the header \"{}\"", header(robot, false, false));
        return Err(error(1, Problem::Missing { field }, "the file is empty: record again, or copy it again"));
    };
    let columns = parse_header(&record, robot).map_err(|(problem, remedy)| error(header_line, problem, remedy))?;
    let joints = columns.joints;
    let empty = || vec![Vec::new(); joints];
    let mut recording = Recording {
        path: path.to_path_buf(),
        tick: Vec::new(),
        reference_counts: empty(),
        error_counts: empty(),
        current_a: empty(),
        command_a: columns.command.then(empty),
        added_torque: columns.added.then(empty),
        manifest,
        notes: Vec::new(),
    };
    let ends_cleanly = text.ends_with('\n');
    let last_line = text.trim_end_matches(['\r', '\n']).lines().count() as u64;
    let mut last_parsed_line = header_line;
    while let Some(line) = next(&mut record)? {
        last_parsed_line = line;
        let parsed = parse_line(&record, &columns, robot.quantised);
        let (tick, values) = match parsed {
            Ok(parsed) => parsed,
            Err(_) if line == last_line && !ends_cleanly => {
                if options.allow_gaps {
                    recording.notes.push(format!("line {line} is cut off and was left out"));
                    break;
                }
                let cut: String = text.lines().last().unwrap_or_default().chars().take(60).collect();
                let remedy = "copy the file again, or pass --allow-gaps to use it without its last line";
                return Err(error(line, Problem::Truncated { text: cut }, remedy));
            }
            Err((problem, remedy)) => return Err(error(line, problem, remedy)),
        };
        check_tick(recording.tick.last().copied(), tick, options)
            .map_err(|(problem, remedy)| error(line, problem, remedy))?;
        recording.tick.push(tick);
        let groups = [
            Some(&mut recording.reference_counts),
            Some(&mut recording.error_counts),
            Some(&mut recording.current_a),
            recording.command_a.as_mut(),
            recording.added_torque.as_mut(),
        ];
        for (column, value) in groups.into_iter().flatten().flatten().zip(values) {
            column.push(value);
        }
    }
    if !ends_cleanly && last_parsed_line == last_line && recording.notes.is_empty() {
        recording
            .notes
            .push(format!("line {last_line} does not end with a line break: its last number may be cut off"));
    }
    let samples = recording.samples();
    if let Some(manifest) = &mut recording.manifest {
        let doubt = manifest.check_csv(&Recording::manifest_path(path), path, (samples, bytes), options.allow_gaps)?;
        recording.notes.extend(doubt);
        (manifest.rows, manifest.csv) = (None, None);
    }
    if samples < LEAST_SAMPLES {
        return Err(FileError {
            path: path.to_path_buf(),
            line: None,
            problem: Problem::TooShort { samples, least: LEAST_SAMPLES },
            remedy: "record a whole movement".into(),
        });
    }
    let doubts = plausible::check(&recording, robot)?;
    recording.notes.extend(doubts);
    Ok(recording)
}

type Flaw = (Problem, &'static str);

fn parse_header(record: &csv::StringRecord, robot: &Robot) -> Result<Columns, Flaw> {
    let found: Vec<&str> = record.iter().map(str::trim).collect();
    for (command, added) in [(false, false), (true, false), (false, true), (true, true)] {
        let wanted = header(robot, command, added);
        if wanted.split(',').eq(found.iter().copied()) {
            return Ok(Columns {
                joints: robot.joints.len(),
                names: found.iter().map(|name| name.to_string()).collect(),
                command,
                added,
            });
        }
    }
    let with_command = found.iter().any(|name| name.starts_with("cmd"));
    let with_added = found.iter().any(|name| name.starts_with("add"));
    let expected = header(robot, with_command, with_added);
    let mut sorted_found = found.clone();
    let mut sorted_expected: Vec<&str> = expected.split(',').collect();
    sorted_found.sort_unstable();
    sorted_expected.sort_unstable();
    if sorted_found == sorted_expected {
        let evidence = format!("the header is \"{}\", but the robot file's order is \"{expected}\"", found.join(","));
        return Err((
            Problem::SwappedJoints { evidence },
            "make sure which column is which joint's, then reorder the columns or the [[joint]] tables",
        ));
    }
    // The prefixes fit but the joints are other ones: the robot file is probably another robot's.
    let prefix = |name: &&str| name.get(..3).map(str::to_string);
    let same_shape = found.iter().map(prefix).eq(expected.split(',').map(|name| prefix(&name)));
    let shown: String = found.join(",").chars().take(120).collect();
    let remedy = if same_shape {
        "the recording is of joints with other names: use the robot file it was made with"
    } else if found.first().is_some_and(|first| first.parse::<f64>().is_ok()) {
        "the file starts with numbers: put the header line back"
    } else {
        "compare it with the recording format in the manual, and with the joints of the robot file"
    };
    Err((Problem::Header { found: shown, expected }, remedy))
}

/// One line's tick and its other values, in the header's order.
fn parse_line(record: &csv::StringRecord, columns: &Columns, quantised: bool) -> Result<(u32, Vec<f64>), Flaw> {
    if record.len() != columns.names.len() {
        let problem = Problem::ColumnCount { found: record.len(), expected: columns.names.len() };
        return Err((problem, "the line is damaged; record again, or remove it and pass --allow-gaps"));
    }
    let value_problem = |index: usize, limit: &str| Problem::Value {
        field: columns.names[index].clone(),
        value: record[index].chars().take(40).collect(),
        limit: limit.into(),
    };
    let tick = record[0].trim().parse::<u32>().map_err(|_| {
        (value_problem(0, "a whole number from 0 to 4294967295"), "tick counts record periods from the start")
    })?;
    let mut values = Vec::with_capacity(record.len() - 1);
    for (index, field) in record.iter().enumerate().skip(1) {
        let is_count = index <= 2 * columns.joints;
        let value = field
            .trim()
            .parse::<f64>()
            .map_err(|_| (value_problem(index, "a number"), "the line is damaged; record again"))?;
        if !value.is_finite() {
            return Err((value_problem(index, "a finite number"), "the recorder failed here; record again"));
        }
        let largest = if is_count { LARGEST_COUNT } else { LARGEST_CURRENT_A };
        if value.abs() > largest {
            let limit = if is_count { "within ±2147483647 counts" } else { "within ±1000000" };
            return Err((value_problem(index, limit), "the line is damaged; record again"));
        }
        if is_count && quantised && value.fract() != 0.0 {
            return Err((
                value_problem(index, "a whole number of counts"),
                "if this robot's references and errors are fractional, set quantised = false in its robot file",
            ));
        }
        values.push(value);
    }
    Ok((tick, values))
}

fn check_tick(previous: Option<u32>, tick: u32, options: ReadOptions) -> Result<(), Flaw> {
    let expected = previous.map_or(Some(0), |previous| previous.checked_add(1));
    if expected == Some(tick) {
        return Ok(());
    }
    match previous {
        Some(from) if tick <= from => {
            Err((Problem::TickOrder { from, to: tick }, "two recordings may have been joined; split the file there"))
        }
        _ if options.allow_gaps => Ok(()),
        Some(from) => Err((
            Problem::Gap { from, to: tick, missing: tick - from - 1 },
            "record again, or pass --allow-gaps if the gap may be passed over",
        )),
        None => Err((
            Problem::Value { field: "tick".into(), value: tick.to_string(), limit: "0 on the first line".into() },
            "the start is missing; record again, or pass --allow-gaps",
        )),
    }
}

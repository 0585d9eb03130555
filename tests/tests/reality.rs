//! Recordings as they come from real robots: `identify` must still find every f within the limits it has on clean
//! ones, or refuse in words. Every trouble is also shown to spoil the result where nothing is done about it.

#![expect(clippy::result_large_err, reason = "only tests")]

use std::path::Path;
use std::sync::OnceLock;

use armid::identify::{Identification, IdentifyError, Options, identify};
use armid::recording::{Manifest, Mode, ReadOptions, Recording};
use armid::robot::Robot;
use armid_tests::simulator::noise::{Purpose, RandomStream, TorqueDisturbance, TorqueNoise};
use armid_tests::simulator::{self, Reference, RunSettings, record};

const PERIODS_S: [f64; 2] = [3.65, 5.0];
const SEED: u64 = 7;

fn truth() -> simulator::Robot {
    simulator::Robot::draw(SEED)
}

fn recorded(truth: &simulator::Robot, settings: RunSettings) -> Vec<simulator::Recording> {
    PERIODS_S.iter().map(|&period_s| record(truth, &Reference::Paper { period_s }, &settings)).collect()
}

/// Clean recordings of one robot, made once.
fn clean() -> Vec<simulator::Recording> {
    static CLEAN: OnceLock<Vec<simulator::Recording>> = OnceLock::new();
    CLEAN.get_or_init(|| recorded(&truth(), RunSettings { seed: SEED, ..RunSettings::default() })).clone()
}

/// With the commands as our own board records them.
fn read(recordings: &[simulator::Recording]) -> Vec<Recording> {
    let robot = Robot::paper();
    let read = |recording: &simulator::Recording| {
        let csv = recording.to_csv();
        let mut read =
            Recording::from_bytes(Path::new("run.csv"), csv.as_bytes(), &robot, ReadOptions::default(), None)
                .expect("a recording that reads back");
        read.command_a = Some(recording.command_a.to_vec());
        read
    };
    recordings.iter().map(read).collect()
}

/// Only the samples in `range`, ticks from 0.
fn part(mut recording: Recording, range: std::ops::Range<usize>) -> Recording {
    let groups = [
        Some(&mut recording.reference_counts),
        Some(&mut recording.error_counts),
        Some(&mut recording.current_a),
        recording.command_a.as_mut(),
    ];
    for column in groups.into_iter().flatten().flatten() {
        column.truncate(range.end);
        column.drain(..range.start);
    }
    recording.tick.truncate(range.len());
    recording
}

fn options() -> Options {
    Options { seed: 1, ..Options::default() }
}

fn found(recordings: &[Recording], options: &Options) -> Result<Identification, IdentifyError> {
    identify(&Robot::paper(), recordings, &[], options, &|_| ())
}

/// How far the worst f is beyond what is allowed: 0.5 % of its reference magnitude, 0.005 for f3, f5 and f8.
fn excess(found: &Identification) -> f64 {
    let (truth, reference) = (truth().arm.base_parameters().0, simulator::BaseParameters::REFERENCE.0);
    (0..9)
        .map(|index| {
            let allowed = if matches!(index, 2 | 4 | 7) { 0.005 } else { 0.005 * reference[index].abs() };
            (found.values.f[index] - truth[index]).abs() / allowed
        })
        .fold(0.0, f64::max)
}

/// With the treatment the result is right; without it, it is not. Gives what was said.
fn treated(trouble: &str, recordings: &[Recording]) -> Vec<String> {
    let found_it = found(recordings, &options()).unwrap_or_else(|error| panic!("{trouble}: {error}"));
    let untreated = found(recordings, &Options { as_recorded: true, ..options() });
    let without = untreated.map_or(f64::INFINITY, |found| excess(&found));
    let with = excess(&found_it);
    println!("{trouble}: {with:.2} of what is allowed, {without:.2} untreated; {:?}", found_it.findings);
    assert!(with < 1.0, "{trouble}: {with}");
    assert!(without > 1.0, "{trouble} does no harm: {without}");
    found_it.findings
}

fn says(findings: &[String], parts: &[&str]) {
    for part in parts {
        assert!(findings.iter().any(|finding| finding.contains(part)), "no {part:?} in {findings:?}");
    }
}

#[test]
fn clean_recordings_are_left_as_they_are() {
    let found = found(&read(&clean()), &options()).expect("an identification");
    assert!(found.findings.is_empty(), "{:?}", found.findings);
    assert!(excess(&found) < 1.0);
}

#[test]
fn corrupted_samples_are_mended() {
    let mut recordings = clean();
    let mut random = RandomStream::new(3, Purpose::Reference);
    for recording in &mut recordings {
        for joint in 0..2 {
            for _ in 0..6 {
                let row = (random.uniform() * (recording.tick.len() - 20) as f64) as usize + 10;
                recording.error_counts[joint][row] += if random.uniform() < 0.5 { -1024 } else { 300 };
                recording.reference_counts[joint][row + 7] ^= 1 << 9;
            }
        }
    }
    says(&treated("corrupted samples", &read(&recordings)), &["samples of err2", "samples of ref3"]);
}

#[test]
fn gaps_are_passed_over_when_allowed_and_refused_otherwise() {
    let (robot, whole) = (Robot::paper(), clean());
    let csv: Vec<String> = whole.iter().map(simulator::Recording::to_csv).collect();
    let missing = |line: usize| [800..830, 2100..2101, 2900..3300].iter().any(|gap| gap.contains(&line));
    let read = |csv: &String, renumbered: bool, allow_gaps: bool| {
        let mut next = 0;
        let lines = csv.lines().enumerate().filter(|&(line, _)| !missing(line)).map(|(line, text)| {
            if !renumbered || line == 0 {
                return format!("{text}\n");
            }
            next += 1;
            format!("{},{}\n", next - 1, text.split_once(',').expect("columns").1)
        });
        let text: String = lines.collect();
        Recording::from_bytes(Path::new("run.csv"), text.as_bytes(), &robot, ReadOptions { allow_gaps }, None)
    };
    let refusal = read(&csv[0], false, false).expect_err("a gap").to_string();
    assert!(refusal.contains("30 samples are missing") && refusal.contains("--allow-gaps"), "{refusal}");
    let with_gaps: Vec<Recording> = csv.iter().map(|csv| read(csv, false, true).expect("gaps allowed")).collect();
    let with = excess(&found(&with_gaps, &options()).expect("an identification"));
    // Had the ticks not told of the gaps, the arm would have seemed to jump.
    let jumping: Vec<Recording> = csv.iter().map(|csv| read(csv, true, false).expect("no gaps")).collect();
    let without = found(&jumping, &options()).map_or(f64::INFINITY, |found| excess(&found));
    println!("gaps: {with:.2} of what is allowed, {without:.2} had they been hidden");
    assert!(with < 1.0 && without > 1.0, "{with} {without}");
}

/// A sensor's bias leaves the arm alone; an amplifier's drives it. Both show the same in the current.
#[test]
fn a_current_offset_is_told_and_its_cause_found() {
    let mut of_sensor = clean();
    for recording in &mut of_sensor {
        recording.current_a[0].iter_mut().for_each(|current| *current += 0.25);
    }
    let found_it = found(&read(&of_sensor), &options()).expect("an identification");
    says(&found_it.findings, &["joint 2 shows 250 mA more"]);
    assert!(excess(&found_it) < 1.0);
    assert!(found_it.values.torque_offset_nm[0].abs() < 1e-3, "{:?}", found_it.values.torque_offset_nm);

    // A torque that never changes is an amplifier that always gives a little more.
    let noise = TorqueNoise { standard_deviation_nm: [0.05, 0.05], correlation_time_s: 1e12 };
    let offset_nm = TorqueDisturbance::new(Some(noise), SEED).next_nm(0.0);
    let settings = RunSettings { seed: SEED, torque_noise: Some(noise), ..RunSettings::default() };
    let mut of_amplifier = recorded(&truth(), settings);
    for recording in &mut of_amplifier {
        for (column, offset_nm) in recording.current_a.iter_mut().zip(offset_nm) {
            column.iter_mut().for_each(|current| *current += offset_nm / 0.25);
        }
    }
    let recordings = read(&of_amplifier);
    treated("an amplifier's offset", &recordings);
    let found_it = found(&recordings, &options()).expect("an identification");
    for (joint, offset_nm) in offset_nm.into_iter().enumerate() {
        let left = found_it.values.torque_offset_nm[joint] + offset_nm;
        assert!(left.abs() < 1e-3, "joint {joint}: {left} N m left of {offset_nm}");
    }
}

/// The first second is gone: the arm is under way at the first sample.
#[test]
fn a_recording_may_start_in_the_middle_of_the_movement() {
    let started: Vec<Recording> = read(&clean())
        .into_iter()
        .map(|recording| {
            let samples = recording.samples();
            part(recording, 900..samples)
        })
        .collect();
    let with = excess(&found(&started, &options()).expect("an identification"));
    println!("mid-motion start: {with:.2} of what is allowed");
    assert!(with < 1.0, "{with}");
}

/// The amplifier gives less than the robot file says: at the top of the movement the arm lags.
#[test]
fn stretches_at_a_limit_of_the_amplifier_are_cut() {
    let mut weak = truth();
    let peak_a = clean()[0].command_a[0].iter().fold(0.0_f64, |peak, current| peak.max(current.abs()));
    weak.drives[0].current_limit_a = 0.9 * peak_a;
    let mut recordings = recorded(&weak, RunSettings { seed: SEED, ..RunSettings::default() });
    // The board does not know: it records what it sent.
    let gain = weak.drives[0].position_gain_a_per_count;
    for recording in &mut recordings {
        recording.command_a[0] = recording.error_counts[0].iter().map(|&error| gain * f64::from(error)).collect();
    }
    says(&treated("a weak amplifier", &read(&recordings)), &["current of joint 2 does not follow its command"]);
}

/// Joint 3 runs into a stop and stands there while its reference goes on.
fn against_a_stop() -> Vec<simulator::Recording> {
    let mut recordings = clean();
    for recording in &mut recordings {
        let (from, to) = (1500, 1900);
        let position = |recording: &simulator::Recording, row: usize| {
            recording.reference_counts[1][row] - recording.error_counts[1][row]
        };
        let stop = position(recording, from);
        for row in from..to {
            recording.error_counts[1][row] = recording.reference_counts[1][row] - stop;
            let command_a = 0.048 * f64::from(recording.error_counts[1][row]);
            recording.command_a[1][row] = command_a.clamp(-12.0, 12.0);
            recording.current_a[1][row] = recording.command_a[1][row];
        }
    }
    recordings
}

#[test]
fn a_stretch_against_a_stop_is_cut() {
    says(&treated("a stop", &read(&against_a_stop())), &["joint 3 stands still against a torque"]);
}

/// The following error of joint 2 ended the movement; the brakes had it for the last tenth of a second.
#[test]
fn what_led_to_a_fault_is_cut() {
    let mut recordings = read(&clean());
    for recording in &mut recordings {
        let samples = 4000;
        *recording = part(recording.clone(), 0..samples);
        // An obstacle slows joint 2 more and more.
        for row in samples - 140..samples {
            let lag = (row + 140 - samples) as f64;
            recording.error_counts[0][row] += (0.02 * lag * lag).trunc();
            let command = &mut recording.command_a.as_mut().expect("commands")[0][row];
            *command += 0.036 * (0.02 * lag * lag).trunc();
            recording.current_a[0][row] = *command;
        }
        recording.manifest = Some(Manifest {
            rows: None,
            csv: None,
            mode: Mode::P,
            robot: String::new(),
            trajectory: String::new(),
            tool: String::new(),
            firmware: String::new(),
            record_period_s: None,
            loop_period_s: None,
            seed: None,
            model_crc: None,
            rows_read_again: None,
            partial: Some("following error of joint 2".into()),
            joint: Vec::new(),
        });
    }
    says(&treated("a fault", &recordings), &["the movement ended early (following error of joint 2)"]);
}

/// What cannot be used at all is refused with what was left out and why.
#[test]
fn a_recording_without_a_sound_stretch_is_refused() {
    let recordings: Vec<Recording> =
        read(&against_a_stop()).into_iter().take(1).map(|recording| part(recording, 1400..2100)).collect();
    let error = found(&recordings, &options()).expect_err("nothing to identify from").to_string();
    assert!(error.contains("joint 3 stands still") && error.contains("record again"), "{error}");
}

/// The encoder shows a 30 Hz oscillation of the transmission that the arm itself does not make.
#[test]
fn an_oscillation_is_filtered_from_both_signals() {
    let mut recordings = clean();
    for recording in &mut recordings {
        for joint in 0..2 {
            for row in 0..recording.tick.len() {
                let time_s = row as f64 * 0.7e-3;
                let swing = 12.0 * (std::f64::consts::TAU * 30.0 * time_s + joint as f64).sin();
                recording.error_counts[joint][row] += swing.round() as i32;
            }
        }
    }
    let recordings = read(&recordings);
    let filtered = found(&recordings, &Options { filter_hz: Some(15.0), ..options() }).expect("an identification");
    let with = excess(&filtered);
    let without = found(&recordings, &options()).map_or(f64::INFINITY, |found| excess(&found));
    println!("oscillation: {with:.2} of what is allowed, {without:.2} unfiltered");
    assert!(with < 1.0 && without > with, "{with} {without}");
}

//! Movements that end before their time, and recordings that cannot be written: what was measured is never lost.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use armid::link::{Link as _, SimulatedBoard};
use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use shared::protocol::{Decoder, Request};

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const UNREACHABLE: i32 = 4;
const UNSAFE: i32 = 5;

/// Board's time between two requests of the host, so that the pace of this machine does not matter.
const STEP: Duration = Duration::from_millis(100);
/// The same while the host is to do something that the board waits for.
const WAITING_STEP: Duration = Duration::from_micros(700);
/// Requests after which the board waits no longer.
const MOST_WAITING_REQUESTS: usize = 300;
/// How long a test waits before it fails; one that passes does not come near it.
const LONGEST_WAIT: Duration = Duration::from_secs(120);
/// What the board reports besides the requests it sees.
const ACCIDENT: &str = "accident";

/// What goes wrong once so many bytes were sent to the host.
type Accident = Box<dyn FnOnce() + Send>;

/// Serves hosts one after the other with one simulated board. When `accident_after` bytes were sent, `accident` happens,
/// and the board's time nearly stands still until the host asks for one of `awaited`. Both, and the requests seen, are
/// reported.
fn board(
    accident_after: usize,
    accident: Accident,
    awaited: fn(&Request) -> bool,
) -> (String, mpsc::Receiver<&'static str>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp:{}", listener.local_addr().unwrap());
    let (seen, requests) = mpsc::channel();
    std::thread::spawn(move || {
        let mut board = SimulatedBoard::hidden(&Robot::paper(), 1);
        let mut accident = Some(accident);
        let mut waiting = 0;
        let mut sent = 0;
        while let Ok((mut stream, _)) = listener.accept() {
            let mut buffer = [0; 512];
            let mut decoder: Decoder = Decoder::new();
            while let Ok(count @ 1..) = stream.read(&mut buffer) {
                for &byte in &buffer[..count] {
                    let Some(Ok(message)) = decoder.host_message(byte) else { continue };
                    let name = match message.request {
                        Request::Stop => "stop",
                        Request::Disarm => "disarm",
                        _ => "other",
                    };
                    // Nobody may be listening any more.
                    let _ = seen.send(name);
                    waiting = if awaited(&message.request) { 0 } else { usize::saturating_sub(waiting, 1) };
                }
                board.send(&buffer[..count]).unwrap();
                let until = board.now() + if waiting > 0 { WAITING_STEP } else { STEP };
                while board.now() < until {
                    let count = board.receive(&mut buffer, until - board.now()).unwrap();
                    if stream.write_all(&buffer[..count]).is_err() {
                        break;
                    }
                    sent += count;
                    if sent >= accident_after
                        && let Some(accident) = accident.take()
                    {
                        accident();
                        let _ = seen.send(ACCIDENT);
                        waiting = MOST_WAITING_REQUESTS;
                        break;
                    }
                }
            }
        }
    });
    (address, requests)
}

fn nothing_awaited(_: &Request) -> bool {
    true
}

fn armid(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_armid"));
    command
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .env_remove("ARMID_BOARD")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn read(path: &Path) -> Recording {
    Recording::read(path, &Robot::paper(), Default::default()).unwrap()
}

/// Starts a recording and interrupts it in the middle, and again after each of `answers` but the last; waits for its end.
/// Gives what the command printed, and the requests that the board saw after the first interrupt.
#[cfg(unix)]
fn interrupted(folder: &Path, awaited: fn(&Request) -> bool, answers: &[&'static str]) -> (Output, Vec<&'static str>) {
    ended_by("-INT", Stdio::piped(), folder, awaited, answers)
}

/// [`interrupted`] by another signal, or with another place for what is told.
#[cfg(unix)]
fn ended_by(
    signal: &str,
    stderr: Stdio,
    folder: &Path,
    awaited: fn(&Request) -> bool,
    answers: &[&'static str],
) -> (Output, Vec<&'static str>) {
    let (address, seen) = board(60_000, Box::new(|| {}), awaited);
    let command = format!("record --board {address} --pose 0,0 --settle 0.2 --out part.csv");
    let child: Child = armid(folder, &command).stderr(stderr).spawn().unwrap();
    let process_number = child.id().to_string();
    let mut requests = Vec::new();
    assert!(seen.iter().any(|name| name == ACCIDENT), "it ended before it could be interrupted");
    for answer in answers {
        assert!(Command::new("kill").args([signal, &process_number]).status().unwrap().success());
        while requests.last() != Some(answer) {
            requests.push(seen.recv_timeout(LONGEST_WAIT).unwrap_or_else(|_| panic!("no {answer} in {requests:?}")));
        }
    }
    let output = child.wait_with_output().unwrap();
    requests.extend(seen.try_iter());
    (output, requests)
}

#[test]
#[cfg(unix)]
fn ctrl_c_stops_the_arm_along_its_path_and_keeps_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let (output, requests) = interrupted(folder.path(), |request| matches!(request, Request::Stop), &["stop"]);
    let stderr = text(&output);
    assert_eq!(output.status.code(), Some(FAILED), "{stderr}");
    assert!(stderr.contains("stopping along the path") && stderr.contains("interrupted at the computer"), "{stderr}");
    let part = read(&folder.path().join("part.csv"));
    assert!((500..5000).contains(&part.samples()), "{} samples", part.samples());
    assert!(part.manifest.unwrap().partial.unwrap().contains("Ctrl-C"));
    let commands: Vec<_> = requests.iter().filter(|name| **name != "other").collect();
    assert_eq!(commands, [&"stop", &"disarm"], "stopped once, and switched off after it");
    // It stood before it was switched off: the board slows down for a while, and the host asks meanwhile.
    let at = |wanted| requests.iter().position(|name| *name == wanted).unwrap();
    assert!(at("disarm") > at("stop") + 1, "{requests:?}");
}

#[test]
#[cfg(unix)]
fn a_second_ctrl_c_switches_off_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (output, _) = interrupted(folder.path(), |request| matches!(request, Request::Disarm), &["stop", "disarm"]);
    let stderr = text(&output);
    assert_eq!(output.status.code(), Some(FAILED), "{stderr}");
    assert!(stderr.contains("switching off"), "{stderr}");
    assert!(read(&folder.path().join("part.csv")).manifest.unwrap().partial.is_some());
}

/// Whoever closed the terminal, or filled the disk of a log, still has a program that obeys.
#[test]
#[cfg(target_os = "linux")]
fn ctrl_c_switches_off_where_nobody_can_be_told() {
    let folder = tempfile::tempdir().unwrap();
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let disarm = |request: &Request| matches!(request, Request::Disarm);
    let (output, _) = ended_by("-INT", full.into(), folder.path(), disarm, &["stop", "disarm"]);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(read(&folder.path().join("part.csv")).manifest.unwrap().partial.is_some());
}

#[test]
#[cfg(unix)]
fn a_recording_says_which_signal_ended_it() {
    let stop = |request: &Request| matches!(request, Request::Stop);
    for (signal, name) in [("-TERM", "SIGTERM"), ("-HUP", "SIGHUP")] {
        let folder = tempfile::tempdir().unwrap();
        let (output, _) = ended_by(signal, Stdio::piped(), folder.path(), stop, &["stop"]);
        assert_eq!(output.status.code(), Some(FAILED), "{}", text(&output));
        let reason = read(&folder.path().join("part.csv")).manifest.unwrap().partial.unwrap();
        assert!(reason.contains(name) && !reason.contains("Ctrl-C"), "{reason}");
    }
}

#[test]
fn a_recording_that_could_not_be_written_is_read_again_from_the_board() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let lost = out.clone();
    // The folder was there when the movement began; a file in its place cannot be written into.
    let accident = Box::new(move || {
        std::fs::remove_dir_all(&lost).unwrap();
        std::fs::write(&lost, "").unwrap();
    });
    let (address, _) = board(60_000, accident, nothing_awaited);
    let record = format!("record --board {address} --settle 0.2");
    let output = armid(folder.path(), &format!("{record} --pose 0,0 --out out/run.csv")).output().unwrap();
    let stderr = text(&output);
    assert_eq!(output.status.code(), Some(FAILED), "{stderr}");
    assert!(stderr.contains("cannot be written") && stderr.contains("armid record --last"), "{stderr}");

    let again = |arguments: &str| {
        armid(folder.path(), &format!("record --board {address} --last --json {arguments}")).output().unwrap()
    };
    let output = again("--out again.csv");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let recording = read(&folder.path().join("again.csv"));
    assert_eq!(recording.samples(), 5214);
    let manifest = recording.manifest.unwrap();
    assert_eq!((manifest.partial, manifest.mode), (None, armid::recording::Mode::P));
    assert!(manifest.trajectory.contains("movement 1"), "{}", manifest.trajectory);

    // Constants of another robot would turn the codes into wrong currents.
    let mut robot = Robot::paper();
    robot.joints[0].current_full_scale_a *= 0.5;
    robot.joints[0].current_limit_a *= 0.5;
    robot.write(&folder.path().join("half.toml")).unwrap();
    let output = again("--out other.csv --robot half.toml");
    assert_eq!(output.status.code(), Some(USAGE), "{}", text(&output));
    assert!(text(&output).contains("other robot constants"), "{}", text(&output));
}

#[test]
#[cfg(unix)]
fn what_a_killed_program_recorded_is_on_disk_and_marked() {
    let folder = tempfile::tempdir().unwrap();
    let (address, seen) = board(60_000, Box::new(|| {}), nothing_awaited);
    let command = format!("record --board {address} --settle 0.2 --out run.csv");
    let mut child: Child = armid(folder.path(), &format!("{command} --pose 0,0")).spawn().unwrap();
    assert!(seen.iter().any(|name| name == ACCIDENT), "it ended before it could be killed");
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!folder.path().join("run.csv").exists());
    let left = folder.path().join("run.unfinished.csv");
    let recording = Recording::read(&left, &Robot::paper(), ReadOptions { allow_gaps: true }).unwrap();
    assert!((100..5214).contains(&recording.samples()), "{} samples", recording.samples());
    assert!(recording.manifest.as_ref().unwrap().partial.as_ref().unwrap().contains("the program ended"));

    // Its manifest is whole, and one that is not is told from it.
    let manifest = std::fs::read_to_string(left.with_extension("toml")).unwrap();
    let cut = folder.path().join("cut.toml");
    for lines in 0..manifest.lines().count() {
        let first: String = manifest.lines().take(lines).map(|line| format!("{line}\n")).collect();
        std::fs::write(&cut, first).unwrap();
        assert!(armid::recording::Manifest::read(&cut).is_err(), "cut after line {lines}");
    }

    // These rows are nowhere else: nothing writes over them but who takes them away.
    let rows = format!("{} rows", recording.samples());
    for force in ["", " --force"] {
        let output = armid(folder.path(), &format!("{command}{force}")).output().unwrap();
        assert_eq!(output.status.code(), Some(USAGE), "{}", text(&output));
        for part in ["run.unfinished.csv", "run.unfinished.toml", rows.as_str(), "--force does not"] {
            assert!(text(&output).contains(part), "no {part}: {}", text(&output));
        }
        assert!(left.exists());
    }
    for path in [left.clone(), left.with_extension("toml")] {
        std::fs::rename(&path, path.with_file_name("rescued").with_extension(path.extension().unwrap())).unwrap();
    }
    // A program that was killed before the first row left nothing that is worth keeping.
    std::fs::write(&left, "tick,ref2,ref3,err2,err3,cur2,cur3,cmd2,cmd3\n").unwrap();
    let output = armid(folder.path(), "record --board sim --settle 0.2 --out run.csv").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(read(&folder.path().join("run.csv")).samples(), 5214);
    assert!(!left.exists() && !left.with_extension("toml").exists());
}

#[test]
fn a_refused_movement_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    // Computed torque on a board without a model.
    let output = armid(folder.path(), "record --board sim --mode ctc --out run.csv").output().unwrap();
    assert_eq!(output.status.code(), Some(UNSAFE), "{}", text(&output));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// `run` and `run.csv` would both have the manifest `run.toml`.
#[test]
fn a_recording_does_not_replace_the_manifest_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let refused = |arguments: &str, parts: &[&str]| {
        let output = armid(folder.path(), arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(USAGE), "{arguments}: {}", text(&output));
        for part in parts {
            assert!(text(&output).contains(part), "{arguments}: no {part:?} in: {}", text(&output));
        }
    };
    let output = armid(folder.path(), "record --board sim --settle 0 --out run.csv").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let manifest = std::fs::read(path("run.toml")).unwrap();
    for command in ["record --board sim", "load --board sim --load-kg 1", "simulate"] {
        for force in ["", " --force"] {
            refused(&format!("{command} --out run{force}"), &["run.toml is the manifest of run.csv", "another --out"]);
        }
    }
    // Without its recording it stays just as well, until somebody says otherwise.
    std::fs::remove_file(path("run.csv")).unwrap();
    for out in ["run", "run.csv"] {
        refused(&format!("record --board sim --out {out}"), &["run.toml, a manifest, exists", "--force"]);
    }
    assert_eq!(std::fs::read(path("run.toml")).unwrap(), manifest);
    let output = armid(folder.path(), "record --board sim --settle 0 --seed 2 --out run --force").output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(read(&path("run")).manifest.unwrap().seed, Some(2));
}

#[test]
fn a_board_without_a_recording_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let output = armid(folder.path(), "record --board sim --last").output().unwrap();
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output).contains("holds no recording"), "{}", text(&output));
    assert!(!folder.path().join("recording.csv").exists());
}

#[test]
fn a_recording_is_replaced_only_when_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &str| armid(folder.path(), arguments).output().unwrap();
    std::fs::create_dir(folder.path().join("tracked")).unwrap();
    let old = "tick,ref2,ref3,err2,err3,cur2,cur3\n";
    for name in ["run.csv", "tracked/ctc.csv"] {
        std::fs::write(folder.path().join(name), old).unwrap();
    }
    for command in ["record --board sim --out run.csv", "track --board sim --out tracked"] {
        let output = run(command);
        assert_eq!(output.status.code(), Some(USAGE), "{command}: {}", text(&output));
        assert!(
            text(&output).contains("exists; choose another --out, or replace it with --force"),
            "{}",
            text(&output)
        );
    }
    for name in ["run.csv", "tracked/ctc.csv"] {
        assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), old.as_bytes(), "{name}");
        std::fs::write(folder.path().join(name), "precious").unwrap();
    }
    // What is no recording goes for nobody's asking.
    for command in ["record --board sim --out run.csv", "simulate --out run.csv", "track --board sim --out tracked"] {
        let output = run(&format!("{command} --settle 0 --force"));
        assert_eq!(output.status.code(), Some(USAGE), "{command}: {}", text(&output));
        let told = "is no file that armid knows as a recording and would be overwritten by a recording";
        assert!(text(&output).contains(told), "{command}: {}", text(&output));
    }
    for name in ["run.csv", "tracked/ctc.csv"] {
        assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"precious", "{name}");
    }
    std::fs::remove_file(folder.path().join("run.csv")).unwrap();
    for seed in [1, 2] {
        let output = run(&format!("record --board sim --seed {seed} --settle 0 --out run.csv --force"));
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    }
    let recording = read(&folder.path().join("run.csv"));
    assert_eq!((recording.samples(), recording.manifest.unwrap().seed), (5214, Some(2)));
}

#[test]
fn a_board_that_does_not_answer_in_the_middle_ends_the_movement_with_what_there_is() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp:{}", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        let mut board = SimulatedBoard::hidden(&Robot::paper(), 1);
        let (mut stream, _) = listener.accept().unwrap();
        let (mut buffer, mut sent) = ([0; 512], 0);
        // The line stays open but falls silent, as when a cable to a serial adapter breaks.
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            if sent > 60_000 {
                continue;
            }
            board.send(&buffer[..count]).unwrap();
            let until = board.now() + STEP;
            while board.now() < until && sent <= 60_000 {
                let count = board.receive(&mut buffer, until - board.now()).unwrap();
                stream.write_all(&buffer[..count]).unwrap();
                sent += count;
            }
        }
    });
    let command = format!("record --board {address} --pose 0,0 --settle 0.2 --out part.csv");
    let output = armid(folder.path(), &command).output().unwrap();
    let stderr = text(&output);
    assert_eq!(output.status.code(), Some(UNREACHABLE), "{stderr}");
    let part = read(&folder.path().join("part.csv"));
    assert!((500..5000).contains(&part.samples()), "{} samples", part.samples());
    assert!(part.manifest.unwrap().partial.unwrap().contains("no answer"));
}

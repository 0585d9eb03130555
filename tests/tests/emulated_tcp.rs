//! The commands a user types, against the real firmware image behind a TCP port.
//!
//! `tests/run emulated` names the image and the command; without them this passes without having shown anything, and
//! says so. The board's time goes on only with its host, so no result depends on how fast this machine is.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use armid_tests::emulated_board::image_and_command_from_environment;
use serde_json::Value;

/// Exit code of a command that the board's state forbids.
const REFUSED: i32 = 5;

/// The program that serves the board; ends with its owner.
struct BoardProgram {
    process: Child,
    address: String,
    /// How its debug probe is named.
    probe: String,
}

impl BoardProgram {
    fn start(firmware: &Path) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_emulated-board"))
            .args(["--port", "0", "--probe-port", "0", "--seed", "5", "--unpaced", "--firmware"])
            .arg(firmware)
            .stdout(Stdio::piped())
            .spawn()
            .expect("a program that starts");
        let stdout = process.stdout.as_mut().expect("its output");
        let mut lines = BufReader::new(stdout).lines().map(|line| line.expect("a line"));
        let [address, probe] = [(); 2].map(|()| lines.next().expect("an address"));
        Self { process, address, probe }
    }
}

impl Drop for BoardProgram {
    fn drop(&mut self) {
        // It may have ended by itself; the test fails elsewhere then.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Runs armid in a folder against the board.
struct Bench {
    firmware: PathBuf,
    command: PathBuf,
    board: BoardProgram,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Option<Self> {
        let (firmware, command) = image_and_command_from_environment()?;
        let folder = tempfile::tempdir().expect("a folder");
        Some(Self { board: BoardProgram::start(&firmware), firmware, command, folder })
    }

    fn run(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(&self.command);
        command
            .args(arguments)
            .arg("--json")
            .env("ARMID_BOARD", &self.board.address)
            .env("ARMID_PROBE", &self.board.probe)
            .current_dir(self.folder.path());
        command
    }

    /// Flashes the image that the board runs.
    fn flash(&self) -> Output {
        self.run(&["flash", self.firmware.to_str().expect("a plain path")]).output().expect("a command that starts")
    }

    /// Runs and expects success; gives what `--json` printed. No row may have been lost on the way.
    fn json(&self, arguments: &str) -> Value {
        let words: Vec<&str> = arguments.split_whitespace().collect();
        let output = self.run(&words).output().expect("a command that starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "armid {arguments}: {stderr}");
        assert!(!stderr.contains("lost on the way") && !stderr.contains("came differently"), "{arguments}: {stderr}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

#[test]
fn recorded_identified_uploaded_and_tracked_over_tcp() {
    let Some(bench) = Bench::new() else { return };

    // While one host is connected, a second is told so and let go.
    let address = bench.board.address.strip_prefix("tcp:").expect("a TCP address");
    let first = TcpStream::connect(address).expect("a connection");
    let mut told = String::new();
    let mut second = TcpStream::connect(address).expect("a connection");
    second.read_to_string(&mut told).expect("an answer");
    assert!(told.contains("another host"), "{told}");
    drop(first);

    let info = bench.json("info");
    assert_eq!(info["board"], "nucleo-f429zi");
    assert_eq!(info["mode"], "idle");

    let first = bench.json("record --pose 0,0 --settle 0.5 --out train1.csv");
    let second = bench.json("record --period 5 --settle 0.5 --out train2.csv");
    assert_eq!([&first["samples"], &second["samples"]], [5214, 7142]);
    assert!(first["partial"].is_null() && second["partial"].is_null());

    let found = bench.json("identify train1.csv train2.csv --out model.toml");
    let uploaded = bench.json("upload model.toml");
    assert_eq!(uploaded["active"]["f"], found["f"]);
    let tracked = bench.json("track --settle 0.5");
    assert_eq!([&tracked["p"]["samples"], &tracked["ctc"]["samples"]], [5214, 5214]);
    let before = numbers(&tracked["p"]["max_abs_error_counts"]);
    let after = numbers(&tracked["ctc"]["max_abs_error_counts"]);
    let within = numbers(&tracked["ctc"]["within_one_count"]);
    println!("largest error {before:?} counts under the position loop, {after:?} after; within one count {within:?} %");
    assert!(before.iter().all(|&counts| (40.0..250.0).contains(&counts)));
    assert!(within.iter().all(|&percent| percent >= 99.0));
}

#[test]
fn a_board_that_moves_is_not_flashed_and_one_that_rests_says_what_it_runs_afterwards() {
    let Some(bench) = Bench::new() else { return };
    // The program that recorded is killed in the movement; time stands still until somebody else asks for the board.
    let mut recording = bench.run(&["record", "--pose", "0,0", "--out", "moving.csv"]);
    let mut recording = recording.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a command");
    let rows = bench.folder.path().join("moving.unfinished.csv");
    while std::fs::metadata(&rows).map_or(0, |file| file.len()) < 1000 {
        assert!(recording.try_wait().expect("a command").is_none(), "it ended before it was killed");
        std::thread::sleep(Duration::from_millis(5));
    }
    recording.kill().expect("a command that runs");
    recording.wait().expect("one that ended");
    let refused = bench.flash();
    let told = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(REFUSED), "{told}");
    assert!(told.contains("the board is running"), "{told}");
    drop(bench);

    let bench = Bench::new().expect("the same image");
    let flashed = bench.flash();
    assert!(flashed.status.success(), "{}", String::from_utf8_lossy(&flashed.stderr));
    let told: Value = serde_json::from_slice(&flashed.stdout).expect("JSON");
    let info = bench.json("info");
    assert_eq!(told["address"], bench.board.address);
    for what in ["firmware_version", "git_revision"] {
        assert!(told[what].is_string() && told[what] == info[what], "{what}: {told} and {info}");
    }
}

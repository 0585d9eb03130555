//! The commands a user types, against the real firmware image behind a TCP port.
//!
//! `tests/run emulated` names the image and the command; without them this passes without having shown anything, and
//! says so. The board's time goes on only with its host, so no result depends on how fast this machine is.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use armid_tests::emulated_board::{FIRMWARE_VARIABLE, firmware_from_environment};
use serde_json::Value;

/// Names the command `armid`, which belongs to another package than this test.
const COMMAND_VARIABLE: &str = "ARMID_COMMAND";

/// The program that serves the board; ends with its owner.
struct BoardProgram {
    process: Child,
    address: String,
}

impl BoardProgram {
    fn start(firmware: &Path) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_emulated-board"))
            .args(["--port", "0", "--seed", "5", "--unpaced", "--firmware"])
            .arg(firmware)
            .stdout(Stdio::piped())
            .spawn()
            .expect("a program that starts");
        let mut address = String::new();
        let stdout = process.stdout.as_mut().expect("its output");
        BufReader::new(stdout).read_line(&mut address).expect("an address");
        Self { process, address: address.trim().into() }
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
    command: PathBuf,
    board: BoardProgram,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Option<Self> {
        let (firmware, command) = (firmware_from_environment(), std::env::var_os(COMMAND_VARIABLE));
        let (Some(firmware), Some(command)) = (firmware, command) else {
            println!("SKIPPED: {FIRMWARE_VARIABLE} or {COMMAND_VARIABLE} is not set; run `tests/run emulated`");
            return None;
        };
        let folder = tempfile::tempdir().expect("a folder");
        Some(Self { command: command.into(), board: BoardProgram::start(&firmware), folder })
    }

    /// Runs and expects success; gives what `--json` printed. No row may have been lost on the way.
    fn json(&self, arguments: &str) -> Value {
        let output = Command::new(&self.command)
            .args(arguments.split_whitespace())
            .arg("--json")
            .env("ARMID_BOARD", &self.board.address)
            .current_dir(self.folder.path())
            .output()
            .expect("a command that starts");
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

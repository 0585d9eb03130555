//! A folder to run the command in, and what may come of a run.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

pub const FAILED: i32 = 1;
pub const USAGE: i32 = 2;
pub const BAD_FILE: i32 = 3;
pub const UNREACHABLE: i32 = 4;
pub const UNSAFE: i32 = 5;

/// A folder to run in, with a robot file.
pub struct Bench(TempDir);

impl Bench {
    pub fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        armid::robot::Robot::paper().write(&bench.path("robot.toml")).unwrap();
        bench
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// The command, not run yet.
    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_armid"));
        command
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .env_remove("ARMID_BOARD")
            // Nothing is kept among the caches of whoever runs the tests.
            .env("ARMID_CACHE", "")
            .stdin(Stdio::null());
        command
    }

    /// Runs and expects success; gives stdout.
    pub fn done(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "armid {arguments}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    }

    pub fn json(&self, arguments: &str) -> Value {
        serde_json::from_str(&self.done(&format!("{arguments} --json"))).unwrap()
    }

    /// Runs and expects an exit code, and every one of `parts` on stderr and nothing on stdout.
    pub fn refused(&self, code: i32, arguments: &str, parts: &[&str]) {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "armid {arguments}: {stderr}");
        for part in parts {
            assert!(stderr.contains(part), "armid {arguments}: no {part:?} in: {stderr}");
        }
        assert!(output.stdout.is_empty(), "armid {arguments} printed a result as well");
    }

    /// A copy of `from` with `change` made to its text.
    pub fn spoil(&self, from: &str, to: &str, change: impl Fn(String) -> String) {
        let text = std::fs::read_to_string(self.path(from)).unwrap();
        let changed = change(text.clone());
        assert_ne!(text, changed, "nothing was changed");
        std::fs::write(self.path(to), changed).unwrap();
    }

    /// A recording on which bad copies are made.
    pub fn with_recording(self) -> Self {
        self.done("simulate --settle 0.5 --out run.csv --truth truth.toml");
        self
    }
}

/// Lets a script that was written be run.
#[cfg(unix)]
pub fn use_as_program(path: &std::path::Path) {
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

/// Nothing marks a program here.
#[cfg(not(unix))]
pub fn use_as_program(_path: &std::path::Path) {}

pub fn replace_line(text: &str, line: usize, new: &str) -> String {
    text.lines().enumerate().map(|(at, old)| if at + 1 == line { new } else { old }.to_string() + "\n").collect()
}

/// A manifest that goes with any rows.
pub fn without_checksum(manifest: &str) -> String {
    let lines = manifest.lines().filter(|line| !line.starts_with("rows =") && !line.starts_with("[csv]"));
    lines.filter(|line| !line.starts_with("crc32 =")).map(|line| format!("{line}\n")).collect()
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Bounds on the links of an arm, in tables of these names: upper arm and forearm.
pub fn bounds([upper, fore]: [&str; 2]) -> String {
    let link = |name: &str, mass_kg: &str| {
        format!(
            "[{name}]\nmass_kg = {mass_kg}\ncentre_x_m = [-0.5, 0.5]\ncentre_y_m = [-0.5, 0.5]\ninertia_kg_m2 = [0.01, 1]\n\
             motor_inertia_kg_m2 = [1e-5, 1e-3]\n"
        )
    };
    format!("upper_arm_m = 0.35\n{}{}", link(upper, "[1, 20]"), link(fore, "[9, 10]"))
}

//! `armid excite`, `armid compare` and the baselines of `armid identify` from the command line, as the manual shows them.

use std::path::PathBuf;
use std::process::{Command, Output};

use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use armid::trajectory_file;
use serde_json::Value;
use tempfile::TempDir;

struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, arguments: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_armid"))
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .env_remove("ARMID_BOARD")
            .output()
            .unwrap()
    }

    fn done(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "armid {arguments}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, arguments: &str) -> Value {
        serde_json::from_str(&self.done(&format!("{arguments} --json"))).unwrap()
    }

    fn refused(&self, code: i32, arguments: &str, parts: &[&str]) {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "armid {arguments}: {stderr}");
        for part in parts {
            assert!(stderr.contains(part), "armid {arguments}: no {part:?} in: {stderr}");
        }
        assert!(output.stdout.is_empty(), "armid {arguments} printed a result as well");
    }

    /// A robot file with `change` made to the paper's robot.
    fn robot(&self, name: &str, change: impl FnOnce(&mut Robot)) {
        let mut robot = Robot::paper();
        change(&mut robot);
        robot.write(&self.path(name)).unwrap();
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// An arm a tenth as large, which may not go where the paper's movement goes.
#[test]
fn a_design_for_another_arm_is_not_compared_with_what_it_cannot_do() {
    let bench = Bench::new();
    bench.done("new-robot --example direct-drive-double-pendulum --out pendulum.toml");
    let robot = std::fs::read_to_string(bench.path("pendulum.toml")).unwrap();
    let narrow =
        |line: &str| if line.starts_with("position_low_rad") { "position_low_rad = -0.3" } else { line }.to_string();
    std::fs::write(bench.path("narrow.toml"), robot.lines().map(|line| narrow(line) + "\n").collect::<String>())
        .unwrap();
    let command = "excite --robot narrow.toml --duration 3 --generations 1";
    let output = bench.run(command);
    let told = String::from_utf8(output.stdout).unwrap() + std::str::from_utf8(&output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert!(told.contains("the middle of the robot file's [search]") && !told.contains("paper"), "{told}");
    // Every line about a joint has its name.
    assert!(told.contains("joint shoulder lowest position") && !told.contains("joint 2"), "{told}");
    let design = bench.json(command);
    assert!(design["worst_ratio"].is_null() && design["paper"].is_null(), "{design}");
    let weak = robot.replacen("current_limit_a = 12.0", "current_limit_a = 0.5", 1);
    std::fs::write(bench.path("weak.toml"), weak).unwrap();
    bench.refused(5, "excite --robot weak.toml --duration 3 --generations 1", &["its limit of 0.5 A: the best needs"]);
}

/// Designed, played by the board and recorded: the board computes the series itself, from the coefficients, and its
/// references are the exact ones to the last count.
#[test]
fn a_designed_movement_is_played_exactly_and_repeats_for_a_seed() {
    let bench = Bench::new();
    let design = bench.json("excite --duration 3.65 --generations 34 --out movement.toml");
    let ratio = number(&design["worst_ratio"]);
    assert!(ratio >= 2.0, "only {ratio} times better than the paper's movement");
    for margin in design["margins"].as_array().unwrap() {
        assert!(number(&margin["left"]) >= 0.0, "{margin}");
    }
    for margin in design["loop_margins"].as_array().unwrap() {
        assert!(number(&margin["peak"]) <= 0.8 * number(&margin["limit"]), "{margin}");
    }
    // The same on one thread, to the bit.
    let again = Command::new(env!("CARGO_BIN_EXE_armid"))
        .args("excite --duration 3.65 --generations 34 --out again.toml".split(' '))
        .env("RAYON_NUM_THREADS", "1")
        .current_dir(bench.0.path())
        .output()
        .unwrap();
    assert!(again.status.success());
    let text = |name: &str| std::fs::read_to_string(bench.path(name)).unwrap();
    assert_eq!(text("movement.toml"), text("again.toml"));

    bench.done("record --board sim --trajectory movement.toml --out designed.csv");
    let robot = Robot::paper();
    let recording = Recording::read(&bench.path("designed.csv"), &robot, ReadOptions::default()).unwrap();
    let trajectory = trajectory_file::read(&bench.path("movement.toml")).unwrap();
    assert_eq!(recording.samples(), 5214);
    for joint in 0..2 {
        let counts_per_rad = robot.joints[joint].counts_per_rad();
        let mut other = 0;
        for (tick, &played) in recording.reference_counts[joint].iter().enumerate() {
            let exact = trajectory.reference::<f64>(tick as u64 * 700_000).position_rad[joint] * counts_per_rad;
            // The board computes in f32, 0.002 count off: it may fall on the other side of a whole number.
            assert!(
                played == exact.trunc() || (exact - exact.round()).abs() < 0.01,
                "tick {tick}: {played} for {exact}"
            );
            other += u32::from(played != exact.trunc());
        }
        assert!(other <= 20, "joint {joint}: {other} of {} on the other side", recording.samples());
    }
    let found = bench.json("identify designed.csv");
    assert!(found["not_identifiable"].as_array().unwrap().is_empty(), "{found}");
}

#[test]
fn limits_that_leave_no_movement_are_named() {
    let bench = Bench::new();
    bench.robot("narrow.toml", |robot| {
        robot.joints[1].limits.position_low_rad = 0.5;
        robot.joints[1].limits.position_high_rad = 0.53;
    });
    bench.refused(
        5,
        "excite --robot narrow.toml --generations 33 --duration 2",
        &["joint 3", "counts of travel", "position limit of 0.5"],
    );
    bench.robot("weak.toml", |robot| robot.joints[0].current_limit_a = 0.6);
    bench.refused(5, "excite --robot weak.toml --generations 33 --duration 2", &["joint 2", "current", "limit of 0.6"]);
    // A robot file may limit the counts per tick itself.
    bench.robot("counting.toml", |robot| robot.counts_per_tick_limit = Some(9.0));
    let design = bench.json("excite --robot counting.toml --generations 33 --duration 2");
    let peak = |joint: usize| number(&design["margins"][7 * joint + 4]["peak"]);
    assert!(peak(0).max(peak(1)) <= 9.0 && peak(0).max(peak(1)) > 7.0, "{} {}", peak(0), peak(1));
    bench.refused(2, "excite --duration 20", &["--duration is 20 s", "7.35"]);
    bench.refused(2, "excite --harmonics 9", &["--harmonics is 9", "from 1 to 8"]);
}

#[test]
fn baselines_and_models_are_compared() {
    let bench = Bench::new();
    bench.done("simulate --seed 5 --settle 0.5 --period 3.65 --out fast.csv --truth truth.toml");
    bench.done("simulate --seed 5 --settle 0.5 --period 5 --out slow.csv");
    for method in ["full", "linear", "didim"] {
        bench.done(&format!("identify fast.csv slow.csv --method {method} --out {method}.toml"));
    }
    let compared = bench.json("compare truth.toml full.toml linear.toml didim.toml fast.csv slow.csv");
    let models = compared["models"].as_array().unwrap();
    let methods: Vec<&str> = models.iter().map(|model| model["method"].as_str().unwrap()).collect();
    assert_eq!(methods, ["", "full", "linear", "didim"]);
    // Largest error of f1..f9 as a share of what is allowed of `full`, and in standard errors.
    let parameters = |index: usize| models[index]["parameters"].as_array().unwrap()[..9].to_vec();
    let excess = |index: usize| {
        let allowed = [1.647, 1.070, 1.0, 0.958, 1.0, 2.219, 5.609, 1.0, 4.875].map(|magnitude| 0.005 * magnitude);
        let share = |(allowed, p): (&f64, &Value)| number(&p["difference"]).abs() / allowed;
        allowed.iter().zip(&parameters(index)).map(share).fold(0.0, f64::max)
    };
    let in_standard_errors = |index: usize| {
        let ratio = |p: &Value| number(&p["difference"]).abs() / number(&p["standard_error"]);
        parameters(index).iter().map(ratio).fold(0.0, f64::max)
    };
    let [full, linear, didim] = [1, 2, 3].map(excess);
    println!("largest error as a share of what is allowed: full {full:.3}, linear {linear:.3}, didim {didim:.3}");
    assert!(full < 0.5, "{full}");
    // The torque equations know far less from the same recordings, and say so.
    assert!(full < 0.1 * linear && full < 0.1 * didim);
    for (index, method) in methods.iter().enumerate().skip(1) {
        assert!(in_standard_errors(index) < 4.5, "{} of {method}", in_standard_errors(index));
    }
    let gap = |model: &Value| number(&model["gap"]["innovation_rms_counts"][0]);
    assert!(gap(&models[1]) < 0.31 && gap(&models[1]) <= gap(&models[2]), "{}", gap(&models[1]));
    let table = bench.done("compare full.toml linear.toml fast.csv");
    assert!(table.contains("closed-loop gap") && table.contains("in standard errors of the difference"), "{table}");

    bench.done("simulate --seed 6 --settle 0.5 --period 3.65 --out other.csv");
    let differences = bench.json("compare fast.csv fast.csv other.csv --plot errors.svg");
    let of = |index: usize, key: &str| number(&differences["differences"][index]["joints"][0][key]);
    assert_eq!(of(0, "error_max_counts"), 0.0);
    assert!(of(1, "error_max_counts") > 1.0 && of(1, "error_rms_counts") < of(1, "error_max_counts"));
    assert_eq!(of(1, "reference_max_counts"), 0.0);
    let svg = std::fs::read_to_string(bench.path("errors.svg")).unwrap();
    assert!(svg.contains("joint 3") && svg.contains("other.csv"));
    bench.refused(2, "compare fast.csv", &["two models, two recordings"]);
    bench.refused(2, "compare fast.csv other.csv --plot fast.csv", &["would be overwritten"]);
}

/// A filter belongs to a method that has one.
#[test]
fn a_filter_that_cannot_be_is_refused() {
    let bench = Bench::new();
    bench.done("simulate --settle 0.5 --out run.csv");
    bench.refused(2, "identify run.csv --method paper --filter 15", &["another --method"]);
    bench.refused(2, "identify run.csv --filter 0.5", &["--filter is 0.5 Hz", "from 2 to 714"]);
    let found = bench.json("identify run.csv --filter 20");
    assert!(found["not_identifiable"].as_array().unwrap().is_empty());
}

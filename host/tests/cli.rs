//! The command line: results, messages and exit codes, one bad input at a time.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use armid::link::{Link as _, SimulatedBoard};
use serde_json::Value;
use tempfile::TempDir;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const BAD_FILE: i32 = 3;
const UNREACHABLE: i32 = 4;
const UNSAFE: i32 = 5;

/// A folder to run in, with a robot file.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        armid::robot::Robot::paper().write(&bench.path("robot.toml")).unwrap();
        bench
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

    /// Runs and expects success; gives stdout.
    fn done(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "armid {arguments}: {stderr}");
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, arguments: &str) -> Value {
        serde_json::from_str(&self.done(&format!("{arguments} --json"))).unwrap()
    }

    /// Runs and expects an exit code, and every one of `parts` on stderr and nothing on stdout.
    fn refused(&self, code: i32, arguments: &str, parts: &[&str]) {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "armid {arguments}: {stderr}");
        for part in parts {
            assert!(stderr.contains(part), "armid {arguments}: no {part:?} in: {stderr}");
        }
        assert!(output.stdout.is_empty(), "armid {arguments} printed a result as well");
    }

    /// A copy of `from` with `change` made to its text.
    fn spoil(&self, from: &str, to: &str, change: impl Fn(String) -> String) {
        let text = std::fs::read_to_string(self.path(from)).unwrap();
        let changed = change(text.clone());
        assert_ne!(text, changed, "nothing was changed");
        std::fs::write(self.path(to), changed).unwrap();
    }

    /// A recording on which bad copies are made.
    fn with_recording(self) -> Self {
        self.done("simulate --settle 0.5 --out run.csv --truth truth.toml");
        self
    }
}

fn replace_line(text: &str, line: usize, new: &str) -> String {
    text.lines().enumerate().map(|(at, old)| if at + 1 == line { new } else { old }.to_string() + "\n").collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn help_documents_the_exit_codes() {
    let bench = Bench::new();
    let help = bench.done("--help");
    let codes =
        ["0  done", "1  failed", "2  wrong usage", "3  bad input file", "4  board unreachable", "5  refused as unsafe"];
    assert!(codes.iter().all(|code| help.contains(code)), "{help}");
    for command in ["demo", "info", "monitor", "record", "calibrate", "identify", "upload", "track", "simulate"] {
        assert!(help.contains(command));
        bench.done(&format!("{command} --help"));
    }
    assert!(bench.done("--version").starts_with("armid "));
}

#[test]
fn wrong_usage_is_code_2() {
    let bench = Bench::new();
    bench.refused(USAGE, "", &["Usage"]);
    bench.refused(USAGE, "dance", &["dance"]);
    bench.refused(USAGE, "identify", &["RECORDING"]);
    bench.refused(USAGE, "upload --board sim", &["MODEL"]);
    bench.refused(USAGE, "upload model.toml --forget --board sim", &["--forget"]);
    bench.refused(USAGE, "info --board somewhere", &["somewhere", "usb:SERIAL", "tcp:HOST:PORT"]);
    bench.refused(USAGE, "record --board sim --pose north", &["two joint angles"]);
    bench.refused(USAGE, "record --board sim --period -1", &["--period -1"]);
    bench.refused(USAGE, "record --board sim --settle 1e9", &["--settle", "60 s"]);
}

#[test]
fn an_unreachable_board_is_code_4() {
    let bench = Bench::new();
    for arguments in ["info", "info --board usb", "track", "record", "upload truth.toml"] {
        if arguments.starts_with("upload") {
            bench.done("simulate --settle 0 --out x.csv --truth truth.toml");
        }
        bench.refused(UNREACHABLE, arguments, &["no board was found on USB", "--board sim"]);
    }
    // No board has this number, whatever is connected to this machine.
    bench.refused(UNREACHABLE, "info --board usb:NO-SUCH-BOARD", &["serial number NO-SUCH-BOARD"]);
    bench.refused(UNREACHABLE, "info --board serial:/nowhere/tty", &["serial:/nowhere/tty", "check the path"]);
    // Port 1 of the local machine: nobody listens there, and the answer comes at once.
    bench.refused(UNREACHABLE, "info --board tcp:127.0.0.1:1", &["tcp:127.0.0.1:1", "emulator"]);
}

#[test]
fn bad_recordings_are_code_3_and_named_by_line() {
    let bench = Bench::new().with_recording();
    let spoil = |change: &dyn Fn(String) -> String| bench.spoil("run.csv", "bad.csv", change);
    let refused = |parts: &[&str]| {
        for command in ["identify", "calibrate"] {
            bench.refused(BAD_FILE, &format!("{command} bad.csv --robot robot.toml"), parts);
        }
    };
    spoil(&|text| replace_line(&text, 10, "8,1,2,3"));
    refused(&["bad.csv:10", "4 columns", "9"]);
    spoil(&|text| replace_line(&text, 10, "8,1,2,NaN,4,5,6,7,8"));
    refused(&["bad.csv:10", "err2", "NaN", "finite number"]);
    spoil(&|text| replace_line(&text, 10, "8,1,2,3,x,5,6,7,8"));
    refused(&["bad.csv:10", "err3", "x", "a number"]);
    spoil(&|text| replace_line(&text, 10, "9,1,2,3,4,5,6,7,8"));
    refused(&["bad.csv:10", "tick jumps from 7 to 9", "--allow-gaps"]);
    spoil(&|text| text[..text.len() - 30].to_string());
    refused(&["bad.csv:5215", "cut off", "copy the file again"]);
    spoil(&|text| replace_line(&text, 1, "tick,ref3,ref2,err3,err2,cur3,cur2,cmd3,cmd2"));
    refused(&["bad.csv:1", "swapped"]);
    spoil(&|text| text.lines().take(20).map(|line| format!("{line}\n")).collect());
    refused(&["bad.csv", "19 samples", "at least 50"]);
    bench.refused(BAD_FILE, "identify missing.csv", &["missing.csv", "cannot be read"]);
    bench.spoil("run.toml", "bad.toml", |text| {
        text.replace("position_gain_a_per_count = 0.036", "position_gain_a_per_count = nan")
    });
    spoil(&|text| text + "\n");
    refused(&["bad.toml", "position_gain_a_per_count", "NaN"]);
}

#[test]
fn swapped_joints_are_found_by_their_gains() {
    let bench = Bench::new().with_recording();
    bench.spoil("run.csv", "bad.csv", |text| {
        let mut lines = text.lines();
        let header = lines.next().unwrap().to_string() + "\n";
        let exchange = |line: &str| {
            let f: Vec<&str> = line.split(',').collect();
            [f[0], f[2], f[1], f[4], f[3], f[6], f[5], f[8], f[7]].join(",") + "\n"
        };
        header + &lines.map(exchange).collect::<String>()
    });
    bench.refused(BAD_FILE, "identify bad.csv", &["bad.csv", "joints look swapped", "A/count"]);
}

#[test]
fn recordings_of_another_loop_are_not_repeated_with_this_one() {
    let bench = Bench::new().with_recording();
    bench.spoil("robot.toml", "other.toml", |text| text.replace("_count = 0.036", "_count = 0.03"));
    // Gains may differ from recording to recording; each is repeated with those of its manifest, if they are stable.
    let with = |robot: &str| bench.json(&format!("identify run.csv --robot {robot}"))["f"].clone();
    assert_eq!(with("other.toml"), with("robot.toml"));
    bench.spoil("run.csv", "wild.csv", str::to_string);
    bench.spoil("run.toml", "wild.toml", |text| text.replace("_count = 0.036", "_count = 0.36"));
    bench.refused(BAD_FILE, "identify wild.csv", &["wild.toml", "stability limit", "correct the manifest"]);
    bench.spoil("robot.toml", "fast.toml", |text| text.replace("loop_period_s = 0.0007", "loop_period_s = 0.00035"));
    for command in ["identify", "calibrate"] {
        bench.refused(
            BAD_FILE,
            &format!("{command} run.csv --robot fast.toml"),
            &["loop_period_s is 0.0007", "0.00035"],
        );
    }
    bench.done("simulate --mode ctc --settle 0.5 --out ctc.csv");
    bench.refused(BAD_FILE, "identify ctc.csv", &["ctc.toml", "mode is ctc", "must be p", "--mode p"]);
}

#[test]
fn bad_robot_files_are_code_3() {
    let bench = Bench::new().with_recording();
    let refused = |from: &str, to: &str, parts: &[&str]| {
        bench.spoil("robot.toml", "bad.toml", |text| text.replacen(from, to, 1));
        for command in ["identify run.csv", "calibrate run.csv", "record --board sim", "simulate", "info --board sim"] {
            bench.refused(BAD_FILE, &format!("{command} --robot bad.toml"), parts);
        }
    };
    refused(
        "gear_ratio = 107.8",
        "gear_ratio = 0",
        &["bad.toml:11", "gear_ratio", "is 0", "other than 0", "motor turns"],
    );
    refused("counts_per_rev = 800", "counts_per_rev = -800", &["bad.toml:12", "counts_per_rev", "-800", "above 0"]);
    refused("gear_ratio", "gear_ration", &["bad.toml:11", "gear_ration", "did you mean `gear_ratio`"]);
    refused("[[joint]]", "[[joint", &["bad.toml:9"]);
}

#[test]
fn gains_above_the_stability_limit_never_move_anything() {
    let bench = Bench::new().with_recording();
    bench.done("simulate --settle 0 --out x.csv --truth model.toml");
    bench.spoil("robot.toml", "stiff.toml", |text| text.replace("_count = 0.036", "_count = 0.384"));
    let parts = ["joint 2", "0.09600 N m/count", "stability limit 0.016", "lower the gain"];
    for command in ["record --board sim", "track --board sim", "simulate", "upload model.toml --board sim"] {
        bench.refused(UNSAFE, &format!("{command} --robot stiff.toml"), &parts);
        bench.refused(UNSAFE, &format!("{command} --robot stiff.toml"), &["stiff.toml:14", "nothing was moved"]);
    }
    // A recording of an unstable loop does not exist: the robot file is wrong.
    bench.refused(BAD_FILE, "identify run.csv --robot stiff.toml", &parts);
    // The same gain in a loop of 50 µs is what the paper's hardware card ran.
    bench.spoil("stiff.toml", "card.toml", |text| text.replace("loop_period_s = 0.0007", "loop_period_s = 0.00005"));
    bench.done("simulate --robot card.toml --settle 0.2 --out with-card.csv");
}

#[test]
fn bad_models_are_code_3() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out x.csv --truth model.toml");
    bench.spoil("model.toml", "bad.toml", |text| {
        let start = text.find("value = [").unwrap();
        let end = start + text[start..].find(']').unwrap();
        text[..start].to_string() + "value = [1.6, 1.07, 0.0, -0.96, 0.0, -2.2, 1.9, -0.1, 4.9" + &text[end..]
    });
    for command in ["upload", "track --model", "record --model"] {
        bench.refused(
            BAD_FILE,
            &format!("{command} bad.toml --board sim"),
            &["bad.toml:2", "not positive definite", "det D", "above 0", "identify the arm again"],
        );
    }
}

#[test]
fn movements_beyond_the_limits_are_refused() {
    let bench = Bench::new();
    bench.refused(UNSAFE, "record --board sim --period 1.0", &["not started", "speed", "4.9", "limit of 2.7"]);
    std::fs::write(
        bench.path("far.toml"),
        "[points]\ninterval_s = 5.0\npoints_rad = [[0.0, 0.0], [3.0, 0.0], [0.0, 0.0]]\n",
    )
    .unwrap();
    bench.refused(UNSAFE, "record --board sim --trajectory far.toml", &["highest position", "3.0", "limit of 0.35"]);
    bench.refused(BAD_FILE, "record --board sim --trajectory robot.toml", &["robot.toml:", "unknown field"]);
}

#[test]
fn record_writes_recording_and_manifest_and_prints_the_margins() {
    let bench = Bench::new();
    let output = bench.run("record --board sim --seed 9 --settle 0.5 --period 5 --out deep/run.csv");
    assert_eq!(output.status.code(), Some(0));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("joint 2 speed") && stderr.contains("left"), "{stderr}");
    let robot = armid::robot::Robot::paper();
    let recording = armid::recording::Recording::read(&bench.path("deep/run.csv"), &robot, Default::default()).unwrap();
    assert_eq!(recording.samples(), 7142);
    assert!(recording.command_a.is_some());
    let manifest = recording.manifest.unwrap();
    assert_eq!(manifest.trajectory, "paper, T = 5 s");
    assert_eq!(manifest.seed, Some(9));
    assert_eq!(manifest.joint[1].position_gain_a_per_count, 0.048);
    assert_eq!(manifest.partial, None);
}

/// Serves one host with a simulated board, and goes away after having sent `bytes`. Half a second of virtual time
/// passes with every request, so how fast the machine is does not matter.
fn board_that_goes_away_after(bytes: usize) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        let mut board = SimulatedBoard::hidden(&armid::robot::Robot::paper(), 1);
        let (mut stream, _) = listener.accept().unwrap();
        let (mut buffer, mut sent) = ([0; 512], 0);
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            board.send(&buffer[..count]).unwrap();
            let until = board.now() + Duration::from_millis(500);
            while board.now() < until && sent < bytes {
                let count = board.receive(&mut buffer, until - board.now()).unwrap();
                stream.write_all(&buffer[..count]).unwrap();
                sent += count;
            }
            if sent >= bytes {
                return;
            }
        }
    });
    address
}

#[test]
fn what_was_recorded_before_the_board_went_away_is_kept_and_marked() {
    let bench = Bench::new();
    let address = board_that_goes_away_after(60_000);
    let output = bench.run(&format!("record --board tcp:{address} --pose 0,0 --settle 0.2 --out part.csv"));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(UNREACHABLE), "{stderr}");
    assert!(stderr.contains("did not come to its end") && stderr.contains("broke"), "{stderr}");
    let robot = armid::robot::Robot::paper();
    let part = armid::recording::Recording::read(&bench.path("part.csv"), &robot, Default::default()).unwrap();
    assert!((500..5000).contains(&part.samples()), "{} samples", part.samples());
    assert!(part.manifest.unwrap().partial.unwrap().contains("broke"));
}

#[test]
fn info_shows_the_board() {
    let bench = Bench::new();
    let info = bench.json("info --board sim");
    assert_eq!(info["board"], "simulated");
    assert_eq!(info["mode"], "idle");
    assert_eq!(info["protocol_version"], shared::protocol::PROTOCOL_VERSION);
    assert_eq!((info["reset_cause"].as_str(), &info["last_fault"]), (Some("other"), &Value::Null));
    assert_eq!(info["links"][0]["telemetry_dropped"], 0);
    assert_eq!(info["stored"]["state"], "nothing");
    let text = bench.done("info --board sim");
    for part in [
        "firmware      ",
        "(protocol 2)",
        "chip          ",
        "last start    other",
        "last fault    none",
        "dropped 0 rows",
    ] {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
}

#[test]
fn monitor_shows_rows_for_people_and_for_programs() {
    let bench = Bench::new();
    // Half a second in steps of 50 ms, and what the requests themselves took.
    let lines = bench.done("monitor --board sim --for 0.5 --json");
    let rows: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!((8..=10).contains(&rows.len()), "{} rows", rows.len());
    for row in &rows {
        assert_eq!((&row["mode"], &row["emergency_stop"]), (&"idle".into(), &false.into()));
        assert_eq!(numbers(&row["error_counts"]), [0.0, 0.0]);
        assert!(row["links"][0]["bad_frames"].is_u64() && row["fault"].is_null() && row["pose_known"] == false);
    }
    let times: Vec<f64> = rows.iter().map(|row| row["time_s"].as_f64().unwrap()).collect();
    assert!(times.windows(2).all(|pair| (0.05..0.06).contains(&(pair[1] - pair[0]))), "{times:?}");

    // Without a terminal: a header and plain lines.
    let lines = bench.done("monitor --board sim --for 0.2");
    assert!(lines.starts_with("time, s") || lines.trim_start().starts_with("time, s"), "{lines}");
    assert!(lines.lines().skip(1).all(|line| line.ends_with("idle")) && lines.lines().count() > 3, "{lines}");
    bench.refused(USAGE, "monitor --board sim --for -1", &["--for -1", "positive time"]);
    bench.refused(UNREACHABLE, "monitor --board tcp:127.0.0.1:1", &["tcp:127.0.0.1:1"]);
}

#[test]
fn calibrate_tells_gain_and_disagreement() {
    let bench = Bench::new().with_recording();
    let found = bench.json("calibrate run.csv --robot robot.toml");
    let gain = found["joints"][0]["position_gain_a_per_count"]["value"].as_f64().unwrap();
    assert!((gain - 0.036).abs() < 1e-4);
    assert_eq!(found["joints"][0]["agrees"], true);

    // Without its manifest and with another robot file, the recording is believed, and the file corrected.
    std::fs::remove_file(bench.path("run.toml")).unwrap();
    bench.spoil("robot.toml", "wrong.toml", |text| text.replace("_count = 0.036", "_count = 0.02"));
    let output = bench.run("calibrate run.csv --robot wrong.toml --out right.toml");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("joint 2: the robot file says 0.02 A/count"), "{stderr}");
    let right = armid::robot::Robot::read(&bench.path("right.toml")).unwrap();
    let armid::robot::Law::Proportional(found) = right.joints[0].law else { panic!("another law") };
    assert!((found.gain_a_per_count - 0.036).abs() < 1e-4);
}

#[test]
fn track_without_a_model_says_what_to_do() {
    let bench = Bench::new();
    bench.refused(FAILED, "track --board sim", &["no model", "--model"]);
}

#[test]
fn identified_and_uploaded_the_arm_tracks_within_one_count() {
    let bench = Bench::new();
    bench.done("record --board sim --seed 4 --out train1.csv");
    bench.done("record --board sim --seed 4 --period 5 --out train2.csv");
    let found = bench.json("identify train1.csv train2.csv --robot robot.toml --out model.toml");
    for key in ["f", "standard_error"] {
        assert_eq!(numbers(&found[key]).len(), 9, "{key}");
    }
    for key in ["friction", "objective_counts2", "rms_counts", "held_out_rms_counts", "evaluations", "seconds", "seed"]
    {
        assert!(!found[key].is_null(), "{key}");
    }
    let uploaded = bench.json("upload model.toml --board sim --seed 4");
    assert_eq!(uploaded["active"]["f"], found["f"]);
    assert_eq!(uploaded["stored"], true);
    assert!(bench.done("upload model.toml --board sim").contains("now active: model.toml"));
    assert_eq!(bench.json("upload --forget --board sim")["stored"], false);

    let tracked = bench.json("track --board sim --seed 4 --model model.toml --out tracked");
    let largest = numbers(&tracked["p"]["max_abs_error_counts"]);
    assert!(largest.iter().all(|error| (50.0..300.0).contains(error)), "{largest:?}");
    let within = numbers(&tracked["ctc"]["within_one_count"]);
    assert!(within.iter().all(|percent| (99.0..=100.0).contains(percent)), "{within:?}");
    assert!(bench.path("tracked/p.csv").is_file() && bench.path("tracked/ctc.toml").is_file());
    // A recording under computed torque is no recording of the position loop.
    bench.refused(FAILED, "calibrate tracked/ctc.csv", &["ctc.csv", "--mode p"]);
}

#[test]
fn demo_shows_the_whole_chain() {
    let bench = Bench::new();
    let shown = bench.json("demo --seed 2 --out shown");
    let within = numbers(&shown["ctc"]["within_one_count"]);
    assert!(within.iter().all(|percent| *percent >= 99.0), "{within:?}");
    for ((found, truth), error) in
        numbers(&shown["f"]).iter().zip(numbers(&shown["true_f"])).zip(numbers(&shown["standard_error"]))
    {
        assert!((found - truth).abs() < 5.0 * error, "{found} for {truth}, standard error {error}");
    }
    for file in ["robot.toml", "train1.csv", "train2.csv", "model.toml", "truth.toml", "track-p.csv", "track-ctc.csv"] {
        assert!(bench.path("shown").join(file).is_file(), "{file}");
    }
    let picture = std::fs::read_to_string(bench.path("shown/demo.svg")).unwrap();
    assert!(picture.starts_with("<svg") && picture.contains("computed torque"));
}

/// The positioning axis of the shared data folder, where this machine has it.
#[test]
fn a_real_axis_is_identified() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/emps");
    if !folder.is_dir() {
        eprintln!("skipped: {} is not there", folder.display());
        return;
    }
    let bench = Bench::new();
    let found = bench.json(&format!("identify --robot {0}/robot.toml {0}/identification.csv", folder.display()));
    let near = |found: &Value, published: f64| {
        let found = found.as_f64().unwrap();
        assert!((found / published - 1.0).abs() < 0.03, "{found} for {published}");
    };
    near(&found["mass"], 95.1089);
    near(&found["friction"]["viscous_nm_s_per_rad"][0], 203.5034);
    near(&found["friction"]["coulomb_nm"][0], 20.3935);
    assert!(numbers(&found["force_gap_rms"])[0] <= 2.45, "{}", found["force_gap_rms"]);
}

#[test]
fn results_never_destroy_what_they_are_made_of() {
    let bench = Bench::new().with_recording();
    let kept = |name: &str| std::fs::read(bench.path(name)).unwrap();
    let (robot, recording) = (kept("robot.toml"), kept("run.csv"));
    // The manifest of robot.csv would be robot.toml: the robot file.
    for command in ["record --board sim --robot robot.toml", "simulate --robot robot.toml", "simulate"] {
        bench.refused(USAGE, &format!("{command} --out robot.csv"), &["robot.toml", "choose another --out"]);
    }
    for out in ["run.csv", "run.toml", "./run.csv", "robot.toml"] {
        bench.refused(USAGE, &format!("identify run.csv --robot robot.toml --out {out}"), &[out, "overwritten"]);
    }
    bench.refused(USAGE, "calibrate run.csv --out run.csv", &["run.csv", "overwritten"]);
    assert_eq!(kept("robot.toml"), robot);
    assert_eq!(kept("run.csv"), recording);
    // A second recording under the same name replaces the first with its manifest, as asked.
    bench.done("simulate --settle 0 --out run.csv --seed 2");
    // Names without .csv keep recording and manifest, and each other's manifests, apart.
    for name in ["one.1", "one.2", "bare.toml"] {
        bench.done(&format!("simulate --settle 0 --out {name}"));
        assert!(kept(name).starts_with(b"tick,"), "{name}");
        assert!(kept(&format!("{name}.toml")).starts_with(b"mode"), "{name}");
    }
}

#[test]
fn an_output_that_cannot_be_written_is_told_before_the_work() {
    let bench = Bench::new().with_recording();
    std::fs::create_dir(bench.path("folder")).unwrap();
    for out in ["folder", "folder/", "robot.toml/run.csv"] {
        for command in ["record --board sim", "simulate", "identify run.csv", "calibrate run.csv"] {
            let output = bench.run(&format!("{command} --out {out}"));
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(FAILED), "{command} --out {out}: {stderr}");
            assert!(stderr.contains("cannot be written"), "{stderr}");
            // Nothing came before the error: no margins of a movement, no advice of an identification.
            assert!(stderr.starts_with("error"), "{command} --out {out}: {stderr}");
        }
    }
    assert_eq!(std::fs::read_dir(bench.path("folder")).unwrap().count(), 0, "something was left behind");
}

#[test]
fn recordings_too_short_or_without_motion_are_bad_files() {
    let bench = Bench::new().with_recording();
    bench.spoil("run.csv", "short.csv", |text| text.lines().take(200).map(|line| format!("{line}\n")).collect());
    bench.refused(BAD_FILE, "identify short.csv", &["short.csv", "199 samples", "500", "longer movement"]);
    let still: String = (0..1500).map(|tick| format!("{tick},0,0,-61,0,-2.2,0.0\n")).collect();
    std::fs::write(bench.path("still.csv"), format!("tick,ref2,ref3,err2,err3,cur2,cur3\n{still}")).unwrap();
    bench.refused(BAD_FILE, "identify still.csv", &["joint 2", "travels only 0 counts", "larger movement"]);
}

#[test]
fn a_current_that_does_not_fit_the_gain_is_told() {
    let bench = Bench::new().with_recording();
    let with_current = |change: fn(&str) -> String| {
        bench.spoil("run.csv", "bad.csv", |text| {
            let mut lines = text.lines();
            lines.next();
            let columns = |line: &str| {
                let f: Vec<&str> = line.split(',').collect();
                format!("{},{},{}\n", f[..5].join(","), change(f[5]), f[6])
            };
            let rows: String = lines.map(columns).collect();
            format!("tick,ref2,ref3,err2,err3,cur2,cur3\n{rows}")
        });
        String::from_utf8(bench.run("calibrate bad.csv").stderr).unwrap()
    };
    let milliampere = with_current(|current| (1e3 * current.parse::<f64>().unwrap()).to_string());
    assert!(milliampere.contains("cur2 over err2 is 36.") && milliampere.contains("ampere"), "{milliampere}");
    let nothing = with_current(|_| "0".into());
    assert!(nothing.contains("cur2 does not follow err2"), "{nothing}");
    // Calibrating by it must not end in a gain of zero.
    bench.refused(FAILED, "calibrate bad.csv --out zero.toml", &["joint 2", "correlate by 0.00", "current sensor"]);
    assert!(!bench.path("zero.toml").exists());
    let sound = with_current(|current| format!("{current}0"));
    assert!(!sound.contains("cur2"), "{sound}");
}

#[test]
fn files_of_another_robot_are_told() {
    let bench = Bench::new().with_recording();
    bench.spoil("robot.toml", "other.toml", |text| text.replacen("name = \"PUMA", "name = \"Another PUMA", 1));
    let stderr = String::from_utf8(bench.run("calibrate run.csv --robot other.toml").stderr).unwrap();
    assert!(stderr.contains("run.toml: is of the robot \"PUMA 560"), "{stderr}");
    bench.spoil("run.toml", "run.toml", |text| text.replace("name = \"3\"", "name = \"4\""));
    for command in ["identify", "calibrate"] {
        bench.refused(BAD_FILE, &format!("{command} run.csv"), &["run.toml", "2, 4", "2, 3", "robot file"]);
    }
}

#[test]
fn friction_in_another_unit_is_refused() {
    let bench = Bench::new().with_recording();
    bench.spoil("robot.toml", "bad.toml", |text| {
        text.replacen("coulomb_friction_nm = 0.124", "coulomb_friction_nm = 124", 1)
    });
    bench.refused(
        BAD_FILE,
        "calibrate run.csv --robot bad.toml",
        &["bad.toml:", "coulomb_friction_nm", "124", "greatest torque", "unit"],
    );
}

//! Commands that talk to a board.

use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::time::Duration;

use armid::link::{Link as _, SimulatedBoard};
use serde_json::Value;

use crate::bench::{BAD_FILE, Bench, FAILED, UNREACHABLE, UNSAFE, USAGE, numbers};

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
fn an_empty_board_variable_is_as_good_as_none() {
    let bench = Bench::new();
    for arguments in ["info", "doctor"] {
        let run = |board| bench.command(arguments).env("ARMID_BOARD", board).output().unwrap().status.code();
        assert_eq!(run(""), bench.run(arguments).status.code(), "{arguments}");
        assert_eq!(run("nonsense"), Some(USAGE), "{arguments}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn nothing_fails_because_stderr_is_full() {
    let bench = Bench::new();
    let full = || std::fs::File::options().write(true).open("/dev/full").unwrap();
    let run = |arguments| bench.command(arguments).stderr(full()).output().unwrap().status.code();
    assert_eq!(run("record --board sim --settle 0 --out a.csv"), Some(0));
    assert_eq!(run("record --board sim --settle 0 --out a.csv"), Some(USAGE), "it exists");
    assert_eq!(run("new-robot --ask"), Some(USAGE), "nobody answers");
}

#[test]
fn gains_above_the_stability_limit_never_move_anything() {
    let bench = Bench::new().with_recording();
    bench.done("simulate --settle 0 --out x.csv --truth model.toml");
    bench.spoil("robot.toml", "stiff.toml", |text| text.replace("_count = 0.036", "_count = 0.384"));
    let parts = ["joint 2", "0.09600 N m/count", "stability limit 0.016", "lower the gain"];
    for command in ["record --board sim", "track --board sim", "simulate", "upload model.toml --board sim"] {
        bench.refused(UNSAFE, &format!("{command} --robot stiff.toml"), &parts);
        bench.refused(UNSAFE, &format!("{command} --robot stiff.toml"), &["stiff.toml:15", "nothing was moved"]);
    }
    // A recording of an unstable loop does not exist: the robot file is wrong.
    bench.refused(BAD_FILE, "identify run.csv --robot stiff.toml", &parts);
    // The same gain in a loop of 50 µs is what the paper's hardware card ran.
    bench.spoil("stiff.toml", "card.toml", |text| text.replace("loop_period_s = 0.0007", "loop_period_s = 0.00005"));
    bench.done("simulate --robot card.toml --settle 0.2 --out with-card.csv");
}

/// Neither is anything sent nor anything computed for ever.
#[test]
fn a_model_with_friction_that_no_drive_overcomes_reaches_no_board() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out x.csv --truth model.toml");
    let spoil = |key: &str, value: &str| {
        bench.spoil("model.toml", "absurd.toml", |text| {
            let changed =
                |line: &str| if line.starts_with(key) { format!("{key} = [{value}, 0.001]") } else { line.into() };
            text.lines().map(|line| changed(line) + "\n").collect()
        });
    };
    for (key, value, kind) in [
        ("coulomb_nm", "13.0", "Coulomb"),
        ("coulomb_nm", "1e308", "Coulomb"),
        ("viscous_nm_s_per_rad", "1000.0", "viscous"),
        ("viscous_nm_s_per_rad", "1e308", "viscous"),
    ] {
        spoil(key, value);
        for command in ["upload absurd.toml", "track --model absurd.toml", "record --model absurd.toml --out y.csv"] {
            bench.refused(BAD_FILE, &format!("{command} --board usb"), &["absurd.toml:", kind, "joint 2", "below"]);
        }
        bench.refused(BAD_FILE, "info --margins --model absurd.toml", &["absurd.toml:", kind]);
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

/// Serves hosts one after the other with a simulated board, and goes away after having sent `bytes`. Half a second of
/// virtual time passes with every request, so how fast the machine is does not matter.
fn board_that_goes_away_after(bytes: usize) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        let mut board = SimulatedBoard::hidden(&armid::robot::Robot::paper(), 1);
        let (mut buffer, mut sent) = ([0; 512], 0);
        while let Ok((mut stream, _)) = listener.accept() {
            while let Ok(count @ 1..) = stream.read(&mut buffer) {
                board.send(&buffer[..count]).unwrap();
                let until = board.now() + Duration::from_millis(500);
                while board.now() < until && sent < bytes {
                    let count = board.receive(&mut buffer, until - board.now()).unwrap();
                    // Whoever has what it wanted is gone.
                    if stream.write_all(&buffer[..count]).is_err() {
                        break;
                    }
                    sent += count;
                }
                if sent >= bytes {
                    return;
                }
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
    assert_eq!((info["reset_cause"].as_str(), &info["last_fault"]), (Some("power-on"), &Value::Null));
    assert_eq!(info["links"][0]["telemetry_dropped"], 0);
    assert_eq!(info["stored"]["state"], "nothing");
    let text = bench.done("info --board sim");
    for part in [
        "firmware      ",
        "(protocol 5)",
        "chip          ",
        "last start    power-on",
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
fn a_model_that_the_board_kept_is_checked_with_the_robot_file_of_today() {
    let bench = Bench::new();
    let board = format!("--board tcp:{}", board_that_goes_away_after(usize::MAX));
    bench.done("simulate --settle 0 --out x.csv --truth truth.toml");
    bench.done(&format!("upload {board} --pose 0,0 --model truth.toml"));
    let mut hard = armid::robot::Robot::paper();
    hard.computed_torque.bandwidth_rad_s = 1500.0;
    hard.computed_torque.observer_bandwidth_rad_s = 6000.0;
    hard.write(&bench.path("hard.toml")).unwrap();
    let record = format!("record {board} --pose 0,0 --settle 0.2 --mode ctc --out run.csv");
    bench.refused(UNSAFE, &format!("{record} --robot hard.toml"), &["margin", "nothing was moved"]);
    assert!(!bench.path("run.csv").exists());
    bench.done(&record);
}

//! Tracking without a model, its figures, and margins: shown, and refused where there are none.

use crate::bench::{Bench, UNREACHABLE, UNSAFE, USAGE, numbers};

/// A shaft of joint 3 that swings at 30 Hz.
const SHAFT: &str = "--effect joint-flexibility:joint=3,compliance_rad_per_nm=0.0000751,damping_s=0.0001";

#[test]
fn without_a_model_track_identifies_the_arm_first() {
    let bench = Bench::new();
    let output = bench.run("track --board sim --seed 6 --settle 0.5 --json");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("no model was given: recording two movements"), "{stderr}");
    let tracked: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(numbers(&tracked["ctc"]["within_one_count"]), [100.0; 2]);
    assert!(numbers(&tracked["p"]["max_abs_error_counts"]).iter().all(|&largest| largest > 50.0));
    for field in ["p", "ctc"] {
        // The paper's movement takes about 1.5 A rms of joint 2, 0.9 of joint 3.
        let torque = numbers(&tracked[field]["torque_rms_nm"]);
        assert!(torque.iter().all(|torque| (0.1..0.8).contains(torque)), "{field}: {torque:?}");
        assert_eq!(numbers(&tracked[field]["time_in_limits_s"]), [0.0; 2]);
    }
}

/// The paper's movements go where this arm may not be.
#[test]
fn an_arm_that_cannot_make_the_papers_movements_is_identified_from_the_given_and_a_designed_one() {
    let bench = Bench::new();
    bench.spoil("robot.toml", "narrow.toml", |text| {
        let bound = |line: &str| match line.split(" = ").next() {
            Some(key @ "position_low_rad") => format!("{key} = -0.4"),
            Some(key @ "position_high_rad") => format!("{key} = 0.3"),
            _ => line.into(),
        };
        text.lines().map(|line| bound(line) + "\n").collect()
    });
    let remedy = ["position of joint", "armid excite --robot FILE --out m.toml", "--trajectory m.toml"];
    for command in ["record --board sim", "track --board sim", "simulate"] {
        bench.refused(UNSAFE, &format!("{command} --robot narrow.toml"), &remedy);
    }
    bench.done("excite --robot narrow.toml --generations 1 --duration 4 --out m.toml");
    let output = bench.run("track --board sim --robot narrow.toml --trajectory m.toml --settle 0.5 --json");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("identified from m.toml and a movement designed within its limits"), "{stderr}");
    let tracked: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let within = numbers(&tracked["ctc"]["within_one_count"]);
    assert!(within.iter().all(|share| *share > 99.0), "{tracked}");
}

/// An amplifier that cannot give what the movement takes is at its limit for a while, and that is told.
#[test]
fn time_in_limits_is_told() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out x.csv --truth model.toml");
    bench.spoil("robot.toml", "weak.toml", |text| text.replacen("current_limit_a = 12.0", "current_limit_a = 4.2", 1));
    let output = bench.run("track --board sim --settle 0.5 --robot weak.toml --model model.toml --json");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("a limit acted during the movement: current_limit_a of joint 2"), "{stderr}");
    let tracked: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let [second, third] = numbers(&tracked["p"]["time_in_limits_s"])[..] else { panic!() };
    assert!(second > 0.01 && third == 0.0, "{second} {third}");
}

#[test]
fn margins_are_shown_without_a_board() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out x.csv --truth rigid.toml");
    let shown = bench.json("info --margins --model rigid.toml --robot robot.toml");
    assert_eq!(shown["accepted"], true);
    assert!(numbers(&shown["gain_margin"]).iter().all(|&gain| gain > 4.0), "{shown}");
    assert!(numbers(&shown["phase_margin_deg"]).iter().all(|&phase| phase > 40.0), "{shown}");
    assert_eq!(shown["bandwidth_rad_s"], 200.0);
    assert!(shown["grid"].as_array().unwrap().len() >= 20);
    let text = bench.done("info --margins --model rigid.toml");
    for part in ["gain margin", "phase margin", "delay margin", "rigid", "accepted"] {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
    // Without a model it is the board's that is meant.
    bench.refused(UNREACHABLE, "info --margins", &["no board was found"]);
    bench.refused(USAGE, "info --model rigid.toml", &["--margins"]);
}

#[test]
fn computed_torque_without_margin_is_refused_and_what_is_proposed_is_accepted() {
    let bench = Bench::new();
    bench.done(&format!("simulate --settle 0 --out x.csv --truth flexible.toml {SHAFT}"));
    let shown = bench.json("info --margins --model flexible.toml");
    assert_eq!(shown["accepted"], false);
    let reason = shown["reason"].as_str().unwrap();
    let parts = ["joint 3", "must be at least", "bandwidth_rad_s 200", "[computed_torque] bandwidth_rad_s = "];
    assert!(parts.iter().all(|part| reason.contains(part)), "{reason}");
    for command in ["track --board sim --model", "upload --board sim", "record --board sim --mode ctc --model"] {
        bench.refused(UNSAFE, &format!("{command} flexible.toml"), &parts);
        bench.refused(UNSAFE, &format!("{command} flexible.toml"), &["nothing was moved"]);
    }
    let proposed = reason.split("[computed_torque] ").nth(1).unwrap().replace(", ", "\n");
    bench.spoil("robot.toml", "soft.toml", |text| {
        let (before, after) = text.split_once("[computed_torque]").unwrap();
        let (_, after) = after.split_once("\n\n").unwrap();
        format!("{before}[computed_torque]\n{proposed}\n\n{after}")
    });
    assert_eq!(bench.json("info --margins --model flexible.toml --robot soft.toml")["accepted"], true);
    let tracked =
        bench.json(&format!("track --board sim --settle 0.5 --robot soft.toml --model flexible.toml {SHAFT}"));
    let largest = numbers(&tracked["ctc"]["max_abs_error_counts"]);
    assert!(largest.iter().all(|&largest| largest < 15.0), "{largest:?}");
    // Values that cannot be.
    bench.spoil("soft.toml", "hard.toml", |text| {
        text.replace("[computed_torque]\n", "[computed_torque]\ndamping_ratio = -1.0\n")
    });
    bench.refused(
        crate::bench::BAD_FILE,
        "info --margins --model flexible.toml --robot hard.toml",
        &["damping_ratio", "-1"],
    );
}

//! The command line: results, messages and exit codes.

mod bad_input;
mod bench;
mod benchmarks;
mod board;
mod doctor;
mod documentation;
mod effects;
mod export;
mod hostile;
mod load;
mod outputs;
mod page;
mod readme;
mod report;
mod robots;
mod tracking;
#[cfg(unix)]
mod udev_rule;

use std::path::Path;

use serde_json::Value;

use bench::{Bench, FAILED, USAGE, numbers};

#[test]
fn help_documents_the_exit_codes() {
    let bench = Bench::new();
    let help = bench.done("--help");
    let codes =
        ["0  done", "1  failed", "2  wrong usage", "3  bad input file", "4  board unreachable", "5  refused as unsafe"];
    assert!(codes.iter().all(|code| help.contains(code)), "{help}");
    for command in [
        "demo",
        "info",
        "monitor",
        "record",
        "calibrate",
        "identify",
        "upload",
        "track",
        "load",
        "simulate",
        "report",
        "export",
    ] {
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

/// Neither the manifest nor the robot file knows of the lead that the recording was made with.
#[test]
fn a_lead_is_sought_with_f() {
    let bench = Bench::new();
    let mut robot = armid::robot::Robot::paper();
    for joint in &mut robot.joints {
        if let armid::robot::Law::Proportional(position_loop) = &mut joint.law {
            position_loop.lead = 0.4;
        }
    }
    robot.write(&bench.path("leading.toml")).unwrap();
    bench.done("simulate --robot leading.toml --settle 0.5 --out run.csv");
    bench.spoil("run.toml", "run.toml", |text| text.replace("lead = 0.4", "lead = 0.0"));
    let gap = |found: &serde_json::Value| found["rms_counts"][0].as_f64().unwrap();
    let without = bench.json("identify run.csv");
    let with = bench.json("identify run.csv --identify-lead");
    for joint in 0..2 {
        let lead = with["lead"][joint]["value"].as_f64().unwrap();
        assert!((lead - 0.4).abs() < 0.02, "{lead}");
    }
    assert!(gap(&with) < 0.6 && gap(&without) > 2.0 * gap(&with), "{} {}", gap(&with), gap(&without));
}

#[test]
fn demo_shows_the_whole_chain() {
    let bench = Bench::new();
    let shown = bench.json("demo --seed 2 --out shown --report page.html");
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

    let page = page::Page::read(&bench, "page.html");
    page.expect_sections(&[
        "Tracking",
        "Currents",
        "True and found",
        "Parameters",
        "How well the model repeats the recordings",
        "Search",
        "Correlations",
        "Tracking errors, measured and simulated",
        "Currents, measured and simulated",
        "Residual maps",
        "Provenance",
    ]);
    assert_eq!(page.column("True and found", 0, 2)[..9], numbers(&shown["f"]));
    assert_eq!(page.column("True and found", 0, 1)[..9], numbers(&shown["true_f"]));
    assert_eq!(page.column("Tracking", 0, 4)[2..], within);
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
    // With the example that the tool brings along.
    bench.done("new-robot --example emps --out emps.toml");
    let found = bench.json(&format!("identify --robot emps.toml {}/identification.csv", folder.display()));
    let near = |found: &Value, published: f64| {
        let found = found.as_f64().unwrap();
        assert!((found / published - 1.0).abs() < 0.03, "{found} for {published}");
    };
    near(&found["mass"], 95.1089);
    near(&found["friction"]["viscous_nm_s_per_rad"][0], 203.5034);
    near(&found["friction"]["coulomb_nm"][0], 20.3935);
    assert!(numbers(&found["force_gap_rms"])[0] <= 2.45, "{}", found["force_gap_rms"]);
}

/// What the published structure of that axis lacks, beginning with what its makers suspect.
#[test]
fn a_real_axis_is_explained() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/emps");
    if !folder.is_dir() {
        eprintln!("skipped: {} is not there", folder.display());
        return;
    }
    let bench = Bench::new();
    let found = bench.json(&format!("explain --robot {0}/robot.toml {0}/identification.csv", folder.display()));
    assert_eq!(found["effects"][0]["name"], "asymmetric-viscous-friction", "{}", found["effects"]);
    let [before, after] = numbers(&found["force_gap_rms"])[..] else { panic!("{}", found["force_gap_rms"]) };
    assert!(before > 2.4 && after <= 1.2, "{before} {after}");
}

/// f3 = a3 f5 and f4 = a3 f6 are not sought, but their values and standard errors are told like all others.
#[test]
fn what_follows_from_other_parameters_is_told_with_its_standard_error() {
    let bench = Bench::new().with_recording();
    let found = bench.json("identify run.csv --robot robot.toml --a3 0.4318");
    let parameters = found["parameters"].as_array().unwrap();
    let of = |name: &str, what: &str| {
        let parameter = parameters.iter().find(|parameter| parameter["name"] == name);
        parameter.unwrap_or_else(|| panic!("no {name}"))[what].as_f64().unwrap()
    };
    for (tied, source) in [("f3", "f5"), ("f4", "f6")] {
        for what in ["value", "standard_error"] {
            assert!((of(tied, what) - 0.4318 * of(source, what)).abs() < 1e-12, "{tied}: {what}");
        }
    }
    // Only the paper's own method reads bits.
    bench.refused(USAGE, "identify run.csv --robot robot.toml --coding gray", &["--method paper"]);
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
    // A slip: the first recording becomes the value of --out.
    std::fs::copy(bench.path("run.csv"), bench.path("other.csv")).unwrap();
    for command in ["identify --out other.csv", "identify --report other.csv", "calibrate --out other.csv"] {
        bench.refused(USAGE, &format!("{command} run.csv"), &["other.csv is a recording", "choose another name"]);
    }
    assert_eq!(kept("other.csv"), recording);
    assert_eq!(kept("robot.toml"), robot);
    assert_eq!(kept("run.csv"), recording);
    // A second recording under the same name replaces the first with its manifest, as asked.
    bench.done("simulate --settle 0 --out run.csv --seed 2 --force");
    // Names without .csv keep recording and manifest, and each other's manifests, apart.
    for name in ["one.1", "one.2", "bare.toml"] {
        bench.done(&format!("simulate --settle 0 --out {name}"));
        assert!(kept(name).starts_with(b"tick,"), "{name}");
        assert!(kept(&format!("{name}.toml")).starts_with(b"rows"), "{name}");
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

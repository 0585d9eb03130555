//! Files that cannot be used, one mistake at a time.

use crate::bench::{self, BAD_FILE, Bench, FAILED, USAGE, replace_line};

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
    spoil(&|_| String::new());
    refused(&["bad.csv:1", "the header", "is missing", "the file is empty"]);
    spoil(&|text| text.lines().take(20).map(|line| format!("{line}\n")).collect());
    refused(&["bad.csv", "19 samples", "at least 50"]);
    bench.refused(BAD_FILE, "identify missing.csv", &["missing.csv", "cannot be read"]);
    bench.spoil("run.toml", "bad.toml", |text| {
        text.replace("position_gain_a_per_count = 0.036", "position_gain_a_per_count = nan")
    });
    spoil(&|text| text + "\n");
    refused(&["bad.toml", "position_gain_a_per_count", "NaN"]);
}

/// Old rows under a new manifest are what a program leaves that ends between the two, or a copy of one file alone.
#[test]
fn a_recording_and_a_manifest_that_do_not_belong_together_are_told() {
    let bench = Bench::new().with_recording();
    let rows = std::fs::read_to_string(bench.path("run.csv")).unwrap();
    let told = |command: &str| String::from_utf8(bench.run(command).stderr).unwrap();
    const NOTE: &str = "not the rows that run.toml was written with";
    assert!(!told("identify run.csv").contains(NOTE));
    // As many rows of another movement, or rows that somebody mended.
    bench.done("simulate --settle 0.5 --seed 2 --out run.csv --force");
    std::fs::write(bench.path("run.csv"), &rows).unwrap();
    bench.done("identify run.csv");
    assert!(told("identify run.csv").contains(NOTE));
    // Another number of them.
    bench.done("simulate --settle 0.5 --period 5 --out run.csv --force");
    std::fs::write(bench.path("run.csv"), &rows).unwrap();
    let parts =
        ["run.csv: does not belong to its manifest run.toml", "states 7142 rows", "here are 5214", "--allow-gaps"];
    for command in ["identify run.csv", "calibrate run.csv"] {
        bench.refused(BAD_FILE, command, &parts);
    }
    bench.spoil("run.toml", "run.toml", |text| bench::without_checksum(&text));
    bench.done("calibrate run.csv");
    // Another system's line ends are no other rows.
    bench.done("simulate --settle 0 --out sent.csv");
    bench.spoil("sent.csv", "sent.csv", |text| text.replace('\n', "\r\n"));
    assert!(!told("identify sent.csv").contains("sent.toml"));
}

#[test]
fn a_recording_or_a_manifest_cut_at_a_line_end_is_told() {
    let bench = Bench::new().with_recording();
    let first = |text: &str, lines: usize| text.lines().take(lines).map(|line| format!("{line}\n")).collect::<String>();
    std::fs::copy(bench.path("run.toml"), bench.path("cut.toml")).unwrap();
    bench.spoil("run.csv", "cut.csv", |text| first(&text, 2000));
    bench.refused(BAD_FILE, "identify cut.csv", &["cut.csv", "states 5214 rows", "here are 1999"]);
    // Whoever says that rows may be missing gets what is there.
    let told = String::from_utf8(bench.run("identify cut.csv --allow-gaps").stderr).unwrap();
    assert!(told.contains("(1999 of 5214)"), "{told}");
    let manifest = std::fs::read_to_string(bench.path("run.toml")).unwrap();
    for lines in 0..manifest.lines().count() {
        bench.spoil("run.toml", "cut.toml", |text| first(&text, lines));
        let read = armid::recording::Manifest::read(&bench.path("cut.toml"));
        assert!(read.is_err(), "cut after line {lines}: {read:?}");
    }
    bench.spoil("run.toml", "run.toml", |text| first(&text, 3));
    bench.refused(BAD_FILE, "calibrate run.csv", &["run.toml", "is missing", "cut off", "copy it again whole"]);
}

#[test]
fn unknown_keys_of_a_manifest_are_refused_with_their_line() {
    let bench = Bench::new().with_recording();
    bench.spoil("run.toml", "run.toml", |text| text.replace("loop_period_s", "loop_perod_s"));
    bench.refused(BAD_FILE, "calibrate run.csv", &["run.toml:8", "loop_perod_s", "did you mean `loop_period_s`"]);
}

#[test]
fn what_stands_in_the_place_of_a_manifest_and_is_none_is_told() {
    let bench = Bench::new().with_recording();
    std::fs::remove_file(bench.path("run.toml")).unwrap();
    std::fs::create_dir(bench.path("run.toml")).unwrap();
    let parts = ["run.toml", "cannot be read", "should be the recording's manifest", "move away what is there"];
    bench.refused(BAD_FILE, "calibrate run.csv", &parts);
    std::fs::remove_dir(bench.path("run.toml")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("nowhere.toml", bench.path("run.toml")).unwrap();
        bench.refused(BAD_FILE, "calibrate run.csv", &["run.toml", "cannot be read", "move away what is there"]);
        std::fs::remove_file(bench.path("run.toml")).unwrap();
    }
    bench.done("calibrate run.csv");
}

/// Noise that counts twice would halve the variances stated, and what was fitted foretells itself.
#[test]
fn a_recording_is_used_once() {
    let bench = Bench::new().with_recording();
    for command in ["identify run.csv ./run.csv", "identify run.csv --check run.csv", "explain run.csv run.csv"] {
        bench.refused(USAGE, command, &["run.csv is given twice", "give it once"]);
    }
    bench.refused(USAGE, "calibrate run.csv run.csv", &["run.csv is given twice"]);
}

/// A number below zero is refused as the value it was meant to be.
#[test]
fn negative_numbers_are_refused_by_the_option_they_are_of() {
    let bench = Bench::new();
    bench.refused(USAGE, "demo --seed -1", &["invalid value '-1'", "--seed"]);
    bench.refused(USAGE, "bench load --picks -3", &["invalid value '-3'", "--picks"]);
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
    std::fs::copy(bench.path("run.csv"), bench.path("wild.csv")).unwrap();
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
        &["bad.toml:12", "gear_ratio", "is 0", "other than 0", "motor turns"],
    );
    refused("counts_per_rev = 800", "counts_per_rev = -800", &["bad.toml:13", "counts_per_rev", "-800", "above 0"]);
    refused("gear_ratio", "gear_ration", &["bad.toml:12", "gear_ration", "did you mean `gear_ratio`"]);
    refused("[[joint]]", "[[joint", &["bad.toml:10"]);
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

#[test]
fn a_model_of_another_robot_is_refused() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out x.csv --truth truth.toml");
    // Another gearbox, whose friction and f this model knows nothing of; another loop period is still the same robot.
    bench.spoil("robot.toml", "geared.toml", |text| text.replace("gear_ratio = -53.7", "gear_ratio = -50.0"));
    bench.spoil("robot.toml", "fast.toml", |text| text.replace("loop_period_s = 0.0007", "loop_period_s = 0.00035"));
    for command in ["track --board sim", "upload --board sim", "record --board sim --mode ctc", "load --board sim"] {
        let command = |robot: &str| format!("{command} --robot {robot} --model truth.toml");
        bench.refused(BAD_FILE, &command("geared.toml"), &["truth.toml", "identity", "--robot", "gear ratios"]);
    }
    bench.done("upload --board sim --robot fast.toml --model truth.toml");
}

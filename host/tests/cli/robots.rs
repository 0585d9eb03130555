//! `armid new-robot`, and robots other than the PUMA all the way.

use std::io::Write as _;
use std::process::{Command, Stdio};

use armid::robot::Robot;

use crate::bench::{BAD_FILE, Bench, FAILED, UNSAFE, USAGE, bounds, numbers};

/// What a maker would write down of the example's double pendulum.
const ANSWERS: &str = r#"
name = "pendulum"
upper_arm_m = 0.35
[joint1]
name = "shoulder"
gear_ratio = 1
counts_per_rev = 65536
torque_constant_nm_per_a = 2.0
current_limit_a = 12
viscous_friction_nm_s_per_rad = 0.02
position_low_rad = -1.9
position_high_rad = 0.4
speed_limit_rad_s = 6
acceleration_limit_rad_s2 = 40
[joint2]
name = "elbow"
gear_ratio = 1
counts_per_rev = 65536
torque_constant_nm_per_a = 0.5
current_limit_a = 12
viscous_friction_nm_s_per_rad = 0.005
position_low_rad = -0.4
position_high_rad = 2
speed_limit_rad_s = 8
acceleration_limit_rad_s2 = 80
[link1]
mass_kg = 3
centre_x_m = 0.18
centre_y_m = 0
inertia_kg_m2 = 0.06
motor_inertia_kg_m2 = 0.004
[link2]
mass_kg = 1
centre_x_m = 0
centre_y_m = -0.14
inertia_kg_m2 = 0.012
motor_inertia_kg_m2 = 0.001
"#;

#[test]
fn answers_from_a_file_make_a_robot_that_moves() {
    let bench = Bench::new();
    std::fs::write(bench.path("answers.toml"), ANSWERS).unwrap();
    bench.done("new-robot --answers answers.toml --defaults --set joint1.coulomb_friction_nm=0.03 --out new.toml");
    let robot = Robot::read_for_motion(&bench.path("new.toml")).unwrap();
    assert_eq!((robot.name.as_str(), robot.joints[0].coulomb_friction_nm), ("pendulum", Some(0.03)));
    let recorded = bench.json("record --board sim --robot new.toml --settle 0.5 --out moved.csv");
    assert!(recorded.to_string().contains("moved.csv"), "{recorded}");
    // What is there stays.
    bench.refused(USAGE, "new-robot --answers answers.toml --defaults --out new.toml", &["new.toml exists", "--force"]);
    // A link is called like its joint, or counted.
    let named = ANSWERS.replace("[link1]", "[link_shoulder]").replace("[link2]", "[link_elbow]");
    std::fs::write(bench.path("answers.toml"), named).unwrap();
    let with = "new-robot --answers answers.toml --defaults --set joint_shoulder.coulomb_friction_nm=0.03";
    bench.done(&format!("{with} --out named.toml"));
    assert_eq!(Robot::read(&bench.path("named.toml")).unwrap(), robot);
    bench.refused(USAGE, &format!("{with} --set link_wrist.mass_kg=1"), &["link_wrist.mass_kg is asked of no robot"]);
}

#[test]
fn nothing_is_guessed_where_nobody_can_be_asked() {
    let bench = Bench::new();
    std::fs::write(bench.path("answers.toml"), ANSWERS).unwrap();
    bench.refused(
        USAGE,
        "new-robot --set name=arm",
        &["no answer to kind, gravity_m_s2", "joint1.gear_ratio", "--defaults"],
    );
    // Those without a usual value are missing even so.
    bench.refused(USAGE, "new-robot --set name=arm --defaults", &["no answer to upper_arm_m, joint1.gear_ratio"]);
    let wrong = "new-robot --answers answers.toml --defaults";
    bench.refused(USAGE, &format!("{wrong} --set upper_arm_m=350"), &["upper_arm_m is 350", "0.001 to 100 m", "in m"]);
    bench.refused(USAGE, &format!("{wrong} --set upper_arm=0.35"), &["upper_arm is asked of no robot", "--list"]);
    bench.refused(USAGE, &format!("{wrong} --set nonsense"), &["nonsense is not KEY=VALUE"]);
    std::fs::write(bench.path("bad.toml"), "name = \n").unwrap();
    bench.refused(BAD_FILE, "new-robot --answers bad.toml", &["bad.toml:1"]);
    bench.refused(USAGE, "new-robot --example pumpkin", &["puma-560", "direct-drive-double-pendulum", "emps"]);
}

/// Questions show unit and default; a wrong answer is told and asked for again.
#[test]
fn whoever_answers_is_told_what_is_wrong_and_asked_again() {
    let bench = Bench::new();
    std::fs::write(bench.path("answers.toml"), ANSWERS.replace("upper_arm_m = 0.35\n", "")).unwrap();
    let mut asked = Command::new(env!("CARGO_BIN_EXE_armid"))
        .args(["new-robot", "--ask", "--answers", "answers.toml", "--out", "new.toml"])
        .current_dir(bench.path(""))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Kind, gravity, periods and delay as proposed; the length wrong, then right; the rest as proposed.
    let answers = "\n\n\n\n\n-1\n0.35\n".to_string() + &"\n".repeat(20);
    asked.stdin.take().unwrap().write_all(answers.as_bytes()).unwrap();
    let output = asked.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    for part in [
        "Gravity in the arm's plane, m/s² [9.81]: ",
        "upper_arm_m is -1, but must be 0.001 to 100 m",
        "(joint elbow) Current at full scale of the board's converters, A [15]: ",
    ] {
        assert!(stderr.contains(part), "no {part:?} in {stderr}");
    }
    assert_eq!(stderr.matches("Length of the upper arm").count(), 2, "{stderr}");
    assert_eq!(Robot::read(&bench.path("new.toml")).unwrap().upper_arm_m, 0.35);
}

#[test]
fn json_is_json_where_no_file_is_written() {
    let bench = Bench::new();
    let example = bench.json("new-robot --example emps");
    let robot = Robot::from_bytes("emps.toml".as_ref(), example["toml"].as_str().unwrap().into()).unwrap();
    assert_eq!(example["robot"], robot.name.as_str());
}

#[test]
fn questions_are_listed_with_their_keys() {
    let bench = Bench::new();
    let list = bench.done("new-robot --list");
    assert!(
        list.contains("joint2.gear_ratio") && list.contains("(N m s/rad)") && list.contains("link1.mass_kg"),
        "{list}"
    );
    let list = bench.done("new-robot --list --set kind=single-axis --set unit=m");
    assert!(!list.contains("joint2") && list.contains("link1.moved") && list.contains("(1/m)"), "{list}");
}

/// A two-link arm that shares nothing with the PUMA but its structure: no gears, fine encoders, next to no friction.
#[test]
fn a_direct_drive_double_pendulum_is_recorded_identified_and_tracked() {
    let bench = Bench::new();
    bench.done("new-robot --example direct-drive-double-pendulum --out pendulum.toml");
    let on = "--board sim --seed 7 --robot pendulum.toml";
    // The board knows joints by number, a user by name.
    bench.refused(UNSAFE, &format!("record {on} --period 0.2 --out none.csv"), &["joint shoulder"]);
    bench.done(&format!("record {on} --period 5 --out slow.csv"));
    bench.done(&format!("record {on} --period 3.65 --out fast.csv"));
    let found = bench.json("identify slow.csv fast.csv --robot pendulum.toml --out model.toml");
    // The simulated robot itself, drawn from the same seed, is the truth.
    let robot = Robot::read(&bench.path("pendulum.toml")).unwrap();
    let truth = armid::hidden_robot::HiddenRobot::draw(&robot, 7).f;
    let errors = numbers(&found["standard_error"]);
    for (index, (found, truth)) in numbers(&found["f"]).into_iter().zip(truth).enumerate() {
        let off = (found - truth).abs();
        assert!(
            off < 4.0 * errors[index] && off < 0.005 * truth.abs().max(0.03),
            "f{}: {found}, not {truth}",
            index + 1
        );
    }
    let tracked = bench.json(&format!("track {on} --model model.toml"));
    let share = |controller: &str| numbers(&tracked[controller]["within_one_count"]);
    assert!(share("p").iter().all(|share| *share < 5.0), "{tracked}");
    assert_eq!(share("ctc"), [100.0, 100.0], "{tracked}");
    // What leaves the chain for a simulator is this arm.
    let urdf = bench.done("export model.toml --robot pendulum.toml --format urdf");
    assert!(urdf.contains("<origin xyz=\"0.35 0 0\"/>") && urdf.contains("link_elbow"), "{urdf}");
}

#[test]
fn links_are_called_like_their_joints_and_the_numbers_of_old_files_are_read() {
    let bench = Bench::new();
    bench.done("new-robot --example direct-drive-double-pendulum --out pendulum.toml");
    bench.done("simulate --robot pendulum.toml --seed 7 --period 5 --settle 0 --out run.csv --truth model.toml");
    let ranges = |names: [&str; 2]| {
        std::fs::write(bench.path("bounds.toml"), bounds(names)).unwrap();
        bench.done("ranges bounds.toml --robot pendulum.toml")
    };
    let named = ranges(["link_shoulder", "link_elbow"]);
    // As new-robot counts them, and as the paper numbers those of the PUMA.
    for old in [["link1", "link2"], ["link2", "link3"]] {
        assert_eq!(ranges(old), named, "{old:?}");
    }
    assert_ne!(ranges(["link_elbow", "link_shoulder"]), named);
    std::fs::write(bench.path("bounds.toml"), bounds(["link_shoulder", "link_elbow"])).unwrap();
    let told = bench.done("ranges bounds.toml --robot pendulum.toml --check model.toml");
    assert!(told.contains("inertia of link shoulder (kg m²)") && told.contains("inertia of motor elbow"), "{told}");

    for (wrong, parts) in [
        (["link_sholder", "link_elbow"], ["wrong.toml:2", "`link_sholder`", "did you mean `link_shoulder`?"]),
        (["upper", "link_elbow"], ["wrong.toml:2", "`upper`", "[link_shoulder] or [link_elbow]"]),
        (["link1", "link_elbow"], ["wrong.toml", "one of [link_shoulder] and [link_elbow]", "like the joint"]),
    ] {
        std::fs::write(bench.path("wrong.toml"), bounds(wrong)).unwrap();
        bench.refused(BAD_FILE, "ranges wrong.toml --robot pendulum.toml", &parts);
    }
    let misspelt = bounds(["link_2", "link_3"]).replace("upper_arm_m", "uper_arm_m");
    std::fs::write(bench.path("wrong.toml"), misspelt).unwrap();
    bench.refused(BAD_FILE, "ranges wrong.toml", &["wrong.toml:1", "did you mean `upper_arm_m`?"]);
}

/// What stopped a movement is told, and noted in the manifest, with the names of the robot file. The first joint has the
/// board's number of the second here: renamed twice, it would be the elbow.
#[test]
fn a_recording_that_was_cut_short_names_the_joint_as_the_robot_file_does() {
    let bench = Bench::new();
    bench.spoil("robot.toml", "strict.toml", |text| {
        let named = text.replace("name = \"3\"", "name = \"elbow\"").replace("name = \"2\"", "name = \"3\"");
        // The first joint comes to 120 counts on this movement, the second to 99.
        format!("following_error_limit_counts = 110\n{named}")
    });
    let output = bench.run("record --board sim --robot strict.toml --out run.csv");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{stderr}");
    let told = "joint 3 is";
    assert!(stderr.contains(told) && !stderr.contains("elbow is"), "{stderr}");
    let manifest = armid::recording::Manifest::read(&bench.path("run.toml")).unwrap();
    let reason = manifest.partial.unwrap();
    assert!(reason.contains(told), "{reason}");
    assert!(bench.done("report run.csv --robot strict.toml").contains(&reason));
}

/// A limit left out would be the reference robot's: on another arm nothing moves within limits that are not its own.
#[test]
fn another_arm_needs_limits_of_its_own() {
    let bench = Bench::new();
    bench.done("new-robot --example direct-drive-double-pendulum --out pendulum.toml");
    for limit in ["position_low_rad", "speed_limit_rad_s"] {
        bench.spoil("pendulum.toml", "unlimited.toml", |text| {
            let kept = |line: &&str| !line.starts_with(limit);
            text.lines().filter(kept).map(|line| format!("{line}\n")).collect()
        });
        let missing = format!("{limit} of joint \"shoulder\" is missing");
        bench.refused(BAD_FILE, "record --board sim --robot unlimited.toml", &[&missing, "another arm"]);
    }
}

/// The axis of which only recordings are at hand cannot be moved by the board, and is told apart from files that are wrong.
#[test]
fn a_single_axis_is_read_but_not_moved() {
    let bench = Bench::new();
    bench.done("new-robot --example emps --out emps.toml");
    for command in ["record --board sim", "track --board sim", "simulate"] {
        bench.refused(BAD_FILE, &format!("{command} --robot emps.toml"), &["EMPS", "single axis"]);
    }
    bench.refused(USAGE, "new-robot --set kind=single-axis --set unit=m --set name=x --defaults", &["link1.moved"]);
}

#[test]
fn a_loop_that_ticks_between_the_samples_is_identified_within_its_errors_and_lacks_nothing() {
    const LARGEST_IN_STANDARD_ERRORS: f64 = 3.0;
    // What noise reaches in a few dozen null simulations of a loop that is stable.
    const MOST_BY_CHANCE: f64 = 100.0;
    let bench = Bench::new();
    bench.done("new-robot --example puma-560 --out puma.toml");
    let every_tick = std::fs::read_to_string(bench.path("puma.toml")).unwrap();
    let every_tenth = every_tick.replace("record_period_s = 0.0007", "record_period_s = 0.007");
    assert_ne!(every_tick, every_tenth);
    std::fs::write(bench.path("tenth.toml"), every_tenth).unwrap();
    for seed in [1, 2] {
        for (name, period_s) in [("slow", 5.0), ("fast", 3.65), ("kept", 4.3)] {
            bench.done(&format!(
                "simulate --robot tenth.toml --seed {seed} --period {period_s} --out {name}{seed}.csv --truth truth.toml"
            ));
        }
        let recordings = format!("slow{seed}.csv fast{seed}.csv");
        let found = bench.json(&format!("identify --robot tenth.toml {recordings}"));
        let truth: toml::Table = std::fs::read_to_string(bench.path("truth.toml")).unwrap().parse().unwrap();
        let true_f = truth["f"]["value"].as_array().unwrap().iter().map(|f| f.as_float().unwrap());
        let off: Vec<f64> = numbers(&found["f"])
            .iter()
            .zip(true_f)
            .zip(numbers(&found["standard_error"]))
            .map(|((found, truth), error)| (found - truth) / error)
            .collect();
        assert!(off.iter().all(|off| off.abs() < LARGEST_IN_STANDARD_ERRORS), "{off:?}");
        let explained = bench.json(&format!("explain --robot tenth.toml {recordings} --check kept{seed}.csv"));
        assert_eq!(explained["verdict"], "none", "{explained}");
        assert!(explained["threshold"].as_f64().unwrap() < MOST_BY_CHANCE, "{}", explained["threshold"]);
    }
    // Nor is what does lack something passed over.
    for (name, period_s) in [("slow", 5.0), ("fast", 3.65), ("kept", 4.3)] {
        bench.done(&format!(
            "simulate --robot tenth.toml --seed 4 --effect stribeck-friction:joint=2,extra_nm=0.03 --period {period_s} \
             --out {name}4.csv"
        ));
    }
    let explained = bench.json("explain --robot tenth.toml slow4.csv fast4.csv --check kept4.csv");
    assert_eq!(explained["effects"][0]["name"], "stribeck-friction", "{explained}");
}

#[test]
fn what_acts_by_weight_alone_is_not_identifiable_on_an_arm_that_feels_no_gravity() {
    const LARGEST_IN_STANDARD_ERRORS: f64 = 3.0;
    let bench = Bench::new();
    bench.done("new-robot --example puma-560 --out puma.toml");
    let text = std::fs::read_to_string(bench.path("puma.toml")).unwrap();
    let weightless = text.replace("gravity_m_s2 = 9.81", "gravity_m_s2 = 0.0");
    assert_ne!(text, weightless);
    std::fs::write(bench.path("flat.toml"), weightless).unwrap();
    for (name, period_s) in [("slow", 5.0), ("fast", 3.65)] {
        bench.done(&format!("simulate --robot flat.toml --period {period_s} --out {name}.csv --truth truth.toml"));
    }
    let found = bench.json("identify --robot flat.toml slow.csv fast.csv --out flat-model.toml");
    assert_eq!(found["not_identifiable"], serde_json::json!(["f5", "f6", "f8", "f9"]));
    let truth: toml::Table = std::fs::read_to_string(bench.path("truth.toml")).unwrap().parse().unwrap();
    let (f, errors) = (numbers(&found["f"]), numbers(&found["standard_error"]));
    for index in [0, 1, 2, 3, 6] {
        let off = (f[index] - truth["f"]["value"][index].as_float().unwrap()) / errors[index];
        assert!(errors[index] > 0.0 && off.abs() < LARGEST_IN_STANDARD_ERRORS, "f{}: {off}", index + 1);
    }
    // As much as is known of the others is that they are within their ranges.
    assert!([4, 5, 7, 8].iter().all(|&index| errors[index] > 0.5), "{errors:?}");
    let tracked = bench.json("track --board sim --robot flat.toml --model flat-model.toml --settle 0.5");
    assert!(numbers(&tracked["ctc"]["within_one_count"]).iter().all(|&percent| percent > 99.0), "{tracked}");
}

/// Its friction lets go of a motor within an integration step, which shows on counts as fine as these; and the shoulder
/// moves the load of an elbow that sticks, which is no stop.
#[test]
fn a_small_arm_that_sticks_lacks_nothing_and_runs_into_nothing() {
    let bench = Bench::new();
    for (name, text) in [
        ("robot", include_str!("desk_arm/robot.toml")),
        ("slow", include_str!("desk_arm/slow.toml")),
        ("fast", include_str!("desk_arm/fast.toml")),
        ("kept", include_str!("desk_arm/kept.toml")),
    ] {
        std::fs::write(bench.path(&format!("{name}.toml")), text).unwrap();
    }
    for name in ["slow", "fast", "kept"] {
        bench.done(&format!("simulate --robot robot.toml --seed 8 --trajectory {name}.toml --out {name}-run.csv"));
    }
    let explained = bench.json("explain --robot robot.toml slow-run.csv fast-run.csv --check kept-run.csv");
    assert_eq!(explained["verdict"], "none", "{explained}");

    bench.done("simulate --robot robot.toml --seed 3 --trajectory fast.toml --out sticking.csv");
    let identified = bench.run("identify --robot robot.toml sticking.csv");
    let told = String::from_utf8_lossy(&identified.stderr);
    assert!(identified.status.success() && !told.contains("left out"), "{told}");
}

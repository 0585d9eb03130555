//! Every kind of bad file is refused by file, line, value, limit and remedy; good files read back the same.

#![expect(clippy::result_large_err, reason = "only tests")]

use std::path::{Path, PathBuf};

use armid::file_error::{FileError, Problem};
use armid::model::Model;
use armid::recording::{Manifest, ManifestJoint, Mode, ReadOptions, Recording};
use armid::robot::{Kind, Law, Robot};

const STRICT: ReadOptions = ReadOptions { allow_gaps: false };
const LENIENT: ReadOptions = ReadOptions { allow_gaps: true };

/// A small well-formed recording of the paper's robot: the current follows the error one tick later.
fn good_csv() -> String {
    let mut text = String::from("tick,ref2,ref3,err2,err3,cur2,cur3\n");
    let error = |tick: i32| [tick % 40 - 20, 30 - (tick * 7) % 61];
    for tick in 0..120 {
        let [e2, e3] = error(tick);
        let [p2, p3] = error((tick - 1).max(0));
        let (c2, c3) = (0.036 * f64::from(p2), 0.048 * f64::from(p3));
        text += &format!("{tick},{},{},{e2},{e3},{c2:.4},{c3:.4}\n", tick * 3, -tick * 2);
    }
    text
}

fn read(csv: &str, options: ReadOptions) -> Result<Recording, FileError> {
    Recording::from_bytes(Path::new("run.csv"), csv.as_bytes(), &Robot::paper(), options, None)
}

/// The error's text, which must contain every one of `parts`.
fn refused<T: std::fmt::Debug>(result: Result<T, FileError>, parts: &[&str]) -> FileError {
    let error = result.expect_err("should have been refused");
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
    error
}

fn with_line(line: usize, new: &str) -> String {
    good_csv().lines().enumerate().map(|(at, old)| if at + 1 == line { new } else { old }.to_string() + "\n").collect()
}

#[test]
fn a_good_recording_is_read_whole() {
    let recording = read(&good_csv(), STRICT).unwrap();
    assert_eq!(recording.samples(), 120);
    assert_eq!(recording.reference_counts[1][119], -238.0);
    assert_eq!(recording.mode(), Mode::P);
    assert!(recording.notes.is_empty());
}

#[test]
fn a_wrong_column_count_names_its_line() {
    let error = refused(read(&with_line(7, "5,15,-10,1,2,0.1"), STRICT), &["run.csv:7", "6 columns", "7"]);
    assert!(matches!(error.problem, Problem::ColumnCount { found: 6, expected: 7 }));
}

#[test]
fn a_wrong_header_shows_the_right_one() {
    refused(read(&with_line(1, "time,ref2,ref3,err2,err3,cur2,cur3"), STRICT), &["run.csv:1", "tick,ref2,ref3,err2"]);
    refused(read("", STRICT), &["header", "tick,ref2"]);
    refused(read("0,0,0,0,0,0,0\n", STRICT), &["put the header line back"]);
}

#[test]
fn swapped_joints_are_found_by_header_and_by_contents() {
    let error = refused(read(&with_line(1, "tick,ref3,ref2,err3,err2,cur3,cur2"), STRICT), &["swapped", "order"]);
    assert!(matches!(error.problem, Problem::SwappedJoints { .. }));
    refused(read(&with_line(1, "tick,ref1,ref2,err1,err2,cur1,cur2"), STRICT), &["joints with other names"]);

    let exchange = |line: &str| {
        let f: Vec<&str> = line.split(',').collect();
        [f[0], f[2], f[1], f[4], f[3], f[6], f[5]].join(",") + "\n"
    };
    let text = good_csv();
    let (header, body) = text.split_once('\n').unwrap();
    let exchanged = format!("{header}\n{}", body.lines().map(exchange).collect::<String>());
    let error = refused(read(&exchanged, STRICT), &["swapped", "0.048", "0.036", "exchange"]);
    assert!(matches!(error.problem, Problem::SwappedJoints { .. }));
}

#[test]
fn a_current_against_its_error_is_refused() {
    let turned: String = good_csv()
        .lines()
        .enumerate()
        .map(|(at, line)| {
            let mut fields: Vec<String> = line.split(',').map(str::to_string).collect();
            if at > 0 {
                fields[5] = (-fields[5].parse::<f64>().unwrap()).to_string();
            }
            fields.join(",") + "\n"
        })
        .collect();
    let error = refused(read(&turned, STRICT), &["cur2 falls when err2 rises", "correlation"]);
    assert!(matches!(error.problem, Problem::CurrentAgainstError { .. }));
}

#[test]
fn numbers_that_are_none_name_line_and_column() {
    for (text, limit) in
        [("nan", "finite"), ("inf", "finite"), ("abc", "a number"), ("", "a number"), ("1e300", "within")]
    {
        refused(
            read(&with_line(9, &format!("7,21,-14,{text},2,0.1,0.1")), STRICT),
            &["run.csv:9", "err2", text, limit],
        );
        refused(read(&with_line(9, &format!("7,21,-14,1,2,0.1,{text}")), STRICT), &["run.csv:9", "cur3", text, limit]);
    }
    refused(
        read(&with_line(9, "7,21.5,-14,1,2,0.1,0.1"), STRICT),
        &["ref2 is 21.5", "whole number", "quantised = false"],
    );
    refused(read(&with_line(9, "-7,21,-14,1,2,0.1,0.1"), STRICT), &["tick is -7", "whole number"]);
}

#[test]
fn gaps_are_refused_unless_allowed() {
    let gap: String =
        good_csv().lines().enumerate().filter(|(at, _)| *at != 50).map(|(_, l)| format!("{l}\n")).collect();
    let error = refused(read(&gap, STRICT), &["run.csv:51", "from 48 to 50", "1 samples are missing", "--allow-gaps"]);
    assert!(matches!(error.problem, Problem::Gap { from: 48, to: 50, missing: 1 }));
    assert_eq!(read(&gap, LENIENT).unwrap().samples(), 119);

    let late: String =
        good_csv().lines().enumerate().filter(|(at, _)| *at != 1).map(|(_, l)| format!("{l}\n")).collect();
    refused(read(&late, STRICT), &["run.csv:2", "tick is 1", "0 on the first line"]);
    let twice = with_line(60, "12,0,0,0,0,0,0");
    for options in [STRICT, LENIENT] {
        refused(read(&twice, options), &["run.csv:60", "tick 12 follows tick 57"]);
    }
}

#[test]
fn a_cut_file_is_noticed_wherever_it_was_cut() {
    let whole = good_csv();
    let last_line_start = whole.trim_end().rfind('\n').unwrap() + 1;
    for end in last_line_start + 1..whole.len() {
        match read(&whole[..end], STRICT) {
            Err(error) => assert!(matches!(error.problem, Problem::Truncated { .. }), "{error}"),
            // Only a cut within the last number can go unseen as an error: it is pointed out.
            Ok(recording) => assert!(recording.notes[0].contains("may be cut off"), "{:?}", recording.notes),
        }
    }
    let cut = &whole[..last_line_start + 5];
    refused(read(cut, STRICT), &["run.csv:121", "cut off", "copy the file again"]);
    assert_eq!(read(cut, LENIENT).unwrap().samples(), 119);
}

#[test]
fn too_short_and_unreadable_files_say_so() {
    let short: String = good_csv().lines().take(21).map(|line| format!("{line}\n")).collect();
    refused(read(&short, STRICT), &["20 samples", "at least 50"]);
    refused(
        Recording::read(Path::new("/nowhere/run.csv"), &Robot::paper(), STRICT),
        &["/nowhere/run.csv", "check the path"],
    );
    refused(
        Recording::from_bytes(Path::new("run.csv"), b"tick\xff\n", &Robot::paper(), STRICT, None),
        &["not UTF-8", "byte 4"],
    );
}

const ROBOT: &str = r#"name = "PUMA 560, links 2 and 3"
gravity_m_s2 = 9.81
record_period_s = 0.0007
loop_period_s = 0.0007
command_delay_s = 0.00003
[[joint]]
name = "2"
gear_ratio = 107.8
counts_per_rev = 800
torque_constant_nm_per_a = 0.25
position_gain_a_per_count = 0.036
current_limit_a = 12.0
viscous_friction_nm_s_per_rad = 0.817e-3
coulomb_friction_nm = 0.124
[[joint]]
name = "3"
gear_ratio = -53.7
counts_per_rev = 1000
torque_constant_nm_per_a = 0.25
position_gain_a_per_count = 0.048
lead = 0.0
current_limit_a = 12.0
viscous_friction_nm_s_per_rad = 1.38e-3
coulomb_friction_nm = 0.146
"#;

fn robot(text: &str) -> Result<Robot, FileError> {
    Robot::from_bytes(Path::new("robot.toml"), text.as_bytes().to_vec())
}

#[test]
fn the_paper_robot_is_the_file_of_the_contract() {
    assert_eq!(robot(ROBOT).unwrap(), Robot::paper());
}

#[test]
fn impossible_robots_name_line_value_limit_and_remedy() {
    let changed = |from: &str, to: &str| {
        assert!(ROBOT.contains(from));
        robot(&ROBOT.replacen(from, to, 1))
    };
    refused(
        changed("gear_ratio = 107.8", "gear_ratio = 0"),
        &["robot.toml:8", "gear_ratio of joint \"2\" is 0", "other than 0", "motor turns per joint turn"],
    );
    refused(changed("= 1000", "= -1000"), &["robot.toml:18", "counts_per_rev of joint \"3\" is -1000", "above 0"]);
    refused(changed("= 1000", "= nan"), &["robot.toml:18", "NaN", "above 0"]);
    refused(changed("= 0.124", "= -0.1"), &["robot.toml:14", "coulomb_friction_nm", "0 or above"]);
    refused(changed("name = \"3\"", "name = \"2\""), &["robot.toml:16", "a name of its own"]);
    refused(changed("loop_period_s = 0.0007", "loop_period_s = 0.0005"), &["robot.toml:4", "whole fraction"]);
    refused(changed("0.00003", "0.0009"), &["robot.toml:5", "command_delay_s is 0.0009", "below one loop period"]);
    refused(changed("gear_ratio", "gear_ration"), &["robot.toml:8", "unknown field", "did you mean `gear_ratio`?"]);
    refused(changed("gear_ratio = 107.8\n", ""), &["robot.toml:7", "gear_ratio of joint \"2\" is missing"]);
    refused(changed("= 107.8", "= \"107.8\""), &["robot.toml:8", "invalid type"]);
    refused(changed("record_period_s = 0.0007\n", ""), &["record_period_s", "missing"]);
    refused(robot(&(ROBOT.to_string() + "[search]\nf10 = [0, 1]\n")), &["robot.toml:26", "`f10`", "f1 to f9"]);
    refused(robot(&(ROBOT.to_string() + "[search]\nf1 = [2, 1]\n")), &["robot.toml:26", "[2, 1]", "low below high"]);
    let one_joint = ROBOT.rsplit_once("[[joint]]").unwrap().0;
    refused(robot(one_joint), &["[[joint]]", "is 1", "must be 2", "single-axis"]);
}

#[test]
fn gains_above_the_stability_limit_are_refused_for_motion_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.toml");
    std::fs::write(&path, ROBOT.replace("= 0.048", "= 0.4")).unwrap();
    assert!(Robot::read(&path).is_ok());
    let error = refused(
        Robot::read_for_motion(&path),
        &[
            "robot.toml:20",
            "joint 3",
            "0.10000 N m/count",
            "stability limit 0.02",
            "lower the gain",
            "nothing was moved",
        ],
    );
    assert!(error.is_unsafe());

    // The paper's gains at its loop card's 50 µs hold the arm within ±10 counts and must pass.
    let stiff = ROBOT
        .replace("loop_period_s = 0.0007", "loop_period_s = 0.00005")
        .replace("= 0.036", "= 0.384")
        .replace("= 0.048", "= 0.376");
    std::fs::write(&path, &stiff).unwrap();
    assert_eq!(Robot::read_for_motion(&path).unwrap().loop_ticks_per_record(), 14);
    std::fs::write(&path, ROBOT.replace("viscous_friction_nm_s_per_rad = 1.38e-3\n", "")).unwrap();
    refused(Robot::read_for_motion(&path), &["robot.toml:16", "viscous_friction", "missing"]);
}

const MODEL: &str = "[f]\nvalue = [1.647, 1.07, -0.011, -0.958, -0.025, -2.219, 5.609, -0.104, 4.875]\n\
    [friction]\nviscous_nm_s_per_rad = [8e-4, 1.3e-3]\ncoulomb_nm = [0.12, 0.15]\n";

#[test]
fn impossible_models_are_refused() {
    let model = |text: &str| Model::from_bytes(Path::new("model.toml"), text.as_bytes().to_vec(), &Robot::paper());
    assert_eq!(model(MODEL).unwrap().coulomb_nm, [0.12, 0.15]);
    refused(
        model(&MODEL.replace("5.609", "1.9")),
        &["model.toml:2", "not positive definite", "det D", "q3 =", "identify the arm again"],
    );
    refused(model(&MODEL.replace("1.647", "-1")), &["model.toml:2", "f1 is -1", "above 0"]);
    refused(model(&MODEL.replace("1.07,", "nan,")), &["model.toml:2", "f2 is NaN"]);
    refused(model(&MODEL.replace("1.07, ", "")), &["f.value is a list of 8 numbers", "list of 9"]);
    refused(model(&MODEL.replace("[0.12, 0.15]", "[0.12]")), &["model.toml:5", "friction.coulomb_nm", "list of 2"]);
    refused(model(&MODEL.replace("0.12", "-0.12")), &["friction.coulomb_nm[0] is -0.12", "0 or above"]);
    let held_fast = ["model.toml:5", "Coulomb friction of joint 2 is 3.0 N m", "below 3.000", "identify the arm again"];
    refused(model(&MODEL.replace("0.12", "3")), &held_fast);
    for viscous in ["0.0104", "1e39", "1e308"] {
        let parts = ["model.toml:4", "viscous friction of joint 2 is", "below 0.01031", "speed limit of 2.7 rad/s"];
        refused(model(&MODEL.replace("8e-4", viscous)), &parts);
    }
    refused(model(&MODEL.replace("coulomb_nm", "coulombs_nm")), &["did you mean `coulomb_nm`?"]);
}

#[test]
fn files_read_back_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut robot = Robot::paper();
    robot.name = "a \"quoted\" name".into();
    robot.search[3] = [-1.5, 0.25];
    let path = folder.path().join("deep/er/robot.toml");
    robot.write(&path).unwrap();
    assert_eq!(Robot::read(&path).unwrap(), robot);

    let mut recording = read(&good_csv(), STRICT).unwrap();
    recording.command_a = Some(recording.current_a.clone());
    recording.manifest = Some(Manifest {
        rows: None,
        csv: None,
        mode: Mode::Ctc,
        robot: robot.name.clone(),
        trajectory: "paper, T = 3.65 s".into(),
        tool: armid::TOOL_VERSION.into(),
        firmware: String::new(),
        record_period_s: Some(0.0007),
        loop_period_s: Some(0.0007),
        seed: Some(7),
        model_crc: None,
        rows_read_again: Some(3),
        partial: Some("the board went away".into()),
        joint: ["2", "3"]
            .map(|name| ManifestJoint { name: name.into(), position_gain_a_per_count: 0.03, lead: 2.0 })
            .to_vec(),
    });
    recording.path = folder.path().join("run.csv");
    recording.write(&recording.path, &robot).unwrap();
    assert_eq!(Recording::read(&recording.path, &robot, STRICT).unwrap(), recording);

    let model = Model::from_bytes(Path::new("m"), MODEL.as_bytes().to_vec(), &robot).unwrap();
    let path = folder.path().join("model.toml");
    model.write(&path).unwrap();
    assert_eq!(Model::read(&path, &robot).unwrap(), model);
    let left: Vec<PathBuf> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(left.iter().all(|path| path.extension().is_none_or(|ending| ending != "part")), "{left:?}");
}

/// Neither of the two takes its place before both are on disk.
#[test]
fn a_recording_that_cannot_be_written_leaves_the_manifest_that_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let robot = Robot::paper();
    let mut recording = read(&good_csv(), STRICT).unwrap();
    recording.manifest = Some(toml::from_str("mode = \"p\"").unwrap());
    let (csv, manifest) = (folder.path().join("run.csv"), folder.path().join("run.toml"));
    std::fs::create_dir(&csv).unwrap();
    std::fs::write(&manifest, "of another").unwrap();
    refused(recording.write(&csv, &robot), &["run.csv", "cannot be written", "folder"]);
    assert_eq!(std::fs::read(&manifest).unwrap(), b"of another");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "something was left behind");
}

/// The data folder beside the checkout, where this machine has it.
fn data() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: {} is not there", folder.display());
    None
}

#[test]
fn the_sample_recordings_are_read() {
    let Some(data) = data() else { return };
    for case in ["healthy", "coulomb-friction-joint-2-plus-30-percent"] {
        let folder = data.join("sample").join(case);
        let robot = Robot::read_for_motion(&folder.join("robot.toml")).unwrap();
        let samples = ["train1.csv", "train2.csv", "check.csv"]
            .map(|name| Recording::read(&folder.join(name), &robot, STRICT).unwrap().samples());
        assert_eq!(samples, [5214, 7143, 6143]);
        Model::read(&folder.join("model.toml"), &robot).unwrap();
    }
}

#[test]
fn the_positioning_axis_is_read() {
    let Some(data) = data() else { return };
    let robot = Robot::read(&data.join("emps/robot.toml")).unwrap();
    assert_eq!(robot.kind, Kind::SingleAxis);
    assert!((robot.joints[0].counts_per_rad() / 2e7 - 1.0).abs() < 1e-12);
    assert_eq!(robot.joints[0].torque_constant_nm_per_a, 35.1507);
    assert!(matches!(robot.joints[0].law, Law::Cascade { .. }));
    let recording = Recording::read(&data.join("emps/identification.csv"), &robot, STRICT).unwrap();
    assert_eq!(recording.samples(), 24841);
}

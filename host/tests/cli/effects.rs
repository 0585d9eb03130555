//! Effects that a model has: compensated, left out by name, found and shown.

use serde_json::Value;

use crate::bench::{BAD_FILE, Bench, USAGE, numbers};
use crate::page::Page;

const EFFECTS: &str = "--effect cogging:joint=3,amplitude_nm=0.1,order=3,phase_rad=0.5 \
    --effect asymmetric-friction:joint=2,difference_nm=0.14 --effect torque-offset:joint=3,torque_nm=-0.05";

fn rms(tracked: &Value, field: &str) -> Vec<f64> {
    numbers(&tracked[field]["rms_error_counts"])
}

#[test]
fn track_shows_errors_with_and_without_the_effects_of_the_model() {
    let bench = Bench::new();
    bench.done(&format!("simulate --seed 3 --settle 0 --out x.csv --truth model.toml {EFFECTS}"));
    let arguments = format!("track --board sim --seed 3 --settle 0.5 --model model.toml {EFFECTS}");
    let tracked = bench.json(&format!("{arguments} --out tracked"));
    let (without, with) = (rms(&tracked, "ctc_without_effects"), rms(&tracked, "ctc"));
    for joint in 0..2 {
        assert!(with[joint] < 0.6 && without[joint] > 2.0 * with[joint], "{without:?} {with:?}");
    }
    assert!(rms(&tracked, "p")[0] > 10.0);
    for file in ["p.csv", "ctc.csv", "ctc-without-effects.csv"] {
        assert!(bench.path("tracked").join(file).is_file(), "{file}");
    }
    bench.refused(USAGE, &format!("{arguments} --out tracked"), &["exists", "--force"]);
    let text = bench.done(&arguments);
    for part in ["position loop", "computed torque, effects left out", "computed torque, with effects"] {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
}

#[test]
fn compare_shows_the_effects_of_models() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out x.csv --truth plain.toml");
    bench.done(&format!("simulate --settle 0 --out y.csv --truth with.toml {EFFECTS}"));
    let text = bench.done("compare plain.toml with.toml");
    let row = text.lines().find(|line| line.starts_with("cogging 3 amplitude_nm")).unwrap_or_else(|| panic!("{text}"));
    assert!(row.contains('–') && row.ends_with("0.100000"), "{row}");
    // Friction is shown with its digits.
    let viscous = text.lines().find(|line| line.starts_with("viscous friction 2")).unwrap();
    let digits = viscous.split_whitespace().nth(3).unwrap().trim_start_matches(['0', '.', '-']);
    assert!(digits.len() >= 6, "{viscous}");
    let json = bench.json("compare plain.toml with.toml");
    assert_eq!(json["models"][0]["effects"].as_array().unwrap().len(), 0, "{json}");
    assert_eq!(json["models"][1]["effects"].as_array().unwrap().len(), 3, "{json}");
}

#[test]
fn effects_that_are_not_compensated_are_named() {
    let bench = Bench::new();
    let effects = "--effect backlash:joint=3,gap_rad=0.001 --effect cogging:joint=2,amplitude_nm=0.02";
    bench.done(&format!("simulate --settle 0 --out x.csv --truth model.toml {effects}"));
    let output = bench.run("upload model.toml --board sim --json");
    let stderr = String::from_utf8_lossy(&output.stderr);
    for part in
        ["joint 3: computed torque does not compensate backlash", "no encoder looks", "joint 2: cogging", "phase"]
    {
        assert!(stderr.contains(part), "no {part:?} in: {stderr}");
    }
    let uploaded: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(uploaded["compensated_effects"], serde_json::json!(["cogging of joint 2"]));
    assert_eq!(uploaded["effects_left_out"], serde_json::json!(["backlash of joint 3"]));
    assert!(bench.done("upload model.toml --board sim").contains("compensated: cogging of joint 2"));

    // Nothing to compensate, nothing to compare.
    bench.done("simulate --settle 0 --out y.csv --truth loose.toml --effect backlash:joint=3,gap_rad=0.001");
    let tracked = bench.json("track --board sim --settle 0.5 --model loose.toml");
    assert!(tracked["ctc_without_effects"].is_null() && tracked["ctc"].is_object());
    bench.spoil("model.toml", "bad.toml", |text| text.replace("amplitude_nm = 0.02", "amplitude_nm = 2000.0"));
    bench.refused(BAD_FILE, "upload bad.toml --board sim", &["cogging", "amplitude_nm is 2000"]);
}

/// Found, named, added and compensated, whatever was hidden.
#[test]
fn demo_explain_tells_the_whole_story() {
    let bench = Bench::new();
    for seed in [3, 5] {
        let shown = bench.json(&format!("demo explain --seed {seed} --out story --report page.html"));
        let (truth, found) = (&shown["truth"], &shown["explanation"]);
        assert_eq!(found["verdict"], "named", "seed {seed}: {found}");
        let named = found["effects"].as_array().unwrap().iter().any(|effect| {
            effect["joint"] == truth["joint"] && effect["class"].as_array().unwrap().contains(&truth["name"])
        });
        assert!(named, "seed {seed}: {truth} is not among {}", found["effects"]);
        assert_eq!(shown["truth_in_class"], true);
        let gap = |name: &str| found["gap"]["held_out"][name].as_f64().unwrap();
        let floor = found["gap"]["floor"].as_f64().unwrap();
        assert!(gap("after") < 0.9 * gap("before") && gap("after") < 1.1 * floor, "seed {seed}: {}", found["gap"]);
        let (without, with) = (rms(&shown, "ctc_without_effects"), rms(&shown, "ctc"));
        let healthy = rms(&shown, "ctc_healthy");
        for joint in 0..2 {
            assert!(with[joint] < 1.3 * healthy[joint], "seed {seed}: {with:?} for {healthy:?}");
        }
        assert!((0..2).any(|joint| without[joint] > 1.3 * with[joint]), "seed {seed}: {without:?} {with:?}");
        for file in ["baseline.toml", "extended.toml", "report.html", "tracking.svg", "changed-check.csv"] {
            assert!(bench.path("story").join(file).is_file(), "{file}");
        }
        let explained =
            ["Findings", "Effects named", "Gap", "What was tried", "Ruled out by the screen", "Pictures", "Parameters"];
        let page = Page::read(&bench, "story/report.html");
        page.expect_sections(&[&explained[..], &["Provenance"]].concat());
        assert_eq!(page.column("Gap", 0, 1)[0], found["gap"]["before"].as_f64().unwrap());
        assert_eq!(page.column("Gap", 0, 2)[1], gap("after"));
        assert_eq!(page.table("What was tried", 0).len(), found["candidates"].as_array().unwrap().len());
        let page = Page::read(&bench, "page.html");
        page.expect_sections(&[&["Tracking", "Currents", "The truth"], &explained[..], &["Provenance"]].concat());
        assert_eq!(page.column("Tracking", 0, 3)[4..], with);
    }
    let shown = bench.done("demo --help");
    assert!(shown.contains("demo explain --seed"), "{shown}");
}

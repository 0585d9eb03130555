//! Report pages: whole, closed in themselves, and with the numbers that the commands print.

use serde_json::Value;

use crate::bench::{BAD_FILE, Bench, FAILED, USAGE, numbers};
use crate::page::Page;

const REPEATED: [&str; 3] =
    ["Tracking errors, measured and simulated", "Currents, measured and simulated", "Residual maps"];

/// Values named `name` in a list of JSON objects.
fn all(list: &Value, name: &str) -> Vec<f64> {
    list.as_array().unwrap().iter().map(|one| one[name].as_f64().unwrap()).collect()
}

#[test]
fn recordings_and_a_model_on_disk_make_a_page() {
    let bench = Bench::new().with_recording();
    let shown = bench.json("report run.csv --model truth.toml --out page.html");
    let page = Page::read(&bench, "page.html");
    page.expect_sections(&[&["Parameters"], &REPEATED[..], &["Provenance"]].concat());
    let parameters = page.table("Parameters", 0);
    let model = armid::model::Model::read(&bench.path("truth.toml"), &armid::robot::Robot::paper()).unwrap();
    for (row, f) in parameters.iter().zip(model.f) {
        assert_eq!(row[1].parse::<f64>().unwrap(), f);
    }
    // The paper's f9, and its scatter.
    assert_eq!(parameters[8][5..], ["10.2", "3"]);
    let difference = page.column(REPEATED[0], 0, 4);
    for (difference, told) in difference.iter().zip(numbers(&shown["closed_loop_rms_counts"])) {
        assert!((difference - told).abs() < 1e-9, "{difference} {told}");
    }
    assert_eq!(page.column(REPEATED[2], 0, 1), numbers(&shown["innovation_rms_counts"]));
    let pictures = page.pictures(REPEATED[0]);
    assert_eq!(pictures[0], "joint 2, run.csv");
    assert_eq!(pictures.len(), 4, "{pictures:?}");
    assert!(page.legends(REPEATED[0]).starts_with(&["measured".into(), "simulated".into()]));
    let maps = page.pictures(REPEATED[2]);
    for over in ["position and speed", "over position", "over speed", "over time"] {
        assert!(
            maps.iter().filter(|title| title.starts_with("joint 3") && title.ends_with(over)).count() == 1,
            "{maps:?}"
        );
    }
    let provenance = page.text();
    for part in
        [armid::TOOL_VERSION, "armid report run.csv --model truth.toml --out page.html --json", "paper, T = 3.65 s"]
    {
        assert!(provenance.contains(part), "no {part:?}");
    }
    let files = page.table("Provenance", 2);
    let names: Vec<&str> = files.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(names, ["run.csv", "run.toml", "truth.toml"]);
    let length = std::fs::metadata(bench.path("run.csv")).unwrap().len();
    assert_eq!(files[0][2], length.to_string());
    assert!(files.iter().all(|row| row[3].len() == 64), "{files:?}");

    // Without a model, what was measured; made again, the same page to the byte.
    bench.done("report run.csv --out measured.html");
    Page::read(&bench, "measured.html").expect_sections(&["Tracking errors", "Currents", "Provenance"]);
    let before = std::fs::read(bench.path("measured.html")).unwrap();
    bench.done("report run.csv --out measured.html");
    assert_eq!(std::fs::read(bench.path("measured.html")).unwrap(), before);
    bench.refused(BAD_FILE, "report absent.csv --out page.html", &["absent.csv"]);
}

/// The simulated arm of the truth errs under computed torque as the recorded one did, with the controller's own model, wrong
/// as it is; with the true one it would not.
#[test]
fn a_movement_under_computed_torque_is_made_once_more() {
    const SECTION: &str = "Computed torque, measured and simulated";
    let bench = Bench::new().with_recording();
    bench.spoil("truth.toml", "wrong.toml", |text| {
        let mut model: toml::Table = text.parse().unwrap();
        for coulomb_nm in model["friction"]["coulomb_nm"].as_array_mut().unwrap() {
            *coulomb_nm = (0.5 * coulomb_nm.as_float().unwrap()).into();
        }
        toml::to_string(&model).unwrap()
    });
    let ctc = "simulate --model truth.toml --controller-model wrong.toml --mode ctc --seed 9 --settle 1 --out ctc.csv";
    bench.done(ctc);
    let shown = bench.json("report run.csv ctc.csv --model truth.toml --controller-model wrong.toml --out page.html");
    let page = Page::read(&bench, "page.html");
    page.expect_sections(
        &[&["Parameters"], &REPEATED[..], &[SECTION, "Currents under computed torque"], &["Provenance"]].concat(),
    );
    let (measured, simulated) = (page.column(SECTION, 0, 2), page.column(SECTION, 0, 3));
    assert_eq!(simulated, numbers(&shown["simulated_under_computed_torque"][0]["rms_error_counts"]));
    for (measured, simulated) in measured.iter().zip(&simulated) {
        assert!((simulated / measured - 1.0).abs() < 0.05, "{measured} {simulated}");
    }
    assert_eq!(page.pictures(SECTION), ["joint 2, ctc.csv", "joint 3, ctc.csv"]);

    // The manifest knows which model the board had.
    bench.done("report ctc.csv --model truth.toml --out page.html");
    let page = Page::read(&bench, "page.html");
    for (measured, exact) in measured.iter().zip(page.column(SECTION, 0, 3)) {
        assert!(exact < 0.5 * measured, "{measured} {exact}");
    }
    assert!(page.text().contains("give the one it ran with as --controller-model"));

    // What cannot be made again is shown as measured: a movement cut short, one of another name, one that changed.
    for (from, to, reason) in [
        ("mode = ", "partial = 'stopped'\nmode = ", "only part of the movement"),
        ("paper, T = 3.65 s", "gone.toml", "gone.toml"),
        ("paper, T = 3.65 s", "paper, T = 3.64 s", "counts from that of the movement"),
    ] {
        bench.spoil("ctc.toml", "other.toml", |text| text.replacen(from, to, 1));
        std::fs::copy(bench.path("ctc.csv"), bench.path("other.csv")).unwrap();
        bench.done("report other.csv --model truth.toml --out page.html");
        let page = Page::read(&bench, "page.html");
        page.expect_sections(&["Parameters", "Not simulated", "Tracking errors", "Currents", "Provenance"]);
        assert!(page.text().contains("other.csv is shown as measured") && page.text().contains(reason), "{reason}");
    }
}

#[test]
fn an_identification_shows_its_parameters_search_and_certainty() {
    let bench = Bench::new().with_recording();
    let found = bench.json("identify run.csv --robot robot.toml --report page.html --out model.toml");
    let page = Page::read(&bench, "page.html");
    let judged = "How well the model repeats the recordings";
    page.expect_sections(&[&["Parameters", judged, "Search", "Correlations"], &REPEATED[..], &["Provenance"]].concat());
    assert_eq!(page.column("Parameters", 0, 1), all(&found["parameters"], "value"));
    assert_eq!(page.column("Parameters", 0, 2), all(&found["parameters"], "standard_error"));
    assert_eq!(page.column(judged, 0, 2), numbers(&found["rms_counts"]));
    assert_eq!(page.column(judged, 0, 3), numbers(&found["innovation_rms_counts"]));
    for (row, told) in page.table("Correlations", 0).iter().zip(found["correlations"].as_array().unwrap()) {
        let row: Vec<f64> = row[1..].iter().map(|cell| cell.parse().unwrap()).collect();
        assert_eq!(row, numbers(told));
    }
    let number = format!("{:.3e}", found["condition_number"].as_f64().unwrap());
    assert!(page.text().contains(&number));
    let files: Vec<String> =
        page.table("Provenance", 2).into_iter().map(|row| format!("{} {}", row[0], row[1])).collect();
    assert_eq!(files, ["run.csv read", "run.toml read", "robot.toml read", "model.toml written"]);

    // The paper's algorithm has no standard errors, but four subpopulations that can be watched.
    let found = bench.json("identify run.csv --method paper --report paper.html");
    let page = Page::read(&bench, "paper.html");
    page.expect_sections(&[&["Parameters", judged, "Search"], &REPEATED[..], &["Provenance"]].concat());
    assert_eq!(page.legends("Search"), [1, 2, 3, 4].map(|index| format!("subpopulation {index}")));
    assert_eq!(page.column("Search", 0, 3)[1], found["least_objective_counts2"].as_f64().unwrap());
}

#[test]
fn recording_and_calibration_have_pages() {
    let bench = Bench::new();
    let recorded = bench.json("record --board sim --settle 0.5 --out run.csv --report page.html");
    let page = Page::read(&bench, "page.html");
    page.expect_sections(&["Tracking errors", "Currents", "Provenance"]);
    assert_eq!(page.column("Tracking errors", 0, 2), numbers(&recorded["max_abs_error_counts"]));
    assert_eq!(page.column("Tracking errors", 0, 3), numbers(&recorded["rms_error_counts"]));
    assert_eq!(page.table("Provenance", 2)[0][..2], ["run.csv", "written"]);

    let found = bench.json("calibrate run.csv --report gains.html");
    let page = Page::read(&bench, "gains.html");
    page.expect_sections(&["Position loop", "Provenance"]);
    let gains: Vec<f64> = found["joints"]
        .as_array()
        .unwrap()
        .iter()
        .map(|joint| joint["position_gain_a_per_count"]["value"].as_f64().unwrap())
        .collect();
    assert_eq!(page.column("Position loop", 0, 1), gains);
    assert_eq!(page.pictures("Position loop"), ["joint 2, run.csv", "joint 3, run.csv"]);
}

#[test]
fn tracking_and_a_load_have_pages() {
    let bench = Bench::new();
    bench.done("simulate --settle 0 --out run.csv --truth truth.toml --seed 1");
    let tracked = bench.json("track --board sim --settle 0.5 --model truth.toml --report page.html");
    let page = Page::read(&bench, "page.html");
    page.expect_sections(&["Tracking", "Currents", "Parameters", "Provenance"]);
    let told = |name: &str| [numbers(&tracked["p"][name]), numbers(&tracked["ctc"][name])].concat();
    for (column, name) in
        ["max_abs_error_counts", "rms_error_counts", "within_one_count", "torque_rms_nm", "time_in_limits_s"]
            .into_iter()
            .enumerate()
    {
        assert_eq!(page.column("Tracking", 0, column + 2), told(name), "{name}");
    }
    let titles = page.pictures("Tracking");
    assert_eq!(titles[..2], ["joint 2, position loop", "joint 2, computed torque"]);
    assert!(page.text().contains("not kept"));

    let found = bench.json("load --board sim --seed 1 --model truth.toml --load-kg 1.72 --report load.html");
    let page = Page::read(&bench, "load.html");
    page.expect_sections(&[
        "Load",
        "Load over time",
        "Tracking",
        "What was told",
        "Currents",
        "Parameters",
        "Provenance",
    ]);
    let mass = page.table("Load", 0)[0].clone();
    for (cell, name) in mass[1..].iter().zip(["mass_kg", "standard_error_kg"]) {
        // The board reckons in single precision.
        assert_eq!(cell.parse::<f64>().unwrap() as f32, found[name].as_f64().unwrap() as f32, "{name}");
    }
    assert_eq!(page.table("What was told", 0).len(), found["events"].as_array().unwrap().len());
    assert!(page.legends("Load over time").contains(&"95 % interval".to_string()));
    assert_eq!(page.column("Tracking", 0, 2), numbers(&found["max_abs_error_counts"]));
}

#[test]
fn comparisons_and_designed_movements_have_pages() {
    let bench = Bench::new().with_recording();
    bench.done("simulate --settle 0.5 --out other.csv --seed 2 --truth second.toml");
    let compared = bench.json("compare run.csv other.csv --report recordings.html --plot errors.svg");
    let page = Page::read(&bench, "recordings.html");
    page.expect_sections(&["Differences", "Provenance"]);
    let joints = &compared["differences"][0]["joints"];
    assert_eq!(page.column("Differences", 0, 4), all(joints, "error_rms_counts"));
    assert_eq!(page.legends("Differences")[..2], ["run.csv", "other.csv"]);
    let svg = std::fs::read_to_string(bench.path("errors.svg")).unwrap();
    let svg = roxmltree::Document::parse(&svg).unwrap();
    assert_eq!(svg.root_element().tag_name().name(), "svg");

    let compared = bench.json("compare truth.toml second.toml run.csv --report models.html");
    let page = Page::read(&bench, "models.html");
    let of = |name: &str| REPEATED.map(|title| format!("{title}: {name}"));
    let expected = [
        &["Parameters".to_string(), "How well each repeats the recordings".into()][..],
        &of("truth.toml"),
        &of("second.toml"),
        &["Provenance".into()],
    ];
    assert_eq!(page.sections(), expected.concat());
    for (index, model) in compared["models"].as_array().unwrap().iter().enumerate() {
        let gaps = page.column("How well each repeats the recordings", 0, 2);
        assert_eq!(gaps[2 * index..2 * index + 2], numbers(&model["gap"]["closed_loop_rms_counts"]));
        assert_eq!(page.column("Parameters", 0, 1 + 2 * index), all(&model["parameters"], "value"));
    }

    // What the terminal shows of effects, the page does.
    bench.done("simulate --settle 0 --effect backlash:joint=3,gap_rad=0.002 --out rattling.csv --truth loose.toml");
    let compared = bench.done("compare truth.toml loose.toml --report effects.html");
    assert!(compared.contains("backlash 3 gap_rad"), "{compared}");
    let page = Page::read(&bench, "effects.html");
    page.expect_sections(&["Parameters", "Effects", "Provenance"]);
    let effect = ["backlash", "3", "gap_rad", "–", "–", "0.002", "–"].map(String::from).to_vec();
    assert!(page.table("Effects", 0).contains(&effect), "{:?}", page.table("Effects", 0));

    let designed = bench.json("excite --generations 2 --duration 4 --report movement.html");
    let page = Page::read(&bench, "movement.html");
    page.expect_sections(&["Predicted standard errors", "Movement", "Margins", "Provenance"]);
    let promised = &designed["parameters"];
    assert_eq!(page.column("Predicted standard errors", 0, 1), all(promised, "standard_error"));
    assert_eq!(page.column("Predicted standard errors", 0, 3), all(promised, "paper_standard_error"));
    assert_eq!(page.pictures("Movement").len(), 4);
}

/// Whatever a robot, a movement or a file is called, it is words on a page. (Joints have plain names in robot files.)
#[test]
fn hostile_names_are_only_names() {
    let bench = Bench::new();
    let hostile = "<script>alert(1)</script>&\"'<img src=http://example.org/x.png onerror=alert(1)>";
    let robot = armid::robot::Robot { name: hostile.into(), ..armid::robot::Robot::paper() };
    robot.write(&bench.path("hostile.toml")).unwrap();
    let csv = "<b>&run.csv";
    bench.done(&format!("simulate --robot hostile.toml --settle 0 --out {csv} --truth truth.toml"));
    bench.spoil("<b>&run.toml", "<b>&run.toml", |text| {
        text.replace("paper, T = 3.65 s", "<a href='http://example.org'>").replace("simulated", "<iframe>")
    });
    bench.done(&format!("report --robot hostile.toml --model truth.toml {csv} --out page.html"));
    std::fs::copy(bench.path(csv), bench.path("<i>.csv")).unwrap();
    bench.done(&format!("compare --robot hostile.toml {csv} <i>.csv --report compared.html --plot errors.svg"));
    let text = Page::read(&bench, "page.html").text();
    for part in [hostile, "joint 2, <b>&run.csv", "<a href='http://example.org'>", "<iframe>", "'<b>&run.csv'"] {
        assert!(text.contains(part), "no {part:?} in {text}");
    }
    assert!(Page::read(&bench, "compared.html").text().contains(hostile));
    let svg = std::fs::read_to_string(bench.path("errors.svg")).unwrap();
    let svg = roxmltree::Document::parse(&svg).unwrap();
    assert!(svg.descendants().any(|node| node.is_text() && node.text().unwrap().contains("<i>.csv")));
}

#[test]
fn a_page_that_cannot_be_written_is_told_before_the_work() {
    let bench = Bench::new().with_recording();
    std::fs::create_dir(bench.path("folder")).unwrap();
    let commands = [
        "record --board sim --out new.csv",
        "track --board sim --model truth.toml",
        "load --board sim --load-kg 1",
        "identify run.csv",
        "explain run.csv",
        "calibrate run.csv",
        "compare run.csv run.csv",
        "excite",
        "demo",
        "demo explain",
        "demo load",
        "bench paper",
        "bench explain --dir .",
    ];
    for command in commands {
        for page in ["folder", "robot.toml/page.html"] {
            let output = bench.run(&format!("{command} --report {page}"));
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(FAILED), "{command} --report {page}: {stderr}");
            assert!(stderr.starts_with("error") && stderr.contains("cannot be written"), "{command}: {stderr}");
        }
    }
    assert!(!bench.path("new.csv").exists() && !bench.path("armid-out").exists(), "work was done all the same");
    bench.refused(FAILED, "report run.csv --out folder", &["cannot be written"]);
    for page in ["run.csv", "run.toml"] {
        bench.refused(USAGE, &format!("identify run.csv --report {page}"), &["overwritten"]);
        bench.refused(USAGE, &format!("report run.csv --out {page}"), &["overwritten"]);
    }
    // Two results cannot be one file.
    bench.refused(USAGE, "identify run.csv --out x --report ./x", &["both the report page and another result"]);
    bench.refused(USAGE, "track --board sim --out t --report t/ctc.csv", &["both the report page and another result"]);
    bench.refused(USAGE, "demo --report armid-out/demo.svg", &["both the report page and another result"]);
}

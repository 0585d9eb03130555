//! `armid bench`: the page of a benchmark has the numbers of its JSON object, and pictures of them.

use serde_json::Value;

use crate::bench::{Bench, FAILED, USAGE, numbers, use_as_program};
use crate::page::Page;

/// Runs a benchmark once for its JSON object and its page.
fn measured(bench: &Bench, command: &str) -> (Value, Page) {
    let object = bench.json(&format!("bench {command} --report page.html"));
    let page = Page::read(bench, "page.html");
    let text = page.text();
    assert!(text.contains(armid::TOOL_VERSION) && text.contains(&format!("armid bench {command}")), "{text}");
    (object, page)
}

/// Numbers named `name` in a list of JSON objects; those without one are left out.
fn all(list: &Value, name: &str) -> Vec<f64> {
    list.as_array().unwrap().iter().filter_map(|one| one[name].as_f64()).collect()
}

#[test]
fn certainty_shows_errors_beside_what_is_stated() {
    let bench = Bench::new();
    let (object, page) = measured(&bench, "certainty --robots 2 --torque-noise 0 --seed 3");
    let section = "2 robots, random torque 0 % of each motor's rms torque";
    page.expect_sections(&[section, "Provenance"]);
    let study = &object["studies"][0];
    assert_eq!(page.column(section, 0, 1), numbers(&study["largest_error_f"]));
    assert_eq!(page.column(section, 0, 4), numbers(&study["rms_standard_error_f"]));
    assert_eq!(page.pictures(section).len(), 2);
    assert!(page.table("Provenance", 0).iter().any(|row| row == &["seeds", "3 to 4"]));
}

#[test]
fn searches_show_how_surely_they_find_the_minimum() {
    let bench = Bench::new();
    let (object, page) = measured(&bench, "ga --seeds 1 --evaluations 400");
    page.expect_sections(&["Searches", "Provenance"]);
    let percent: Vec<f64> = all(&object["searches"], "success_rate").iter().map(|share| 100.0 * share).collect();
    assert_eq!(page.column("Searches", 0, 1), percent);
    assert_eq!(page.column("Searches", 0, 4), all(&object["searches"], "median_rms_counts"));
    let legends = page.legends("Searches");
    for search in ["the paper's genetic algorithm", "CMA-ES with restarts", "armid identify, no guess: its search"] {
        assert!(legends.contains(&search.to_string()), "{legends:?}");
    }
}

#[test]
fn rates_stand_beside_the_program_that_they_are_compared_with() {
    let bench = Bench::new();
    let parts = ["the baseline", "/nonexistent", "cannot be run", "check its path"];
    bench.refused(FAILED, "bench identify --rounds 1 --baseline /nonexistent", &parts);
    std::fs::write(bench.path("baseline"), "echo evals_per_s 1000").unwrap();
    let command = "bench identify --rounds 1 --baseline ./baseline";
    if cfg!(unix) {
        use_as_program(&bench.path("baseline"));
        let object = bench.json(&format!("{command} --report page.html"));
        let rates = Page::read(&bench, "page.html").table("Candidates a second", 0);
        assert_eq!(rates[3][1], "1000");
        let ratio = object["evals_per_s"].as_f64().unwrap() / 1000.0;
        assert!((rates[0][3].parse::<f64>().unwrap() - ratio).abs() < 1e-9 * ratio, "{rates:?}");
    }
    let (object, page) = measured(&bench, "identify --rounds 1");
    let rates = page.column("Candidates a second", 0, 1);
    assert_eq!(
        rates,
        ["evals_per_s", "f64_evals_per_s", "scalar_evals_per_s"].map(|name| object[name].as_f64().unwrap())
    );
    assert_eq!(page.pictures("Candidates a second").len(), 1);
}

#[test]
fn the_papers_experiment_shows_every_seed() {
    let bench = Bench::new();
    let (object, page) = measured(&bench, "paper --runs 2");
    page.expect_sections(&["Objective", "Parameters", "Provenance"]);
    assert_eq!(page.column("Parameters", 0, 1), numbers(&object["true_f"]));
    let percent: Vec<f64> = numbers(&object["paper"]["scatter_f"])
        .iter()
        .zip(numbers(&object["true_f"]))
        .map(|(scatter, truth)| 100.0 * scatter / truth.abs())
        .collect();
    assert_eq!(page.column("Parameters", 0, 3), percent);
    assert_eq!(page.legends("Objective"), ["its genetic algorithm here", "where the paper ends"]);
    let printed = bench.done("bench paper --runs 2");
    assert!(printed.contains("38.0–45.0 thousand") && printed.contains("full, 2 robots"), "{printed}");
}

#[test]
fn loads_show_what_was_found_against_what_was_carried() {
    let bench = Bench::new();
    let (object, page) = measured(&bench, "load --picks 3 --quiet-hours 0.001");
    page.expect_sections(&["3 taken up at rest", "3 taken up in motion", "Without a change", "Provenance"]);
    for (section, study) in [("3 taken up at rest", "at_rest"), ("3 taken up in motion", "in_motion")] {
        let rows = page.table(section, 0);
        assert_eq!(rows[0][1], object[study]["found"].to_string());
        assert_eq!(rows[2][1].parse::<f64>().unwrap(), object[study]["rms_error_kg"].as_f64().unwrap());
        assert_eq!(page.pictures(section), ["Mass found", "Its error"]);
    }
}

#[test]
fn tracking_shows_limits_and_bandwidths() {
    let bench = Bench::new();
    let (object, page) = measured(&bench, "track --robots 1");
    page.expect_sections(&["On simulated boards", "What limits it", "Bandwidths", "Provenance"]);
    assert_eq!(page.column("On simulated boards", 0, 4), all(&object["board"], "rms_error_counts"));
    assert_eq!(page.column("What limits it", 0, 1), all(&object["limits"], "max_abs_error_counts"));
    assert_eq!(page.column("Bandwidths", 0, 0), all(&object["settings"], "bandwidth_rad_s"));
    assert_eq!(page.legends("Bandwidths").len(), 8);
}

/// Of three cases with cogging the two larger are named; on the fourth, with nothing hidden, a name is given all the same.
#[test]
fn effects_show_power_against_size() {
    let bench = Bench::new();
    bench.refused(USAGE, "bench explain --dir nowhere", &["--dir nowhere cannot be read"]);
    let named = r#"{"seconds": 2.0, "verdict": {"verdict": "named", "effects":
        [{"name": "cogging", "joint": "2", "class": ["cogging"]}]}}"#;
    let none = r#"{"seconds": 1.0, "verdict": {"verdict": "none"}}"#;
    let cogging = "effect = [{ name = 'cogging', joint = '2' }]";
    let cases = [
        ("single", 3.0, cogging, named),
        ("single", 1.5, cogging, named),
        ("single", 0.3, cogging, none),
        ("null", 0.0, "", named),
    ];
    std::fs::create_dir_all(bench.path("cases/results")).unwrap();
    for (index, (kind, counts, effect, answer)) in cases.into_iter().enumerate() {
        let folder = bench.path(&format!("cases/case-{index}"));
        std::fs::create_dir(&folder).unwrap();
        std::fs::copy(bench.path("robot.toml"), folder.join("robot.toml")).unwrap();
        let tier = format!("tier-{index}");
        let truth = format!(
            "kind = '{kind}'\ntier = '{tier}'\nnoisy = false\nsize_counts = [{counts:?}, 0.0]\nsize_of_coulomb = [0.1, \
             0.0]\n{effect}\n"
        );
        std::fs::write(folder.join("truth.toml"), truth).unwrap();
        // Answers that are there are not asked for again.
        for (method, answer) in [("explain", answer), ("screen", none), ("sindy", none)] {
            std::fs::write(bench.path(&format!("cases/results/case-{index}.{method}.json")), answer).unwrap();
        }
    }
    let (object, page) = measured(&bench, "explain --dir cases");
    let power = page.table("Power against size", 0);
    let told: Vec<[&str; 4]> = power.iter().map(|row| [1, 3, 5, 6].map(|column| row[column].as_str())).collect();
    assert_eq!(told, [["tier-0", "3", "1", "0"], ["tier-1", "1.5", "1", "0"], ["tier-2", "0.3", "0", "0"]]);
    let limits = &page.table("Power against size", 1)[0];
    assert_eq!(limits[..4], ["cogging", "1.5", "10", "–"]);
    assert_eq!(page.legends("Power against size"), ["explain", "best single regression", "discrepancy SINDy"]);
    assert!(page.text().contains("explain: 67 % of 3 single effects named or classed rightly, 0 % wrongly."));
    let scores = page.table("explain: scores", 0);
    let of = |what: &str| {
        let is_meant = |row: &&Vec<String>| row[..3] == ["null", "all", "all"] && row[3] == what;
        scores.iter().find(is_meant).unwrap_or_else(|| panic!("{scores:?}"))
    };
    assert_eq!(of("false names")[4..7], ["1", "1", "100"]);
    assert_eq!(object[0]["cases"], 4);
    assert_eq!(page.table("explain: answers by what was hidden", 0)[0], ["cogging", "cogging 2, none 1"]);
}

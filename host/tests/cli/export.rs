//! `armid export`.

use crate::bench::{BAD_FILE, Bench, USAGE};

#[test]
fn the_ending_or_the_option_says_the_format() {
    let bench = Bench::new().with_recording();
    bench.done("export run.csv --out run.mcap");
    assert!(std::fs::read(bench.path("run.mcap")).unwrap().starts_with(mcap::MAGIC));
    let table = bench.done("export run.csv --format csv");
    assert!(table.starts_with("time_s,joint_2_reference_rad,"), "{}", &table[..60]);
    assert_eq!(table.lines().count(), 5215);
    let written = bench.json("export truth.toml --out arm.urdf");
    assert_eq!((written["format"].as_str(), written["out"].as_str()), (Some("urdf"), Some("arm.urdf")));
    assert_eq!(urdf_rs::read_file(bench.path("arm.urdf")).unwrap().links.len(), 3);
    let model: serde_json::Value = serde_json::from_str(&bench.done("export truth.toml --format json")).unwrap();
    assert!(model["f"]["f1"]["value"].as_f64().unwrap() > 0.0);
}

#[test]
fn what_does_not_go_together_is_wrong_usage() {
    let bench = Bench::new().with_recording();
    bench.refused(USAGE, "export run.csv", &["--format", ".mcap"]);
    bench.refused(USAGE, "export run.csv --format mcap", &["--out"]);
    bench.refused(USAGE, "export run.csv --out arm.urdf", &["run.csv", "no model"]);
    bench.refused(USAGE, "export truth.toml --out truth.csv", &["truth.toml", "not a recording"]);
    bench.refused(USAGE, "export run.csv --out run.csv", &["run.csv", "overwritten"]);
    bench.refused(USAGE, "export truth.toml --format json --bounds robot.toml", &["--bounds", "urdf"]);
    bench.refused(BAD_FILE, "export missing.csv --format csv", &["missing.csv"]);
}

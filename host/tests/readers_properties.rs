//! The readers never panic, whatever the bytes, and what was written reads back the same.

use std::path::Path;

use armid::model::Model;
use armid::recording::{Manifest, Mode, ReadOptions, Recording};
use armid::robot::Robot;
use proptest::collection::vec;
use proptest::prelude::*;

/// Bytes that get past the first checks: pieces of well-formed files in any order, with noise between.
fn nearly_a_file() -> impl Strategy<Value = Vec<u8>> {
    let pieces = prop::sample::select(vec![
        "tick,ref2,ref3,err2,err3,cur2,cur3\n",
        "tick,ref2,ref3,err2,err3,cur2,cur3,cmd2,cmd3\n",
        "0,0,0,1,2,0.1,0.2\n",
        "1,0,0,1,2,0.1,0.2\n",
        "4294967295,0,0,1,2,0.1,0.2\n",
        "nan",
        "\"",
        "\u{feff}",
        "\r\n",
        ",",
        "-",
        "name = \"x\"\n",
        "record_period_s = 0.0007\n",
        "loop_period_s = 1e-300\n",
        "record_period_s = inf\n",
        "[[joint]]\n",
        "gear_ratio = 0\n",
        "position_gain_a_per_count = 1\n",
        "counts_per_unit = 1\n",
        "[search]\n",
        "f1 = [1, 0]\n",
        "[f]\nvalue = [1, 0, 0, 0, 0, 0, 2, 0, 0]\n",
        "[friction]\n",
        "[[effect]]\n",
    ]);
    let piece = prop_oneof![4 => pieces.prop_map(|text| text.as_bytes().to_vec()), 1 => vec(any::<u8>(), 0..6)];
    vec(piece, 0..40).prop_map(|pieces| pieces.concat())
}

fn read_everything(bytes: &[u8]) {
    let robot = Robot::paper();
    let name = Path::new("any");
    for allow_gaps in [false, true] {
        // Only that there is an answer matters.
        let _ = Recording::from_bytes(name, bytes, &robot, ReadOptions { allow_gaps }, None).map_err(|e| e.to_string());
    }
    let _ = Robot::from_bytes(name, bytes.to_vec()).map_err(|error| error.to_string());
    let _ = Model::from_bytes(name, bytes.to_vec(), &robot).map_err(|error| error.to_string());
}

proptest! {
    #[test]
    fn no_bytes_make_a_reader_panic(bytes in vec(any::<u8>(), 0..400)) {
        read_everything(&bytes);
    }

    #[test]
    fn no_pieces_of_files_make_a_reader_panic(bytes in nearly_a_file()) {
        read_everything(&bytes);
    }

    #[test]
    fn recordings_round_trip(
        samples in vec((any::<i32>(), any::<i32>(), -9999i32..9999, -9999i32..9999, -12.0..12.0, -12.0..12.0), 50..80),
        with_command in any::<bool>(),
    ) {
        let robot = Robot::paper();
        let folder = tempfile::tempdir().unwrap();
        let column = |value: &dyn Fn(usize) -> f64| (0..samples.len()).map(value).collect::<Vec<f64>>();
        let current = vec![column(&|k| samples[k].4), column(&|k| samples[k].5)];
        let recording = Recording {
            path: folder.path().join("run.csv"),
            tick: (0..samples.len() as u32).collect(),
            reference_counts: vec![
                column(&|k| f64::from(samples[k].0.max(-i32::MAX))),
                column(&|k| f64::from(samples[k].1.max(-i32::MAX))),
            ],
            error_counts: vec![column(&|k| f64::from(samples[k].2)), column(&|k| f64::from(samples[k].3))],
            command_a: with_command.then(|| current.clone()),
            current_a: current,
            added_torque: None,
            // Under computed torque any current goes with any error.
            manifest: Some(Manifest {
rows: None,
csv: None,
                mode: Mode::Ctc,
                robot: String::new(),
                trajectory: String::new(),
                tool: String::new(),
                firmware: String::new(),
                record_period_s: None,
                loop_period_s: None,
                seed: None,
                model_crc: None,
                rows_read_again: Some(3),
partial: None,
                joint: Vec::new(),
            }),
            notes: Vec::new(),
        };
        recording.write(&recording.path, &robot).unwrap();
        let read = Recording::read(&recording.path, &robot, ReadOptions::default()).unwrap();
        prop_assert_eq!(read, recording);
    }

    #[test]
    fn robots_round_trip(
        ratio in prop_oneof![-1e4..-1e-3, 1e-3..1e4],
        gain in 1e-6..1e3,
        // Below the motor's greatest torque: 0.25 N m/A at 12 A.
        friction in prop::option::of(0.0..3.0),
        low in -10.0..0.0,
    ) {
        let mut robot = Robot::paper();
        robot.joints[0].gear_ratio = ratio;
        robot.joints[1].law = armid::robot::Law::Cascade { position_gain_per_s: gain, velocity_gain: gain };
        robot.joints[1].coulomb_friction_nm = friction;
        robot.joints[0].limits.position_low_rad = low;
        robot.search[0] = [low, gain];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.toml");
        robot.write(&path).unwrap();
        prop_assert_eq!(Robot::read(&path).unwrap(), robot);
    }

    #[test]
    fn models_round_trip(
        f1 in 1.5..2.0,
        error in prop::option::of(0.0..1.0),
        coulomb in 0.0..1.0,
        gap in 0.0..0.2,
    ) {
        let robot = Robot::paper();
        let mut f = shared::arm::REFERENCE_F;
        f[0] = f1;
        let model = Model {
            f,
            f_standard_error: error.map(|error| [error; 9]),
            viscous_nm_s_per_rad: vec![8e-4, 1.3e-3],
            viscous_standard_error: error.map(|error| vec![error; 2]),
            coulomb_nm: vec![coulomb, 0.1],
            coulomb_standard_error: None,
            effects: vec![armid::model::Effect {
                name: "backlash".into(),
                joint: "3".into(),
                parameters: [("gap_rad".to_string(), gap)].into(),
                standard_error: Default::default(),
            }],
            provenance: toml::Table::from_iter([("tool".to_string(), toml::Value::String("armid".into()))]),
        };
        let text = model.to_toml().unwrap();
        let read = Model::from_bytes(Path::new("m"), text.into_bytes(), &robot).unwrap();
        prop_assert_eq!(read, model);
    }
}

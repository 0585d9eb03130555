//! `identify` on the sample recordings that lie beside a checkout of the project; skipped, and saying so, without them.

use std::path::{Path, PathBuf};

use armid::identify::{Experiment, Options, Parameter, Values, identify};
use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use armid_tests::simulator::read_truth;

fn sample(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/sample").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: the sample recordings are not here ({})", folder.display());
    None
}

/// Every f within 3 standard errors of the truth, and on the recording kept back a gap at most 1.1 times that of the
/// true parameters, in closed loop and in the innovations.
#[test]
fn the_healthy_robot_is_found_within_its_standard_errors() {
    let Some(folder) = sample("healthy") else { return };
    let robot = Robot::read(&folder.join("robot.toml")).expect("a robot file");
    let read = |name: &str| {
        Recording::read(&folder.join(name), &robot, ReadOptions::default()).expect("a recording of the robot")
    };
    let training = [read("train1.csv"), read("train2.csv")];
    let check = [read("check.csv")];
    let found = identify(&robot, &training, &check, &Options::default(), &|_| ()).expect("an identification");
    let truth = read_truth(folder.join("truth.txt")).expect("the truth");
    for (index, true_value) in truth.base.0.into_iter().enumerate() {
        let parameter = Parameter::F(index);
        let standard_error = found.standard_error(parameter).expect("a sought parameter");
        let error = found.values.get(parameter) - true_value;
        println!("f{}: off by {error:.6}, standard error {standard_error:.6}", index + 1);
        assert!(error.abs() < 3.0 * standard_error, "f{}: {error} against {standard_error}", index + 1);
    }

    let true_values = Values {
        f: truth.base.0,
        viscous_nm_s_per_rad: truth.viscous_friction_nm_s_per_rad,
        coulomb_nm: truth.coulomb_friction_nm,
        ..Values::of_robot(&robot)
    };
    let experiment = Experiment::new(&robot, &check).expect("an experiment");
    let gaps = [
        (&found.held_out_rms_counts, experiment.closed_loop_rms_counts(&true_values)),
        (&found.held_out_innovation_rms_counts, experiment.innovation_rms_counts(&true_values)),
    ];
    for (found, of_truth) in gaps {
        println!("gap {found:.4?}, at the true parameters {of_truth:.4?}");
        for joint in 0..2 {
            assert!(found[joint] <= 1.1 * of_truth[joint], "{found:?} against {of_truth:?}");
        }
    }
}

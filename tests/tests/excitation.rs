//! Designed movements judged on robots that another program simulated: they must determine the parameters as well as
//! predicted, and at least twice as well as the paper's movement of the same duration.

use std::path::Path;

use armid::excite::{self, Settings, references_rad};
use armid::identify::{Identification, Options, Parameter, identify};
use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use armid_tests::simulator::{self, Reference, RunSettings, record};
use rayon::prelude::*;

const DURATION_S: f64 = 3.65;
const ROBOTS: u64 = 8;

fn identified(truth: &simulator::Robot, robot: &Robot, reference: &Reference, seed: u64) -> Identification {
    let recording = record(truth, reference, &RunSettings { seed, ..RunSettings::default() });
    let csv = recording.to_csv();
    let recording = Recording::from_bytes(Path::new("run.csv"), csv.as_bytes(), robot, ReadOptions::default(), None)
        .expect("a recording that reads back");
    identify(robot, &[recording], &[], &Options { seed, ..Options::default() }, &|_| ()).expect("an identification")
}

/// Errors of f1..f9 in units of the magnitudes they are judged by: largest of an identification.
fn worst(found: &Identification, truth: &simulator::Robot, magnitudes: &[f64]) -> f64 {
    let truth = truth.arm.base_parameters().0;
    (0..9).map(|i| (found.values.f[i] - truth[i]).abs() / magnitudes[i]).fold(0.0, f64::max)
}

#[test]
fn a_designed_movement_keeps_what_it_promises() {
    // What a user has: the robot file with friction a fifth off, and no model yet.
    let mut robot = Robot::paper();
    for joint in &mut robot.joints {
        joint.coulomb_friction_nm = joint.coulomb_friction_nm.map(|friction| 0.8 * friction);
        joint.viscous_friction_nm_s_per_rad = joint.viscous_friction_nm_s_per_rad.map(|friction| 1.2 * friction);
    }
    let settings = Settings { generations: 45, ..Settings::of_duration(DURATION_S) };
    let design = excite::design(&robot, None, &settings, &|_, _| ()).expect("a movement");
    let expected_of_paper = design.paper.as_ref().expect("the reference robot makes the paper's movements");
    let promised = expected_of_paper.worst.1 / design.designed.worst.1;
    assert!(promised >= 2.0, "only {promised} times better than the paper's movement");

    let counts_per_rad = [0, 1].map(|joint| robot.joints[joint].counts_per_rad());
    let references = references_rad(&design.trajectory, robot.record_period_s);
    let counts = [0, 1].map(|joint| {
        references.iter().map(|angles| (angles[joint] * counts_per_rad[joint]).trunc() as i32).collect::<Vec<i32>>()
    });
    let designed = Reference::Counts(counts);
    let paper = Reference::Paper { period_s: DURATION_S };
    let outcomes: Vec<_> = (0..ROBOTS)
        .into_par_iter()
        .map(|seed| {
            let truth = simulator::Robot::draw(seed);
            let [designed, paper] =
                [&designed, &paper].map(|reference| identified(&truth, &robot, reference, 50 + seed));
            (truth, designed, paper)
        })
        .collect();

    // Predicted against actual scatter, over all robots, of every f.
    let mean = |of: &dyn Fn(&(simulator::Robot, Identification, Identification)) -> f64| {
        (outcomes.iter().map(|outcome| of(outcome).powi(2)).sum::<f64>() / ROBOTS as f64).sqrt()
    };
    let (mut scatter, mut said_scatter) = (0.0, 0.0);
    for index in 0..9 {
        let error = mean(&|(truth, found, _)| found.values.f[index] - truth.arm.base_parameters().0[index]);
        let said = mean(&|(_, found, _)| found.standard_error(Parameter::F(index)).expect("f is sought"));
        let of_paper = mean(&|(_, _, found)| found.standard_error(Parameter::F(index)).expect("f is sought"));
        let predicted = design.designed.standard_errors[index];
        let predicted_of_paper = expected_of_paper.standard_errors[index];
        println!(
            "f{}: predicted {predicted:.2e}, said {said:.2e}, actual {error:.2e}; the paper's: predicted \
             {predicted_of_paper:.2e}, said {of_paper:.2e}",
            index + 1
        );
        scatter += (error / predicted).powi(2) / 9.0;
        said_scatter += (said / predicted).powi(2) / 9.0;
    }
    let (scatter, said_scatter) = (scatter.sqrt(), said_scatter.sqrt());
    println!("over predicted, all f: actual {scatter:.2}, said {said_scatter:.2}");

    let [of_designed, of_paper] = [
        mean(&|(truth, found, _)| worst(found, truth, &design.magnitudes)),
        mean(&|(truth, _, found)| worst(found, truth, &design.magnitudes)),
    ];
    println!(
        "worst error of f: {:.4} % with the paper's movement, {:.4} % with the designed; promised {promised:.1} times better",
        100.0 * of_paper,
        100.0 * of_designed
    );
    assert!((0.25..4.0).contains(&said_scatter), "{said_scatter}");
    assert!((0.25..4.0).contains(&scatter), "{scatter}");
    assert!(of_paper >= 2.0 * of_designed, "{of_paper} and {of_designed}");
}

//! `identify` judged on robots that another program simulated: it sees their recordings and a robot file with the
//! wrong friction, nothing else.

use std::path::Path;

use armid::identify::{FrictionMode, Identification, Options, Parameter, Sought, identify};
use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use armid_tests::simulator::{self, Reference, RunSettings, record};

const PERIODS_S: [f64; 2] = [3.65, 5.0];

/// The robot file a user would have: everything right but the friction, which is 20 % off.
fn robot_file(truth: &simulator::Robot) -> Robot {
    let mut guessed = truth.clone();
    for drive in &mut guessed.drives {
        drive.coulomb_friction_nm *= 0.8;
        drive.viscous_friction_nm_s_per_rad *= 1.2;
    }
    let folder = std::env::temp_dir().join(format!("armid-identification-{}-{:p}", std::process::id(), truth));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let path = folder.join("robot.toml");
    simulator::write_robot_toml(&guessed, &path).expect("a robot file");
    let robot = Robot::read(&path).expect("a robot file that reads back");
    std::fs::remove_dir_all(&folder).expect("the folder just made");
    robot
}

fn recordings(truth: &simulator::Robot, robot: &Robot, periods_s: &[f64], seed: u64) -> Vec<Recording> {
    let movement = |(index, &period_s): (usize, &f64)| {
        let settings = RunSettings { seed: seed + 1000 * index as u64, ..RunSettings::default() };
        let recording = record(truth, &Reference::Paper { period_s }, &settings);
        let name = format!("{period_s}.csv");
        Recording::from_bytes(Path::new(&name), recording.to_csv().as_bytes(), robot, ReadOptions::default(), None)
            .expect("a recording that reads back")
    };
    periods_s.iter().enumerate().map(movement).collect()
}

fn truth_of(truth: &simulator::Robot, parameter: Parameter) -> f64 {
    match parameter {
        Parameter::F(index) => truth.arm.base_parameters().0[index],
        Parameter::Viscous(joint) => truth.drives[joint].viscous_friction_nm_s_per_rad,
        Parameter::Coulomb(joint) => truth.drives[joint].coulomb_friction_nm,
        Parameter::TorqueOffset(_) => 0.0,
        Parameter::Gain(_) => 1.0,
    }
}

fn identified(seed: u64, friction: FrictionMode) -> (simulator::Robot, Identification) {
    let truth = simulator::Robot::draw(seed);
    let robot = robot_file(&truth);
    let recordings = recordings(&truth, &robot, &PERIODS_S, seed);
    let options = Options { seed, sought: Sought { friction, ..Sought::default() }, ..Options::default() };
    let found = identify(&robot, &recordings, &[], &options, &|_| ()).expect("an identification");
    (truth, found)
}

/// Of 30 robots, each with 13 parameters, the 95 % intervals must cover 88 to 99 % of the true values, and every f
/// must be within 0.5 % of its reference magnitude (0.005 for the small f3, f5 and f8).
#[test]
fn standard_errors_are_believable_and_every_f_is_near_the_truth() {
    let (mut covered, mut intervals) = (0, 0);
    let mut worst = 0.0_f64;
    for seed in 0..30 {
        let (truth, found) = identified(seed, FrictionMode::Identify);
        assert!(found.not_identifiable.is_empty(), "robot {seed}: {:?}", found.not_identifiable);
        assert!(!found.lack_of_fit, "robot {seed}");
        for &parameter in &found.free {
            let error = found.values.get(parameter) - truth_of(&truth, parameter);
            let standard_error = found.standard_error(parameter).expect("a sought parameter");
            intervals += 1;
            covered += u32::from(error.abs() < 1.96 * standard_error);
            worst = worst.max(error.abs() / standard_error);
            if let Parameter::F(index) = parameter {
                let allowed = match index {
                    2 | 4 | 7 => 0.005,
                    _ => 0.005 * shared_reference(index).abs(),
                };
                assert!(error.abs() < allowed, "robot {seed}: f{} is off by {error:.5}", index + 1);
            }
        }
    }
    let share = f64::from(covered) / f64::from(intervals);
    println!(
        "95 % intervals cover {:.1} % of {intervals} true values; worst {worst:.2} standard errors",
        100.0 * share
    );
    assert!((0.88..=0.99).contains(&share), "{share}");
}

fn shared_reference(index: usize) -> f64 {
    simulator::BaseParameters::REFERENCE.0[index]
}

/// A slow movement hardly accelerates the arm, and stiff gains leave few counts of error: what only inertia shows
/// (f2, f3, f4, f7) is not in such a recording and must be said not to be, while gravity (f6, f8, f9) is.
#[test]
fn what_one_slow_movement_at_stiff_gains_does_not_show_is_said() {
    let truth = simulator::Robot::reference().with_paper_loop();
    let robot = robot_file(&truth);
    let recordings = recordings(&truth, &robot, &[20.0], 1);
    let found = identify(&robot, &recordings, &[], &Options::default(), &|_| ()).expect("an identification");
    for index in 0..9 {
        let parameter = Parameter::F(index);
        let said = found.not_identifiable.contains(&parameter);
        let standard_error = found.standard_error(parameter).expect("a sought parameter");
        let error = found.values.get(parameter) - truth_of(&truth, parameter);
        println!("f{} off by {error:.5} ± {standard_error:.5}{}", index + 1, if said { ", said" } else { "" });
        assert!(error.abs() < 4.0 * standard_error, "f{}: {error} ± {standard_error}", index + 1);
        match index {
            1 | 2 | 3 | 6 => assert!(said, "f{} was not said to be missing", index + 1),
            5 | 7 | 8 => assert!(!said, "f{} was said to be missing", index + 1),
            _ => {}
        }
    }
}

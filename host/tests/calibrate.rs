//! Calibration finds the gains a simulated loop ran with, within its own standard errors, and says when it cannot.

use armid::board_setup::configuration;
use armid::calibrate::{CalibrateError, Estimate, Source, calibrate};
use armid::capture::{self, Circumstances};
use armid::client::{Client, MovementPlan, Pose};
use armid::link::SimulatedBoard;
use armid::recording::{Mode, Recording};
use armid::robot::{Law, Robot};
use shared::control::PositionLoop;
use shared::protocol::ControlLaw;

/// A recording of the paper's movement on `robot`.
fn record(robot: &Robot, seed: u64) -> Recording {
    let mut client = Client::connect(Box::new(SimulatedBoard::hidden(robot, seed))).unwrap();
    client.prepare(&configuration(robot).unwrap(), Pose::DefaultsTo([0.0; 2]), false).unwrap();
    client.load_trajectory(&armid::trajectory_file::paper(3.65).unwrap()).unwrap();
    let plan = MovementPlan { law: ControlLaw::Position, settle_ns: 500_000_000 };
    let movement = client.run(&plan, &mut |_| {}).unwrap();
    assert_eq!(movement.partial, None);
    let board = client.info().clone();
    let circumstances = Circumstances { robot, mode: Mode::P, trajectory: "paper".into(), board, seed: Some(seed) };
    capture::recording(&movement, &circumstances, "run.csv".into())
}

fn with_loops(gains: [f64; 2], lead: f64, loop_period_s: f64) -> Robot {
    let mut robot = Robot::paper();
    robot.loop_period_s = loop_period_s;
    for (joint, gain_a_per_count) in robot.joints.iter_mut().zip(gains) {
        joint.law = Law::Proportional(PositionLoop { gain_a_per_count, lead });
    }
    robot
}

fn near(estimate: Estimate, truth: f64) {
    let off = (estimate.value - truth).abs();
    // The floor is the rounding of converter codes where it does not average out: 1 part in 1000.
    assert!(off < 5.0 * estimate.standard_error + 1e-3 * truth.abs(), "{estimate:?} for {truth}");
    assert!(estimate.standard_error < 0.01 * truth.abs(), "{estimate:?}");
}

#[test]
fn gains_are_found_from_either_current() {
    let robot = Robot::paper();
    let mut recording = record(&robot, 1);
    for source in [Source::Command, Source::Measured] {
        let found = calibrate(&robot, std::slice::from_ref(&recording)).unwrap();
        for (joint, gain) in found.iter().zip([0.036, 0.048]) {
            assert_eq!(joint.source, source);
            near(joint.position_gain_a_per_count, gain);
            assert_eq!(joint.lead, None, "there is no lead to find");
            assert!(joint.agrees);
        }
        recording.command_a = None;
    }
}

#[test]
fn a_wrong_robot_file_is_contradicted() {
    let recording = record(&Robot::paper(), 2);
    let wrong = with_loops([0.030, 0.048], 0.0, 0.0007);
    let found = calibrate(&wrong, &[recording]).unwrap();
    assert!(!found[0].agrees);
    assert!(found[1].agrees);
    near(found[0].position_gain_a_per_count, 0.036);
}

#[test]
fn a_lead_is_found() {
    // With two ticks of lead even the paper's gains are stable at 0.7 ms.
    let robot = with_loops([0.384, 0.376], 2.0, 0.0007);
    let mut recording = record(&robot, 3);
    for tolerance in [0.01, 0.05] {
        for (joint, gain) in calibrate(&robot, std::slice::from_ref(&recording)).unwrap().iter().zip([0.384, 0.376]) {
            near(joint.position_gain_a_per_count, gain);
            let lead = joint.lead.expect("the lead is there");
            assert!((lead.value - 2.0).abs() < tolerance, "{lead:?}");
        }
        recording.command_a = None;
    }
}

#[test]
fn a_loop_faster_than_the_recording_is_calibrated() {
    let robot = with_loops([0.384, 0.376], 0.0, 0.00005);
    let mut recording = record(&robot, 4);
    for (joint, gain) in calibrate(&robot, std::slice::from_ref(&recording)).unwrap().iter().zip([0.384, 0.376]) {
        near(joint.position_gain_a_per_count, gain);
    }
    recording.command_a = None;
    for (joint, gain) in calibrate(&robot, &[recording]).unwrap().iter().zip([0.384, 0.376]) {
        // The error 50 µs before a sample is read off a straight line between rounded ones.
        let found = joint.position_gain_a_per_count.value;
        assert!((found / gain - 1.0).abs() < 0.03, "{found} for {gain}");
    }
}

#[test]
fn what_cannot_be_calibrated_says_why() {
    let robot = Robot::paper();
    let recording = record(&robot, 5);
    let still = {
        let mut still = recording.clone();
        still.error_counts[1].iter_mut().for_each(|error| *error = 40.0);
        still
    };
    let error = calibrate(&robot, &[still]).unwrap_err();
    assert!(matches!(&error, CalibrateError::HardlyVaries { joint, .. } if joint == "3"), "{error}");
    assert!(error.to_string().contains("0.00 counts rms only, at least 2"), "{error}");

    let mut weak = robot.clone();
    weak.joints[0].current_limit_a = 0.01;
    let error = calibrate(&weak, std::slice::from_ref(&recording)).unwrap_err();
    assert!(matches!(error, CalibrateError::Saturated { .. }), "{error}");

    let mut unrelated = recording.clone();
    let command = unrelated.command_a.as_mut().unwrap();
    command[0] = (0..command[0].len()).map(|k| (k as f64 * 0.37).sin()).collect();
    let error = calibrate(&robot, &[unrelated]).unwrap_err();
    assert!(matches!(error, CalibrateError::DoesNotFollow { .. }), "{error}");

    let mut other = recording;
    other.manifest.as_mut().unwrap().mode = Mode::Ctc;
    assert!(matches!(calibrate(&robot, &[other]).unwrap_err(), CalibrateError::OtherMode { .. }));
    assert_eq!(calibrate(&robot, &[]).unwrap_err(), CalibrateError::NoRecording);
}

#[test]
fn saturated_samples_are_left_out() {
    let robot = Robot::paper();
    let mut recording = record(&robot, 6);
    let limit_a = 3.0;
    let command = recording.command_a.as_mut().unwrap();
    command[0].iter_mut().for_each(|current_a| *current_a = current_a.clamp(-limit_a, limit_a));
    let mut limited = robot.clone();
    limited.joints[0].current_limit_a = limit_a;
    let found = calibrate(&limited, &[recording]).unwrap();
    assert!(found[0].saturated > 100, "{} saturated", found[0].saturated);
    near(found[0].position_gain_a_per_count, 0.036);
}

#[test]
fn the_sample_recordings_give_their_gains() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/sample/healthy");
    if !folder.is_dir() {
        eprintln!("skipped: {} is not there", folder.display());
        return;
    }
    let robot = Robot::read(&folder.join("robot.toml")).unwrap();
    let recordings = ["train1.csv", "train2.csv"]
        .map(|name| Recording::read(&folder.join(name), &robot, Default::default()).unwrap());
    for (joint, gain) in calibrate(&robot, &recordings).unwrap().iter().zip([0.036, 0.048]) {
        assert_eq!(joint.source, Source::Measured);
        near(joint.position_gain_a_per_count, gain);
        assert!(joint.agrees);
    }
}

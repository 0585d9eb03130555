//! `identify` judged on robots that another program simulated: it sees their recordings and a robot file with the
//! wrong friction, nothing else.

use std::path::Path;

use armid::identify::{FrictionMode, Identification, Options, Parameter, Prior, Sought, identify};
use armid::prior::{gains_from_current, leads_from_current};
use armid::recording::{Manifest, ReadOptions, Recording};
use armid::robot::{Law, Robot};
use armid_tests::simulator::{self, Reference, RunSettings, TorqueNoise, record};

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
    disturbed_recordings(truth, robot, periods_s, seed, 0.0)
}

/// Recordings under a random torque of `share` of each motor's own rms torque, which keeps its direction for some 50 ms.
fn disturbed_recordings(
    truth: &simulator::Robot,
    robot: &Robot,
    periods_s: &[f64],
    seed: u64,
    share: f64,
) -> Vec<Recording> {
    let movement = |(index, &period_s): (usize, &f64)| {
        let mut settings = RunSettings { seed: seed + 1000 * index as u64, ..RunSettings::default() };
        let mut recording = record(truth, &Reference::Paper { period_s }, &settings);
        if share > 0.0 {
            let standard_deviation_nm = [0, 1].map(|joint: usize| {
                let current = &recording.current_a[joint];
                let mean_square = current.iter().map(|a| a * a).sum::<f64>() / current.len() as f64;
                share * robot.joints[joint].torque_constant_nm_per_a * mean_square.sqrt()
            });
            settings.torque_noise = Some(TorqueNoise { standard_deviation_nm, correlation_time_s: 0.05 });
            recording = record(truth, &Reference::Paper { period_s }, &settings);
        }
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
        Parameter::Lead(joint) => truth.drives[joint].lead,
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

/// Of 30 robots, each with 13 parameters, the 95 % intervals must cover at least 93 % of the true values without being so
/// wide that they cover all; the worst f of a robot may be beyond 3 standard errors once; and every f must be within 0.5 %
/// of its reference magnitude (0.005 for the small f3, f5 and f8).
#[test]
fn standard_errors_are_believable_and_every_f_is_near_the_truth() {
    let (mut covered, mut intervals, mut beyond) = (0, 0, 0);
    let mut worst = 0.0_f64;
    for seed in 0..30 {
        let (truth, found) = identified(seed, FrictionMode::Identify);
        assert!(found.not_identifiable.is_empty(), "robot {seed}: {:?}", found.not_identifiable);
        assert!(!found.lack_of_fit, "robot {seed}");
        let mut worst_f = 0.0_f64;
        for &parameter in &found.free {
            let error = found.values.get(parameter) - truth_of(&truth, parameter);
            let standard_error = found.standard_error(parameter).expect("a sought parameter");
            if matches!(parameter, Parameter::F(_)) {
                worst_f = worst_f.max(error.abs() / standard_error);
            }
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
        beyond += u32::from(worst_f > 3.0);
    }
    let share = f64::from(covered) / f64::from(intervals);
    println!(
        "95 % intervals cover {:.1} % of {intervals} true values; worst {worst:.2} standard errors",
        100.0 * share
    );
    assert!((0.93..0.998).contains(&share), "{share}");
    assert!(beyond <= 1, "{beyond} robots have an f beyond 3 standard errors");
}

/// Of 8 robots under a random torque of 1 % of their own, the 95 % intervals must cover what a binomial share of 104 may
/// fall to with 97.5 % probability given that a robot's errors go together, and errors must not be a small part of what is
/// stated.
#[test]
fn standard_errors_hold_under_torque_noise() {
    let (mut covered, mut squares, mut intervals) = (0, 0.0, 0);
    for seed in 100..108 {
        let truth = simulator::Robot::draw(seed);
        let robot = robot_file(&truth);
        let recordings = disturbed_recordings(&truth, &robot, &PERIODS_S, seed, 0.01);
        let options = Options { seed, ..Options::default() };
        let found = identify(&robot, &recordings, &[], &options, &|_| ()).expect("an identification");
        for &parameter in &found.free {
            let error = found.values.get(parameter) - truth_of(&truth, parameter);
            let ratio = error / found.standard_error(parameter).expect("a sought parameter");
            intervals += 1;
            covered += u32::from(ratio.abs() < 1.96);
            squares += ratio * ratio;
        }
    }
    let share = f64::from(covered) / f64::from(intervals);
    let rms = (squares / f64::from(intervals)).sqrt();
    println!("95 % intervals cover {:.1} % of {intervals} true values; errors are {rms:.2} of them rms", 100.0 * share);
    assert!(share >= 0.88, "{share}");
    assert!((0.6..1.35).contains(&rms), "{rms}");
}

/// The recordings of a robot as another file of it would be read: without measured currents.
fn without_currents(mut recordings: Vec<Recording>) -> Vec<Recording> {
    for recording in &mut recordings {
        for current in &mut recording.current_a {
            current.fill(0.0);
        }
    }
    recordings
}

/// The gain of joint 2 is really 3 % lower than the robot file says. Position alone cannot tell that from a lighter arm
/// with less friction, and that is said; the measured current tells, and so does a prior on a friction.
#[test]
fn an_unknown_gain_needs_the_current_or_something_else_that_is_known() {
    let truth = simulator::Robot::draw(3);
    let mut robot = robot_file(&truth);
    let Law::Proportional(position_loop) = &mut robot.joints[0].law else { panic!("a position loop") };
    position_loop.gain_a_per_count /= 0.97;
    let recordings = recordings(&truth, &robot, &PERIODS_S, 3);
    let seek = |recordings: &[Recording], priors: Vec<Prior>| {
        let options = Options { sought: Sought { gain: true, ..Sought::default() }, priors, ..Options::default() };
        identify(&robot, recordings, &[], &options, &|_| ()).expect("an identification")
    };
    let blind = without_currents(recordings.clone());
    assert_eq!(gains_from_current(&robot, &blind), []);
    let found = seek(&blind, Vec::new());
    assert!(found.weak_directions[0].common_scale.is_some(), "{:?}", found.weak_directions);
    assert!(found.not_identifiable.contains(&Parameter::F(8)), "{:?}", found.not_identifiable);
    // The ratio of two gains is no matter of scale.
    let ratio = found.values.gain[0] / found.values.gain[1];
    assert!((ratio - 0.97).abs() < 0.003, "{ratio}");

    let coulomb_nm = truth.drives[0].coulomb_friction_nm;
    let friction = Prior { parameter: Parameter::Coulomb(0), mean: coulomb_nm, standard_deviation: 1e-3 * coulomb_nm };
    for (recordings, priors) in [(&recordings, gains_from_current(&robot, &recordings)), (&blind, vec![friction])] {
        let found = seek(recordings, priors);
        assert!(found.weak_directions.is_empty(), "{:?}", found.weak_directions);
        for (gain, truth) in found.values.gain.into_iter().zip([0.97, 1.0]) {
            assert!((gain - truth).abs() < 0.005, "{gain} for {truth}");
        }
        let f9 = found.values.f[8] / truth_of(&truth, Parameter::F(8));
        assert!((f9 - 1.0).abs() < 0.005, "f9 off by a factor {f9}");
    }
}

/// The loops have leads that neither robot file nor manifest knows of. Sought with f they are found: from the recorded
/// commands and the motion, and from the motion alone, where nothing but the errors says what the commands were.
#[test]
fn an_unknown_lead_is_found_and_f_unharmed() {
    let with_lead = |seed: u64| {
        let mut truth = simulator::Robot::draw(seed);
        for (drive, lead) in truth.drives.iter_mut().zip([0.4, 0.15]) {
            drive.lead = lead;
        }
        let mut robot = robot_file(&truth);
        let recordings = recordings(&truth, &robot, &PERIODS_S, seed);
        for joint in &mut robot.joints {
            let Law::Proportional(position_loop) = &mut joint.law else { panic!("a position loop") };
            position_loop.lead = 0.0;
        }
        (truth, robot, recordings)
    };
    let seek = |robot: &Robot, recordings: &[Recording], priors: Vec<Prior>| {
        let options = Options { sought: Sought { lead: true, ..Sought::default() }, priors, ..Options::default() };
        identify(robot, recordings, &[], &options, &|_| ()).expect("an identification")
    };
    for seed in 40..44 {
        let (truth, robot, recordings) = with_lead(seed);
        let mut blind = without_currents(recordings.clone());
        blind.iter_mut().for_each(|recording| recording.command_a = None);
        let from_motion = seek(&robot, &blind, Vec::new());
        let (mut told_robot, mut told) = (robot.clone(), recordings.clone());
        let priors = leads_from_current(&mut told_robot, &mut told, &mut []).expect("leads in the commands");
        assert_eq!(priors.len(), 2);
        let from_both = seek(&told_robot, &told, priors);
        for (name, found) in [("motion", &from_motion), ("command and motion", &from_both)] {
            assert!(!found.lack_of_fit && found.not_identifiable.is_empty(), "robot {seed}: {found:?}");
            for &parameter in &found.free {
                let error = found.values.get(parameter) - truth_of(&truth, parameter);
                let standard_error = found.standard_error(parameter).expect("a sought parameter");
                if matches!(parameter, Parameter::Lead(_)) {
                    println!("robot {seed}, {name}: {parameter:?} off by {error:.5} ± {standard_error:.5}");
                    assert!(standard_error < 0.01, "robot {seed}: {standard_error}");
                }
                assert!(
                    error.abs() < 3.0 * standard_error,
                    "robot {seed}, {name}: {parameter:?} off by {error} ± {standard_error}"
                );
                if let Parameter::F(index) = parameter {
                    let allowed =
                        if matches!(index, 2 | 4 | 7) { 0.005 } else { 0.005 * shared_reference(index).abs() };
                    assert!(error.abs() < allowed, "robot {seed}, {name}: f{} off by {error}", index + 1);
                }
            }
        }
        // What the motion alone says of the lead goes together with what it says of the arm.
        let lead = from_motion.free.iter().position(|&p| p == Parameter::Lead(0)).expect("sought");
        let correlations = from_motion.correlations.as_ref().expect("of a full identification");
        assert!((0..9).any(|f| correlations[lead][f].abs() > 0.01), "{:?}", correlations[lead]);
    }
}

/// One recording at the file's gains, one at two thirds of them, each with its manifest: fitted together they give the
/// same robot; the ties of an upper arm of known length narrow f3 and f4.
#[test]
fn recordings_of_different_gains_are_fitted_together_and_ties_help() {
    let truth = simulator::Robot::draw(5);
    let robot = robot_file(&truth);
    let mut slow = truth.clone();
    for drive in &mut slow.drives {
        drive.position_gain_a_per_count *= 2.0 / 3.0;
    }
    let mut both = recordings(&truth, &robot, &PERIODS_S[..1], 5);
    let mut other = recordings(&slow, &robot, &PERIODS_S[1..], 6).remove(0);
    other.manifest = Some(manifest_of(&slow));
    both.push(other);
    let identified = |upper_arm_m| {
        let options = Options { sought: Sought { upper_arm_m, ..Sought::default() }, ..Options::default() };
        identify(&robot, &both, &[], &options, &|_| ()).expect("an identification")
    };
    let free = identified(None);
    let tied = identified(Some(robot.upper_arm_m));
    for found in [&free, &tied] {
        assert!(!found.lack_of_fit && found.innovation_rms_counts.iter().all(|&rms| rms < 0.32), "{found:?}");
        assert_eq!(found.left_out.len(), 2);
        assert!(found.left_out.iter().flat_map(|left| &left.innovation_rms_counts).all(|&rms| rms < 0.35));
        for index in 0..9 {
            let parameter = Parameter::F(index);
            let error = found.values.get(parameter) - truth_of(&truth, parameter);
            let standard_error = found.standard_error(parameter).expect("sought or tied");
            assert!(error.abs() < 4.0 * standard_error, "f{} off by {error} ± {standard_error}", index + 1);
        }
    }
    for index in [2, 3] {
        let of = |found: &Identification| found.standard_error(Parameter::F(index)).expect("sought or tied");
        assert!(of(&tied) < 0.5 * of(&free), "f{}: {} {}", index + 1, of(&tied), of(&free));
        assert_eq!(tied.values.f[index], robot.upper_arm_m * tied.values.f[index + 2]);
    }
}

fn manifest_of(robot: &simulator::Robot) -> Manifest {
    let joint = |index: usize| {
        let gain = robot.drives[index].position_gain_a_per_count;
        format!("[[joint]]\nname = \"{}\"\nposition_gain_a_per_count = {gain}\n", index + 2)
    };
    toml::from_str(&format!("mode = \"p\"\n{}{}", joint(0), joint(1))).expect("a manifest")
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

//! Effects by name: on the command line, in model files, in the simulated board, and in a model that repeats its
//! recordings.

use std::process::{Command, Output};

use armid::board_setup::configuration;
use armid::capture::{self, Circumstances};
use armid::client::{Client, MovementPlan, Pose};
use armid::effects::{EffectError, from_entries, off, parse, to_entries};
use armid::hidden_robot::HiddenRobot;
use armid::identify::{Experiment, Segment};
use armid::link::SimulatedBoard;
use armid::model::{Effect, Model};
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use shared::control::{Law, LawState, PositionLoop, SampledTiming};
use shared::effects::catalogue::{Entry, LIBRARY, Scope};
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant};
use shared::machine::Machine as _;
use shared::plant::State;
use shared::protocol::ControlLaw;
use shared::replay::{Innovations, RecordedSample, ReplaySettings};

const SEED: u64 = 5;

/// The entry that `armid` would write for an effect of typical size on a joint.
fn typical(entry: &Entry, joint: &str) -> Effect {
    let joint = if entry.scope == Scope::Arm { "both" } else { joint };
    let parameters = entry.parameters.iter().map(|parameter| (parameter.name.into(), parameter.typical)).collect();
    Effect { name: entry.name.into(), joint: joint.into(), parameters, standard_error: Default::default() }
}

#[test]
fn every_effect_survives_a_model_file() {
    let robot = Robot::paper();
    for joint in ["2", "3"] {
        let entries: Vec<Effect> = LIBRARY.iter().map(|entry| typical(entry, joint)).collect();
        let effects = from_entries(&entries, &robot).unwrap();
        assert_eq!(to_entries(&effects, &robot), entries);
        let mut model = HiddenRobot::draw(&robot, SEED).to_model(toml::Table::new());
        model.effects.clone_from(&entries);
        let read = Model::from_bytes("model.toml".as_ref(), model.to_toml().unwrap().into_bytes(), &robot).unwrap();
        assert_eq!(read.effects, entries);
        let hidden = HiddenRobot::from_model(&read, &robot).unwrap();
        assert_eq!(hidden.effects(), Some(&effects));
        assert_eq!(hidden.to_model(toml::Table::new()).effects, entries);
    }
    assert_eq!(from_entries(&[], &robot).unwrap(), off(&robot));
    assert!(to_entries(&off(&robot), &robot).is_empty());
}

#[test]
fn command_line_texts_are_read() {
    let robot = Robot::paper();
    let effect = parse("backlash:joint=3,gap_rad=0.002").unwrap();
    assert_eq!((effect.name.as_str(), effect.joint.as_str()), ("backlash", "3"));
    assert_eq!(from_entries(&[effect], &robot).unwrap().joints[1].gap_rad, 0.002);
    let effect = parse("payload: mass_kg = 1.5").unwrap();
    assert_eq!(effect.joint, "both");
    assert_eq!(from_entries(&[effect], &robot).unwrap().arm.payload_kg, 1.5);
}

#[test]
fn effects_that_cannot_be_are_refused_with_what_was_meant() {
    let robot = Robot::paper();
    let refusal = |text: &str| {
        let effect = match parse(text) {
            Ok(effect) => effect,
            Err(error) => return error.to_string(),
        };
        from_entries(&[effect], &robot).unwrap_err().to_string()
    };
    for (text, parts) in [
        ("backlsh:joint=3,gap_rad=0.002", &["backlsh", "did you mean backlash?"][..]),
        ("wear:joint=3", &["wear", "coulomb-friction", "external-contact"]),
        ("backlash:joint=3,gap=0.002", &["\"gap\"", "gap_rad"]),
        ("backlash:joint=3", &["gap_rad is missing", "0 to 0.2 rad"]),
        ("backlash:joint=3,gap_rad=5", &["gap_rad is 5", "0 to 0.2 rad"]),
        ("backlash:joint=3,gap_rad=-0.001", &["gap_rad is -0.001", "0 to 0.2 rad"]),
        ("backlash:joint=3,gap_rad=NaN", &["gap_rad is NaN", "0 to 0.2 rad"]),
        ("backlash:joint=3,gap_rad=wide", &["gap_rad is \"wide\"", "no number"]),
        ("backlash:joint=4,gap_rad=0.001", &["no joint \"4\"", "2, 3"]),
        ("backlash:gap_rad=0.001", &["no joint \"\"", "2, 3"]),
        ("payload:joint=3,mass_kg=1", &["the whole arm's, not that of joint \"3\"", "joint=both"]),
        ("backlash:joint=3,0.002", &["NAME:joint=JOINT"]),
    ] {
        let found = refusal(text);
        assert!(parts.iter().all(|part| found.contains(part)), "{text}: {found}");
    }
    let twice = vec![parse("backlash:joint=3,gap_rad=0.002").unwrap(); 2];
    assert!(matches!(from_entries(&twice, &robot), Err(EffectError::Twice { .. })));
}

#[test]
fn single_axis_has_its_own_effects() {
    let mut robot = Robot::paper();
    robot.kind = armid::robot::Kind::SingleAxis;
    robot.joints.truncate(1);
    let refused = |text: &str| from_entries(&[parse(text).unwrap()], &robot).unwrap_err();
    assert!(matches!(refused("base-tilt:angle_rad=0.1"), EffectError::NotOnSingleAxis { .. }));
    assert!(matches!(refused("payload:mass_kg=1,x_m=0.1"), EffectError::UnknownParameter { .. }));
    let loaded = from_entries(&[parse("payload:mass_kg=1").unwrap()], &robot).unwrap();
    assert_eq!((loaded.arm.payload_kg, loaded.arm.payload_x_m, loaded.arm.upper_arm_m), (1.0, 0.0, 1.0));
    assert_eq!(to_entries(&loaded, &robot)[0].parameters.len(), 1);
}

fn record(robot: &Robot, hidden: HiddenRobot) -> Recording {
    let mut client = Client::connect(Box::new(SimulatedBoard::new(robot, hidden, SEED))).unwrap();
    client.prepare(&configuration(robot).unwrap(), Pose::DefaultsTo([0.0; 2]), false).unwrap();
    client.load_trajectory(&armid::trajectory_file::paper(3.65).unwrap()).unwrap();
    let plan = MovementPlan { law: ControlLaw::Position, settle_ns: 500_000_000 };
    let movement = client.run(&plan, &mut |_| {}).unwrap();
    let board = client.info().clone();
    let circumstances = Circumstances { robot, mode: Mode::P, trajectory: "paper".into(), board, seed: Some(SEED) };
    capture::recording(&movement, &circumstances, "run.csv".into())
}

/// Root mean square of a model's innovations at both joints, in counts.
fn innovation_rms(robot: &Robot, segment: &Segment, extended: &ExtendedPlant<f64>) -> [f64; 2] {
    let timing = SampledTiming {
        record_period_s: robot.record_period_s,
        loop_period_s: robot.loop_period_s,
        command_delay_s: robot.command_delay_s,
    };
    let settings = ReplaySettings { timing, quantised: true, substeps: 4 };
    let law = LawState::new(Law::Proportional(PositionLoop { gain_a_per_count: 0.0, lead: 0.0 }));
    let machine = ExtendedMachine::new(extended);
    let start: [f64; 2] =
        std::array::from_fn(|joint| segment.measured_counts[0][joint] / robot.joints[joint].counts_per_rad());
    let mut model =
        Innovations::of(machine, [law; 2], &settings, machine.start(State::at_rest(start), segment.start_s));
    let mut sum = [0.0; 2];
    let settled = 400;
    for k in 0..segment.error_counts.len() {
        let innovation = model.tick(&RecordedSample {
            reference_counts: segment.reference_counts[k],
            next_reference_counts: segment.reference_counts[k],
            measured_counts: segment.measured_counts[k],
            command_a: segment.command_a[k],
            added_torque_nm: [0.0; 2],
        });
        if k >= settled {
            sum = [sum[0] + innovation[0].powi(2), sum[1] + innovation[1].powi(2)];
        }
    }
    sum.map(|sum| (sum / (segment.error_counts.len() - settled) as f64).sqrt())
}

/// The rounding of one count.
const FLOOR: f64 = 0.288_675;

#[test]
fn a_model_with_the_effect_leaves_only_rounding_and_one_without_it_more() {
    let robot = Robot::paper();
    for entry in LIBRARY {
        let effect = typical(entry, "3");
        let hidden = HiddenRobot::draw(&robot, SEED).with_effects(&[effect], &robot).unwrap();
        let recording = record(&robot, hidden.clone());
        let experiment = Experiment::new(&robot, std::slice::from_ref(&recording)).unwrap();
        let plant = hidden.plant(&robot);
        let rms =
            |effects: Effects<f64>| innovation_rms(&robot, &experiment.segments[0], &ExtendedPlant { plant, effects });
        let (with, without) = (rms(*hidden.effects().unwrap()), rms(Effects::OFF));
        println!("{:28} {with:.3?} without {without:.3?}", entry.name);
        assert!(with.iter().all(|rms| (rms / FLOOR - 1.0).abs() < 0.05), "{}: {with:?}", entry.name);
        assert!(without[1] > 1.02 * with[1], "{}: {without:?} of {with:?}", entry.name);
    }
}

fn armid(folder: &std::path::Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_armid"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .env_remove("ARMID_BOARD")
        .output()
        .unwrap()
}

#[test]
fn commands_take_effects_and_keep_them_in_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &str| {
        let output = armid(folder.path(), arguments);
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    run(
        "simulate --settle 0.3 --effect backlash:joint=3,gap_rad=0.002 --effect count-loss:joint=2,counts=40,instant_s=2 \
         --out first.csv --truth truth.toml",
    );
    let robot = Robot::paper();
    let truth = Model::read(&folder.path().join("truth.toml"), &robot).unwrap();
    let names: Vec<&str> = truth.effects.iter().map(|effect| effect.name.as_str()).collect();
    assert_eq!(names, ["backlash", "count-loss"]);
    // The truth is a model to simulate again.
    run("simulate --settle 0.3 --model truth.toml --out second.csv");
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(read("first.csv"), read("second.csv"));
    // A board may have the effect, and a controller may be given a model with effects.
    let track =
        run("track --board sim --settle 0.3 --effect torque-offset:joint=3,torque_nm=0.05 --model truth.toml --json");
    assert!(track.contains("ctc"));
    // The slip shows as 40 counts between two samples at 2 s.
    let recording = Recording::read(&folder.path().join("first.csv"), &robot, Default::default()).unwrap();
    let error = &recording.error_counts[0];
    let jump = |k: usize| error[k] - error[k - 1];
    let greatest = (1..error.len()).max_by(|&a, &b| jump(a).abs().total_cmp(&jump(b).abs())).unwrap();
    assert!((greatest as f64 * robot.record_period_s - 2.0).abs() < 0.002, "{greatest}");
    assert!((jump(greatest).abs() - 40.0).abs() < 20.0, "{}", jump(greatest));
}

#[test]
fn commands_refuse_effects_that_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, part) in [
        ("simulate --effect backlsh:joint=3,gap_rad=0.002", "did you mean backlash?"),
        ("track --board sim --effect backlash:joint=3,gap_rad=2", "0 to 0.2 rad"),
        ("record --board tcp:localhost:1 --effect backlash:joint=3,gap_rad=0.002", "--board sim"),
    ] {
        let output = armid(folder.path(), arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {stderr}");
        assert!(stderr.contains(part), "{arguments}: {stderr}");
    }
    let mut model = HiddenRobot::draw(&Robot::paper(), SEED).to_model(toml::Table::new());
    model.effects = vec![Effect {
        name: "wear".into(),
        joint: "3".into(),
        parameters: Default::default(),
        standard_error: Default::default(),
    }];
    std::fs::write(folder.path().join("model.toml"), model.to_toml().unwrap()).unwrap();
    let output = armid(folder.path(), "simulate --model model.toml");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("model.toml") && stderr.contains("wear"), "{stderr}");
}

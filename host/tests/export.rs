//! Recordings and models in other programs' formats, read back by those formats' own readers.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use armid::export::{model_json, model_urdf, recording_csv, recording_mcap};
use armid::hidden_robot::HiddenRobot;
use armid::links::{ArmBounds, LinkBounds};
use armid::model::Model;
use armid::recording::{Manifest, ManifestJoint, Mode, Recording};
use armid::robot::{JointLimits, Kind, Law, Robot, Unit};
use serde_json::Value;
use shared::arm::{Arm, Pose};

fn recording() -> Recording {
    let wave = |size: f64| (0..60).map(|index| (size * (f64::from(index) / 7.0).sin()).round()).collect::<Vec<f64>>();
    let joint = |name: &str, gain| ManifestJoint { name: name.into(), position_gain_a_per_count: gain, lead: 0.5 };
    Recording {
        path: "run.csv".into(),
        tick: (0..60).collect(),
        reference_counts: vec![wave(900.0), wave(-400.0)],
        error_counts: vec![wave(50.0), wave(-20.0)],
        current_a: vec![wave(3.0), wave(-2.0)],
        command_a: Some(vec![wave(2.0), wave(-1.0)]),
        added_torque: None,
        manifest: Some(Manifest {
            rows: None,
            csv: None,
            mode: Mode::P,
            robot: "PUMA 560, links 2 and 3".into(),
            trajectory: "paper, T = 3.65 s".into(),
            tool: "armid".into(),
            firmware: "simulated".into(),
            record_period_s: Some(0.0007),
            loop_period_s: Some(0.0007),
            seed: Some(17),
            model_crc: Some("0a1b2c3d".into()),
            rows_read_again: None,
            partial: None,
            joint: vec![joint("2", 0.036), joint("3", 0.048)],
        }),
        notes: Vec::new(),
    }
}

/// What a sample must be in SI units, from the encoders' own numbers.
fn expected(recording: &Recording, sample: usize) -> BTreeMap<String, f64> {
    let mut values = BTreeMap::new();
    for (joint, (name, gear_ratio, counts_per_rev)) in
        [("2", 107.8, 800.0), ("3", -53.7, 1000.0)].into_iter().enumerate()
    {
        let rad = |counts: f64| counts * TAU / (gear_ratio * counts_per_rev);
        let (reference, error) = (recording.reference_counts[joint][sample], recording.error_counts[joint][sample]);
        let mut put = |quantity: &str, value: f64| {
            values.insert(format!("joint_{name}_{quantity}"), value);
        };
        put("reference_rad", rad(reference));
        put("position_rad", rad(reference - error));
        put("error_rad", rad(error));
        put("error_counts", error);
        put("measured_current_a", recording.current_a[joint][sample]);
        put("commanded_current_a", recording.command_a.as_ref().unwrap()[joint][sample]);
    }
    values
}

fn near(value: f64, expected: f64) -> bool {
    (value - expected).abs() <= 1e-12 * expected.abs().max(1e-6)
}

#[test]
fn csv_has_unit_suffixed_names_and_si_values() {
    let recording = recording();
    let text = recording_csv(&recording, &Robot::paper());
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    assert_eq!(header[0], "time_s");
    let suffixes = ["_s", "_rad", "_counts", "_a"];
    assert!(header.iter().all(|name| suffixes.iter().any(|suffix| name.ends_with(suffix))), "{header:?}");
    let mut rows = 0;
    for (sample, row) in reader.records().enumerate() {
        let row: Vec<f64> = row.unwrap().iter().map(|field| field.parse().unwrap()).collect();
        assert!(near(row[0], 0.0007 * sample as f64), "{row:?}");
        let expected = expected(&recording, sample);
        assert_eq!(expected.len() + 1, header.len());
        for (name, value) in header.iter().zip(&row).skip(1) {
            assert!(near(*value, expected[name]), "sample {sample}, {name}: {value}, not {}", expected[name]);
        }
        rows += 1;
    }
    assert_eq!(rows, 60);
}

#[test]
fn mcap_opens_with_its_reader_and_holds_every_sample() {
    let recording = recording();
    let robot = Robot::paper();
    let bytes = recording_mcap(&recording, &robot).unwrap();
    let mut samples: BTreeMap<u64, BTreeMap<String, f64>> = BTreeMap::new();
    let mut topics: BTreeMap<String, usize> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let channel = &message.channel;
        assert_eq!((channel.message_encoding.as_str(), message.log_time), ("json", message.publish_time));
        let schema = channel.schema.as_ref().unwrap();
        assert_eq!(schema.encoding, "jsonschema");
        // Foxglove takes a schema of JSON for objects of numbers, and says at every level what it is.
        let schema: Value = serde_json::from_slice(&schema.data).unwrap();
        assert_eq!(schema["type"], "object");
        assert!(schema["properties"].as_object().unwrap().values().all(|joint| joint["type"] == "object"));
        *topics.entry(channel.topic.clone()).or_default() += 1;
        let value: Value = serde_json::from_slice(&message.data).unwrap();
        for (joint, quantities) in value.as_object().unwrap() {
            for (quantity, value) in quantities.as_object().unwrap() {
                assert_eq!(schema["properties"][joint]["properties"][quantity]["type"], "number", "{joint} {quantity}");
                let name = format!("{joint}_{quantity}");
                samples.entry(message.log_time).or_default().insert(name, value.as_f64().unwrap());
            }
        }
    }
    let counts: Vec<(&str, usize)> = topics.iter().map(|(topic, count)| (topic.as_str(), *count)).collect();
    assert_eq!(counts, [("/drives", 60), ("/joint_states", 60), ("/tracking_errors", 60)]);
    // 0.7 ms is a whole number of ns: the times are exact.
    assert!(samples.keys().copied().eq((0..60).map(|sample| sample * 700_000)));
    for (sample, values) in samples.values().enumerate() {
        let expected = expected(&recording, sample);
        assert_eq!(values.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
        assert!(values.iter().all(|(name, value)| near(*value, expected[name])), "sample {sample}: {values:?}");
    }

    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    // PlotJuggler takes channels, their schemas and counts from the summary, and reads no file without one.
    let statistics = summary.stats.as_ref().unwrap();
    assert_eq!(statistics.message_count, 180);
    assert!(summary.channels.keys().all(|channel| statistics.channel_message_counts[channel] == 60));
    assert!(
        summary.channels.values().all(|channel| summary.schemas.contains_key(&channel.schema.as_ref().unwrap().id))
    );
    let metadata = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!(metadata.name, "recording");
    for (key, value) in [
        ("seed", "17"),
        ("mode", "p"),
        ("robot", "PUMA 560, links 2 and 3"),
        ("joint_3_lead", "0.5"),
        ("model_crc", "0a1b2c3d"),
    ] {
        assert_eq!(metadata.metadata.get(key).map(String::as_str), Some(value), "{key}");
    }
    let attached = mcap::read::attachment(&bytes, &summary.attachment_indexes[0]).unwrap();
    assert_eq!(Robot::from_bytes("robot.toml".as_ref(), attached.data.to_vec()).unwrap(), robot);
}

/// A slide of 3 kg that a voltage drives with 2 N/V.
fn slide() -> Robot {
    let mut robot = Robot::paper();
    robot.kind = Kind::SingleAxis;
    robot.unit = Unit::Metre;
    robot.current_is_command = true;
    robot.joints.truncate(1);
    let joint = &mut robot.joints[0];
    joint.name = "1".into();
    joint.gear_ratio = 1.0;
    joint.counts_per_rev = TAU * 1e4;
    joint.torque_constant_nm_per_a = 2.0;
    joint.law = Law::Cascade { position_gain_per_s: 100.0, velocity_gain: 50.0 };
    joint.limits = JointLimits {
        position_low_rad: f64::MIN,
        position_high_rad: f64::MAX,
        speed_rad_s: f64::MAX,
        acceleration_rad_s2: f64::MAX,
    };
    robot
}

#[test]
fn a_linear_axis_is_in_metres_and_newtons() {
    let mut recording = recording();
    for columns in [&mut recording.reference_counts, &mut recording.error_counts, &mut recording.current_a] {
        columns.truncate(1);
    }
    recording.command_a = None;
    recording.manifest = None;
    let text = recording_csv(&recording, &slide());
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some(
            "time_s,joint_1_reference_m,joint_1_position_m,joint_1_error_m,joint_1_error_counts,joint_1_commanded_force_n"
        )
    );
    let row: Vec<f64> = lines.nth(5).unwrap().split(',').map(|field| field.parse().unwrap()).collect();
    let (reference, error) = (recording.reference_counts[0][5], recording.error_counts[0][5]);
    let expected =
        [0.0035, reference / 1e4, (reference - error) / 1e4, error / 1e4, error, 2.0 * recording.current_a[0][5]];
    assert!(row.iter().zip(expected).all(|(value, expected)| near(*value, expected)), "{row:?}, not {expected:?}");

    let mut model = HiddenRobot::draw(&Robot::paper(), 1).to_model(toml::Table::new());
    model.f = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0];
    let urdf = urdf_rs::read_from_string(&model_urdf(&model, &slide(), None).unwrap()).unwrap();
    assert_eq!(urdf.joints[0].joint_type, urdf_rs::JointType::Prismatic);
    assert_eq!(urdf.links[1].inertial.mass.value, 3.0);
    assert_real(&urdf.links[1].inertial.inertia);
}

/// f by its definitions from the bodies of a URDF file and the rotors in its transmissions.
fn f_of(urdf: &urdf_rs::Robot, text: &str) -> [f64; 9] {
    let link = |name: &str| &urdf.links.iter().find(|link| link.name == name).unwrap().inertial;
    let (upper, fore) = (link("link_2"), link("link_3"));
    let a3 = urdf.joints.iter().find(|joint| joint.name == "joint_3").unwrap().origin.xyz.0[0];
    let numbers = |element: &str| -> Vec<f64> {
        let start = format!("<drake:{element} value=\"");
        text.split(&start).skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect()
    };
    let (rotor, ratio) = (numbers("rotor_inertia"), numbers("gear_ratio"));
    let (m2, [x2, y2, _], izz2) = (upper.mass.value, upper.origin.xyz.0, upper.inertia.izz);
    let (m3, [x3, y3, _], izz3) = (fore.mass.value, fore.origin.xyz.0, fore.inertia.izz);
    let f2 = izz3 + m3 * (x3 * x3 + y3 * y3);
    let f7 = rotor[0] * ratio[0].powi(2) + izz2 + m2 * (x2 * x2 + y2 * y2) + m3 * a3 * a3 + f2;
    [rotor[1] * ratio[1].powi(2) + f2, f2, m3 * x3 * a3, m3 * y3 * a3, m3 * x3, m3 * y3, f7, m2 * y2, m2 * x2 + m3 * a3]
}

/// An inertia that some distribution of mass has: positive definite, and no principal moment above the sum of the others.
fn assert_real(inertia: &urdf_rs::Inertia) {
    let matrix = nalgebra::Matrix3::new(
        inertia.ixx,
        inertia.ixy,
        inertia.ixz,
        inertia.ixy,
        inertia.iyy,
        inertia.iyz,
        inertia.ixz,
        inertia.iyz,
        inertia.izz,
    );
    let moments = matrix.symmetric_eigenvalues();
    let most = moments.max();
    assert!(moments.min() > 0.0 && most <= moments.sum() - most, "{moments}");
}

fn assert_real_arm(urdf: &urdf_rs::Robot) {
    for link in urdf.links.iter().filter(|link| link.name != "base") {
        assert!(link.inertial.mass.value > 0.0);
        assert_real(&link.inertial.inertia);
    }
}

#[test]
fn urdf_bodies_are_real_and_give_f_back() {
    let robot = Robot::paper();
    for seed in 0..20 {
        let model = HiddenRobot::draw(&robot, seed).to_model(toml::Table::new());
        let text = model_urdf(&model, &robot, None).unwrap();
        let urdf = urdf_rs::read_from_string(&text).unwrap();
        assert_real_arm(&urdf);
        for (index, (found, given)) in f_of(&urdf, &text).iter().zip(model.f).enumerate() {
            assert!(
                (found - given).abs() < 1e-5 * given.abs().max(0.1),
                "seed {seed}: f{}: {found}, not {given}",
                index + 1
            );
        }
        assert!(text.contains("They do not determine"), "{text}");
    }
}

/// The weight of the bodies, moved along the file's own frames, loads the joints as gravity does in the model.
#[test]
fn urdf_frames_are_those_of_f() {
    let robot = Robot::paper();
    let model = HiddenRobot::draw(&robot, 3).to_model(toml::Table::new());
    let urdf = urdf_rs::read_from_string(&model_urdf(&model, &robot, None).unwrap()).unwrap();
    let potential_j = |q: [f64; 2]| {
        let mut frame = nalgebra::Isometry3::identity();
        let mut sum = 0.0;
        for (index, name) in ["2", "3"].into_iter().enumerate() {
            let joint = urdf.joints.iter().find(|joint| joint.name == format!("joint_{name}")).unwrap();
            let ([x, y, z], [roll, pitch, yaw]) = (joint.origin.xyz.0, joint.origin.rpy.0);
            let turn = nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let axis = nalgebra::Vector3::from(joint.axis.xyz.0) * q[index];
            frame = frame
                * nalgebra::Isometry3::from_parts(nalgebra::Translation3::new(x, y, z), turn)
                * nalgebra::Isometry3::rotation(axis);
            let inertial = &urdf.links.iter().find(|link| link.name == format!("link_{name}")).unwrap().inertial;
            let [x, y, z] = inertial.origin.xyz.0;
            sum += inertial.mass.value * robot.gravity_m_s2 * (frame * nalgebra::Point3::new(x, y, z)).z;
        }
        sum
    };
    let arm = Arm { f: model.f, gravity_m_s2: robot.gravity_m_s2 };
    for q in [[0.3, -0.4], [-1.2, 0.9], [2.0, 2.5]] {
        let expected = arm.gravity_torque_nm(&Pose::at(q));
        for (joint, expected) in expected.into_iter().enumerate() {
            let moved = |by: f64| std::array::from_fn(|at| q[at] + if at == joint { by } else { 0.0 });
            let torque = (potential_j(moved(1e-5)) - potential_j(moved(-1e-5))) / 2e-5;
            assert!((torque - expected).abs() < 1e-3, "at {q:?}, joint {joint}: {torque}, not {expected}");
        }
    }
}

/// f as an identification leaves it: a little off what an arm of this length can have.
fn untied() -> Model {
    let mut model = HiddenRobot::draw(&Robot::paper(), 5).to_model(toml::Table::new());
    model.f[2] += 0.02;
    model.f[3] -= 0.03;
    model.f_standard_error = Some([0.01; 9]);
    model
}

#[test]
fn what_no_bodies_give_becomes_the_nearest_that_some_give() {
    let (robot, model) = (Robot::paper(), untied());
    let text = model_urdf(&model, &robot, None).unwrap();
    let urdf = urdf_rs::read_from_string(&text).unwrap();
    assert_real_arm(&urdf);
    let f = f_of(&urdf, &text);
    let a3 = robot.upper_arm_m;
    assert!((f[2] - a3 * f[4]).abs() < 1e-9 && (f[3] - a3 * f[5]).abs() < 1e-9);
    // The ties are two linear equations; the nearest f in the metric of equal errors follows from them by hand: a tie broken
    // by b is mended by moving f3 (f4) by b / (1 + a3²) and f5 (f6) by a3 times as much.
    for (tied, tie, index) in [(2, 4, 0), (3, 5, 1)] {
        let broken = model.f[tied] - a3 * model.f[tie];
        let share = broken / (1.0 + a3 * a3);
        assert!((f[tied] - (model.f[tied] - share)).abs() < 1e-5, "tie {index}: {f:?}");
        assert!((f[tie] - (model.f[tie] + a3 * share)).abs() < 1e-5, "tie {index}: {f:?}");
    }
    assert!(text.contains("standard errors away"), "{text}");
}

/// No arm has an f2 below what its f5 and f6 need: the upper arm's own f7 leaves no room for a heavier forearm.
#[test]
fn an_impossible_f_becomes_the_nearest_possible_one() {
    let (robot, mut model) = (Robot::paper(), untied());
    model.f = [1.647, 0.05, -0.011, -0.958, -0.025, -2.219, 5.609, -0.104, 4.875];
    // Even of the greatest mass that f7 allows, (f7 − f2) / a3², the centre needs more than this f2.
    let a3 = robot.upper_arm_m;
    assert!(model.f[5].powi(2) > model.f[1] * (model.f[6] - model.f[1]) / (a3 * a3));
    let text = model_urdf(&model, &robot, None).unwrap();
    let urdf = urdf_rs::read_from_string(&text).unwrap();
    assert_real_arm(&urdf);
    let f = f_of(&urdf, &text);
    assert!(f[1] > model.f[1] && f[5].powi(2) <= f[1] * (f[6] - f[1]) / (a3 * a3) * (1.0 + 1e-6), "{f:?}");
}

#[test]
fn bodies_keep_to_given_bounds() {
    let (robot, model) = (Robot::paper(), untied());
    let link = |mass_kg, inertia_kg_m2| LinkBounds {
        mass_kg,
        centre_x_m: [-0.5, 0.5],
        centre_y_m: [-0.5, 0.5],
        inertia_kg_m2,
        motor_inertia_kg_m2: [1e-4, 6e-4],
    };
    let bounds = ArmBounds {
        upper_arm_m: robot.upper_arm_m,
        links: [link([8.0, 12.0], [0.05, 2.0]), link([6.0, 7.0], [0.05, 2.0])],
        gear_ratios: [107.8, -53.7],
        joints: ["2", "3"].map(String::from),
    };
    let text = model_urdf(&model, &robot, Some(&bounds)).unwrap();
    let urdf = urdf_rs::read_from_string(&text).unwrap();
    assert_real_arm(&urdf);
    let masses: Vec<f64> = urdf.links[1..].iter().map(|link| link.inertial.mass.value).collect();
    assert!((8.0..=12.0).contains(&masses[0]) && (6.0..=7.0).contains(&masses[1]), "{masses:?}");
}

#[test]
fn json_names_units_and_leaves_out_what_was_not_sought() {
    let mut model = untied();
    model.f_standard_error = Some([0.01, f64::INFINITY, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01]);
    let text = model_json(&model, &Robot::paper()).to_string();
    let found: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((found["f"]["f7"]["value"].as_f64(), &found["f"]["f7"]["unit"]), (Some(model.f[6]), &"kg m²".into()));
    assert_eq!(found["f"]["f9"]["unit"], "kg m");
    assert_eq!(found["f"]["f1"]["standard_error"], 0.01);
    // Untellable, so not a number, but said.
    assert!(found["f"]["f2"].as_object().unwrap()["standard_error"].is_null());
    let joint = &found["joints"][1];
    assert_eq!((joint["name"].as_str(), joint["coulomb_friction_at_motor"]["unit"].as_str()), (Some("3"), Some("N m")));
    assert!(joint["coulomb_friction_at_motor"].get("standard_error").is_none());
}

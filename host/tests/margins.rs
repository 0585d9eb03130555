//! Margins of computed torque against another program's numbers, and against where simulation becomes unstable.

use armid::hidden_robot::HiddenRobot;
use armid::margins::{ArmLoop, MarginLack};
use armid::model::{Effect, Model};
use armid::robot::Robot;
use shared::arm::{Arm, REFERENCE_F};
use shared::control::{ComputedTorque, ComputedTorqueInput, ComputedTorqueSettings, JointReference};
use shared::drive::Drive;
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant, JointEffects};
use shared::machine::Machine as _;
use shared::plant::{Plant, State};

/// The reference robot's model with `effects`.
fn model(effects: &[Effect]) -> Model {
    let robot = Robot::paper();
    let mut model = HiddenRobot::draw(&robot, 1).to_model(toml::Table::new());
    model.f = REFERENCE_F;
    model.viscous_nm_s_per_rad = robot.joints.iter().map(|joint| joint.drive().viscous_friction_nm_s_per_rad).collect();
    model.effects = effects.to_vec();
    model
}

/// The paper's robot with joint 3 near one angle only.
fn robot_at(q3_rad: f64) -> Robot {
    let mut robot = Robot::paper();
    let limits = &mut robot.joints[1].limits;
    (limits.position_low_rad, limits.position_high_rad) = (q3_rad - 1e-9, q3_rad + 1e-9);
    robot
}

fn settings(bandwidth_rad_s: f64, observer_bandwidth_rad_s: f64) -> ComputedTorqueSettings<f64> {
    ComputedTorqueSettings { bandwidth_rad_s, observer_bandwidth_rad_s, ..ComputedTorqueSettings::at_record_period() }
}

/// A shaft of joint 3 on which motor and link, at q3 = 0, swing against each other at `frequency_hz`, damped to 1 %.
fn shaft(frequency_hz: f64) -> Effect {
    let motor = 2e-4 * 53.7 * 53.7;
    let link = REFERENCE_F[0] - motor;
    let omega = std::f64::consts::TAU * frequency_hz;
    let stiffness = motor * link / (motor + link) * omega * omega;
    armid::effects::parse(&format!(
        "joint-flexibility:joint=3,compliance_rad_per_nm={:e},damping_s={:e}",
        1.0 / stiffness,
        0.02 / omega
    ))
    .unwrap()
}

fn without_lag(mut arm: ArmLoop) -> ArmLoop {
    arm.current_lag_s = [0.0; 2];
    arm
}

/// Gain and phase margins of joints 2 and 3 at q3 = 0, and the gain of both that is still stable, from a program of its
/// own (matrices of scipy, no line in common).
#[test]
fn margins_are_those_of_an_independent_computation() {
    let rigid = without_lag(ArmLoop::of_model(&robot_at(0.0), &model(&[])).unwrap());
    let flexible = without_lag(ArmLoop::of_model(&robot_at(0.0), &model(&[shaft(30.0)])).unwrap());
    for (arm, bandwidth, observer, gain, phase_deg, both) in [
        (&rigid, 150.0, 400.0, [5.42, 5.42], [46.86, 47.18], 5.42),
        (&rigid, 200.0, 800.0, [5.55, 5.57], [48.36, 48.55], 5.56),
        (&rigid, 300.0, 1200.0, [4.85, 4.85], [47.06, 47.19], 4.86),
        (&flexible, 200.0, 800.0, [3.93, 1.84], [52.61, 23.31], 1.766),
        (&flexible, 100.0, 1200.0, [f64::NAN, f64::NAN], [f64::NAN, 42.0], 3.07),
    ] {
        let margins = arm.margins(&settings(bandwidth, observer));
        println!("{bandwidth} {observer}: {margins:.4?}");
        for joint in 0..2 {
            let found = &margins.joints[joint];
            let near = |found: f64, expected: f64, within: f64| expected.is_nan() || (found - expected).abs() < within;
            assert!(near(found.gain_margin, gain[joint], 0.03), "{bandwidth} {observer}: {found:?}");
            assert!(near(found.phase_margin_deg, phase_deg[joint], 0.3), "{bandwidth} {observer}: {found:?}");
            assert_eq!(found.gain_reduction, 0.0);
        }
        assert!((1.0 / margins.least_inertia_share - both).abs() < 0.01 * both, "{margins:?}");
    }
}

/// By how much small deviations have grown between the first and the last half second of two, for an arm that has
/// `share` of the inertia that the controller takes it to have. The encoders do not round.
fn growth(arm: &ArmLoop, effects: [JointEffects<f64>; 2], settings: ComputedTorqueSettings<f64>, share: f64) -> f64 {
    let robot = Robot::paper();
    let drive = |joint: usize, share: f64| Drive {
        current_limit_a: 1e9,
        coulomb_friction_nm: 0.0,
        viscous_friction_nm_s_per_rad: robot.joints[joint].drive().viscous_friction_nm_s_per_rad * share,
        ..robot.joints[joint].drive()
    };
    let scaled = effects.map(|joint| JointEffects {
        compliance_rad_per_nm: joint.compliance_rad_per_nm / share,
        motor_inertia_kg_m2: joint.motor_inertia_kg_m2 * share,
        ..joint
    });
    let plant = Plant {
        arm: Arm { f: arm.f.map(|f| f * share), gravity_m_s2: 0.0 },
        drives: [drive(0, share), drive(1, share)],
    };
    let machine = ExtendedMachine::new(&ExtendedPlant { plant, effects: Effects { joints: scaled, ..Effects::OFF } });
    let believed = Arm { f: arm.f, gravity_m_s2: 0.0 };
    // Away from zero, where the middle of a count's cell jumps.
    let start = [0.5, 0.5];
    let reference = JointReference { position_rad: start, velocity_rad_s: [0.0; 2], acceleration_rad_s2: [0.0; 2] };
    let mut controller =
        ComputedTorque::new(believed, [drive(0, 1.0), drive(1, 1.0)], settings, robot.loop_period_s, start);
    let mut motion = machine.start(State::at_rest(start.map(|angle| angle + 1e-4)), 0.0);
    let mut command_a = [0.0; 2];
    let ticks = (2.0 / robot.loop_period_s) as usize;
    let (mut early, mut late) = (0.0_f64, 0.0_f64);
    for tick in 0..ticks {
        let counts = machine.position_counts(&motion);
        let output = controller.tick(&ComputedTorqueInput {
            reference,
            reference_ahead: reference,
            encoder_counts: counts.map(|counts| counts - 0.5 * counts.signum()),
        });
        for (command, duration_s) in
            [(command_a, robot.command_delay_s), (output.command_a, robot.loop_period_s - robot.command_delay_s)]
        {
            let held = machine.fresh(machine.input(command), [0.0; 2]);
            let steps = (duration_s / 2e-5).ceil();
            for _ in 0..steps as usize {
                motion = machine.step(&motion, &held, duration_s / steps);
            }
        }
        command_a = output.command_a;
        let deviation = (0..2).map(|joint| (motion.motor.position_rad[joint] - start[joint]).abs()).fold(0.0, f64::max);
        if (ticks / 4..ticks / 2).contains(&tick) {
            early = early.max(deviation);
        } else if tick >= 3 * ticks / 4 {
            late = late.max(deviation);
        }
        if deviation > 1.0 {
            return f64::INFINITY;
        }
    }
    late / early
}

/// The analysis says down to which inertia the loop is stable: a little above it deviations die away in simulation, a
/// little below they grow. Rigid, flexible, and with amplifiers that lag.
#[test]
fn simulation_becomes_unstable_where_the_analysis_says() {
    let lag = armid::effects::parse("current-lag:joint=2,time_constant_s=0.0003").unwrap();
    let off = JointEffects::OFF;
    for (name, effects, bandwidth, observer) in [
        ("rigid", vec![], 150.0, 400.0),
        ("rigid", vec![], 200.0, 800.0),
        ("rigid", vec![], 300.0, 1200.0),
        ("flexible at 30 Hz", vec![shaft(30.0)], 200.0, 800.0),
        ("flexible at 60 Hz", vec![shaft(60.0)], 150.0, 400.0),
        ("flexible at 15 Hz", vec![shaft(15.0)], 100.0, 1200.0),
        ("lagging", vec![lag], 200.0, 800.0),
    ] {
        let all = armid::effects::from_entries(&effects, &Robot::paper()).unwrap();
        let mut arm = ArmLoop::of_model(&robot_at(0.5), &model(&effects)).unwrap();
        arm.current_lag_s = all.joints.map(|joint| joint.current_lag_s);
        let settings = settings(bandwidth, observer);
        let edge = arm.margins(&settings).least_inertia_share;
        let joints = all.joints.map(|joint| JointEffects {
            compliance_rad_per_nm: joint.compliance_rad_per_nm,
            shaft_damping_s: joint.shaft_damping_s,
            current_lag_s: joint.current_lag_s,
            ..off
        });
        let [above, below] = [1.03, 0.97].map(|share| growth(&arm, joints, settings, share * edge));
        println!(
            "{name}, {bandwidth}/{observer} rad/s: edge at {edge:.4} of the inertia; {above:.3} above, {below:.3e} below"
        );
        assert!(above < 0.8, "{name}: deviations do not die away above the edge: {above}");
        assert!(below > 1.25, "{name}: deviations do not grow below the edge: {below}");
    }
}

#[test]
fn settings_without_margin_are_refused_with_those_that_have_one() {
    let mut robot = Robot::paper();
    let rigid = ArmLoop::of_model(&robot, &model(&[])).unwrap();
    rigid.check(&robot).expect("the default on a rigid arm");
    let flexible = ArmLoop::of_model(&robot, &model(&[shaft(30.0)])).unwrap();
    let error = flexible.check(&robot).unwrap_err();
    assert!(matches!(error.lack, MarginLack::Gain { joint: 1, .. } | MarginLack::Phase { joint: 1, .. }), "{error}");
    let text = error.to_string();
    println!("{text}");
    for part in ["joint 3", "bandwidth_rad_s 200", "must be at least", "[computed_torque]"] {
        assert!(text.contains(part), "{part} is not in: {text}");
    }
    // What it proposes is accepted.
    robot.computed_torque = flexible.with_margin(&robot.computed_torque).expect("settings with margin");
    assert!(text.contains(&format!("bandwidth_rad_s = {:?}", robot.computed_torque.bandwidth_rad_s)), "{text}");
    flexible.check(&robot).expect("what was proposed");
    // A loop that cannot be stable at all.
    robot.computed_torque.bandwidth_rad_s = 3000.0;
    let error = rigid.check(&robot).unwrap_err();
    assert!(matches!(error.lack, MarginLack::Unstable { .. }), "{error}");
}

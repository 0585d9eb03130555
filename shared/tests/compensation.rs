//! Computed torque on a plant with effects that its feedforward knows, and that it does not know.

mod robot;

use robot::{DELAY_S, PERIOD_S, SAMPLES, counts_per_rad, plant, reference};
use shared::control::{ComputedTorque, ComputedTorqueInput, ComputedTorqueSettings};
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant, JointEffects};
use shared::machine::Machine as _;
use shared::plant::State;

const OFF: JointEffects<f64> = JointEffects::OFF;

/// Longest step of the plant in s.
const STEP_S: f64 = 5e-5;

/// Rms of the true errors of both joints in counts over the paper's movement, where the arm has effects and the
/// controller is told of `known` ones.
fn rms_counts(arm: [JointEffects<f64>; 2], known: [JointEffects<f64>; 2]) -> [f64; 2] {
    let effects = Effects { joints: arm, ..Effects::OFF };
    let machine = ExtendedMachine::new(&ExtendedPlant { plant: plant(), effects });
    let start = reference(0.0).position_rad;
    // A softer loop than the board's, in which small effects show.
    let settings = ComputedTorqueSettings {
        bandwidth_rad_s: 150.0,
        observer_bandwidth_rad_s: 400.0,
        ..ComputedTorqueSettings::at_record_period()
    };
    let (arm, drives) = (plant().arm, plant().drives);
    let mut controller = ComputedTorque::with_effects(arm, drives, [&known[0], &known[1]], settings, PERIOD_S, start);
    let mut motion = machine.start(State::at_rest(start), 0.0);
    let mut command_a = [0.0; 2];
    let mut squares = [0.0; 2];
    for tick in 0..SAMPLES {
        let time_s = tick as f64 * PERIOD_S;
        let wanted = reference(time_s);
        for (joint, square) in squares.iter_mut().enumerate() {
            let error = wanted.position_rad[joint] - motion.motor.position_rad[joint];
            *square += (error * counts_per_rad()[joint]).powi(2);
        }
        let output = controller.tick(&ComputedTorqueInput {
            reference: wanted,
            reference_ahead: reference(time_s + 0.5 * PERIOD_S + DELAY_S),
            encoder_counts: machine.position_counts(&motion).map(f64::trunc),
        });
        for (command, duration_s) in [(command_a, DELAY_S), (output.command_a, PERIOD_S - DELAY_S)] {
            let held = machine.fresh(machine.input(command), [0.0; 2]);
            let steps = (duration_s / STEP_S).ceil();
            for _ in 0..steps as usize {
                motion = machine.step(&motion, &held, duration_s / steps);
            }
        }
        command_a = output.command_a;
    }
    squares.map(|square| (square / SAMPLES as f64).sqrt())
}

/// Each at the size that its catalogue calls clear, or twice that.
fn compensated() -> Vec<(&'static str, JointEffects<f64>)> {
    vec![
        ("coulomb-friction", JointEffects { coulomb_change_nm: 0.06, ..OFF }),
        ("viscous-friction", JointEffects { viscous_change_nm_s_per_rad: 6e-4, ..OFF }),
        ("asymmetric-friction", JointEffects { coulomb_asymmetry_nm: 0.08, ..OFF }),
        ("asymmetric-viscous-friction", JointEffects { viscous_asymmetry_nm_s_per_rad: 8e-4, ..OFF }),
        ("stribeck-friction", JointEffects { stribeck_nm: 0.06, stribeck_velocity_rad_s: 30.0, ..OFF }),
        ("stribeck-friction", JointEffects { stribeck_nm: -0.06, stribeck_sharpness: 0.0, ..OFF }),
        ("load-dependent-friction", JointEffects { load_friction_coefficient: 0.1, ..OFF }),
        (
            "position-dependent-friction",
            JointEffects { position_friction_nm: 0.06, position_friction_order: 4.0, ..OFF },
        ),
        ("quadratic-friction", JointEffects { quadratic_nm_s2_per_rad2: 1e-5, ..OFF }),
        ("torque-offset", JointEffects { torque_offset_nm: 0.06, ..OFF }),
        ("torque-constant", JointEffects { torque_constant_change: 0.1, ..OFF }),
        ("torque-ripple", JointEffects { ripple_share: 0.1, ripple_order: 2.0, ripple_phase_rad: 0.7, ..OFF }),
        ("cogging", JointEffects { cogging_nm: 0.05, cogging_order: 3.0, cogging_phase_rad: -1.1, ..OFF }),
        ("gravity-spring", JointEffects { spring_nm: 3.0, spring_angle_rad: 0.4, ..OFF }),
    ]
}

#[test]
fn what_the_feedforward_knows_hardly_disturbs_any_more() {
    let exact = rms_counts([OFF; 2], [OFF; 2]);
    println!("{:<30} {exact:.3?}", "no effect");
    for (name, effects) in compensated() {
        for joint in 0..2 {
            let mut arm = [OFF; 2];
            arm[joint] = effects;
            let without = rms_counts(arm, [OFF; 2])[joint];
            let with = rms_counts(arm, arm)[joint];
            println!("{name:<30} joint {}: {without:.3} → {with:.3} counts rms", joint + 2);
            // What is left: the switching width of friction, and that feedforward is taken at the reference motion.
            assert!(without > 1.5 * exact[joint], "{name} does not disturb joint {}: {without}", joint + 2);
            assert!(with < 1.2 * exact[joint], "{name} is not compensated on joint {}: {with}", joint + 2);
        }
    }
}

/// A phase that is wrong by half a period makes it worse than nothing: why phases are dropped with the pose.
#[test]
fn a_wrong_phase_is_worse_than_none() {
    let cogging = JointEffects { cogging_nm: 0.05, cogging_order: 3.0, ..OFF };
    let turned = JointEffects { cogging_phase_rad: core::f64::consts::PI, ..cogging };
    let without = rms_counts([cogging, OFF], [OFF; 2])[0];
    let wrong = rms_counts([cogging, OFF], [turned, OFF])[0];
    assert!(wrong > 1.5 * without, "{without} {wrong}");
}

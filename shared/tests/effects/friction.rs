//! Friction's shape, by the torque it has at a velocity.

use shared::effects::JointEffects;

use crate::axis::{INERTIA, LINK, RATIO, STEP_S, TORQUE_CONSTANT, acceleration, at, axis, near, step};

const COULOMB: f64 = 0.1;
const OFF: JointEffects<f64> = JointEffects::OFF;

/// Friction's torque at the motor, in the motor's own direction, at a speed of the motor.
fn friction_nm(effects: JointEffects<f64>, position_rad: f64, motor_rad_s: f64, time_s: f64) -> f64 {
    let machine = axis(COULOMB, effects);
    let motion = at(&machine, position_rad, motor_rad_s / RATIO, time_s);
    acceleration(&machine, &motion, 0.0) * INERTIA / RATIO
}

#[test]
fn coulomb_and_viscous_changes_add_to_the_drives_own() {
    let effects = JointEffects { coulomb_change_nm: 0.03, viscous_change_nm_s_per_rad: 2e-3, ..OFF };
    near(friction_nm(effects, 0.0, 20.0, 0.0), -(0.13 + 0.04), 1e-6);
    near(friction_nm(effects, 0.0, -20.0, 0.0), 0.13 + 0.04, 1e-6);
    // Friction that would drive is none.
    near(friction_nm(JointEffects { coulomb_change_nm: -0.2, ..OFF }, 0.0, 20.0, 0.0), 0.0, 1e-9);
}

#[test]
fn asymmetry_is_the_difference_between_the_motors_directions() {
    let effects = JointEffects { coulomb_asymmetry_nm: 0.04, ..OFF };
    near(friction_nm(effects, 0.0, 20.0, 0.0), -0.12, 1e-6);
    near(friction_nm(effects, 0.0, -20.0, 0.0), 0.08, 1e-6);
    let effects = JointEffects { viscous_asymmetry_nm_s_per_rad: 4e-4, ..OFF };
    near(friction_nm(effects, 0.0, 20.0, 0.0), -(0.1 + 0.004), 1e-6);
    near(friction_nm(effects, 0.0, -20.0, 0.0), 0.1 - 0.004, 1e-6);
}

#[test]
fn asymmetric_friction_holds_up_to_its_own_bound_in_each_direction() {
    let machine = axis(COULOMB, JointEffects { coulomb_asymmetry_nm: 0.04, ..OFF });
    for (motor_nm, moves) in [(0.119, false), (0.121, true), (-0.079, false), (-0.081, true)] {
        let next = step(&machine, &at(&machine, 0.0, 0.0, 0.0), motor_nm / TORQUE_CONSTANT, STEP_S);
        assert_eq!(next.motor.velocity_rad_s[0] != 0.0, moves, "{motor_nm}");
        assert!(next.motor.velocity_rad_s[0] * RATIO * motor_nm >= 0.0);
    }
}

#[test]
fn stribeck_friction_falls_as_its_curve() {
    let effects = JointEffects { stribeck_nm: 0.05, stribeck_velocity_rad_s: 8.0, ..OFF };
    for motor_rad_s in [0.01, 2.0, 8.0, 12.0, 24.0, 100.0] {
        let x: f64 = motor_rad_s / 8.0;
        near(-friction_nm(effects, 0.0, motor_rad_s, 0.0), COULOMB + 0.05 * (-x * x).exp(), 2e-4 * 0.05 + 1e-5);
        let blunt = JointEffects { stribeck_sharpness: 0.0, ..effects };
        near(-friction_nm(blunt, 0.0, motor_rad_s, 0.0), COULOMB + 0.05 * (-x).exp(), 2e-4 * 0.05 + 1e-5);
    }
    // Breaking away needs all of it.
    let machine = axis(COULOMB, effects);
    for (motor_nm, moves) in [(0.149, false), (0.151, true)] {
        let next = step(&machine, &at(&machine, 0.0, 0.0, 0.0), motor_nm / TORQUE_CONSTANT, STEP_S);
        assert_eq!(next.motor.velocity_rad_s[0] != 0.0, moves, "{motor_nm}");
    }
}

#[test]
fn load_friction_is_its_share_of_the_torque_that_the_link_needs() {
    let machine = axis(COULOMB, JointEffects { load_friction_coefficient: 0.2, ..OFF });
    let mut motion = at(&machine, 0.0, 1.0, 0.0);
    for _ in 0..20 {
        motion = step(&machine, &motion, -8.0, STEP_S);
    }
    // 100 N m at the joint less 5 of Coulomb friction accelerate 2 kg m², and 0.2 of what the link takes brakes.
    let acceleration = (100.0 - 5.0) / (INERTIA + 0.2 * LINK);
    near(motion.gear_torque_nm[0], LINK * acceleration, 1e-6);
    near(motion.friction_torque_nm[0], -(5.0 + 0.2 * LINK * acceleration), 1e-6);
}

#[test]
fn friction_over_the_angle_has_its_amplitude_order_and_phase() {
    let effects = JointEffects {
        position_friction_nm: 0.03,
        position_friction_order: 2.0,
        position_friction_phase_rad: 0.5,
        ..OFF
    };
    for position_rad in [-2.0, -0.25, 0.0, 0.3, 1.1] {
        let expected = COULOMB + 0.03 * (2.0 * position_rad + 0.5_f64).cos();
        near(-friction_nm(effects, position_rad, 20.0, 0.0), expected, 1e-6);
    }
}

#[test]
fn friction_drifts_with_its_rate_from_the_start_of_the_recording() {
    let effects = JointEffects { friction_drift_nm_per_s: 0.02, ..OFF };
    for (time_s, expected) in [(-1.0, 0.1), (0.0, 0.1), (1.0, 0.12), (3.0, 0.16)] {
        near(-friction_nm(effects, 0.0, 20.0, time_s), expected, 1e-6);
    }
}

#[test]
fn quadratic_friction_grows_with_the_square_against_the_motion() {
    let effects = JointEffects { quadratic_nm_s2_per_rad2: 5e-6, ..OFF };
    near(friction_nm(effects, 0.0, 100.0, 0.0), -(0.1 + 0.05), 1e-5);
    near(friction_nm(effects, 0.0, -50.0, 0.0), 0.1 + 0.0125, 1e-5);
}

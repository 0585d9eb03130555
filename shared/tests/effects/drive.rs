//! Amplifier, motor and encoder.

use core::f64::consts::TAU;

use shared::effects::JointEffects;
use shared::machine::Machine as _;

use crate::axis::{INERTIA, RATIO, STEP_S, TORQUE_CONSTANT, acceleration, at, axis, near, step};

const OFF: JointEffects<f64> = JointEffects::OFF;

/// The motor's torque at an angle of the motor under a commanded current.
fn motor_nm(effects: JointEffects<f64>, motor_rad: f64, command_a: f64) -> f64 {
    let machine = axis(0.0, effects);
    acceleration(&machine, &at(&machine, motor_rad / RATIO, 0.0, 0.0), command_a) * INERTIA / RATIO
}

/// Amplitude and phase of the motor's torque at an order over one revolution, from 96 angles.
fn wave(effects: JointEffects<f64>, order: f64, command_a: f64) -> (f64, f64) {
    let (mut cosine, mut sine) = (0.0, 0.0);
    for k in 0..96 {
        let angle = TAU * f64::from(k) / 96.0;
        let torque = motor_nm(effects, angle, command_a);
        cosine += torque * (order * angle).cos() / 48.0;
        sine += torque * (order * angle).sin() / 48.0;
    }
    (cosine.hypot(sine), (-sine).atan2(cosine))
}

#[test]
fn torque_constant_and_offset_act_at_the_motor() {
    near(motor_nm(JointEffects { torque_constant_change: 0.1, ..OFF }, 0.0, 2.0), 0.55, 1e-8);
    near(motor_nm(JointEffects { torque_offset_nm: 0.03, ..OFF }, 0.0, 2.0), 0.47, 1e-8);
}

#[test]
fn ripple_has_its_order_and_scales_with_the_torque() {
    let effects = JointEffects { ripple_share: 0.05, ripple_order: 7.0, ripple_phase_rad: 0.6, ..OFF };
    for command_a in [2.0, 4.0] {
        let (amplitude, phase) = wave(effects, 7.0, command_a);
        near(amplitude, 0.05 * TORQUE_CONSTANT * command_a, 1e-7);
        near(phase, 0.6, 1e-6);
        near(wave(effects, 6.0, command_a).0, 0.0, 1e-7);
    }
    near(wave(effects, 7.0, 0.0).0, 0.0, 1e-9);
}

#[test]
fn cogging_has_its_order_and_does_not_scale() {
    let effects = JointEffects { cogging_nm: 0.02, cogging_order: 12.0, cogging_phase_rad: -0.9, ..OFF };
    for command_a in [0.0, 4.0] {
        let (amplitude, phase) = wave(effects, 12.0, command_a);
        near(amplitude, 0.02, 1e-7);
        near(phase, -0.9, 1e-6);
        near(wave(effects, 11.0, command_a).0, 0.0, 1e-7);
    }
}

#[test]
fn lag_follows_a_step_with_its_time_constant() {
    for (time_constant_s, tolerance) in [(1e-3, 1e-6), (2e-4, 1e-3), (6.4e-5, 2e-3)] {
        let machine = axis(0.0, JointEffects { current_lag_s: time_constant_s, ..OFF });
        let mut motion = at(&machine, 0.0, 0.0, 0.0);
        for k in 1..=40 {
            motion = step(&machine, &motion, 2.0, STEP_S);
            let expected = 2.0 * (1.0 - (-f64::from(k) * STEP_S / time_constant_s).exp());
            near(motion.current_a[0], expected, 2.0 * tolerance);
        }
        // All told the torque comes late by the time constant: the speed lacks its impulse.
        let full = 40.0 * STEP_S;
        let missing_s = full - motion.motor.velocity_rad_s[0] * INERTIA / (RATIO * TORQUE_CONSTANT * 2.0);
        near(missing_s, time_constant_s * (1.0 - (-full / time_constant_s).exp()), 1e-8);
    }
}

#[test]
fn current_saturates_at_its_level() {
    let effects = JointEffects { current_limit_a: 3.0, ..OFF };
    for (command_a, expected) in [(2.9, 2.9), (5.0, 3.0), (-5.0, -3.0)] {
        near(motor_nm(effects, 0.0, command_a), expected * TORQUE_CONSTANT, 1e-8);
    }
    // A limit above the drive's own does nothing.
    near(motor_nm(JointEffects { current_limit_a: 30.0, ..OFF }, 0.0, 20.0), 12.0 * TORQUE_CONSTANT, 1e-8);
}

#[test]
fn voltage_left_by_the_back_emf_limits_the_current() {
    let machine = axis(0.0, JointEffects { supply_v: 24.0, winding_ohm: 2.0, ..OFF });
    // At 40 rad/s the motor gives 10 V against positive currents: 7 A are left, and −17 A of which the drive allows 12.
    let motion = at(&machine, 0.0, 40.0 / RATIO, 0.0);
    near(step(&machine, &motion, 9.0, 1e-6).current_a[0], 7.0, 1e-3);
    near(step(&machine, &motion, 6.0, 1e-6).current_a[0], 6.0, 1e-9);
    near(step(&machine, &motion, -20.0, 1e-6).current_a[0], -12.0, 1e-9);
}

#[test]
fn back_emf_takes_current_in_proportion_to_the_speed() {
    let machine = axis(0.0, JointEffects { back_emf_a_s_per_rad: 0.01, ..OFF });
    let motion = at(&machine, 0.0, 40.0 / RATIO, 0.0);
    // In a microsecond 625 rad/s² of the motor change that by 3e-6 A.
    near(step(&machine, &motion, 2.0, 1e-6).current_a[0], 1.6, 1e-5);
    // The same torque as viscous friction of Kt times it.
    near(acceleration(&machine, &motion, 0.0) * INERTIA / RATIO, -TORQUE_CONSTANT * 0.01 * 40.0, 1e-6);
}

#[test]
fn dead_zone_swallows_small_commands_and_shortens_great_ones() {
    let machine = axis(0.0, JointEffects { dead_zone_a: 0.2, ..OFF });
    for (command_a, expected) in [(0.15, 0.0), (-0.2, 0.0), (0.5, 0.3), (-1.0, -0.8)] {
        near(step(&machine, &at(&machine, 0.0, 0.0, 0.0), command_a, STEP_S).current_a[0], expected, 1e-12);
    }
}

#[test]
fn transmission_error_shifts_the_counts_with_its_order() {
    let effects = JointEffects {
        transmission_error_rad: 3e-4,
        transmission_error_order: 2.0,
        transmission_error_phase_rad: 0.4,
        ..OFF
    };
    let machine = axis(0.0, effects);
    let counts_per_rad = RATIO * 1000.0 / TAU;
    for motor_rad in [-7.0, 0.0, 0.3, 2.0] {
        let found = machine.position_counts(&at(&machine, motor_rad / RATIO, 0.0, 0.0))[0];
        let error_rad = 3e-4 * (2.0 * motor_rad + 0.4_f64).cos();
        near(found, counts_per_rad * (motor_rad / RATIO + error_rad), 1e-9);
    }
}

#[test]
fn encoder_slips_by_its_counts_at_its_instant() {
    let machine = axis(0.0, JointEffects { slip_counts: 7.0, slip_instant_s: 1.0, ..OFF });
    for (time_s, expected) in [(0.0, 0.0), (1.0, 0.0), (1.0007, 7.0), (5.0, 7.0)] {
        near(machine.position_counts(&at(&machine, 0.0, 0.0, time_s))[0], expected, 1e-9);
    }
}

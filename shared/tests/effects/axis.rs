//! A single axis without friction, whose motion is easily calculated.

use shared::drive::Drive;
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant, JointEffects, Motion};
use shared::machine::Machine as _;
use shared::plant::{Plant, State};

/// Motor turns per joint turn: the motor turns the other way.
pub const RATIO: f64 = -50.0;
pub const TORQUE_CONSTANT: f64 = 0.25;
/// Inertia of the whole axis at the joint, kg m².
pub const INERTIA: f64 = 2.0;
/// The motor's part of it at the joint: 2.4e-4 · 50².
pub const MOTOR: f64 = 0.6;
pub const LINK: f64 = INERTIA - MOTOR;
/// A quarter of the record period.
pub const STEP_S: f64 = 1.75e-4;

pub fn drive() -> Drive<f64> {
    Drive {
        gear_ratio: RATIO,
        counts_per_rev: 1000.0,
        torque_constant_nm_per_a: TORQUE_CONSTANT,
        current_limit_a: 12.0,
        viscous_friction_nm_s_per_rad: 0.0,
        coulomb_friction_nm: 0.0,
        torque_offset_nm: 0.0,
    }
}

/// The axis with `effects` and `coulomb_nm` of friction at the motor.
pub fn axis(coulomb_nm: f64, effects: JointEffects<f64>) -> ExtendedMachine<f64> {
    let drive = Drive { coulomb_friction_nm: coulomb_nm, ..drive() };
    let effects = Effects {
        joints: [JointEffects { motor_inertia_kg_m2: MOTOR / RATIO.powi(2), ..effects }, JointEffects::OFF],
        ..Effects::SINGLE_AXIS
    };
    ExtendedMachine::new(&ExtendedPlant { plant: Plant::single_axis(INERTIA, drive), effects })
}

/// The axis at a position and velocity of its joint, at `time_s`.
pub fn at(machine: &ExtendedMachine<f64>, position_rad: f64, velocity_rad_s: f64, time_s: f64) -> Motion<f64> {
    machine.start(State { position_rad: [position_rad, 0.0], velocity_rad_s: [velocity_rad_s, 0.0] }, time_s)
}

/// One step of `step_s` under a commanded current.
pub fn step(machine: &ExtendedMachine<f64>, motion: &Motion<f64>, command_a: f64, step_s: f64) -> Motion<f64> {
    machine.step(motion, &machine.fresh(machine.input([command_a, 0.0]), [0.0; 2]), step_s)
}

/// The acceleration of the joint in rad/s² that a short step shows.
pub fn acceleration(machine: &ExtendedMachine<f64>, motion: &Motion<f64>, command_a: f64) -> f64 {
    let step_s = 1e-7;
    let next = step(machine, motion, command_a, step_s);
    (next.motor.velocity_rad_s[0] - motion.motor.velocity_rad_s[0]) / step_s
}

#[track_caller]
pub fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} to {tolerance}");
}

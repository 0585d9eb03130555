//! What is in no catalogue: the rate of the current, a torque constant that drifts, crosstalk, a spring with slack.

use shared::effects::{Effects, ExtendedMachine, ExtendedPlant, JointEffects};
use shared::machine::Machine as _;
use shared::plant::Plant;

use crate::axis::{INERTIA, RATIO, STEP_S, TORQUE_CONSTANT, acceleration, at, axis, drive, near, step};

const OFF: JointEffects<f64> = JointEffects::OFF;

#[test]
fn current_rises_at_its_fastest_rate() {
    // 2 A at 1000 A/s take 2 ms, eleven steps and part of one; meanwhile half of the impulse is missing.
    let machine = axis(0.0, JointEffects { current_slew_a_per_s: 1000.0, ..OFF });
    let mut motion = at(&machine, 0.0, 0.0, 0.0);
    for k in 1..=20 {
        motion = step(&machine, &motion, 2.0, STEP_S);
        near(motion.current_a[0], f64::min(1000.0 * STEP_S * f64::from(k), 2.0), 1e-12);
    }
    let missing_s = 20.0 * STEP_S - motion.motor.velocity_rad_s[0] * INERTIA / (RATIO * TORQUE_CONSTANT * 2.0);
    near(missing_s, 1e-3, 1e-9);
    for _ in 0..20 {
        motion = step(&machine, &motion, -1.0, STEP_S);
    }
    near(motion.current_a[0], -1.0, 1e-12);
}

#[test]
fn torque_constant_drifts_from_the_start_of_a_recording() {
    let machine = axis(0.0, JointEffects { torque_constant_drift_per_s: -0.01, ..OFF });
    for time_s in [0.0, 2.0, 5.0] {
        let found = acceleration(&machine, &at(&machine, 0.0, 0.0, time_s), 2.0) * INERTIA / RATIO;
        near(found, 0.5 * (1.0 - 0.01 * time_s), 1e-8);
    }
}

#[test]
fn crosstalk_brings_the_other_motors_torque() {
    // An axis whose second joint, which moves nothing of it, has a motor as well.
    let plant = Plant { drives: [drive(), drive()], ..Plant::single_axis(INERTIA, drive()) };
    let joints = [JointEffects { crosstalk_share: 0.05, ..OFF }, OFF];
    let machine = ExtendedMachine::new(&ExtendedPlant { plant, effects: Effects { joints, ..Effects::SINGLE_AXIS } });
    let motion = at(&machine, 0.0, 0.0, 0.0);
    let held = machine.fresh(machine.input([0.0, 2.0]), [0.0; 2]);
    let next = machine.step(&motion, &held, 1e-7);
    near(next.motor.velocity_rad_s[0] / 1e-7 * INERTIA / RATIO, 0.05 * TORQUE_CONSTANT * 2.0, 1e-8);
}

#[test]
fn spring_with_slack_pulls_beyond_it() {
    let effects = JointEffects { slack_spring_nm_per_rad: 4.0, slack_centre_rad: 0.5, half_slack_rad: 0.2, ..OFF };
    let machine = axis(0.0, effects);
    for (position_rad, torque_nm) in [(0.35, 0.0), (0.6, 0.0), (0.8, -0.4), (0.0, 1.2)] {
        near(acceleration(&machine, &at(&machine, position_rad, 0.0, 0.0), 0.0) * INERTIA, torque_nm, 1e-6);
    }
}

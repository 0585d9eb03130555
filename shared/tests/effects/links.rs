//! Payload, gravity, springs and contacts.

use shared::arm::{Arm, Pose, REFERENCE_F};
use shared::effects::{ArmEffects, Effects, ExtendedMachine, ExtendedPlant, JointEffects};
use shared::machine::Machine as _;
use shared::plant::{Plant, State};

use crate::axis::{INERTIA, STEP_S, at, axis, near, step};
use crate::robot::{GRAVITY, drives, plant};

const MOVING: State<f64> = State { position_rad: [-0.4, 0.7], velocity_rad_s: [1.2, -2.0] };

fn machine(plant: Plant<f64>, effects: Effects<f64>) -> ExtendedMachine<f64> {
    ExtendedMachine::new(&ExtendedPlant { plant, effects })
}

/// The state after half a second under steady currents.
fn after(machine: &ExtendedMachine<f64>) -> State<f64> {
    let held = machine.fresh(machine.input([0.5, -0.4]), [0.0; 2]);
    (0..700).fold(machine.start(MOVING, 0.0), |motion, _| machine.step(&motion, &held, 7e-4)).motor
}

#[test]
fn payload_moves_f_along_its_direction() {
    // 1.5 kg at (0.1, −0.4) m with a radius of gyration of 0.1 m: J = 1.5 · (0.01 + 0.16 + 0.01) = 0.27 kg m²;
    // a3 = 0.4318 m.
    let delta = [0.27, 0.27, 0.06477, -0.25908, 0.15, -0.6, 1.5 * 0.4318 * 0.4318 + 0.27, 0.0, 0.6477];
    let mut f = REFERENCE_F;
    f.iter_mut().zip(delta).for_each(|(f, delta)| *f += delta);
    let heavy = Plant { arm: Arm { f, gravity_m_s2: GRAVITY }, drives: drives() };
    let arm = ArmEffects {
        payload_kg: 1.5,
        payload_x_m: 0.1,
        payload_y_m: -0.4,
        payload_gyration_m2: 0.01,
        ..ArmEffects::OFF
    };
    let (with_payload, with_f) =
        (after(&machine(plant(), Effects { arm, ..Effects::OFF })), after(&machine(heavy, Effects::OFF)));
    let without = after(&machine(plant(), Effects::OFF));
    for joint in 0..2 {
        near(with_payload.position_rad[joint], with_f.position_rad[joint], 1e-9);
        assert!((without.position_rad[joint] - with_f.position_rad[joint]).abs() > 0.01);
    }
}

#[test]
fn payload_of_a_single_axis_is_mass_on_it() {
    let drive = crate::axis::drive();
    let loaded = Effects { arm: ArmEffects { payload_kg: 3.0, ..Effects::SINGLE_AXIS.arm }, ..Effects::SINGLE_AXIS };
    let found = after(&machine(Plant::single_axis(10.0, drive), loaded));
    let expected = after(&machine(Plant::single_axis(13.0, drive), Effects::SINGLE_AXIS));
    near(found.position_rad[0], expected.position_rad[0], 1e-9);
}

#[test]
fn tilt_turns_gravity_and_nothing_else() {
    let tilted = machine(plant(), Effects { arm: ArmEffects { tilt_rad: 0.05, ..ArmEffects::OFF }, ..Effects::OFF });
    let [q2, q3] = MOVING.position_rad;
    // What the gears hold at rest is the weight of an arm turned by the tilt.
    let expected = plant().arm.gravity_torque_nm(&Pose::at([q2 + 0.05, q3]));
    let found = tilted.start(State::at_rest([q2, q3]), 0.0).gear_torque_nm;
    let upright = plant().arm.gravity_torque_nm(&Pose::at([q2, q3]));
    for joint in 0..2 {
        near(found[joint], expected[joint], 1e-9);
        assert!((found[joint] - upright[joint]).abs() > 0.1);
    }
}

#[test]
fn spring_pulls_most_at_its_angle() {
    let second = JointEffects { spring_nm: 4.0, spring_angle_rad: 0.3, ..JointEffects::OFF };
    for position_rad in [0.3, 0.0, 0.3 + core::f64::consts::FRAC_PI_2] {
        let machine = axis(0.0, second);
        let next = step(&machine, &at(&machine, position_rad, 0.0, 0.0), 0.0, 1e-6);
        near(next.motor.velocity_rad_s[0] / 1e-6 * INERTIA, 4.0 * (position_rad - 0.3).cos(), 1e-6);
    }
}

#[test]
fn contact_gives_its_impulse_wherever_its_ends_fall() {
    let contact =
        JointEffects { contact_nm: 5.0, contact_start_s: 0.010_03, contact_duration_s: 0.020_01, ..JointEffects::OFF };
    let machine = axis(0.0, contact);
    let mut motion = at(&machine, 0.0, 0.0, 0.0);
    for k in 0..400 {
        motion = step(&machine, &motion, 0.0, STEP_S);
        let time_s = f64::from(k + 1) * STEP_S;
        let expected_s = (time_s.min(0.030_04) - 0.010_03).max(0.0);
        near(motion.motor.velocity_rad_s[0], 5.0 * expected_s / INERTIA, 1e-9);
    }
}

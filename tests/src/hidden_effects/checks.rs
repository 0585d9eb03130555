//! The generator against hand calculations, against itself with other steps, and against the plain simulator.

use std::f64::consts::TAU;

use crate::simulator::{self, BaseParameters, Reference, Robot, RunSettings};

use super::draw::Draw;
use super::library::{self, Peaks, spring};
use super::machine::{Contact, Friction, Machine, Sliding, Slip, Transmission, VoltageLimit, Wave};
use super::motion::{Drive, Motion};
use super::outside::{self, Outside};
use super::run::{Record, Settings, record};

const STEP_S: f64 = 20e-6;
const ROTOR_KG_M2: f64 = 200e-6;

fn reference_machine() -> Machine {
    Machine::healthy(&Robot::reference(), ROTOR_KG_M2)
}

/// Two joints that do not feel each other, without gravity and friction: inertias 5 and 2 kg m² with the rotors.
fn free_machine() -> Machine {
    let mut machine = reference_machine();
    machine.base = BaseParameters([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0]);
    for (part, rotor) in machine.joints.iter_mut().zip([2.0, 0.5]) {
        part.friction = Friction::default();
        part.motor_inertia_kg_m2 = rotor;
    }
    machine
}

fn recorded(machine: &Machine, step_s: f64, period_s: f64) -> Record {
    let settings = Settings { step_s: Some(step_s), hold_s: 1.0, ..Settings::quiet(3) };
    record(machine, &Robot::reference(), &Reference::Paper { period_s }, &settings)
}

/// Without anything wrong it is the robot of the plain simulator, which another integrator moves.
#[test]
fn a_healthy_machine_is_the_plain_robot() {
    let robot = Robot::draw(4);
    let reference = Reference::Paper { period_s: 3.65 };
    let theirs = simulator::record(&robot, &reference, &RunSettings { seed: 9, ..RunSettings::default() });
    let ours = record(&Machine::healthy(&robot, ROTOR_KG_M2), &robot, &reference, &Settings::quiet(9));
    for joint in 0..2 {
        let gap = super::run::rms(
            ours.error_counts[joint].iter().zip(&theirs.error_counts[joint]).map(|(one, two)| f64::from(one - two)),
        );
        println!("joint {joint}: errors differ by {gap:.3} counts rms");
        assert!(gap < 0.05, "joint {joint}: {gap}");
        assert_eq!(ours.reference_counts[joint], theirs.reference_counts[joint]);
    }
}

/// In a closed loop a single count that is rounded the other way rings on, so what play makes is compared stretch by
/// stretch under the same commands: 50 ms from the same state with whole and half steps.
#[test]
fn half_the_step_changes_nothing() {
    let mut flexible = reference_machine();
    flexible.joints[0].transmission = spring(33_000.0, 20.0, 0.0);
    let mut play = reference_machine();
    // Teeth of 150 Hz on the elbow.
    play.joints[1].transmission = spring(9.5e5, 600.0, 0.0015);
    let mut rough = reference_machine();
    for part in &mut rough.joints {
        part.friction.stribeck_nm = 0.05;
        part.friction.stribeck_speed_rad_s = 6.0;
        part.friction.stribeck_exponent = 2.0;
        part.friction.load_share = 0.05;
        part.amplifier.lag_s = 0.2e-3;
    }
    let robot = Robot::reference();
    let reference = Reference::Paper { period_s: 3.65 };
    for (name, machine) in [("plain", reference_machine()), ("flexible", flexible), ("play", play), ("rough", rough)] {
        let per_rad = machine.joints.map(|part| part.counts_per_rad());
        let mut coarse = Motion::at_rest(&machine, [0.0; 2], 0.0, machine.step_s());
        let mut fine = coarse.clone();
        let mut largest_counts = 0.0_f64;
        for tick in 0..2857 {
            if tick % 71 == 0 {
                fine = coarse.clone().with_step(0.5 * machine.step_s());
            }
            let wanted = reference.counts(&robot, tick, 0, 1);
            let command_a = std::array::from_fn(|joint| {
                let off = wanted[joint] - coarse.motor_angle_at_joint_rad(joint) * per_rad[joint];
                machine.joints[joint].gain_a_per_count * off
            });
            for motion in [&mut coarse, &mut fine] {
                motion.advance(&Drive { command_a, ..Drive::default() }, machine.period_s);
            }
            for (joint, per_rad) in per_rad.iter().enumerate() {
                let apart = coarse.motor_angle_at_joint_rad(joint) - fine.motor_angle_at_joint_rad(joint);
                largest_counts = largest_counts.max((per_rad * apart).abs());
            }
        }
        println!("{name}: half the step moves a motor by {largest_counts:.1e} counts at most within 50 ms");
        assert!(largest_counts < 0.05, "{name}: {largest_counts} counts");
        assert!(coarse.angle_rad()[0] < -1.0, "{name}: it should have moved");
    }
}

/// Motors, links, springs and weight exchange energy; without damping none is lost.
#[test]
fn two_masses_keep_their_energy() {
    let mut machine = reference_machine();
    let stiffness = [30_000.0, 9_000.0];
    for (joint, stiffness) in machine.joints.iter_mut().zip(stiffness) {
        joint.friction = Friction::default();
        joint.transmission = spring(stiffness, 0.0, 0.0);
    }
    let mut motion = Motion::at_rest(&machine, [-0.4, 0.6], 0.0, STEP_S);
    motion.set_velocity_rad_s([0.3, -0.5]);
    let energy = |motion: &Motion<'_>| {
        let (angle, velocity) = (motion.angle_rad(), motion.velocity_rad_s());
        let mut mass = machine.base.equations(angle, [0.0; 2], 0.0).mass_kg_m2;
        let mut energy = machine.base.potential_energy_j(angle, machine.gravity_m_s2);
        for joint in 0..2 {
            let rotor = machine.joints[joint].motor_inertia_kg_m2;
            mass[joint][joint] -= rotor;
            energy += 0.5 * rotor * motion.motor_speed_at_joint_rad_s(joint).powi(2);
            energy += 0.5 * stiffness[joint] * (motion.motor_angle_at_joint_rad(joint) - angle[joint]).powi(2);
        }
        let [v2, v3] = velocity;
        energy + 0.5 * (mass[0][0] * v2 * v2 + mass[1][1] * v3 * v3) + mass[0][1] * v2 * v3
    };
    let start = energy(&motion);
    motion.advance(&Drive::default(), 0.5);
    let drift = (energy(&motion) - start).abs();
    println!("energy of two masses after 0.5 s: changed by {drift:.1e} J");
    assert!(drift < 1e-7, "{drift} J");
    assert!((motion.angle_rad()[0] + 0.4).abs() > 0.1, "it should have fallen");
}

/// Free on both ends a spring's mode is `√(k (1/J_motor + 1/J_link))`.
#[test]
fn a_flexible_joint_swings_at_its_frequency() {
    let mut machine = free_machine();
    let stiffness = 20_000.0;
    machine.joints[0].transmission = spring(stiffness, 0.0, 0.0);
    let expected_hz = (stiffness * (1.0 / 2.0 + 1.0 / 3.0)).sqrt() / TAU;
    let mut motion = Motion::at_rest(&machine, [0.0; 2], 0.0, STEP_S);
    // A short push on the motor leaves it swinging against the link.
    let push = Drive { disturbance_nm: [2.0, 0.0], ..Drive::default() };
    motion.advance(&push, 1e-3);
    let twist = |motion: &Motion<'_>| motion.motor_angle_at_joint_rad(0) - motion.angle_rad()[0];
    let (mut before, mut crossings, mut first_s, mut last_s) = (twist(&motion), 0, 0.0, 0.0);
    for step in 1..40_000 {
        motion.advance(&Drive::default(), 50e-6);
        let now = twist(&motion);
        if before <= 0.0 && now > 0.0 {
            let time_s = 50e-6 * (f64::from(step) - now / (now - before));
            if crossings == 0 {
                first_s = time_s;
            }
            (last_s, crossings) = (time_s, crossings + 1);
        }
        before = now;
    }
    let found_hz = f64::from(crossings - 1) / (last_s - first_s);
    assert!((found_hz / expected_hz - 1.0).abs() < 1e-3, "{found_hz} Hz, expected {expected_hz}");
}

/// Within the play nothing is felt; from one flank to the other a motor travels the gap.
#[test]
fn play_is_travelled_before_the_other_flank_pushes() {
    let teeth = spring(1e6, 0.0, 0.002);
    assert_eq!(teeth.torque_nm(0.000_9, 0.3), 0.0);
    assert!((teeth.torque_nm(0.001_05, 0.0) - 50.0).abs() < 1e-6);
    assert!((teeth.torque_nm(-0.001_05, 0.0) + 50.0).abs() < 1e-6);
    // A contact that opens fast does not pull.
    let damped = spring(1e6, 5e3, 0.002);
    assert_eq!(damped.torque_nm(0.001_001, -1.0), 0.0);

    let mut machine = free_machine();
    machine.joints[1].transmission = teeth;
    let mut motion = Motion::at_rest(&machine, [0.0; 2], 0.0, STEP_S);
    // 4 N m on a rotor of 0.5 kg m² at the joint: 8 rad/s², half of the gap after √(2·0.001/8) = 15.81 ms.
    let torque = Drive { disturbance_nm: [0.0, 4.0 / -53.7], ..Drive::default() };
    motion.advance(&torque, 0.0158);
    assert_eq!(motion.velocity_rad_s()[1], 0.0);
    motion.advance(&torque, 0.0002);
    assert!(motion.velocity_rad_s()[1] > 0.0);
}

#[test]
fn friction_follows_its_laws() {
    let sliding = Sliding { speed_rad_s: 8.0, joint_angle_rad: 0.5, time_s: 2.0, load_nm: -0.6 };
    let plain = Friction { coulomb_nm: 0.1, ..Friction::default() };
    let level = |friction: Friction, direction: f64| friction.level_nm(direction, &sliding);
    let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-12, "{value}, expected {expected}");
    near(level(plain, 1.0), 0.1);
    near(level(Friction { coulomb_asymmetry_nm: 0.02, ..plain }, 1.0), 0.12);
    near(level(Friction { coulomb_asymmetry_nm: 0.02, ..plain }, -1.0), 0.08);
    let stribeck = Friction { stribeck_nm: 0.05, stribeck_speed_rad_s: 8.0, stribeck_exponent: 2.0, ..plain };
    near(level(stribeck, 1.0), 0.1 + 0.05 * (-1.0_f64).exp());
    near(stribeck.level_nm(1.0, &Sliding { speed_rad_s: 0.0, ..sliding }), 0.15);
    near(level(Friction { load_share: 0.1, ..plain }, 1.0), 0.16);
    let wave = Wave { amplitude: 0.3, order: 3.0, phase_rad: 0.2 };
    near(level(Friction { over_angle: wave, ..plain }, 1.0), 0.1 * (1.0 + 0.3 * 1.7_f64.cos()));
    near(level(Friction { drift_per_s: 0.05, ..plain }, 1.0), 0.11);
    near(Friction { drift_per_s: 0.05, ..plain }.level_nm(1.0, &Sliding { time_s: -1.0, ..sliding }), 0.1);
    let viscous = Friction {
        viscous_nm_s_per_rad: 1e-3,
        viscous_asymmetry_nm_s_per_rad: 2e-4,
        quadratic_nm_s2_per_rad2: 1e-6,
        ..Friction::default()
    };
    near(viscous.viscous_nm(100.0), 0.12 + 0.01);
    near(viscous.viscous_nm(-100.0), -0.08 - 0.01);
}

/// A motor without friction over its cogging: `½ J v²` changes by the integral of the torque.
#[test]
fn cogging_has_its_order_and_takes_the_energy_it_should() {
    let mut machine = free_machine();
    let wave = Wave { amplitude: 0.2, order: 3.3, phase_rad: 0.7 };
    machine.joints[1].cogging = wave;
    let mut motion = Motion::at_rest(&machine, [0.0; 2], 0.0, STEP_S);
    motion.set_velocity_rad_s([0.0, -1.0]);
    let gear = machine.joints[1].gear_ratio;
    for _ in 0..40 {
        motion.advance(&Drive::default(), 5e-3);
        let motor_rad = gear * motion.angle_rad()[1];
        let work =
            wave.amplitude / wave.order * ((wave.order * motor_rad + wave.phase_rad).sin() - wave.phase_rad.sin());
        let speed = -(1.0 + 2.0 * work / 2.0).sqrt();
        assert!((motion.velocity_rad_s()[1] - speed).abs() < 1e-9, "{} {speed}", motion.velocity_rad_s()[1]);
    }
}

#[test]
fn amplifiers_fail_as_described() {
    let mut amplifier = reference_machine().joints[0].amplifier;
    assert_eq!(amplifier.settled_a(3.0, 50.0), 3.0);
    amplifier.dead_zone_a = 0.2;
    assert!((amplifier.settled_a(3.0, 0.0) - 2.8).abs() < 1e-12);
    assert_eq!(amplifier.settled_a(-0.15, 0.0), 0.0);
    amplifier.dead_zone_a = 0.0;
    amplifier.limit_a = 2.0;
    assert_eq!(amplifier.settled_a(-3.0, 0.0), -2.0);
    amplifier.limit_a = 12.0;
    amplifier.back_emf_a_s_per_rad = 0.002;
    assert!((amplifier.settled_a(3.0, 100.0) - 2.8).abs() < 1e-12);
    amplifier.back_emf_a_s_per_rad = 0.0;
    amplifier.voltage = Some(VoltageLimit { limit_v: 30.0, resistance_ohm: 2.0, emf_v_s_per_rad: 0.25 });
    // 30 V less 0.25 · 100 V leave 5 V for 2 Ω.
    assert!((amplifier.settled_a(6.0, 100.0) - 2.5).abs() < 1e-12);
    assert_eq!(amplifier.settled_a(-6.0, 100.0), -6.0);

    let mut machine = free_machine();
    machine.joints[0].amplifier.lag_s = 1e-3;
    machine.joints[1].amplifier.slew_a_per_s = Some(500.0);
    let mut motion = Motion::at_rest(&machine, [0.0; 2], 0.0, STEP_S);
    let drive = Drive { command_a: [2.0, 2.0], ..Drive::default() };
    motion.advance(&drive, 2e-3);
    let [lagging, slewing] = motion.current_a(&drive);
    assert!((lagging - 2.0 * (1.0 - (-2.0_f64).exp())).abs() < 1e-6, "{lagging}");
    assert!((slewing - 1.0).abs() < 1e-3, "{slewing}");
}

#[test]
fn a_contact_pushes_for_its_time() {
    let mut machine = free_machine();
    machine.joints[0].contact = Some(Contact { start_s: 0.1, duration_s: 0.3, torque_nm: 2.0 });
    let mut motion = Motion::at_rest(&machine, [0.0; 2], 0.0, STEP_S);
    for _ in 0..100 {
        motion.advance(&Drive::default(), 5e-3);
    }
    // 2 N m for 0.3 s on 5 kg m².
    assert!((motion.velocity_rad_s()[0] - 0.12).abs() < 1e-4, "{:?}", motion.velocity_rad_s());
}

#[test]
fn a_slip_shows_as_its_counts_and_the_loop_takes_it_back() {
    let mut machine = reference_machine();
    machine.joints[0].slip = Some(Slip { time_s: 1.0, counts: 12.0 });
    let (healthy, slipped) = (recorded(&reference_machine(), STEP_S, 3.65), recorded(&machine, STEP_S, 3.65));
    let at = (1.0 / 0.7e-3_f64).ceil() as usize;
    assert_eq!(healthy.error_counts[0][..at], slipped.error_counts[0][..at]);
    assert!((healthy.error_counts[0][at] - slipped.error_counts[0][at] - 12).abs() <= 1);
    // Later the errors are alike again, and the motor stands 12 counts off.
    let late = at + 2500;
    let off = |series: &Record| series.motor_counts[0][late..late + 400].iter().sum::<f64>() / 400.0;
    assert!((off(&healthy) - off(&slipped) - 12.0).abs() < 1.5, "{} {}", off(&healthy), off(&slipped));
}

#[test]
fn tilt_and_payload_and_spring_are_weights() {
    let machine = reference_machine();
    // The torque that keeps the arm at rest is what it does not fall under.
    let stays = |machine: &Machine, torque: [f64; 2]| {
        let mut free = machine.clone();
        for part in &mut free.joints {
            part.friction = Friction::default();
        }
        let mut motion = Motion::at_rest(&free, [-0.5, 0.4], 0.0, STEP_S);
        let disturbance_nm = std::array::from_fn(|joint| torque[joint] / free.joints[joint].gear_ratio);
        motion.advance(&Drive { disturbance_nm, ..Drive::default() }, STEP_S);
        // A torque that is off by 1 % of the smallest effect here would reach 1e-7 rad/s.
        motion.velocity_rad_s().iter().all(|speed| speed.abs() < 1e-9)
    };
    let mut tilted = machine.clone();
    tilted.base_tilt_rad = 0.03;
    assert!(stays(&tilted, machine.base.equations([-0.47, 0.4], [0.0; 2], 9.81).bias_nm));
    let mut loaded = machine.clone();
    loaded.base = loaded.base.with_load(0.4, 0.02, -0.5, 0.001);
    assert!(stays(&loaded, loaded.base.equations([-0.5, 0.4], [0.0; 2], 9.81).bias_nm));
    let mut sprung = machine.clone();
    sprung.joints[0].balance_spring_nm = Wave { amplitude: 3.0, order: 1.0, phase_rad: 0.9 };
    let mut expected = machine.base.equations([-0.5, 0.4], [0.0; 2], 9.81).bias_nm;
    expected[0] -= 3.0 * 0.4_f64.cos();
    assert!(stays(&sprung, expected));
}

/// Dahl's friction reaches Coulomb's after a few of its travels, and turns round with the motion.
#[test]
fn pre_sliding_friction_builds_up_over_its_travel() {
    let mut machine = free_machine();
    machine.joints[0].friction = Friction { coulomb_nm: 0.1, ..Friction::default() };
    machine.outside = Some(Outside::PreSliding { joint: 0, travel_rad: 0.01 });
    let mut motion = Motion::at_rest(&machine, [0.0; 2], 0.0, STEP_S);
    motion.set_velocity_rad_s([1.0, 0.0]);
    motion.advance(&Drive::default(), 0.2);
    // The work over s is C (s - s0 (1 - exp(-s/s0))), C = 107.8 · 0.1 N m, and so much kinetic energy is gone.
    let travelled = motion.angle_rad()[0];
    let work = 10.78 * (travelled - 0.01 * (1.0 - (-travelled / 0.01).exp()));
    let speed = motion.velocity_rad_s()[0];
    assert!((0.5 * 5.0 * (1.0 - speed * speed) - work).abs() < 1e-6, "{speed} {work}");
}

/// Every name can be put in on either joint, changes what is recorded, and the more the larger it is.
#[test]
fn every_effect_shows_and_scales() {
    let healthy = recorded(&reference_machine(), 2.0 * STEP_S, 2.0);
    let peaks = Peaks::of(&reference_machine(), std::slice::from_ref(&healthy), 1.6);
    for (index, name) in library::NAMES.into_iter().chain(outside::NAMES).enumerate() {
        let gap = |size: f64| {
            let mut machines = vec![reference_machine()];
            let mut draw = Draw::of_case(1, index as u64);
            let joint = index % 2;
            if name.starts_with("outside:") {
                outside::put(&mut machines, name, joint, size, &mut draw);
            } else {
                library::inject(&mut machines, name, joint, size, (&peaks, &[2.0], false), &mut draw);
            }
            let gap = recorded(&machines[0], 2.0 * STEP_S, 2.0).gap_counts(&healthy);
            gap[0].max(gap[1])
        };
        let (large, small) = (gap(1.0), gap(0.1));
        println!("{name:<32} {large:8.2} {small:8.2} counts rms");
        assert!(large > 0.3, "{name}: {large} counts rms");
        assert!(large > small, "{name}: {large} at full size, {small} at a tenth");
    }
}

#[test]
fn hardening_gears_harden() {
    let gear = Transmission::Elastic {
        stiffness_nm_per_rad: 1e4,
        hardening_nm_per_rad3: 1e10,
        damping_nm_s_per_rad: 0.0,
        gap_rad: 0.0,
    };
    assert!((gear.torque_nm(0.001, 0.0) - 20.0).abs() < 1e-9);
    assert!((gear.torque_nm(-0.002, 0.0) + 100.0).abs() < 1e-9);
}

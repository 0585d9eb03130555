//! The plant's steps: energy, order of convergence, exact stick and breakaway, the box-constrained friction of both
//! joints, and how far one step of a whole sampling period is from fine steps.

mod robot;

use core::f64::consts::TAU;

use robot::{
    DEFAULT_GAINS, GRAVITY, PERIOD_S, Random, Robot, SAMPLES, counts_per_rad, drives, frictionless, largest, laws,
    plant, reference_counts, rms, single_precision,
};
use shared::arm::{Arm, Pose, REFERENCE_F};
use shared::control::PositionLaw;
use shared::drive::Drive;
use shared::plant::{Plant, PreparedPlant, State};

// Energy and order.

fn kinetic_j(arm: &Arm<f64>, state: &State<f64>) -> f64 {
    let v = state.velocity_rad_s;
    let momentum = arm.inertia(&Pose::at(state.position_rad)).times(v);
    0.5 * (v[0] * momentum[0] + v[1] * momentum[1])
}

fn energy_j(arm: &Arm<f64>, state: &State<f64>) -> f64 {
    let [_, _, _, _, f5, f6, _, f8, f9] = arm.f;
    let p = Pose::at(state.position_rad);
    // The potential whose gradient is g (design.md §2).
    kinetic_j(arm, state) - arm.gravity_m_s2 * (f5 * p.s23 + f6 * p.c23 + f8 * p.c2 + f9 * p.s2)
}

fn swinging() -> State<f64> {
    State { position_rad: [0.3, -0.8], velocity_rad_s: [1.5, -2.0] }
}

fn run(plant: &PreparedPlant<f64>, torque: [f64; 2], step_s: f64, duration_s: f64) -> State<f64> {
    let steps = (duration_s / step_s).round() as usize;
    (0..steps).fold(swinging(), |state, _| plant.step(&state, torque, step_s))
}

#[test]
fn midpoint_step_keeps_the_energy_of_a_free_arm_to_second_order() {
    let plant = frictionless();
    let prepared = plant.prepare();
    let drift = |step_s: f64| {
        let mut state = swinging();
        let start = energy_j(&plant.arm, &state);
        let (mut drift, mut kinetic, mut speed) = (0.0_f64, 0.0_f64, 0.0_f64);
        for _ in 0..(10.0 / step_s) as usize {
            state = prepared.step(&state, [0.0; 2], step_s);
            drift = drift.max((energy_j(&plant.arm, &state) - start).abs());
            kinetic = kinetic.max(kinetic_j(&plant.arm, &state));
            speed = speed.max(largest(state.velocity_rad_s));
        }
        // A second-order step errs by about the square of the angle passed in it.
        let limit = (speed * step_s).powi(2) * kinetic;
        assert!(drift < limit, "{drift} J of {kinetic} J at {step_s} s, limit {limit}");
        drift
    };
    let order = (drift(PERIOD_S) / drift(PERIOD_S / 2.0)).log2();
    assert!(order > 1.8, "order {order}");
}

#[test]
fn midpoint_step_converges_with_second_order_to_much_finer_steps() {
    let mut viscous = plant();
    viscous.drives.iter_mut().for_each(|drive| drive.coulomb_friction_nm = 0.0);
    let prepared = viscous.prepare();
    let torque = [1.0, -0.3];
    let fine = run(&prepared, torque, 1e-5, 0.7);
    let error = |step_s| {
        let coarse = run(&prepared, torque, step_s, 0.7);
        largest([0, 1].map(|j| coarse.position_rad[j] - fine.position_rad[j]))
    };
    let errors = [1.4e-3, 7e-4, 3.5e-4].map(error);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(order > 1.8, "order {order}: {errors:?}");
    }
}

#[test]
fn energy_lost_to_viscous_friction_is_the_work_it_did() {
    let mut plant = plant();
    plant.drives.iter_mut().for_each(|drive| drive.coulomb_friction_nm = 0.0);
    let joint_viscous = plant.drives.map(|d| d.gear_ratio.powi(2) * d.viscous_friction_nm_s_per_rad);
    let prepared = plant.prepare();
    let gap = |step_s: f64| {
        let (mut state, mut work) = (swinging(), 0.0);
        let start = energy_j(&plant.arm, &state);
        for _ in 0..(2.0 / step_s) as usize {
            let next = prepared.step(&state, [0.0; 2], step_s);
            for (joint, viscous) in joint_viscous.iter().enumerate() {
                let speed = (next.position_rad[joint] - state.position_rad[joint]) / step_s;
                work += step_s * viscous * speed * speed;
            }
            state = next;
        }
        assert!(work > 10.0, "the arm hardly moved: {work} J");
        ((start - energy_j(&plant.arm, &state) - work) / work).abs()
    };
    // As for the free arm: (5 rad/s · 0.7 ms)², and of second order.
    let (coarse, fine) = (gap(PERIOD_S), gap(PERIOD_S / 2.0));
    assert!(coarse < 1.2e-5 && fine < coarse / 3.5, "{coarse} {fine}");
}

// Coulomb friction.

/// The motor torques that hold the arm against gravity and add `share` of each joint's Coulomb friction.
fn holding(plant: &Plant<f64>, position_rad: [f64; 2], share: [f64; 2]) -> [f64; 2] {
    let g = plant.arm.gravity_torque_nm(&Pose::at(position_rad));
    [0, 1].map(|j| {
        let drive = &plant.drives[j];
        (g[j] + share[j] * drive.gear_ratio.abs() * drive.coulomb_friction_nm) / drive.gear_ratio
    })
}

#[test]
fn arm_at_rest_under_loads_inside_coulomb_friction_does_not_move_at_all() {
    let plant = plant();
    let prepared = plant.prepare();
    let mut random = Random::new(1);
    for _ in 0..200 {
        let start = State::at_rest(random.pair(3.0));
        let torque = holding(&plant, start.position_rad, random.pair(0.999));
        let (mut midpoint, mut symplectic) = (start, start);
        for _ in 0..100 {
            midpoint = prepared.step(&midpoint, torque, PERIOD_S);
            symplectic = prepared.step_symplectic(&symplectic, torque, PERIOD_S);
        }
        assert_eq!(midpoint, start);
        assert_eq!(symplectic, start);
    }
}

#[test]
fn joint_breaks_away_just_beyond_coulomb_friction_and_in_the_direction_of_the_load() {
    let plant = plant();
    let prepared = plant.prepare();
    let mut random = Random::new(2);
    for _ in 0..200 {
        let start = State::at_rest(random.pair(3.0));
        for (joint, direction) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            let mut share = [0.0; 2];
            share[joint] = 1.001 * direction;
            let next = prepared.step(&start, holding(&plant, start.position_rad, share), PERIOD_S);
            assert!(next.velocity_rad_s[joint] * direction > 0.0, "{next:?}");
            // The other joint is held by its own friction: a thousandth of this one's cannot pull it along.
            assert_eq!(next.velocity_rad_s[1 - joint], 0.0);
        }
    }
}

#[test]
fn sliding_axis_stops_where_constant_friction_stops_it_and_stays() {
    // Friction 2 N·m on an inertia of 3: deceleration 2/3, so 1.2 rad/s last 1.8 s and 1.08 rad.
    let axis = Plant::single_axis(3.0, Drive { gear_ratio: -20.0, coulomb_friction_nm: 0.1, ..free_drive() });
    let prepared = axis.prepare();
    let mut state = State { position_rad: [0.0; 2], velocity_rad_s: [-1.2, 0.0] };
    let mut stopped_at = None;
    for k in 0..4000 {
        state = prepared.step(&state, [0.0; 2], PERIOD_S);
        if state.velocity_rad_s[0] == 0.0 && stopped_at.is_none() {
            stopped_at = Some((k as f64 * PERIOD_S, state));
        }
    }
    let (time_s, stopped) = stopped_at.expect("never stopped");
    assert!((time_s - 1.8).abs() <= PERIOD_S, "{time_s}");
    // The stop is placed at the end of its step: at most a step at the last speed, 2/3 · period.
    assert!((stopped.position_rad[0] + 1.08).abs() <= PERIOD_S * PERIOD_S, "{stopped:?}");
    assert_eq!(state, stopped, "it moved again");
}

/// The velocity after one impulse of friction by trying all nine cases (each joint slides either way or sticks), and
/// which case it is.
fn friction_by_cases(free: [f64; 2], w: [[f64; 2]; 2], bound: [f64; 2]) -> ([f64; 2], usize) {
    let mut found: Option<([f64; 2], usize, f64)> = None;
    for case in 0..9 {
        let direction = [case % 3, case / 3].map(|way| way as f64 - 1.0);
        // Sliding joints have their impulse at the bound; the sticking ones' follow from v = 0.
        let mut impulse = [-direction[0] * bound[0], -direction[1] * bound[1]];
        match (direction[0] == 0.0, direction[1] == 0.0) {
            (true, true) => {
                let determinant = w[0][0] * w[1][1] - w[0][1] * w[1][0];
                impulse = [
                    -(w[1][1] * free[0] - w[0][1] * free[1]) / determinant,
                    -(w[0][0] * free[1] - w[1][0] * free[0]) / determinant,
                ];
            }
            (true, false) => impulse[0] = -(free[0] + w[0][1] * impulse[1]) / w[0][0],
            (false, true) => impulse[1] = -(free[1] + w[1][0] * impulse[0]) / w[1][1],
            (false, false) => {}
        }
        let velocity = [0, 1]
            .map(|i| if direction[i] == 0.0 { 0.0 } else { free[i] + w[i][0] * impulse[0] + w[i][1] * impulse[1] });
        // By how much the case contradicts itself: an impulse beyond its bound, a slide the other way.
        let wrong = [0, 1].map(|i| {
            if direction[i] == 0.0 { w[i][i] * (impulse[i].abs() - bound[i]) } else { -velocity[i] * direction[i] }
        });
        let wrong = wrong[0].max(wrong[1]);
        if found.is_none_or(|(_, _, least)| wrong < least) {
            found = Some((velocity, case, wrong));
        }
    }
    let (velocity, case, wrong) = found.expect("nine cases");
    assert!(wrong < 1e-12, "no case is consistent: {wrong}");
    (velocity, case)
}

fn free_drive() -> Drive<f64> {
    Drive {
        gear_ratio: 1.0,
        counts_per_rev: 1000.0,
        torque_constant_nm_per_a: 1.0,
        current_limit_a: f64::INFINITY,
        viscous_friction_nm_s_per_rad: 0.0,
        coulomb_friction_nm: 0.0,
        torque_offset_nm: 0.0,
    }
}

#[test]
fn friction_of_both_joints_meets_the_complementarity_conditions_in_all_nine_cases() {
    let mut random = Random::new(3);
    let mut seen = [0; 9];
    for _ in 0..20_000 {
        // Any positive definite D at q3 = 0, strongly coupled ones included, and friction up to what stops both.
        let (d11, d22) = (random.between(0.2, 3.0), random.between(0.2, 3.0));
        let d12 = random.between(-0.98, 0.98) * (d11 * d22).sqrt();
        let arm = Arm { f: [d22, d12, 0.0, 0.0, 0.0, 0.0, d11, 0.0, 0.0], gravity_m_s2: 0.0 };
        let bound_nm = [random.between(0.0, 3.0), random.between(0.0, 3.0)];
        let plant =
            Plant { arm, drives: bound_nm.map(|coulomb_friction_nm| Drive { coulomb_friction_nm, ..free_drive() }) };
        let start = State { position_rad: [0.0; 2], velocity_rad_s: random.pair(1.0) };
        let torque = random.pair(1.0);
        let period_s = 0.5;
        let d = arm.inertia(&Pose::at([0.0; 2]));
        let w = d.inverse();
        let w = [[w.d11, w.d12], [w.d12, w.d22]];
        let free = [0, 1].map(|i| start.velocity_rad_s[i] + period_s * (w[i][0] * torque[0] + w[i][1] * torque[1]));
        let bound = bound_nm.map(|b| period_s * b);
        let (expected, case) = friction_by_cases(free, w, bound);
        seen[case] += 1;
        for v in [
            plant.prepare().step(&start, torque, period_s).velocity_rad_s,
            plant.prepare().step_symplectic(&start, torque, period_s).velocity_rad_s,
        ] {
            // W reaches 130 at the strongest coupling; the rest is rounding.
            let rounding = 1e-12 * (1.0 + largest([w[0][0], w[1][1]])) * 3.0;
            let change = [v[0] - free[0], v[1] - free[1]];
            let impulse = d.times(change);
            for i in 0..2 {
                assert!((v[i] - expected[i]).abs() < rounding, "{v:?} {expected:?}");
                assert!(impulse[i].abs() <= bound[i] + rounding, "friction beyond its bound");
                if v[i].abs() > rounding {
                    assert!(
                        (impulse[i] + bound[i].copysign(v[i])).abs() < rounding,
                        "it does not brake with all it has"
                    );
                } else {
                    assert_eq!(v[i], 0.0, "a stuck joint creeps");
                }
            }
        }
    }
    // Free velocity and friction are of one size, so no case is rare.
    assert!(seen.iter().all(|&count| count > 200), "{seen:?}");
}

#[test]
fn joint_without_friction_never_sticks_even_beside_one_that_does() {
    let mut plant = plant();
    plant.drives[1].coulomb_friction_nm = 0.0;
    plant.drives[1].viscous_friction_nm_s_per_rad = 0.0;
    let start = State::at_rest([-0.4, 0.9]);
    let mut torque = holding(&plant, start.position_rad, [0.5, 0.0]);
    for tiny in [1e-9, -1e-9] {
        torque[1] += tiny;
        let next = plant.prepare().step(&start, torque, PERIOD_S);
        assert_eq!(next.velocity_rad_s[0], 0.0);
        assert!(next.velocity_rad_s[1] * tiny * plant.drives[1].gear_ratio > 0.0, "{next:?}");
        torque[1] -= tiny;
    }
}

#[test]
fn motor_that_turns_the_other_way_moves_its_joint_the_same() {
    let plant = plant();
    let mut mirrored = plant;
    mirrored.drives[1].gear_ratio = -plant.drives[1].gear_ratio;
    let (mut state, mut mirror) = (swinging(), swinging());
    let mut random = Random::new(4);
    for _ in 0..2000 {
        let [t2, t3] = random.pair(1.0);
        state = plant.prepare().step(&state, [t2, t3], PERIOD_S);
        mirror = mirrored.prepare().step(&mirror, [t2, -t3], PERIOD_S);
        assert_eq!(state, mirror);
        let count = |plant: &Plant<f64>, state: &State<f64>| plant.drives[1].encoder_counts(state.position_rad[1]);
        assert_eq!(count(&plant, &state), -count(&mirrored, &mirror));
    }
}

// Steps of a whole sampling period.

/// Largest and rms difference, over both joints, of steps of a whole period from fine ones in the default loop.
fn against_fine_steps(
    plant: Plant<f64>,
    fine_step_s: f64,
    mut coarse_step: impl FnMut(&State<f64>, [f64; 2]) -> State<f64>,
) -> (f64, f64) {
    let mut fine = Robot::new(plant, laws(DEFAULT_GAINS, 0.0), false, PERIOD_S);
    (fine.step_s, fine.delay_s) = (fine_step_s, 0.0);
    let mut coarse_laws = laws(DEFAULT_GAINS, 0.0);
    let mut coarse = fine.state;
    let mut differences = Vec::new();
    for k in 0..SAMPLES {
        let reference = reference_counts(k as f64 * PERIOD_S);
        fine.tick(reference);
        let torque = [0, 1].map(|j| {
            let actual = coarse.position_rad[j] * counts_per_rad()[j];
            plant.drives[j].motor_torque_nm(coarse_laws[j].command_a(reference[j], actual))
        });
        coarse = coarse_step(&coarse, torque);
        for j in 0..2 {
            differences.push((coarse.position_rad[j] - fine.state.position_rad[j]) * counts_per_rad()[j]);
        }
    }
    (largest(differences.iter().copied()), rms(&differences))
}

#[test]
fn one_midpoint_step_a_period_is_exact_beside_the_rounding_of_the_encoder() {
    let plant = plant();
    let prepared = plant.prepare();
    let (most, rms) = against_fine_steps(plant, 1e-6, |state, torque| prepared.step(state, torque, PERIOD_S));
    // Rounding is 1/√12 = 0.29 counts rms. What is left is the reversals, placed at the end of their step: 0.06 rms
    // would add 2 % to the rounding, and nowhere may it reach the rounding itself.
    assert!(rms < 0.06 && most < 0.29, "{rms} rms, {most} at most");
}

#[test]
fn where_friction_is_smooth_a_midpoint_step_a_period_is_of_second_order_and_far_below_rounding() {
    let mut plant = plant();
    plant.drives.iter_mut().for_each(|drive| drive.coulomb_friction_nm = 0.0);
    let prepared = plant.prepare();
    let (most, _) = against_fine_steps(plant, 1e-5, |state, torque| prepared.step(state, torque, PERIOD_S));
    // 0.02 counts would add 0.2 % to the rounding's rms of 0.29.
    assert!(most < 0.02, "{most}");
    let (halved, _) = against_fine_steps(plant, 1e-5, |state, torque| {
        let middle = prepared.step(state, torque, PERIOD_S / 2.0);
        prepared.step(&middle, torque, PERIOD_S / 2.0)
    });
    assert!(halved < most / 3.5, "{most} became {halved}");
}

#[test]
fn symplectic_euler_under_held_torque_would_be_wrong_by_counts() {
    // design.md §5: 1 to 3 counts. This is why the midpoint rule is there.
    let plant = plant();
    let prepared = plant.prepare();
    let (most, _) = against_fine_steps(plant, 1e-5, |state, torque| prepared.step_symplectic(state, torque, PERIOD_S));
    assert!(most > 1.0, "{most}");
}

#[test]
fn single_precision_stays_with_double_precision_over_a_movement() {
    let (double, single) = (plant(), single_precision(&plant()));
    let mut double_state = State::at_rest([0.0; 2]);
    let mut single_state = State::at_rest([0.0_f32; 2]);
    let (mut double_laws, mut single_laws) = (laws(DEFAULT_GAINS, 0.0), laws(DEFAULT_GAINS, 0.0));
    let mut most = 0.0_f64;
    for k in 0..SAMPLES {
        let reference = reference_counts(k as f64 * PERIOD_S);
        let counts = |j: usize, position: f64| position * counts_per_rad()[j];
        let of_double = [0, 1].map(|j| double_laws[j].command_a(reference[j], counts(j, double_state.position_rad[j])));
        let of_single = [0, 1]
            .map(|j| single_laws[j].command_a(reference[j], counts(j, f64::from(single_state.position_rad[j]))) as f32);
        double_state = double.prepare().step(
            &double_state,
            [0, 1].map(|j| double.drives[j].motor_torque_nm(of_double[j])),
            PERIOD_S,
        );
        single_state = single.prepare().step(
            &single_state,
            [0, 1].map(|j| single.drives[j].motor_torque_nm(of_single[j])),
            PERIOD_S as f32,
        );
        most = most.max(largest(
            [0, 1].map(|j| counts(j, double_state.position_rad[j] - f64::from(single_state.position_rad[j]))),
        ));
    }
    // Every step rounds the angle by up to 6e-8 rad, 0.0005 counts rms; if nothing were forgotten, 5214 of them would
    // add up to 0.035 rms. Three times that.
    assert!(most < 0.1, "{most}");
}

// The fast-loop emulation and single axes.

#[test]
fn symplectic_step_takes_its_forces_at_the_old_state_and_moves_with_the_new_velocity() {
    let mut plant = plant();
    plant.drives.iter_mut().for_each(|drive| drive.coulomb_friction_nm = 0.0);
    let mut random = Random::new(5);
    for _ in 0..100 {
        let old = State { position_rad: random.pair(3.0), velocity_rad_s: random.pair(3.0) };
        let torque = random.pair(2.0);
        let new = plant.prepare().step_symplectic(&old, torque, PERIOD_S);
        let [moved, gained] = [(new.position_rad, old.position_rad), (new.velocity_rad_s, old.velocity_rad_s)]
            .map(|(new, old)| [0, 1].map(|j| (new[j] - old[j]) / PERIOD_S));
        let needed = plant.arm.inverse_dynamics_nm(old.position_rad, old.velocity_rad_s, gained);
        for j in 0..2 {
            let drive = &plant.drives[j];
            let friction = drive.viscous_friction_nm_s_per_rad * drive.gear_ratio * old.velocity_rad_s[j];
            // 200 N m at the joint, velocities divided by the period: 1e-15 · 200 / 0.0007.
            assert!((needed[j] - drive.gear_ratio * (torque[j] - friction)).abs() < 1e-9);
            assert!((moved[j] - new.velocity_rad_s[j]).abs() < 1e-11);
        }
    }
}

/// A single axis of inertia 0.5 whose motor pulls it back like a spring: 40 Hz, as stiff as the paper's loop.
fn spring_axis() -> (Plant<f64>, f64) {
    let drive = Drive { gear_ratio: -50.0, ..free_drive() };
    let stiffness = 0.5 * (TAU * 40.0_f64).powi(2);
    (Plant::single_axis(0.5, drive), stiffness / drive.gear_ratio)
}

#[test]
fn symplectic_euler_neither_damps_nor_drives_a_loop_without_damping() {
    let (axis, nm_per_rad) = spring_axis();
    let prepared = axis.prepare();
    let mut state = State::at_rest([0.01, 0.0]);
    let amplitude_over = |state: &mut State<f64>, steps: usize, midpoint: bool| {
        let mut most = 0.0_f64;
        for _ in 0..steps {
            let torque = [axis.drives[0].motor_torque_nm(-nm_per_rad * state.position_rad[0]), 0.0];
            let next = if midpoint { PreparedPlant::step } else { PreparedPlant::step_symplectic };
            *state = next(&prepared, state, torque, PERIOD_S);
            most = most.max(state.position_rad[0].abs());
        }
        most
    };
    let first = amplitude_over(&mut state, 1000, false);
    amplitude_over(&mut state, 1_000_000, false);
    let last = amplitude_over(&mut state, 1000, false);
    // 28 000 periods. Sampling 36 times a period misses a peak by at most (1/36 · π)²/2 = 0.4 %, and 1000 samples
    // that fall differently into their periods come far closer.
    assert!((last / first - 1.0).abs() < 1e-3, "{first} became {last}");
    // A torque held over the step, which is what a midpoint step integrates, drives the same loop: by half a period's
    // delay, exp(w² h/4 · t), 60-fold in a third of a second.
    let mut held = State::at_rest([0.01, 0.0]);
    assert!(amplitude_over(&mut held, 600, true) > 0.1);
}

#[test]
fn single_axis_swings_as_a_mass_on_a_spring_and_the_other_joint_stays_out_of_it() {
    let (axis, nm_per_rad) = spring_axis();
    let prepared = axis.prepare();
    let step_s = 1e-6;
    let mut state = State::at_rest([0.01, 0.0]);
    // A quarter period of 40 Hz: 6.25 ms.
    for _ in 0..6250 {
        let torque = [0, 1].map(|j| axis.drives[j].motor_torque_nm(-nm_per_rad * state.position_rad[0]));
        state = prepared.step_symplectic(&state, torque, step_s);
        assert_eq!((state.position_rad[1], state.velocity_rad_s[1]), (0.0, 0.0));
    }
    // First order: w h/2 = 1.3e-4 of the amplitude.
    assert!(state.position_rad[0].abs() < 0.01 * 2.6e-4, "{state:?}");
    assert!((state.velocity_rad_s[0] / (-0.01 * TAU * 40.0) - 1.0).abs() < 2.6e-4, "{state:?}");
}

#[test]
fn single_axis_feels_no_gravity() {
    let (axis, _) = spring_axis();
    let state = State::at_rest([0.7, 0.0]);
    assert_eq!(axis.prepare().step(&state, [0.0; 2], PERIOD_S), state);
    let falls = Plant { arm: Arm { f: REFERENCE_F, gravity_m_s2: GRAVITY }, drives: drives() };
    assert_ne!(falls.prepare().step(&state, [0.0; 2], PERIOD_S), state);
}

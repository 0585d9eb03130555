//! Motion through time: energy, convergence, friction.

use crate::simulator::friction::Mode;
use crate::simulator::{Arm, BaseParameters, LinkMasses, Plant, Robot, State};

const STEP_S: f64 = 20e-6;

fn reference_plant() -> Plant {
    Plant::of(&Robot::reference())
}

fn largest_difference(one: &State, other: &State) -> f64 {
    let differences = |one: [f64; 2], other: [f64; 2]| (one[0] - other[0]).abs().max((one[1] - other[1]).abs());
    differences(one.angle_rad, other.angle_rad).max(differences(one.velocity_rad_s, other.velocity_rad_s))
}

#[test]
fn energy_stays_without_friction() {
    for arm in [Arm::Base(BaseParameters::REFERENCE), Arm::Links(LinkMasses::reference())] {
        let plant = Plant { arm, viscous_nm_s: [0.0; 2], coulomb_nm: [0.0; 2], ..reference_plant() };
        let energy = |state: &State| arm.energy_j(state.angle_rad, state.velocity_rad_s, plant.gravity_m_s2);
        // Dropped from the horizontal it swings wildly, at several rad/s.
        let mut state = State::at_rest([0.0, 0.5]);
        let start = energy(&state);
        let mut fastest = 0.0_f64;
        for _ in 0..200 {
            plant.advance(&mut state, [0.0; 2], 0.01, STEP_S);
            fastest = fastest.max(state.velocity_rad_s[0].abs());
            let drift = (energy(&state) - start).abs();
            assert!(drift < 1e-9, "{drift} J");
        }
        assert!(fastest > 2.0);
        println!("energy after 2 s of free swing: changed by {:.1e} J of about 100 J", energy(&state) - start);
    }
}

#[test]
fn both_forms_of_the_arm_move_alike() {
    let links = LinkMasses::reference();
    let mut states = [State::at_rest([0.0, 0.0]); 2];
    for (state, arm) in states.iter_mut().zip([Arm::Links(links), Arm::Base(links.base_parameters())]) {
        wander(&Plant { arm, ..reference_plant() }, state, STEP_S);
    }
    assert!(largest_difference(&states[0], &states[1]) < 1e-9, "{states:?}");
}

/// Two seconds under torques that jump every 0.7 ms, with many reversals and rests.
fn wander(plant: &Plant, state: &mut State, step_s: f64) {
    for period in 0..2857 {
        let time_s = 0.7e-3 * f64::from(period);
        let weight = plant.arm.equations(state.angle_rad, [0.0; 2], plant.gravity_m_s2).bias_nm;
        // A spring would hide errors of the integrator; a fixed torque over the weight does not.
        let torque = [weight[0] + 22.0 * (9.0 * time_s).sin(), weight[1] + 12.0 * (14.0 * time_s).cos()];
        plant.advance(state, torque, 0.7e-3, step_s);
    }
}

#[test]
fn shorter_steps_change_nothing() {
    let plant = reference_plant();
    let end = |step_s: f64| {
        let mut state = State::at_rest([0.0, 0.0]);
        wander(&plant, &mut state, step_s);
        state
    };
    let finest = end(2.5e-6);
    let errors = [40e-6, 20e-6, 10e-6].map(|step_s| largest_difference(&end(step_s), &finest));
    let [coarse, default, fine] = errors;
    println!("state after 2 s less that with 2.5 µs steps: {coarse:.1e}, {default:.1e}, {fine:.1e} for 40, 20, 10 µs");
    // A count is 7e-5 rad.
    assert!(errors[1] < 1e-6, "{errors:?}");
}

#[test]
fn without_events_the_order_is_four() {
    let plant = Plant { coulomb_nm: [0.0; 2], ..reference_plant() };
    let end = |step_s: f64| {
        let mut state = State::at_rest([0.0, 0.0]);
        plant.advance(&mut state, [5.0, -3.0], 1.0, step_s);
        state
    };
    let exact = end(0.1e-3);
    let errors = [8e-3, 4e-3, 2e-3].map(|step_s| largest_difference(&end(step_s), &exact));
    for pair in errors.windows(2) {
        assert!((12.0..20.0).contains(&(pair[0] / pair[1])), "{errors:?}");
    }
}

#[test]
fn coasting_ends_where_it_must_and_stays_there() {
    // Decoupled joints without gravity have a closed solution: v = (v0 + C/B) exp(-B t / M) - C/B.
    let arm = Arm::Base(BaseParameters([1.6, 0.0, 0.0, 0.0, 0.0, 0.0, 5.6, 0.0, 0.0]));
    let plant = Plant { arm, gravity_m_s2: 0.0, ..reference_plant() };
    let (mass, start) = ([5.6, 1.6], [0.9, -1.7]);
    let mut state = State { angle_rad: [0.0; 2], velocity_rad_s: start };
    plant.advance(&mut state, [0.0; 2], 2.0, STEP_S);
    for joint in 0..2 {
        let (viscous, coulomb) = (plant.viscous_nm_s[joint], plant.coulomb_nm[joint]);
        let limit = coulomb / viscous;
        let stop_s = mass[joint] / viscous * (start[joint].abs() / limit).ln_1p();
        let distance = start[joint].signum() * (mass[joint] * start[joint].abs() - coulomb * stop_s) / viscous;
        let error = (state.angle_rad[joint] - distance).abs();
        assert!(error < 1e-12, "joint {joint} stops {error} rad off");
        assert_eq!(state.velocity_rad_s[joint], 0.0);
    }
    let rest = state;
    plant.advance(&mut state, [0.99 * plant.coulomb_nm[0], -0.99 * plant.coulomb_nm[1]], 1.0, STEP_S);
    assert_eq!(state, rest, "a stuck arm must not move at all");
}

#[test]
fn stick_ends_at_the_coulomb_torque() {
    let plant = reference_plant();
    let rest = State::at_rest([-0.7, 0.6]);
    let weight = plant.arm.equations(rest.angle_rad, [0.0; 2], plant.gravity_m_s2).bias_nm;
    let under = |shares: [f64; 2]| std::array::from_fn(|joint| weight[joint] + shares[joint] * plant.coulomb_nm[joint]);
    assert_eq!(plant.modes(&rest, under([0.999, -0.999])), [Mode::Stuck; 2]);
    assert_eq!(plant.modes(&rest, under([1.001, 0.0])), [Mode::Up, Mode::Stuck]);
    assert_eq!(plant.modes(&rest, under([0.0, -1.001])), [Mode::Stuck, Mode::Down]);
    // Torque on the elbow alone drags the shoulder along once the reaction exceeds its friction.
    assert_eq!(plant.modes(&rest, under([0.0, 6.0]))[0], Mode::Down);

    let mut state = rest;
    plant.advance(&mut state, under([0.0, 1.5]), 0.05, STEP_S);
    assert_eq!(state.angle_rad[0], rest.angle_rad[0], "the stuck shoulder must not creep while the elbow moves");
    assert!(state.angle_rad[1] > rest.angle_rad[1]);
}

#[test]
fn friction_takes_energy_and_never_gives_any() {
    let plant = reference_plant();
    let energy = |state: &State| plant.arm.energy_j(state.angle_rad, state.velocity_rad_s, plant.gravity_m_s2);
    let mut state = State::at_rest([0.0, 0.5]);
    let mut before = energy(&state);
    for _ in 0..4000 {
        plant.advance(&mut state, [0.0; 2], 1e-3, STEP_S);
        let now = energy(&state);
        assert!(now <= before + 1e-10, "gained {} J", now - before);
        before = now;
    }
    assert_eq!(state.velocity_rad_s, [0.0; 2], "after 4 s the dropped arm lies still");
}

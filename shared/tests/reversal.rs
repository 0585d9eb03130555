//! A joint that turns within a step, beside fine steps.

#[path = "robot/mod.rs"]
mod robot;

use robot::{Random, counts_per_rad, largest, plant};
use shared::arm::Pose;
use shared::plant::{Frame, PreparedPlant, State};

/// Two rows, which is the longest step that is taken through reversals.
const STEP_S: f64 = 0.0014;
const MOVEMENTS: usize = 400;

/// An arm about to turn in one or both joints, and the torques that turn it.
fn about_to_turn(random: &mut Random) -> ([f64; 2], State<f64>, [f64; 2]) {
    let origin = random.pair(1.5);
    let state = State { position_rad: random.pair(1e-3), velocity_rad_s: random.pair(0.01) };
    (origin, state, random.pair(2.0))
}

fn in_counts(state: &State<f64>, other: &State<f64>) -> [f64; 2] {
    let off = |of: fn(&State<f64>) -> [f64; 2], scale: f64| {
        let differences = [0, 1].map(|joint| (of(state)[joint] - of(other)[joint]) * counts_per_rad()[joint] * scale);
        largest(differences)
    };
    [off(|state| state.position_rad, 1.0), off(|state| state.velocity_rad_s, STEP_S)]
}

fn fine(plant: &PreparedPlant<f64>, origin: [f64; 2], state: &State<f64>, torque_nm: [f64; 2]) -> State<f64> {
    const STEPS: u32 = 4000;
    let absolute = |state: State<f64>, sign: f64| State {
        position_rad: [0, 1].map(|joint| state.position_rad[joint] + sign * origin[joint]),
        ..state
    };
    let end =
        (0..STEPS).fold(absolute(*state, 1.0), |state, _| plant.step(&state, torque_nm, STEP_S / f64::from(STEPS)));
    absolute(end, -1.0)
}

#[test]
fn a_step_through_reversals_is_as_fine_steps_are() {
    let plant = plant().prepare();
    let mut random = Random::new(5);
    let (mut worst, mut plain, mut turned, mut both) = ([0.0_f64; 2], [0.0_f64; 2], 0, 0);
    for _ in 0..MOVEMENTS {
        let (at, state, torque_nm) = about_to_turn(&mut random);
        let origin = Pose::at(at);
        let frame = Frame { middle: origin, velocity_rad_s: [0.0; 2] };
        let truth = fine(&plant, at, &state, torque_nm);
        let through = plant.step_through_reversals(&origin, &state, torque_nm, STEP_S, [0.0; 2]);
        let whole = plant.step_from(&frame, &state, torque_nm, STEP_S);
        let turns = [0, 1].map(|joint| state.velocity_rad_s[joint] * truth.velocity_rad_s[joint] <= 0.0);
        if turns == [false; 2] {
            assert_eq!(through, whole);
            continue;
        }
        turned += 1;
        both += u32::from(turns == [true; 2]);
        for index in 0..2 {
            worst[index] = worst[index].max(in_counts(&through, &truth)[index]);
            plain[index] = plain[index].max(in_counts(&whole, &truth)[index]);
        }
    }
    println!(
        "{turned} turned, {both} in both joints: {worst:.6?} counts through reversals, {plain:.6?} in whole steps"
    );
    assert!(turned > 100 && both > 20, "{turned} turned, {both} in both joints");
    // A hundredth of what an encoder rounds by.
    assert!(worst.iter().all(|&worst| worst < 0.003), "{worst:?}");
    assert!(plain.iter().zip(worst).all(|(&plain, worst)| plain > 10.0 * worst), "{plain:?} and {worst:?}");
}

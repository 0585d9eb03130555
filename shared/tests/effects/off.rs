//! With every effect off the extended plant is the plain one.

use shared::control::{LawState, SampledTiming};
use shared::drive::centre_of_count;
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant};
use shared::machine::Machine as _;
use shared::plant::{Plant, State};
use shared::replay::{ClosedLoop, Innovations, RecordedSample, ReplaySettings};

use crate::robot::{
    DEFAULT_GAINS, DELAY_S, PERIOD_S, Robot, laws, plant, reference, reference_counts, single_precision,
};

const TICKS: u32 = 3000;

fn settings(loop_period_s: f64, substeps: u32) -> ReplaySettings {
    let timing = SampledTiming { record_period_s: PERIOD_S, loop_period_s, command_delay_s: DELAY_S };
    ReplaySettings { timing, quantised: true, substeps }
}

/// The largest difference between both machines' errors in counts.
fn difference(plain: &Plant<f64>, laws: [LawState<f64>; 2], settings: &ReplaySettings) -> f64 {
    let machine = ExtendedMachine::new(&ExtendedPlant { plant: *plain, effects: Effects::OFF });
    let start = State::at_rest(reference(0.0).position_rad);
    let mut without = ClosedLoop::new(plain, laws, settings, start);
    let mut off = ClosedLoop::of(machine, laws, settings, machine.start(start, 0.0));
    let mut worst = 0.0_f64;
    for k in 0..TICKS {
        let [reference, next] = [k, k + 1].map(|k| reference_counts(f64::from(k) * PERIOD_S));
        let [a, b] = [without.tick(reference, next, [0.01, 0.02]), off.tick(reference, next, [0.01, 0.02])];
        for joint in 0..2 {
            worst = worst.max((a.error_counts[joint] - b.error_counts[joint]).abs());
        }
    }
    worst
}

#[test]
fn closed_loops_are_the_same_to_rounding() {
    for substeps in [1, 4] {
        let found = difference(&plant(), laws(DEFAULT_GAINS, 0.0), &settings(PERIOD_S, substeps));
        // Positions are 3e4 counts: 1e-12 of them.
        assert!(found < 3e-8, "{substeps}: {found}");
    }
}

#[test]
fn fast_loops_are_the_same_to_rounding() {
    // The loop rings at these gains, and differences with it.
    for substeps in [1, 4] {
        let found = difference(&plant(), laws([0.096, 0.094], 0.0), &settings(5e-5, substeps));
        assert!(found < 3e-8, "{substeps}: {found}");
    }
}

#[test]
fn innovations_are_the_same_to_rounding() {
    let mut robot = Robot::new(plant(), laws(DEFAULT_GAINS, 0.0), true, PERIOD_S);
    let machine = ExtendedMachine::new(&ExtendedPlant { plant: plant(), effects: Effects::OFF });
    let start = State::at_rest(reference(0.0).position_rad);
    let settings = settings(PERIOD_S, 4);
    let mut plain = Innovations::new(&plant(), laws(DEFAULT_GAINS, 0.0), &settings, start);
    let mut off = Innovations::of(machine, laws(DEFAULT_GAINS, 0.0), &settings, machine.start(start, 0.0));
    for k in 0..TICKS {
        let tick = robot.tick(reference_counts(f64::from(k) * PERIOD_S));
        let sample = RecordedSample {
            reference_counts: tick.reference,
            next_reference_counts: tick.reference,
            measured_counts: tick.actual.map(centre_of_count),
            command_a: tick.command,
            added_torque_nm: [0.0; 2],
        };
        let [a, b] = [plain.tick(&sample), off.tick(&sample)];
        assert!((0..2).all(|joint| (a[joint] - b[joint]).abs() < 3e-8), "tick {k}: {a:?} {b:?}");
        // What a sensor shows next is this command, within the amplifier's limit.
        assert_eq!(off.motion().current_a, tick.command.map(|command| command.clamp(-12.0, 12.0)), "tick {k}");
    }
}

#[test]
fn single_precision_carries_the_effects_as_well() {
    let settings = settings(PERIOD_S, 4);
    let start = State::at_rest(reference(0.0).position_rad);
    let single = ExtendedPlant {
        plant: single_precision(&plant()),
        effects: Effects::from_constants(|constant| constant(&Effects::OFF) as f32),
    };
    let machine = ExtendedMachine::new(&single);
    let law = |joint: usize| {
        let position_loop = crate::robot::position_loop(DEFAULT_GAINS[joint], 0.0);
        LawState::new(shared::control::Law::Proportional(position_loop).map(|value| value as f32))
    };
    let narrow = State { position_rad: start.position_rad.map(|q| q as f32), velocity_rad_s: [0.0; 2] };
    let mut single = ClosedLoop::of(machine, [law(0), law(1)], &settings, machine.start(narrow, 0.0));
    let mut double = ClosedLoop::new(&plant(), laws(DEFAULT_GAINS, 0.0), &settings, start);
    for k in 0..700 {
        let reference = reference_counts(f64::from(k) * PERIOD_S);
        let a = double.tick(reference, reference, [0.0; 2]).error_counts;
        let b = single.tick(reference.map(|r| r as f32), reference.map(|r| r as f32), [0.0; 2]).error_counts;
        // 24 bits of some thousand counts, gathered over four steps a tick.
        assert!((0..2).all(|joint| (a[joint] - f64::from(b[joint])).abs() < 1.0), "tick {k}: {a:?} {b:?}");
    }
}

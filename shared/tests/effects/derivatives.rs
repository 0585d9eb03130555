//! Exact derivatives of the innovations by every smooth size, at what is off and at what is typical, against
//! differences.

use shared::control::{LawState, SampledTiming};
use shared::drive::centre_of_count;
use shared::dual::Dual;
use shared::effects::catalogue::{Entry, LIBRARY, Scope};
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant};
use shared::machine::Machine as _;
use shared::plant::{Plant, State};
use shared::replay::{Innovations, RecordedSample, ReplaySettings};
use shared::scalar::Number;

use crate::robot::{DEFAULT_GAINS, DELAY_S, PERIOD_S, Robot, Tick, laws, plant, reference, reference_counts};

fn recording() -> Vec<Tick> {
    let mut robot = Robot::new(plant(), laws(DEFAULT_GAINS, 0.0), true, PERIOD_S);
    (0..1500).map(|k| robot.tick(reference_counts(f64::from(k) * PERIOD_S))).collect()
}

/// Innovations of both joints, one after the other.
fn innovations<N: Number>(recording: &[Tick], extended: &ExtendedPlant<N>) -> Vec<N> {
    let timing = SampledTiming { record_period_s: PERIOD_S, loop_period_s: PERIOD_S, command_delay_s: DELAY_S };
    let settings = ReplaySettings { timing, quantised: true, substeps: 4 };
    let machine = ExtendedMachine::new(extended);
    let start = State { position_rad: reference(0.0).position_rad.map(N::from_f64), velocity_rad_s: [N::zero(); 2] };
    let law = |joint: usize| {
        let position_loop = crate::robot::position_loop(DEFAULT_GAINS[joint], 0.0);
        LawState::new(shared::control::Law::Proportional(position_loop).map(N::from_f64))
    };
    let mut model = Innovations::of(machine, [law(0), law(1)], &settings, machine.start(start, 0.0));
    recording
        .iter()
        .flat_map(|tick| {
            model.tick(&RecordedSample {
                reference_counts: tick.reference.map(N::from_f64),
                next_reference_counts: tick.reference.map(N::from_f64),
                measured_counts: tick.actual.map(|count| N::from_f64(centre_of_count(count))),
                command_a: tick.command.map(N::from_f64),
                added_torque_nm: [N::zero(); 2],
            })
        })
        .collect()
}

fn plain(effects: Effects<f64>) -> ExtendedPlant<f64> {
    ExtendedPlant { plant: plant(), effects }
}

/// The exact derivative, in one direction of `effects`.
fn exact(recording: &[Tick], effects: Effects<f64>, towards: Effects<f64>) -> Vec<f64> {
    let number = |constant: &dyn Fn(&ExtendedPlant<f64>) -> f64| {
        let (value, other) = (constant(&plain(effects)), constant(&plain(towards)));
        // A limit that is off is infinite in both.
        Dual { value, slope: if value == other { 0.0 } else { other - value } }
    };
    innovations(recording, &ExtendedPlant::from_constants(number)).iter().map(|dual| dual.slope).collect()
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// The share by which the exact derivative differs from differences over `step`, and its norm.
fn disagreement(recording: &[Tick], entry: &Entry, joint: usize, from: f64, step: f64, one_sided: bool) -> (f64, f64) {
    let size = entry.size();
    let with = |value: f64| {
        let mut effects = Effects::OFF;
        size.set(&mut effects, joint, value);
        effects
    };
    let slope = exact(recording, with(from), with(from + 1.0));
    let low = if one_sided { from } else { from - step };
    let high = from + step;
    let [low_values, high_values] = [low, high].map(|value| innovations(recording, &plain(with(value))));
    let gaps: Vec<f64> = slope
        .iter()
        .zip(high_values.iter().zip(&low_values))
        .map(|(slope, (high_value, low_value))| slope - (high_value - low_value) / (high - low))
        .collect();
    (norm(&gaps) / norm(&slope), norm(&slope))
}

/// Sizes whose effect has no corner at off that a small step would cross, with what of the difference is one-sided.
fn smooth(entry: &Entry) -> Option<bool> {
    match entry.name {
        // Limits do nothing until they are reached; the gap's motion jumps from flank to flank.
        "current-saturation" | "voltage-saturation" | "backlash" => None,
        "joint-flexibility" | "current-lag" | "amplifier-dead-zone" => Some(true),
        _ => Some(false),
    }
}

#[test]
fn derivatives_at_off_and_at_typical_sizes_agree_with_differences() {
    let recording = recording();
    let mut tried = 0;
    for entry in LIBRARY {
        let Some(one_sided) = smooth(entry) else { continue };
        for joint in if entry.scope == Scope::Arm { 0..1 } else { 0..2 } {
            let typical = entry.size().typical;
            // A step so small that no reversal moves by a substep, where friction's corner is not smooth; and so
            // great that the rounding of 1e-11 counts does not show.
            for (from, one_sided, step) in [(0.0, one_sided, 1e-6 * typical), (typical, false, 1e-5 * typical)] {
                let (found, size) = disagreement(&recording, entry, joint, from, step, one_sided);
                assert!(size * typical > 1e-3, "{} of joint {joint}: no effect, {size}", entry.name);
                assert!(found < 0.02, "{} of joint {joint} from {from}: {found}", entry.name);
                tried += 1;
            }
        }
    }
    assert_eq!(tried, 2 * (2 * 21 + 2));
}

#[test]
fn gap_has_a_finite_derivative_at_off_that_shifts_the_motor_at_reversals_of_the_torque() {
    let recording = recording();
    let entry = shared::effects::catalogue::find("backlash").expect("in the library");
    let mut wide = Effects::OFF;
    entry.size().set(&mut wide, 1, 1.0);
    let slope = exact(&recording, Effects::OFF, wide);
    assert!(slope.iter().all(|value| value.is_finite()));
    assert!(norm(&slope) > 0.0);
}

#[test]
fn plain_constants_keep_their_derivatives_among_the_effects() {
    // By Coulomb friction, once as a constant of the drive and once as the effect.
    let recording = recording();
    let mut heavier = plant();
    heavier.drives[1].coulomb_friction_nm += 1.0;
    let of_drive = |towards: Plant<f64>| {
        let other = ExtendedPlant { plant: towards, effects: Effects::OFF };
        let number = |constant: &dyn Fn(&ExtendedPlant<f64>) -> f64| {
            let (value, other) = (constant(&plain(Effects::OFF)), constant(&other));
            Dual { value, slope: if value == other { 0.0 } else { other - value } }
        };
        innovations(&recording, &ExtendedPlant::from_constants(number))
            .iter()
            .map(|dual| dual.slope)
            .collect::<Vec<_>>()
    };
    let mut effects = Effects::OFF;
    effects.joints[1].coulomb_change_nm = 1.0;
    let [a, b] = [of_drive(heavier), exact(&recording, Effects::OFF, effects)];
    let gap: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
    assert!(norm(&gap) < 1e-9 * norm(&a), "{} of {}", norm(&gap), norm(&a));
}

//! The same experiment on robots that lack nothing: how large a score chance alone reaches.
//!
//! Every one is another robot: the fitted model under its own position loop, its encoder rounding at another phase, a
//! torque noise like the estimated one, and a baseline that errs by its standard errors.

use rayon::prelude::*;
use shared::control::{LawState, PositionLaw};
use shared::drive::centre_of_count;
use shared::effects::ExtendedPlant;
use shared::machine::{Machine, Movable};
use shared::replay::{Course, Innovations, RecordedSample};

use super::simulate::{Candidate, neutral};
use crate::identify::experiment::following;
use crate::identify::simulation::Simulation;
use crate::identify::{Columns, Experiment, Segment};
use crate::random::Random;

/// The noise of a simulated robot.
#[derive(Clone, Copy, Debug)]
pub struct NullNoise {
    /// Standard deviation of the motors' torque noise in N m.
    pub torque_nm: [f64; 2],
    /// Its correlation time in s.
    pub correlation_time_s: [f64; 2],
    /// Standard deviation of the measured position in counts, for encoders that do not round.
    pub position_counts: [f64; 2],
}

/// The innovations of `count` robots that are exactly `model`.
pub fn simulate_nulls(
    experiment: &Experiment,
    model: &Candidate,
    noise: &NullNoise,
    seed: u64,
    count: usize,
) -> Vec<Columns> {
    let segments = experiment.segments.len();
    let of = |null: usize, segment: usize| {
        let seed = seed.wrapping_add((null * segments + segment) as u64);
        closed_loop(experiment, model, segment, noise, &mut Random::new(seed, 0x6e75_6c6c)).innovations
    };
    (0..count).into_par_iter().map(|null| (0..segments).map(|segment| of(null, segment)).collect()).collect()
}

/// Robots that tell how loud rounding is.
const ROUNDING_NULLS: usize = 4;

/// Variance in counts² of the innovations of robots that are exactly `model` and have no noise but that of rounding, per joint.
/// In a loop that is faster than the recording, rounding of positions and commands moves the arm between the samples, unseen.
pub fn rounding_counts2(experiment: &Experiment, model: &Candidate, seed: u64) -> [f64; 2] {
    let silent = NullNoise { torque_nm: [0.0; 2], correlation_time_s: [1.0; 2], position_counts: [0.0; 2] };
    let nulls = simulate_nulls(experiment, model, &silent, seed, ROUNDING_NULLS);
    [0, 1].map(|joint: usize| {
        let settled = nulls.iter().flat_map(|columns| columns.iter().zip(&experiment.segments));
        let (mut sum, mut count) = (0.0, 0);
        for (columns, segment) in settled {
            let part = &columns[joint][experiment.settled(segment)];
            sum += part.iter().map(|innovation| innovation * innovation).sum::<f64>();
            count += part.len();
        }
        sum / count.max(1) as f64
    })
}

/// What a simulated robot records, and what the model that it is does not foresee of it.
pub struct Run {
    /// Tracking errors in counts.
    pub error_counts: [Vec<f64>; 2],
    /// Currents in A: the commands of the tick before.
    pub current_a: [Vec<f64>; 2],
    /// Innovations in counts.
    pub innovations: [Vec<f64>; 2],
}

/// `model` under the robot's own loop along the reference of a segment.
pub fn closed_loop(
    experiment: &Experiment,
    model: &Candidate,
    segment: usize,
    noise: &NullNoise,
    random: &mut Random,
) -> Run {
    let of = &experiment.segments[segment];
    if model.effects.is_empty() {
        run(&Simulation { experiment, plant: model.plant }, of, noise, random)
    } else {
        let effects = model.effects.get(segment).copied().unwrap_or(neutral(experiment));
        let plant = ExtendedPlant { plant: model.plant, effects };
        run(&Simulation { experiment, plant }, of, noise, random)
    }
}

fn run<P: Movable<Number = f64>>(
    simulation: &Simulation<'_, P>,
    segment: &Segment,
    noise: &NullNoise,
    random: &mut Random,
) -> Run {
    let experiment = simulation.experiment;
    let quantised = experiment.robot.quantised;
    let period_s = experiment.robot.record_period_s;
    let settings = experiment.settings(experiment.innovation_substeps);
    let samples = segment.error_counts.len();
    let robot = simulation.plant.machine();
    let ticks = experiment.ticks_per_record();
    let substeps = experiment.innovation_substeps.div_ceil(ticks);
    let substep_s = period_s / f64::from(ticks * substeps);
    let start = Simulation::<P>::start(&robot, segment);
    let mut laws: [LawState<f64>; 2] = simulation.laws(&robot, segment);
    let mut model = Innovations::of(robot, simulation.laws(&robot, segment), &settings, start);
    let mut motion = start;
    let mut previous: Option<[f64; 2]> = None;
    // Where between two counts the encoder begins.
    let phase = [0, 1].map(|_| if quantised { random.unit() } else { 0.0 });
    let kept = noise.correlation_time_s.map(|time_s| (-period_s / time_s).exp());
    let mut torque = noise.torque_nm.map(|deviation| deviation * random.normal());
    // A faster loop sees the reference itself, the model what is left of its rounded samples.
    let references = &segment.model_reference_counts;
    let seen = experiment.model_reference(&references.iter().map(|pair| pair.map(f64::round)).collect::<Vec<_>>());
    let seen = if ticks > 1 && quantised { &seen } else { references };
    let columns = || [Vec::with_capacity(samples), Vec::with_capacity(samples)];
    let mut left = Run { error_counts: columns(), current_a: columns(), innovations: columns() };
    let mut last_command: Option<[f64; 2]> = None;
    for k in 0..samples {
        let known = segment.added_torque_nm[k];
        let added = [torque[0] + known[0], torque[1] + known[1]];
        let (before, here, next) = (k.checked_sub(1).map(|k| references[k]), references[k], following(references, k));
        let course = [0, 1].map(|joint: usize| Course::new(before.map(|b| b[joint]), here[joint], next[joint]));
        for tick in 0..ticks {
            let position = robot.position_counts(&motion);
            let (mut actual, mut measured) = (position, position);
            for joint in 0..2 {
                if quantised {
                    actual[joint] = (position[joint] + phase[joint]).trunc();
                    measured[joint] = centre_of_count(actual[joint]) - phase[joint];
                } else {
                    actual[joint] += noise.position_counts[joint] * random.normal();
                    measured[joint] = actual[joint];
                }
            }
            let share = f64::from(tick) / f64::from(ticks);
            // Where commands are missing the model follows a loop of its own, and one whose encoder begins at a whole count.
            // What such a loop sees of the reference between the samples is rounded too, and so is what it commands there.
            let command = [0, 1].map(|joint: usize| {
                let (reference, actual) = (course[joint].at(share), actual[joint]);
                if ticks > 1 && quantised {
                    let command_a = laws[joint].command_a(reference.round(), actual - phase[joint]);
                    converted_a(experiment, joint, command_a)
                } else {
                    laws[joint].command_a(reference, actual)
                }
            });
            if tick == 0 {
                let innovation = model.tick(&RecordedSample {
                    reference_counts: seen[k],
                    next_reference_counts: following(seen, k),
                    measured_counts: measured,
                    command_a: command,
                    added_torque_nm: known,
                });
                let shown = last_command.unwrap_or(command);
                for joint in 0..2 {
                    left.innovations[joint].push(innovation[joint]);
                    left.error_counts[joint].push(segment.reference_counts[k][joint] - actual[joint]);
                    left.current_a[joint].push(shown[joint]);
                }
            }
            last_command = Some(command);
            let input = robot.input(command);
            let before = previous.unwrap_or_else(|| {
                motion = robot.begun(&motion, input);
                input
            });
            let mut late = experiment.robot.command_delay_s / substep_s;
            for _ in 0..substeps {
                let held = robot.held(late.clamp(0.0, 1.0), before, input, added);
                motion = robot.step(&motion, &held, substep_s);
                late -= 1.0;
            }
            previous = Some(input);
        }
        for joint in 0..2 {
            let fresh = noise.torque_nm[joint] * (1.0 - kept[joint] * kept[joint]).sqrt();
            torque[joint] = kept[joint] * torque[joint] + fresh * random.normal();
        }
    }
    left
}

/// Codes of the board's converters from zero to full scale.
const CODES_TO_FULL_SCALE: f64 = 2048.0;

/// A command in A as the board's converter gives it.
fn converted_a(experiment: &Experiment, joint: usize, command_a: f64) -> f64 {
    let a_per_code =
        experiment.robot.joints.get(joint).map_or(0.0, |joint| joint.current_full_scale_a) / CODES_TO_FULL_SCALE;
    if a_per_code > 0.0 { (command_a / a_per_code).round() * a_per_code } else { command_a }
}

//! The same experiment on robots that lack nothing: how large a score chance alone reaches.
//!
//! Every lane is another robot: the fitted model under its own position loop, its encoder rounding at another phase, a
//! torque noise like the estimated one, and a baseline that errs by its standard errors.

use fearless_simd::{Level, Simd, dispatch, f64x8};
use rayon::prelude::*;
use shared::control::{LawState, PositionLaw};
use shared::drive::centre_of_count;
use shared::effects::{Effects, ExtendedPlant};
use shared::machine::{Machine, Movable};
use shared::plant::Plant;
use shared::replay::{Innovations, RecordedSample};
use shared::scalar::Scalar;

use super::simulate::{Candidate, LANES, neutral};
use crate::identify::experiment::INNOVATION_SUBSTEPS;
use crate::identify::simulation::Simulation;
use crate::identify::{Columns, Experiment, Segment};
use crate::lanes::Lanes;
use crate::random::Random;

const GROUPS: usize = LANES / 8;
type Wide<S> = Lanes<S, f64x8<S>, GROUPS>;

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
    let level = Level::new();
    let chunks = count.div_ceil(LANES);
    let work: Vec<(usize, usize)> =
        (0..chunks).flat_map(|chunk| (0..experiment.segments.len()).map(move |segment| (chunk, segment))).collect();
    let of = |&(chunk, segment): &(usize, usize)| {
        let seed = seed.wrapping_add((chunk * experiment.segments.len() + segment) as u64);
        let mut random = Random::new(seed, 0x6e75_6c6c);
        if model.effects.is_empty() {
            dispatch!(level, machine => plain(machine, experiment, segment, model, noise, &mut random))
        } else {
            dispatch!(level, machine => extended(machine, experiment, segment, model, noise, &mut random))
        }
    };
    let done: Vec<Vec<[Vec<f64>; 2]>> = work.par_iter().map(of).collect();
    let mut nulls: Vec<Columns> = vec![Vec::new(); chunks * LANES];
    for (&(chunk, _), lanes) in work.iter().zip(done) {
        for (lane, columns) in lanes.into_iter().enumerate() {
            nulls[chunk * LANES + lane].push(columns);
        }
    }
    nulls.truncate(count);
    nulls
}

#[inline(always)]
fn plain<S: Simd>(
    machine: S,
    experiment: &Experiment,
    index: usize,
    model: &Candidate,
    noise: &NullNoise,
    random: &mut Random,
) -> Vec<[Vec<f64>; 2]> {
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| Wide::<S>::splat(machine, constant(&model.plant));
    let simulation = Simulation { experiment, plant: Plant::from_constants(number) };
    run(machine, &simulation, &experiment.segments[index], noise, random)
}

#[inline(always)]
fn extended<S: Simd>(
    machine: S,
    experiment: &Experiment,
    index: usize,
    model: &Candidate,
    noise: &NullNoise,
    random: &mut Random,
) -> Vec<[Vec<f64>; 2]> {
    let effects: Effects<f64> = model.effects.get(index).copied().unwrap_or(neutral(experiment));
    let extended = ExtendedPlant { plant: model.plant, effects };
    let number = |constant: &dyn Fn(&ExtendedPlant<f64>) -> f64| Wide::<S>::splat(machine, constant(&extended));
    let simulation = Simulation { experiment, plant: ExtendedPlant::from_constants(number) };
    run(machine, &simulation, &experiment.segments[index], noise, random)
}

#[inline(always)]
fn run<S: Simd, P: Movable<Number = Wide<S>>>(
    lanes: S,
    simulation: &Simulation<'_, P>,
    segment: &Segment,
    noise: &NullNoise,
    random: &mut Random,
) -> Vec<[Vec<f64>; 2]> {
    let experiment = simulation.experiment;
    let quantised = experiment.robot.quantised;
    let period_s = experiment.robot.record_period_s;
    let settings = experiment.settings(INNOVATION_SUBSTEPS);
    let samples = segment.error_counts.len();
    let robot = simulation.plant.machine();
    let number = |value: f64| Wide::<S>::splat(lanes, value);
    let substep_s = number(period_s / f64::from(INNOVATION_SUBSTEPS));
    let start = Simulation::<P>::start(&robot, segment);
    let mut laws: [LawState<Wide<S>>; 2] = simulation.laws(&robot, segment);
    let mut model = Innovations::of(robot, simulation.laws(&robot, segment), &settings, start);
    let mut motion = start;
    let mut previous: Option<[Wide<S>; 2]> = None;
    // Where between two counts each lane's encoder begins.
    let phase: [Wide<S>; 2] = [0, 1].map(|_| Lanes::from_fn(lanes, |_| if quantised { random.unit() } else { 0.0 }));
    let kept = noise.correlation_time_s.map(|time_s| (-period_s / time_s).exp());
    let mut torque: [Wide<S>; 2] = [0, 1].map(|joint| Lanes::from_fn(lanes, |_| noise.torque_nm[joint] * random.normal()));
    let mut left: Vec<[Vec<f64>; 2]> =
        (0..LANES).map(|_| [Vec::with_capacity(samples), Vec::with_capacity(samples)]).collect();
    for k in 0..samples {
        let position = robot.position_counts(&motion);
        let mut actual = position;
        let mut measured = position;
        for joint in 0..2 {
            if quantised {
                actual[joint] = (position[joint] + phase[joint]).fix();
                measured[joint] = centre_of_count(actual[joint]) - phase[joint];
            } else {
                let error: Wide<S> = Lanes::from_fn(lanes, |_| noise.position_counts[joint] * random.normal());
                actual[joint] = position[joint] + error;
                measured[joint] = actual[joint];
            }
        }
        let reference = [number(segment.reference_counts[k][0]), number(segment.reference_counts[k][1])];
        let command = [laws[0].command_a(reference[0], actual[0]), laws[1].command_a(reference[1], actual[1])];
        let known = segment.added_torque_nm[k];
        let innovation = model.tick(&RecordedSample {
            reference_counts: reference,
            measured_counts: measured,
            command_a: command,
            added_torque_nm: [number(known[0]), number(known[1])],
        });
        for (lane, left) in left.iter_mut().enumerate() {
            left[0].push(innovation[0].get(lane));
            left[1].push(innovation[1].get(lane));
        }
        let input = robot.input(command);
        let before = match previous {
            Some(before) => before,
            None => {
                motion = robot.begun(&motion, input);
                input
            }
        };
        let added = [torque[0] + number(known[0]), torque[1] + number(known[1])];
        let mut late = experiment.robot.command_delay_s * f64::from(INNOVATION_SUBSTEPS) / period_s;
        for _ in 0..INNOVATION_SUBSTEPS {
            let held = robot.held(number(late.clamp(0.0, 1.0)), before, input, added);
            motion = robot.step(&motion, &held, substep_s);
            late -= 1.0;
        }
        previous = Some(input);
        for joint in 0..2 {
            if noise.torque_nm[joint] > 0.0 {
                let fresh = noise.torque_nm[joint] * (1.0 - kept[joint] * kept[joint]).sqrt();
                let shock: Wide<S> = Lanes::from_fn(lanes, |_| fresh * random.normal());
                torque[joint] = torque[joint] * number(kept[joint]) + shock;
            }
        }
    }
    left
}

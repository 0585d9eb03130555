//! Many models at once on the recordings of an experiment: one in each lane where the processor has wide vectors, one
//! after the other elsewhere.

use fearless_simd::{Level, Simd, f64x8};
use rayon::prelude::*;
use shared::effects::{Effects, ExtendedPlant};
use shared::machine::{Machine, Movable};
use shared::plant::Plant;
use shared::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

use crate::identify::simulation::{Motion, Simulation};
use crate::identify::{Columns, Experiment, Segment};
use crate::lanes::Lanes;

/// Vectors per operation. The effects fill the registers with one.
const GROUPS: usize = 1;
/// Models simulated side by side.
pub const LANES: usize = 8 * GROUPS;

/// Integration steps a record period of a closed loop that is shown.
const CLOSED_LOOP_SUBSTEPS: u32 = 20;

/// Numbers in lanes.
type Wide<S> = Lanes<S, f64x8<S>, GROUPS>;

/// What one model leaves of the recordings.
#[derive(Clone, Debug, Default)]
pub struct Left {
    /// Innovations in counts, per segment and joint.
    pub innovations: Columns,
    /// Recorded less modelled current in A, per segment and joint.
    pub current: Columns,
}

/// A model to simulate.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The plain plant.
    pub plant: Plant<f64>,
    /// Its effects in each segment; empty where there is none at all.
    pub effects: Vec<Effects<f64>>,
}

/// Simulates every candidate on every segment.
pub fn simulate(experiment: &Experiment, candidates: &[Candidate]) -> Vec<Left> {
    let level = Level::new();
    let work: Vec<(usize, usize)> = (0..candidates.len().div_ceil(LANES))
        .flat_map(|chunk| (0..experiment.segments.len()).map(move |segment| (chunk, segment)))
        .collect();
    let of = |&(chunk, segment): &(usize, usize)| {
        let candidates = &candidates[chunk * LANES..candidates.len().min((chunk + 1) * LANES)];
        on_vectors(level, experiment, segment, candidates)
            .unwrap_or_else(|| candidates.iter().map(|candidate| alone(experiment, segment, candidate)).collect())
    };
    let done: Vec<Vec<OfSegment>> = work.par_iter().map(of).collect();
    let mut left: Vec<Left> = vec![Left::default(); candidates.len()];
    for (&(chunk, _), lanes) in work.iter().zip(done) {
        for (lane, one) in lanes.into_iter().enumerate() {
            let left = &mut left[chunk * LANES + lane];
            left.innovations.push(one.innovations);
            left.current.push(one.current);
        }
    }
    left
}

/// What a model leaves of one segment.
struct OfSegment {
    innovations: [Vec<f64>; 2],
    current: [Vec<f64>; 2],
}

/// All candidates side by side, if the processor can. The wide instructions alone: the code for each set of them is
/// large, and the narrow ones gain little over plain numbers.
#[cfg(target_arch = "x86_64")]
fn on_vectors(level: Level, experiment: &Experiment, index: usize, candidates: &[Candidate]) -> Option<Vec<OfSegment>> {
    // A loop faster than the recording has commands between the samples: another simulation, and a rare one.
    if experiment.commands_are_missing() {
        return None;
    }
    let machine = level.as_avx512()?;
    let bare = candidates.iter().all(|candidate| candidate.effects.is_empty());
    Some(machine.vectorize(
        #[inline(always)]
        || {
            if bare {
                plain(machine, experiment, index, candidates)
            } else {
                extended(machine, experiment, index, candidates)
            }
        },
    ))
}

#[cfg(not(target_arch = "x86_64"))]
fn on_vectors(_: Level, _: &Experiment, _: usize, _: &[Candidate]) -> Option<Vec<OfSegment>> {
    None
}

/// One candidate in plain numbers.
fn alone(experiment: &Experiment, index: usize, candidate: &Candidate) -> OfSegment {
    let simulation = Simulation { experiment, plant: of_segment(experiment, index, candidate) };
    let segment = &experiment.segments[index];
    let mut left = nothing(segment, 1);
    let mut left = left.remove(0);
    simulation.innovations_and_motion(
        segment,
        &experiment.settings(experiment.innovation_substeps),
        |k, innovation, motion| {
            for (joint, innovation) in innovation.into_iter().enumerate() {
                left.innovations[joint].push(innovation);
                left.current[joint].push(segment.current_a[k][joint] - motion.current_a[joint]);
            }
        },
    );
    left
}

#[inline(always)]
fn plain<S: Simd>(machine: S, experiment: &Experiment, index: usize, candidates: &[Candidate]) -> Vec<OfSegment> {
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| {
        let values = gathered(candidates, &|candidate| constant(&candidate.plant));
        Wide::<S>::from_fn(machine, |lane| values[lane])
    };
    let simulation = Simulation { experiment, plant: Plant::from_constants(number) };
    let segment = &experiment.segments[index];
    let mut left = nothing(segment, candidates.len());
    under_commands(&simulation, segment, |_, innovation, _| {
        for (lane, left) in left.iter_mut().enumerate() {
            left.innovations[0].push(innovation[0].get(lane));
            left.innovations[1].push(innovation[1].get(lane));
        }
    });
    with_commanded_current(experiment, segment, left)
}

/// One number of each lane's candidate. A function of its own: inlined a hundred times over it would be most of the code.
#[inline(never)]
fn gathered<T>(candidates: &[T], number: &dyn Fn(&T) -> f64) -> [f64; LANES] {
    // Lanes without a candidate repeat the last one.
    std::array::from_fn(|lane| number(&candidates[lane.min(candidates.len() - 1)]))
}

/// Follows a segment under the recorded command, as [`shared::replay::Innovations`] does for a loop that runs once a
/// sample; `sample` gets the number of each, its innovation and the motion before its correction.
#[inline(always)]
fn under_commands<P: Movable>(
    simulation: &Simulation<'_, P>,
    segment: &Segment,
    mut sample: impl FnMut(usize, [P::Number; 2], &Motion<P>),
) {
    let experiment = simulation.experiment;
    let machine = simulation.plant.machine();
    let period_s = experiment.robot.record_period_s;
    let omega = std::f64::consts::TAU * CORRECTION_HZ;
    let [position_gain, velocity_gain, substep_s] = [
        2.0 * CORRECTION_DAMPING * omega * period_s,
        omega * omega * period_s,
        period_s / f64::from(experiment.innovation_substeps),
    ]
    .map(|value| machine.number(value));
    let counts_per_rad = machine.counts_per_rad();
    let per_count = [machine.number(1.0) / counts_per_rad[0], machine.number(1.0) / counts_per_rad[1]];
    let mut motion = Simulation::<P>::start(&machine, segment);
    let mut previous =
        machine.input([machine.number(segment.command_a[0][0]), machine.number(segment.command_a[0][1])]);
    motion = machine.begun(&motion, previous);
    let lateness = experiment.robot.command_delay_s * f64::from(experiment.innovation_substeps) / period_s;
    for k in 0..segment.error_counts.len() {
        let modelled = machine.position_counts(&motion);
        let measured = segment.measured_counts[k];
        let innovation = [machine.number(measured[0]) - modelled[0], machine.number(measured[1]) - modelled[1]];
        sample(k, innovation, &motion);
        let radians = [innovation[0] * per_count[0], innovation[1] * per_count[1]];
        motion = machine.corrected(
            &motion,
            [position_gain * radians[0], position_gain * radians[1]],
            [velocity_gain * radians[0], velocity_gain * radians[1]],
        );
        let command = segment.command_a[k];
        let input = machine.input([machine.number(command[0]), machine.number(command[1])]);
        let added = segment.added_torque_nm[k];
        let added = [machine.number(added[0]), machine.number(added[1])];
        let mut late = lateness;
        for _ in 0..experiment.innovation_substeps {
            let held = machine.held(machine.number(late.clamp(0.0, 1.0)), previous, input, added);
            motion = machine.step(&motion, &held, substep_s);
            late -= 1.0;
        }
        previous = input;
    }
}

fn nothing(segment: &Segment, candidates: usize) -> Vec<OfSegment> {
    let column = || Vec::with_capacity(segment.error_counts.len());
    (0..candidates).map(|_| OfSegment { innovations: [column(), column()], current: [column(), column()] }).collect()
}

#[inline(always)]
fn extended<S: Simd>(machine: S, experiment: &Experiment, index: usize, candidates: &[Candidate]) -> Vec<OfSegment> {
    let plants: Vec<ExtendedPlant<f64>> =
        candidates.iter().map(|candidate| of_segment(experiment, index, candidate)).collect();
    let number = |constant: &dyn Fn(&ExtendedPlant<f64>) -> f64| {
        let values = gathered(&plants, constant);
        Wide::<S>::from_fn(machine, |lane| values[lane])
    };
    let simulation = Simulation { experiment, plant: ExtendedPlant::from_constants(number) };
    let segment = &experiment.segments[index];
    let mut left = nothing(segment, candidates.len());
    under_commands(&simulation, segment, |k, innovation, motion| {
        for (lane, left) in left.iter_mut().enumerate() {
            for (joint, innovation) in innovation.iter().enumerate() {
                left.innovations[joint].push(innovation.get(lane));
                left.current[joint].push(segment.current_a[k][joint] - motion.current_a[joint].get(lane));
            }
        }
    });
    left
}

fn of_segment(experiment: &Experiment, index: usize, candidate: &Candidate) -> ExtendedPlant<f64> {
    let effects = candidate.effects.get(index).copied().unwrap_or(neutral(experiment));
    ExtendedPlant { plant: candidate.plant, effects }
}

/// The commands in A that the robot's own law gives on a model in its loop, finely integrated.
pub fn closed_loop_commands(experiment: &Experiment, index: usize, candidate: &Candidate) -> Vec<[f64; 2]> {
    let simulation = Simulation { experiment, plant: of_segment(experiment, index, candidate) };
    let segment = &experiment.segments[index];
    let mut commands = Vec::with_capacity(segment.error_counts.len());
    simulation
        .closed_loop(segment, &experiment.settings(CLOSED_LOOP_SUBSTEPS), |_, tick, _| commands.push(tick.command_a));
    commands
}

/// No effect at all, for this kind of robot.
pub fn neutral(experiment: &Experiment) -> Effects<f64> {
    crate::effects::off(experiment.robot)
}

/// An ideal amplifier gives what was commanded a tick before, within its limit.
fn with_commanded_current(experiment: &Experiment, segment: &Segment, mut left: Vec<OfSegment>) -> Vec<OfSegment> {
    for joint in 0..2 {
        let limit = experiment.robot.joints.get(joint).map_or(0.0, |joint| joint.current_limit_a);
        let difference: Vec<f64> = (0..segment.command_a.len())
            .map(|k| {
                let command = segment.command_a[k.saturating_sub(1)][joint];
                segment.current_a[k][joint] - command.clamp(-limit, limit)
            })
            .collect();
        for one in &mut left {
            one.current[joint].clone_from(&difference);
        }
    }
    left
}

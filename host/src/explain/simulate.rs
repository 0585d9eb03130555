//! Many models at once on the recordings of an experiment: one in each lane.

use fearless_simd::{Level, Simd, dispatch, f64x8};
use rayon::prelude::*;
use shared::effects::{Effects, ExtendedPlant};
use shared::plant::Plant;

use crate::identify::experiment::INNOVATION_SUBSTEPS;
use crate::identify::simulation::Simulation;
use crate::identify::{Columns, Experiment, Segment};
use crate::lanes::Lanes;

/// Vectors per operation.
const GROUPS: usize = 2;
/// Models simulated side by side.
pub const LANES: usize = 8 * GROUPS;

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
        if candidates.iter().all(|candidate| candidate.effects.is_empty()) {
            dispatch!(level, machine => plain(machine, experiment, segment, candidates))
        } else {
            dispatch!(level, machine => extended(machine, experiment, segment, candidates))
        }
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

#[inline(always)]
fn plain<S: Simd>(machine: S, experiment: &Experiment, index: usize, candidates: &[Candidate]) -> Vec<OfSegment> {
    let last = candidates.len() - 1;
    // Lanes without a candidate repeat the last one.
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| {
        Wide::<S>::from_fn(machine, |lane| constant(&candidates[lane.min(last)].plant))
    };
    let simulation = Simulation { experiment, plant: Plant::from_constants(number) };
    let segment = &experiment.segments[index];
    let mut left = nothing(segment, candidates.len());
    simulation.innovations(segment, &experiment.settings(INNOVATION_SUBSTEPS), |_, innovation| {
        for (lane, left) in left.iter_mut().enumerate() {
            left.innovations[0].push(innovation[0].get(lane));
            left.innovations[1].push(innovation[1].get(lane));
        }
    });
    with_commanded_current(experiment, segment, left)
}

fn nothing(segment: &Segment, candidates: usize) -> Vec<OfSegment> {
    let column = || Vec::with_capacity(segment.error_counts.len());
    (0..candidates)
        .map(|_| OfSegment { innovations: [column(), column()], current: [column(), column()] })
        .collect()
}

#[inline(always)]
fn extended<S: Simd>(machine: S, experiment: &Experiment, index: usize, candidates: &[Candidate]) -> Vec<OfSegment> {
    let last = candidates.len() - 1;
    let plants: Vec<ExtendedPlant<f64>> = candidates
        .iter()
        .map(|candidate| ExtendedPlant {
            plant: candidate.plant,
            effects: candidate.effects.get(index).copied().unwrap_or(neutral(experiment)),
        })
        .collect();
    let number = |constant: &dyn Fn(&ExtendedPlant<f64>) -> f64| {
        Wide::<S>::from_fn(machine, |lane| constant(&plants[lane.min(last)]))
    };
    let simulation = Simulation { experiment, plant: ExtendedPlant::from_constants(number) };
    let segment = &experiment.segments[index];
    let mut left = nothing(segment, candidates.len());
    simulation.innovations_and_motion(
        segment,
        &experiment.settings(INNOVATION_SUBSTEPS),
        |k, innovation, motion| {
            for (lane, left) in left.iter_mut().enumerate() {
                for joint in 0..2 {
                    left.innovations[joint].push(innovation[joint].get(lane));
                    left.current[joint].push(segment.current_a[k][joint] - motion.current_a[joint].get(lane));
                }
            }
        },
    );
    left
}

/// No effect at all, for this kind of robot.
pub fn neutral(experiment: &Experiment) -> Effects<f64> {
    match experiment.robot.kind {
        crate::robot::Kind::TwoLink => Effects::OFF,
        crate::robot::Kind::SingleAxis => Effects::SINGLE_AXIS,
    }
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

//! The paper's objective for many candidates at once: the plant on vector lanes, the lanes shared out to all cores.

use fearless_simd::{Level, Simd, dispatch, f64x8};
use rayon::prelude::*;
use shared::plant::Plant;
use shared::scalar::Scalar;

use super::experiment::{Experiment, Fineness};
use super::simulation::Simulation;
use crate::lanes::Lanes;

/// Vectors per operation: two keep the arithmetic units busy and still fit the registers.
const GROUPS: usize = 2;

/// Candidates simulated side by side.
const CANDIDATES: usize = 8 * GROUPS;

impl Experiment<'_> {
    /// The paper's Y ([`Experiment::objective_counts2`]) of every plant, in order. The same for a plant to the bit,
    /// whatever stands beside it and on however many threads.
    pub fn objectives_counts2(&self, plants: &[Plant<f64>]) -> Vec<f64> {
        let level = Level::new();
        let judge = |plants: &[Plant<f64>]| dispatch!(level, machine => on_lanes(machine, self, plants));
        plants.par_chunks(CANDIDATES).flat_map_iter(judge).collect()
    }
}

#[inline(always)]
fn on_lanes<S: Simd>(machine: S, experiment: &Experiment, plants: &[Plant<f64>]) -> Vec<f64> {
    // Lanes without a candidate repeat the last one.
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| {
        Lanes::<S, f64x8<S>, GROUPS>::from_fn(machine, |lane| constant(&plants[lane.min(plants.len() - 1)]))
    };
    let simulation = Simulation { experiment, plant: Plant::from_constants(number) };
    let settings = experiment.settings(experiment.closed_loop_substeps(Fineness::Coarse));
    let second_joint = experiment.robot.joints.len() > 1;
    let mut sum = Lanes::splat(machine, 0.0);
    for segment in &experiment.segments {
        simulation.closed_loop(segment, &settings, |_, _, difference| {
            sum = difference[0].mul_add(difference[0], sum);
            if second_joint {
                sum = difference[1].mul_add(difference[1], sum);
            }
        });
    }
    (0..plants.len()).map(|lane| sum.get(lane)).collect()
}

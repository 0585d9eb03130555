//! The paper's objective for many candidates at once: the plant on vector lanes, the lanes shared out to all cores.

use fearless_simd::{Level, Simd, SimdFloat, dispatch, f32x16, f64x8};
use rayon::prelude::*;
use shared::plant::Plant;
use shared::scalar::{Number, Scalar};

use super::experiment::{Experiment, Fineness};
use super::simulation::Simulation;
use crate::lanes::Lanes;

/// Precision of the lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 64 bits: agrees with the plain plant to rounding.
    Double,
    /// 32 bits, twice as fast: for searches.
    Single,
}

impl Precision {
    /// Candidates simulated side by side.
    pub const fn lanes(self) -> usize {
        match self {
            Self::Double => 8 * GROUPS,
            Self::Single => 16 * GROUPS,
        }
    }
}

/// Vectors per operation: two keep the arithmetic units busy and still fit the registers.
const GROUPS: usize = 2;

/// Samples summed in the lanes' own precision; the sum of these sums has full precision.
const SAMPLES_PER_SUM: usize = 64;

impl Experiment<'_> {
    /// The paper's Y ([`Experiment::objective_counts2`]) of every plant, in order. The same for a plant to the bit,
    /// whatever stands beside it and on however many threads.
    pub fn objectives_counts2(&self, plants: &[Plant<f64>], precision: Precision) -> Vec<f64> {
        let level = Level::new();
        let judge = |plants: &[Plant<f64>]| match precision {
            Precision::Double => {
                dispatch!(level, machine => on_lanes::<_, f64x8<_>, GROUPS>(machine, self, plants))
            }
            Precision::Single => {
                dispatch!(level, machine => on_lanes::<_, f32x16<_>, GROUPS>(machine, self, plants))
            }
        };
        plants.par_chunks(precision.lanes()).flat_map_iter(judge).collect()
    }
}

#[inline(always)]
fn on_lanes<S: Simd, V: SimdFloat<S, Element: Number + Into<f64>>, const GROUPS: usize>(
    machine: S,
    experiment: &Experiment,
    plants: &[Plant<f64>],
) -> Vec<f64> {
    // Lanes without a candidate repeat the last one.
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| {
        Lanes::<S, V, GROUPS>::from_fn(machine, |lane| constant(&plants[lane.min(plants.len() - 1)]))
    };
    let simulation = Simulation { experiment, plant: Plant::from_constants(number) };
    let settings = experiment.settings(experiment.closed_loop_substeps(Fineness::Coarse));
    let second_joint = experiment.robot.joints.len() > 1;
    let zero = Lanes::splat(machine, 0.0);
    let mut totals = vec![0.0; plants.len()];
    for segment in &experiment.segments {
        let mut sum = zero;
        simulation.closed_loop(segment, &settings, |k, _, difference| {
            sum = difference[0].mul_add(difference[0], sum);
            if second_joint {
                sum = difference[1].mul_add(difference[1], sum);
            }
            if (k + 1) % SAMPLES_PER_SUM == 0 || k + 1 == segment.error_counts.len() {
                for (lane, total) in totals.iter_mut().enumerate() {
                    *total += sum.get(lane).into();
                }
                sum = zero;
            }
        });
    }
    totals
}

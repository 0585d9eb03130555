//! The paper's objective for many candidates at once: the plant on vector lanes, the lanes shared out to all cores.

use fearless_simd::{Level, Simd, SimdFloat, f32x16, f64x8};
use rayon::prelude::*;
use shared::control::PositionLoop;
use shared::plant::Plant;
use shared::replay::FollowedModel;
use shared::scalar::{Number, Scalar};

use super::experiment::{Experiment, Fineness, Segment};
use super::followed;
use super::simulation::Simulation;
use super::smoothed::Smoother;
use crate::lanes::{Lanes, on_vectors};

/// Vectors per operation in double precision: two chains of operations run in each other's gaps.
const DOUBLE_GROUPS: usize = 2;
/// Vectors per operation in single precision.
const SINGLE_GROUPS: usize = 3;
/// The same where there are only enough candidates for fewer.
const FEW_GROUPS: usize = 2;

/// Candidates simulated side by side in double precision.
const DOUBLE_LANES: usize = 8 * DOUBLE_GROUPS;
/// Candidates that a search simulates side by side on one core.
pub const SEARCH_LANES: usize = 16 * SINGLE_GROUPS;
const FEW_LANES: usize = 16 * FEW_GROUPS;

/// Samples whose squares are summed before the sum is added to the total: short sums of short sums lose less to
/// rounding than one long sum.
const SUMMED_SAMPLES: usize = 64;

/// How far from the recorded motion in rad a model may be counted from it: its pose is exact within π/4.
const FOLLOWED_RAD: f64 = 0.75;

/// The vector instructions found on this machine, by the name they have in code.
pub fn instructions() -> String {
    let level = format!("{:?}", Level::new());
    level.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default().to_owned()
}

impl Experiment<'_> {
    /// The paper's Y ([`Experiment::objective_counts2`]) of every plant, in order, in double precision. The same for a
    /// plant to the bit, whatever stands beside it and on however many threads.
    pub fn objectives_counts2(&self, plants: &[Plant<f64>]) -> Vec<f64> {
        let Some(loops) = followed::loops(self) else { return self.objectives_from_zero_counts2(plants) };
        let judged = self.followed_objectives(plants, &loops, None);
        self.judge_strayed(plants, judged)
    }

    /// [`Experiment::objectives_counts2`] within a relative 1e-4 and at twice its rate, for searches: in single
    /// precision. Where a loop cannot be followed it is the same. What may become a result should be judged in
    /// double precision as well.
    pub fn search_objectives_counts2(&self, plants: &[Plant<f64>]) -> Vec<f64> {
        let Some(loops) = followed::loops(self) else { return self.objectives_from_zero_counts2(plants) };
        let many = |plants: &[Plant<f64>]| {
            on_vectors!(machine => followed_on_lanes::<_, f32x16<_>, _, SINGLE_GROUPS>(
                machine, self, &loops, plants, single, None
            ))
        };
        let few = |plants: &[Plant<f64>]| {
            on_vectors!(machine => followed_on_lanes::<_, f32x16<_>, _, FEW_GROUPS>(
                machine, self, &loops, plants, single, None
            ))
        };
        // A generation is small: with fewer lanes it takes every core less time.
        let judged = if plants.len().div_ceil(rayon::current_num_threads().max(1)) <= FEW_LANES {
            plants.par_chunks(FEW_LANES).flat_map_iter(few).collect()
        } else {
            plants.par_chunks(SEARCH_LANES).flat_map_iter(many).collect()
        };
        self.judge_strayed(plants, judged)
    }

    /// The objective of what is left below `cutoff_hz` of the differences between recorded and modelled errors, counts²,
    /// of every plant in order, in double precision; infinite for a plant that strays from the recorded motion or blows
    /// up. None where a loop cannot be followed: one faster than the recording, or a law other than P.
    pub fn smoothed_objectives_counts2(&self, plants: &[Plant<f64>], cutoff_hz: f64) -> Option<Vec<f64>> {
        let loops = followed::loops(self)?;
        let judged = self.followed_objectives(plants, &loops, Some(cutoff_hz));
        Some(judged.into_iter().map(|objective| objective.unwrap_or(f64::INFINITY)).collect())
    }

    /// Objectives in double precision counted from the robot's motion; none for a plant that strays from it.
    fn followed_objectives(
        &self,
        plants: &[Plant<f64>],
        loops: &[[PositionLoop<f64>; 2]],
        cutoff_hz: Option<f64>,
    ) -> Vec<Option<f64>> {
        let judge = |plants: &[Plant<f64>]| {
            on_vectors!(machine => followed_on_lanes::<_, f64x8<_>, _, DOUBLE_GROUPS>(
                machine, self, loops, plants, double, cutoff_hz
            ))
        };
        plants.par_chunks(DOUBLE_LANES).flat_map_iter(judge).collect()
    }

    /// Fills the gaps in `judged`: candidates that strayed too far from the recorded motion to be counted from it, or
    /// that blew up, counted from zero.
    fn judge_strayed(&self, plants: &[Plant<f64>], judged: Vec<Option<f64>>) -> Vec<f64> {
        let strayed: Vec<Plant<f64>> =
            plants.iter().zip(&judged).filter(|(_, judged)| judged.is_none()).map(|(plant, _)| *plant).collect();
        let mut again = self.objectives_from_zero_counts2(&strayed).into_iter();
        judged.into_iter().map(|objective| objective.or_else(|| again.next()).unwrap_or(f64::NAN)).collect()
    }

    fn objectives_from_zero_counts2(&self, plants: &[Plant<f64>]) -> Vec<f64> {
        let judge = |plants: &[Plant<f64>]| on_vectors!(machine => on_lanes(machine, self, plants));
        plants.par_chunks(on_vectors!(machine => lanes(machine))).flat_map_iter(judge).collect()
    }
}

fn double(segment: &Segment) -> &[followed::Sample<f64>] {
    &segment.followed.double
}

fn single(segment: &Segment) -> &[followed::Sample<f32>] {
    &segment.followed.single
}

/// The objective of up to a chunk of candidates counted from the robot's own motion; none for those that stray from it.
#[inline(always)]
fn followed_on_lanes<
    S: Simd,
    V: SimdFloat<S, Element: Number + Into<f64>>,
    N: Number + Into<f64>,
    const GROUPS: usize,
>(
    machine: S,
    experiment: &Experiment,
    loops: &[[PositionLoop<f64>; 2]],
    plants: &[Plant<f64>],
    samples: fn(&Segment) -> &[followed::Sample<N>],
    cutoff_hz: Option<f64>,
) -> Vec<Option<f64>> {
    let settings = experiment.settings(1);
    let zero = Lanes::splat(machine, 0.0);
    let mut total = zero;
    let mut farthest = [zero, zero];
    for (segment, loops) in experiment.segments.iter().zip(loops) {
        let models: Vec<FollowedModel<f64>> =
            plants.iter().map(|plant| FollowedModel::new(plant, loops, &settings)).collect();
        // Lanes without a candidate repeat the last one.
        let number = |constant: &dyn Fn(&FollowedModel<f64>) -> f64| {
            Lanes::<S, V, GROUPS>::from_fn(machine, |lane| constant(&models[lane.min(models.len() - 1)]))
        };
        let constants = FollowedModel::in_numbers(number, settings.quantised);
        let mut model = followed::start(machine, experiment, segment, constants);
        let smoother = cutoff_hz.map(|cutoff_hz| {
            Smoother::new(cutoff_hz, experiment.robot.record_period_s, |value| Lanes::splat(machine, value))
        });
        let mut smoothers = smoother.map(|smoother| [smoother; 2]);
        for samples in samples(segment).chunks(SUMMED_SAMPLES) {
            let mut sum = zero;
            for sample in samples {
                let sample = sample.on_lanes(machine);
                let modelled = model.tick(&sample.model);
                let mut difference = [modelled[0] - sample.actual_counts[0], modelled[1] - sample.actual_counts[1]];
                if let Some([first, second]) = &mut smoothers {
                    difference = [first.next(difference[0]), second.next(difference[1])];
                }
                sum = difference[0].mul_add(difference[0], difference[1].mul_add(difference[1], sum));
                farthest = [farthest[0].maximum(modelled[0].abs()), farthest[1].maximum(modelled[1].abs())];
            }
            total += sum;
        }
    }
    let bound = [0, 1].map(|joint| FOLLOWED_RAD * experiment.counts_per_rad(joint).abs());
    (0..plants.len())
        .map(|lane| {
            let objective: f64 = total.get(lane).into();
            let near = (0..2).all(|joint| farthest[joint].get(lane).into() < bound[joint]);
            (near && objective.is_finite()).then_some(objective)
        })
        .collect()
}

/// As many candidates as this machine's registers hold: this way of counting is rare, and its code is large.
type Wide<S> = Lanes<S, <S as Simd>::f64s, DOUBLE_GROUPS>;

fn lanes<S: Simd>(_: S) -> usize {
    Wide::<S>::COUNT
}

#[inline(always)]
fn on_lanes<S: Simd>(machine: S, experiment: &Experiment, plants: &[Plant<f64>]) -> Vec<f64> {
    // Lanes without a candidate repeat the last one.
    let number = |constant: &dyn Fn(&Plant<f64>) -> f64| {
        Wide::<S>::from_fn(machine, |lane| constant(&plants[lane.min(plants.len() - 1)]))
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

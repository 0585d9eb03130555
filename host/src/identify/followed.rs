//! Segments counted from the robot's own motion, for the search: every sample's constants computed once, in double
//! precision, for all candidates.

use fearless_simd::{Simd, SimdFloat};
use shared::arm::Pose;
use shared::control::{Law, PositionLoop};
use shared::plant::{Frame, State};
use shared::replay::{FollowedLoop, FollowedModel, FollowedSample};
use shared::scalar::{Number, Scalar};

use super::experiment::{Experiment, Segment};
use super::low_pass::low_pass;
use crate::lanes::Lanes;

/// The robot's motion is taken below this frequency: its own oscillations are followed, the rounding of its encoder,
/// which would shake every model, is not.
const MOTION_CUTOFF_HZ: f64 = 40.0;

/// A segment's samples counted from the robot's motion, in both precisions; none where no search is meant.
#[derive(Clone, Debug, Default)]
pub struct Followed {
    /// In double precision.
    pub double: Vec<Sample<f64>>,
    /// In single precision.
    pub single: Vec<Sample<f32>>,
}

/// One sample: what the model needs, and what it is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Sample<N> {
    /// What the model needs.
    pub model: FollowedSample<N>,
    /// Recorded motor position, counted from the robot's smooth motion, in counts.
    pub actual_counts: [N; 2],
}

impl Followed {
    /// Takes a segment apart into the robot's smooth motion and what is left.
    pub(super) fn new(
        experiment: &Experiment,
        reference_counts: &[[f64; 2]],
        actual_counts: &[[f64; 2]],
        measured_counts: &[[f64; 2]],
        added_torque_nm: &[[f64; 2]],
    ) -> Self {
        let period_s = experiment.robot.record_period_s;
        let samples = measured_counts.len();
        let smooth: [Vec<f64>; 2] = std::array::from_fn(|joint| {
            let column: Vec<f64> = measured_counts.iter().map(|pair| pair[joint]).collect();
            low_pass(&column, period_s, MOTION_CUTOFF_HZ)
        });
        let position_rad = |k: usize, joint: usize| smooth[joint][k] / experiment.counts_per_rad(joint);
        // The last period is not simulated to its end by anyone.
        let velocity = |k: usize| -> [f64; 2] {
            let k = k.min(samples.saturating_sub(2));
            std::array::from_fn(|joint| (position_rad(k + 1, joint) - position_rad(k, joint)) / period_s)
        };
        let sample = |k: usize| {
            let velocity_rad_s = velocity(k);
            let after = velocity(k + 1);
            let middle: [f64; 2] =
                std::array::from_fn(|joint| 0.5f64.mul_add(period_s * velocity_rad_s[joint], position_rad(k, joint)));
            let position_counts = [smooth[0][k], smooth[1][k]];
            let from_motion = |counts: &[[f64; 2]]| [counts[k][0] - smooth[0][k], counts[k][1] - smooth[1][k]];
            Sample {
                model: FollowedSample {
                    position_counts,
                    frame: Frame { middle: Pose::at(middle), velocity_rad_s },
                    slowing_rad_s: [velocity_rad_s[0] - after[0], velocity_rad_s[1] - after[1]],
                    reference_counts: from_motion(reference_counts),
                    added_torque_nm: added_torque_nm[k],
                },
                actual_counts: from_motion(actual_counts),
            }
        };
        let double: Vec<Sample<f64>> = (0..samples).map(sample).collect();
        Self { single: double.iter().map(|sample| sample.map(|value| value as f32)).collect(), double }
    }
}

impl<N: Number + Into<f64>> Sample<N> {
    /// The same for every lane.
    #[inline(always)]
    pub fn on_lanes<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize>(
        &self,
        machine: S,
    ) -> Sample<Lanes<S, V, GROUPS>> {
        self.map(
            #[inline(always)]
            |value| Lanes::splat(machine, value.into()),
        )
    }
}

impl<N: Copy> Sample<N> {
    /// In another number type.
    #[inline(always)]
    fn map<M: Scalar>(&self, number: impl Fn(N) -> M) -> Sample<M> {
        let model = &self.model;
        let middle = &model.frame.middle;
        Sample {
            model: FollowedSample {
                position_counts: [number(model.position_counts[0]), number(model.position_counts[1])],
                frame: Frame {
                    middle: Pose {
                        s2: number(middle.s2),
                        c2: number(middle.c2),
                        s3: number(middle.s3),
                        c3: number(middle.c3),
                        s23: number(middle.s23),
                        c23: number(middle.c23),
                    },
                    velocity_rad_s: [number(model.frame.velocity_rad_s[0]), number(model.frame.velocity_rad_s[1])],
                },
                slowing_rad_s: [number(model.slowing_rad_s[0]), number(model.slowing_rad_s[1])],
                reference_counts: [number(model.reference_counts[0]), number(model.reference_counts[1])],
                added_torque_nm: [number(model.added_torque_nm[0]), number(model.added_torque_nm[1])],
            },
            actual_counts: [number(self.actual_counts[0]), number(self.actual_counts[1])],
        }
    }
}

/// The position loops each segment was recorded under, if all are such that they can be followed: P with or without
/// lead, once a record period.
pub fn loops(experiment: &Experiment) -> Option<Vec<[PositionLoop<f64>; 2]>> {
    if experiment.commands_are_missing() {
        return None;
    }
    let proportional = |segment: &Segment| match segment.laws {
        [Law::Proportional(first), Law::Proportional(second)] if !segment.followed.double.is_empty() => {
            Some([first, second])
        }
        _ => None,
    };
    experiment.segments.iter().map(proportional).collect()
}

/// A model about to follow `segment` from its start.
#[inline(always)]
pub fn start<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize>(
    machine: S,
    experiment: &Experiment,
    segment: &Segment,
    model: FollowedModel<Lanes<S, V, GROUPS>>,
) -> FollowedLoop<Lanes<S, V, GROUPS>> {
    let number = |value| Lanes::splat(machine, value);
    let first = &segment.followed.double[0].model;
    let position = |joint: usize| {
        let motion_rad = first.position_counts[joint] / experiment.counts_per_rad(joint);
        number(segment.start.position_rad[joint] - motion_rad)
    };
    let velocity = |joint: usize| number(segment.start.velocity_rad_s[joint] - first.frame.velocity_rad_s[joint]);
    let state = State { position_rad: [position(0), position(1)], velocity_rad_s: [velocity(0), velocity(1)] };
    let [first, second] = segment.error_counts[0];
    FollowedLoop::new(model, state, [number(first), number(second)])
}

//! The paper's objective for many candidates at once: the plant on vector lanes, the lanes shared out to all cores.

use fearless_simd::{Level, Simd, SimdFloat, dispatch};
use rayon::prelude::*;
use shared::arm::Arm;
use shared::control::{Cascade, Law, LawState, PositionLoop};
use shared::drive::Drive;
use shared::plant::{Plant, State};
use shared::replay::{ClosedLoop, ReplaySettings};
use shared::scalar::{Number, Scalar};

use crate::lanes::Lanes;

/// Precision of the lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 64 bits: agrees with the plain plant to rounding.
    Double,
    /// 32 bits, twice as fast: for searches.
    Single,
}

/// A stretch of a recording as the closed loop is judged by it.
#[derive(Clone, Debug)]
pub struct Course<'a> {
    /// The reference that the model's loop takes, counts.
    pub reference_counts: &'a [[f64; 2]],
    /// The recorded motor position as truncated, counts.
    pub actual_counts: &'a [[f64; 2]],
    /// Known motor torque beside the command in N m.
    pub added_torque_nm: &'a [[f64; 2]],
    /// Where the arm is at the first sample.
    pub start: State<f64>,
    /// The first sample's error, counts.
    pub first_error_counts: [f64; 2],
    /// Counts moved per tick at the first sample.
    pub first_counts_per_tick: [f64; 2],
}

/// Everything candidates are judged by.
#[derive(Clone, Debug)]
pub struct Objective<'a> {
    /// Stretches without gaps.
    pub courses: Vec<Course<'a>>,
    /// The robot's laws.
    pub laws: [Law<f64>; 2],
    /// How the recordings were sampled.
    pub settings: ReplaySettings,
    /// Joints that count: two, or one for a single axis.
    pub joints: usize,
}

impl Objective<'_> {
    /// The paper's Y in counts² of every plant, in order; NaN or infinite for one that blows up. The same for a plant
    /// whatever stands beside it, on however many threads.
    pub fn counts2(&self, plants: &[Plant<f64>], precision: Precision) -> Vec<f64> {
        let level = Level::new();
        match precision {
            Precision::Double => self.in_chunks(
                plants,
                DOUBLES,
                |chunk| dispatch!(level, simd => self.on_lanes::<_, fearless_simd::f64x8<_>, 2>(simd, chunk)),
            ),
            Precision::Single => self.in_chunks(
                plants,
                SINGLES,
                |chunk| dispatch!(level, simd => self.on_lanes::<_, fearless_simd::f32x16<_>, 2>(simd, chunk)),
            ),
        }
    }

    fn in_chunks(
        &self,
        plants: &[Plant<f64>],
        size: usize,
        judge: impl Fn(&[Plant<f64>]) -> Vec<f64> + Sync + Send,
    ) -> Vec<f64> {
        plants.par_chunks(size).flat_map_iter(judge).collect()
    }

    #[inline(always)]
    fn on_lanes<S: Simd, V: SimdFloat<S, Element: Number + Into<f64>>, const GROUPS: usize>(
        &self,
        machine: S,
        plants: &[Plant<f64>],
    ) -> Vec<f64> {
        let lanes = |value: &dyn Fn(&Plant<f64>) -> f64| {
            Lanes::<S, V, GROUPS>::from_fn(machine, |lane| value(&plants[lane.min(plants.len() - 1)]))
        };
        let same = |value: f64| Lanes::<S, V, GROUPS>::splat(machine, value);
        let drive = |joint: usize| Drive {
            gear_ratio: lanes(&|plant| plant.drives[joint].gear_ratio),
            counts_per_rev: lanes(&|plant| plant.drives[joint].counts_per_rev),
            torque_constant_nm_per_a: lanes(&|plant| plant.drives[joint].torque_constant_nm_per_a),
            current_limit_a: lanes(&|plant| plant.drives[joint].current_limit_a),
            viscous_friction_nm_s_per_rad: lanes(&|plant| plant.drives[joint].viscous_friction_nm_s_per_rad),
            coulomb_friction_nm: lanes(&|plant| plant.drives[joint].coulomb_friction_nm),
            torque_offset_nm: lanes(&|plant| plant.drives[joint].torque_offset_nm),
        };
        let plant = Plant {
            arm: Arm {
                f: std::array::from_fn(|index| lanes(&|plant| plant.arm.f[index])),
                gravity_m_s2: lanes(&|plant| plant.arm.gravity_m_s2),
            },
            drives: [drive(0), drive(1)],
        };
        let law = |joint: usize| match &self.laws[joint] {
            Law::Proportional(law) => {
                Law::Proportional(PositionLoop { gain_a_per_count: same(law.gain_a_per_count), lead: same(law.lead) })
            }
            Law::Cascade(law) => Law::Cascade(Cascade {
                position_gain_per_s: same(law.position_gain_per_s),
                velocity_gain: same(law.velocity_gain),
                counts_per_unit: same(law.counts_per_unit),
                period_s: same(law.period_s),
            }),
        };
        let mut sums = vec![0.0; plants.len()];
        for course in &self.courses {
            let laws = [0, 1].map(|joint: usize| {
                let error = course.first_error_counts[joint];
                let actual = course.reference_counts[0][joint] - error;
                LawState::moving(law(joint), same(error), same(actual), same(course.first_counts_per_tick[joint]))
            });
            let start = State {
                position_rad: course.start.position_rad.map(same),
                velocity_rad_s: course.start.velocity_rad_s.map(same),
            };
            let mut model = ClosedLoop::new(&plant, laws, &self.settings, start);
            // Short sums in the lanes' precision, the sum of those in full precision.
            for from in (0..course.reference_counts.len()).step_by(SAMPLES_PER_SUM) {
                let to = (from + SAMPLES_PER_SUM).min(course.reference_counts.len());
                let mut sum = same(0.0);
                for k in from..to {
                    let reference = course.reference_counts[k];
                    let [actual, added] = [course.actual_counts[k], course.added_torque_nm[k]];
                    let tick = model.tick(pair::<S, V, GROUPS>(machine, reference), pair(machine, added));
                    let recorded = pair(machine, [reference[0] - actual[0], reference[1] - actual[1]]);
                    let difference = recorded[0] - tick.error_counts[0];
                    sum = difference.mul_add(difference, sum);
                    if self.joints > 1 {
                        let difference = recorded[1] - tick.error_counts[1];
                        sum = difference.mul_add(difference, sum);
                    }
                }
                for (lane, total) in sums.iter_mut().enumerate() {
                    *total += sum.get(lane).into();
                }
            }
        }
        sums
    }
}

/// Both numbers in every lane.
#[inline(always)]
fn pair<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize>(
    machine: S,
    values: [f64; 2],
) -> [Lanes<S, V, GROUPS>; 2] {
    [Lanes::splat(machine, values[0]), Lanes::splat(machine, values[1])]
}

const SAMPLES_PER_SUM: usize = 64;
const DOUBLES: usize = 16;
const SINGLES: usize = 32;

//! Movements, limits and measures that several of these tests need.

use proptest::prelude::*;
use shared::control::JointReference;
use shared::trajectory::*;

pub const RECORD_PERIOD_NS: u64 = 700_000;
pub const PERIOD_NS: u64 = 3_650_000_000;
/// 107.8 · 800 / 2π and −53.7 · 1000 / 2π.
pub const COUNTS_PER_RAD: [f64; 2] = [13_725.522_3, -8_546.620_4];
pub const COUNTS_PER_RAD_F32: [f32; 2] = [13_725.522, -8_546.62];

pub fn paper() -> Trajectory {
    Trajectory::Paper(Paper { period_ns: PERIOD_NS })
}

pub fn fourier(harmonics: &[Harmonic], period_ns: u64, repeats: u32, fade_ns: u64) -> Trajectory {
    Trajectory::Fourier(Fourier {
        period_ns,
        repeats,
        fade_ns,
        centre_rad: [-0.7, 0.8],
        harmonics: heapless::Vec::from_slice(harmonics).unwrap(),
    })
}

pub fn points(interval_ns: u64, points_rad: &[[f32; 2]]) -> Trajectory {
    Trajectory::Points(Points::new(interval_ns, points_rad).unwrap())
}

/// A spline that goes up and down: p(i) = 0.6 sin(0.9 i), −0.4 i / count.
pub fn wavy(interval_ns: u64, count: usize) -> Trajectory {
    let knots: Vec<[f32; 2]> =
        (0..count).map(|i| [0.6 * (0.9 * i as f32).sin(), -0.4 * i as f32 / count as f32]).collect();
    points(interval_ns, &knots)
}

/// Limits that let everything through.
pub fn generous() -> MotionLimits {
    MotionLimits {
        position_low_rad: [-100.0; 2],
        position_high_rad: [100.0; 2],
        speed_rad_s: [1e6; 2],
        acceleration_rad_s2: [1e9; 2],
        counts_per_tick: 1e9,
    }
}

pub fn any_harmonics() -> impl Strategy<Value = Vec<Harmonic>> {
    let pair = || prop::array::uniform2(-0.1_f32..0.1);
    prop::collection::vec((pair(), pair()), 1..=MAX_HARMONICS).prop_map(|amplitudes| {
        amplitudes.into_iter().map(|(cosine_rad, sine_rad)| Harmonic { cosine_rad, sine_rad }).collect()
    })
}

pub fn any_points() -> impl Strategy<Value = Vec<[f32; 2]>> {
    prop::collection::vec(prop::array::uniform2(-0.8_f32..0.8), 2..40)
}

pub fn any_trajectory() -> impl Strategy<Value = Trajectory> {
    let periods = 500_000_000_u64..20_000_000_000;
    prop_oneof![
        periods.clone().prop_map(|period_ns| Trajectory::Paper(Paper { period_ns })),
        (any_harmonics(), periods, 1_u32..4, 0.0..0.5).prop_map(|(harmonics, period_ns, repeats, fade)| {
            let fade_ns = (fade * (period_ns * u64::from(repeats)) as f64) as u64;
            fourier(&harmonics, period_ns, repeats, fade_ns)
        }),
        (any_points(), 10_000_000_u64..1_000_000_000).prop_map(|(knots, interval_ns)| points(interval_ns, &knots)),
    ]
}

/// The greatest distance in counts between two references.
pub fn apart_counts(one: &JointReference<f32>, other: &JointReference<f64>) -> [f64; 2] {
    [0, 1].map(|j| ((f64::from(one.position_rad[j]) - other.position_rad[j]) * COUNTS_PER_RAD[j]).abs())
}

/// Central differences of `reference` at `time_ns` against its own derivatives. `scale` bounds |velocity| and
/// |acceleration|.
pub fn assert_derivatives(
    reference: impl Fn(u64) -> JointReference<f64>,
    time_ns: u64,
    step_ns: u64,
    scale: [f64; 2],
) -> Result<(), TestCaseError> {
    let (before, here, after) = (reference(time_ns - step_ns), reference(time_ns), reference(time_ns + step_ns));
    let interval_s = 2.0e-9 * step_ns as f64;
    for joint in 0..2 {
        let velocity = (after.position_rad[joint] - before.position_rad[joint]) / interval_s;
        let acceleration = (after.velocity_rad_s[joint] - before.velocity_rad_s[joint]) / interval_s;
        let velocity_gap = (velocity - here.velocity_rad_s[joint]).abs();
        let acceleration_gap = (acceleration - here.acceleration_rad_s2[joint]).abs();
        prop_assert!(velocity_gap <= 1e-3 * scale[0] + 1e-9, "velocity {velocity}, {here:?}");
        prop_assert!(acceleration_gap <= 1e-3 * scale[1] + 1e-9, "acceleration {acceleration}, {here:?}");
    }
    Ok(())
}

/// Sampled peaks of |velocity| and |acceleration| over both joints.
pub fn scale(reference: impl Fn(u64) -> JointReference<f64>, duration_ns: u64) -> [f64; 2] {
    (0..2000).map(|i| reference(duration_ns / 2000 * i)).fold([0.0; 2], |[v, a], r| {
        [0, 1]
            .iter()
            .fold([v, a], |[v, a], &j| [v.max(r.velocity_rad_s[j].abs()), a.max(r.acceleration_rad_s2[j].abs())])
    })
}

pub fn margins_of(trajectory: &Trajectory) -> Margins {
    margins(trajectory, &generous(), COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap()
}

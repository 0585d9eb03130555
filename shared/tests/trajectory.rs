//! Trajectories: derivatives, exactness of time and of both ends, rounding of `f32` in counts, splines, the approach,
//! and the check against limits.

use proptest::prelude::*;
use shared::control::JointReference;
use shared::trajectory::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

const RECORD_PERIOD_NS: u64 = 700_000;
const PERIOD_NS: u64 = 3_650_000_000;
/// 107.8 · 800 / 2π and −53.7 · 1000 / 2π.
const COUNTS_PER_RAD: [f64; 2] = [13_725.522_3, -8_546.620_4];
const COUNTS_PER_RAD_F32: [f32; 2] = [13_725.522, -8_546.62];

fn paper() -> Trajectory {
    Trajectory::Paper(Paper { period_ns: PERIOD_NS })
}

fn fourier(harmonics: &[Harmonic], period_ns: u64, repeats: u32, fade_ns: u64) -> Trajectory {
    Trajectory::Fourier(Fourier {
        period_ns,
        repeats,
        fade_ns,
        centre_rad: [-0.7, 0.8],
        harmonics: heapless::Vec::from_slice(harmonics).unwrap(),
    })
}

fn points(interval_ns: u64, points_rad: &[[f32; 2]]) -> Trajectory {
    Trajectory::Points(Points::new(interval_ns, points_rad).unwrap())
}

/// A spline that goes up and down: p(i) = 0.6 sin(0.9 i), −0.4 i / count.
fn wavy(interval_ns: u64, count: usize) -> Trajectory {
    let knots: Vec<[f32; 2]> =
        (0..count).map(|i| [0.6 * (0.9 * i as f32).sin(), -0.4 * i as f32 / count as f32]).collect();
    points(interval_ns, &knots)
}

/// Limits that let everything through.
fn generous() -> MotionLimits {
    MotionLimits {
        position_low_rad: [-100.0; 2],
        position_high_rad: [100.0; 2],
        speed_rad_s: [1e6; 2],
        acceleration_rad_s2: [1e9; 2],
        counts_per_tick: 1e9,
    }
}

fn any_harmonics() -> impl Strategy<Value = Vec<Harmonic>> {
    let pair = || prop::array::uniform2(-0.1_f32..0.1);
    prop::collection::vec((pair(), pair()), 1..=MAX_HARMONICS).prop_map(|amplitudes| {
        amplitudes.into_iter().map(|(cosine_rad, sine_rad)| Harmonic { cosine_rad, sine_rad }).collect()
    })
}

fn any_points() -> impl Strategy<Value = Vec<[f32; 2]>> {
    prop::collection::vec(prop::array::uniform2(-0.8_f32..0.8), 2..40)
}

fn any_trajectory() -> impl Strategy<Value = Trajectory> {
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
fn apart_counts(one: &JointReference<f32>, other: &JointReference<f64>) -> [f64; 2] {
    [0, 1].map(|j| ((f64::from(one.position_rad[j]) - other.position_rad[j]) * COUNTS_PER_RAD[j]).abs())
}

/// Central differences of `reference` at `time_ns` against its own derivatives. `scale` bounds |velocity| and
/// |acceleration|.
fn assert_derivatives(
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
fn scale(reference: impl Fn(u64) -> JointReference<f64>, duration_ns: u64) -> [f64; 2] {
    (0..2000).map(|i| reference(duration_ns / 2000 * i)).fold([0.0; 2], |[v, a], r| {
        [0, 1]
            .iter()
            .fold([v, a], |[v, a], &j| [v.max(r.velocity_rad_s[j].abs()), a.max(r.acceleration_rad_s2[j].abs())])
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn phase_is_the_exact_quotient(time_ns: u64, period_ns in 1_u64..) {
        let exact = (u128::from(time_ns % period_ns) << 32) / u128::from(period_ns);
        prop_assert_eq!(u128::from(phase(time_ns, period_ns)), exact);
    }

    #[test]
    fn phase_is_exact_for_periods_of_every_length(time_ns: u64, period_ns in 1_u64.., bits in 1_u32..=64, near in 0..4_u64) {
        let period_ns = (period_ns >> (64 - bits)).max(1);
        // Any time, and those at the end of a period, where every digit is at its largest.
        for time_ns in [time_ns, time_ns % period_ns, period_ns.saturating_sub(near + 1)] {
            let exact = (u128::from(time_ns % period_ns) << 32) / u128::from(period_ns);
            prop_assert_eq!(u128::from(phase(time_ns, period_ns)), exact);
        }
    }

    #[test]
    fn phase_does_not_drift(time_ns in 0_u64..PERIOD_NS, turns in 1_u64..1_000_000_000) {
        prop_assert_eq!(phase(time_ns + turns * PERIOD_NS, PERIOD_NS), phase(time_ns, PERIOD_NS));
    }

    #[test]
    fn derivatives_agree_with_differences(trajectory in any_trajectory(), place in 0.01..0.99) {
        let duration_ns = trajectory.duration_ns();
        let reference = |time_ns| trajectory.reference::<f64>(time_ns);
        let time_ns = (place * duration_ns as f64) as u64;
        assert_derivatives(reference, time_ns, duration_ns / 200_000, scale(reference, duration_ns))?;
    }

    #[test]
    fn approach_derivatives_agree_with_differences(
        from in prop::array::uniform2(-1.5_f32..1.5), to in prop::array::uniform2(-1.5_f32..1.5), place in 0.01..0.99,
    ) {
        let limits = MotionLimits { position_low_rad: [-1.5; 2], position_high_rad: [1.5; 2], ..generous() };
        let limits = MotionLimits { speed_rad_s: [2.0; 2], acceleration_rad_s2: [9.0; 2], ..limits };
        let approach = Approach::new(from, to, &limits, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap();
        let duration_ns = approach.duration_ns();
        let reference = |time_ns| approach.reference::<f64>(time_ns);
        let time_ns = (place * duration_ns as f64) as u64;
        assert_derivatives(reference, time_ns, duration_ns / 100_000, scale(reference, duration_ns))?;
        let apart = apart_counts(&approach.reference(time_ns), &reference(time_ns));
        prop_assert!(apart[0] < 0.01 && apart[1] < 0.01, "{apart:?} counts");
    }

    #[test]
    fn single_precision_errs_by_less_than_a_hundredth_of_a_count(trajectory in any_trajectory(), place in 0.0..1.1) {
        let time_ns = (place * trajectory.duration_ns() as f64) as u64;
        let (single, double) = (trajectory.reference::<f32>(time_ns), trajectory.reference::<f64>(time_ns));
        let apart = apart_counts(&single, &double);
        prop_assert!(apart[0] < 0.01 && apart[1] < 0.01, "{apart:?}");
    }

    #[test]
    fn every_movement_holds_its_end(trajectory in any_trajectory(), later in 0_u64..1_000_000_000_000) {
        let duration_ns = trajectory.duration_ns();
        let before = trajectory.reference::<f64>(duration_ns - 1);
        let held = trajectory.reference::<f64>(duration_ns + later);
        prop_assert_eq!(held.velocity_rad_s, [0.0; 2]);
        prop_assert_eq!(held.acceleration_rad_s2, [0.0; 2]);
        prop_assert_eq!(held.position_rad, trajectory.reference::<f64>(u64::MAX).position_rad);
        prop_assert_eq!(trajectory.end_rad(), trajectory.reference::<f32>(duration_ns + later).position_rad);
        for joint in 0..2 {
            prop_assert!((held.position_rad[joint] - before.position_rad[joint]).abs() < 1e-7);
        }
    }

    #[test]
    fn what_is_decoded_is_what_was_sent(trajectory in any_trajectory()) {
        let mut buffer = [0; 4096];
        let bytes = postcard::to_slice(&trajectory, &mut buffer).unwrap();
        prop_assert_eq!(postcard::from_bytes::<Trajectory>(bytes).unwrap(), trajectory);
    }

    #[test]
    fn reported_peaks_are_upper_bounds_and_close(trajectory in any_trajectory()) {
        let margins = margins_of(&trajectory);
        let duration_ns = trajectory.duration_ns();
        // A fade of a few samples is bounded too, but not closely.
        let closely = match &trajectory {
            Trajectory::Fourier(fourier) => fourier.fade_ns == 0 || fourier.fade_ns > 50_000_000,
            _ => true,
        };
        let (mut low, mut high, mut speed, mut acceleration) = ([9.0_f64; 2], [-9.0_f64; 2], [0.0_f64; 2], [0.0_f64; 2]);
        for i in 0..20_000 {
            let reference = trajectory.reference::<f64>(duration_ns / 20_000 * i);
            for j in 0..2 {
                low[j] = low[j].min(reference.position_rad[j]);
                high[j] = high[j].max(reference.position_rad[j]);
                speed[j] = speed[j].max(reference.velocity_rad_s[j].abs());
                acceleration[j] = acceleration[j].max(reference.acceleration_rad_s2[j].abs());
            }
        }
        for j in 0..2 {
            for (quantity, exact, size) in [
                (Quantity::PositionLow, -low[j], high[j] - low[j]),
                (Quantity::PositionHigh, high[j], high[j] - low[j]),
                (Quantity::Speed, speed[j], speed[j]),
                (Quantity::Acceleration, acceleration[j], acceleration[j]),
                (Quantity::CountsPerTick, speed[j] * COUNTS_PER_RAD[j].abs() * 0.0007, speed[j] * 10.0),
            ] {
                let outward = if quantity == Quantity::PositionLow { -1.0 } else { 1.0 };
                let peak = outward * f64::from(margins.of(quantity, j).peak);
                // Rounding of f32 apart, never short of the truth.
                let rounding = 1e-5 * (size + 0.1);
                prop_assert!(peak >= exact - rounding, "{quantity:?} {peak}, truly {exact}");
                prop_assert!(!closely || peak <= exact + 0.02 * size + rounding, "{quantity:?} {peak}, truly {exact}");
            }
        }
    }

    #[test]
    fn a_spline_passes_its_points_with_continuous_acceleration(knots in any_points()) {
        let interval_ns = 100_000_000;
        let trajectory = points(interval_ns, &knots);
        for (i, knot) in knots.iter().enumerate() {
            prop_assert_eq!(trajectory.reference::<f32>(interval_ns * i as u64).position_rad, *knot);
        }
        let jerk_bound = scale(|t| trajectory.reference(t), trajectory.duration_ns())[1] * 4.0 / 0.1;
        for i in 1..knots.len() - 1 {
            let at = interval_ns * i as u64;
            let (before, after) = (trajectory.reference::<f64>(at - 1000), trajectory.reference::<f64>(at + 1000));
            for joint in 0..2 {
                let jump = after.acceleration_rad_s2[joint] - before.acceleration_rad_s2[joint];
                // 2 µs of jerk, and slopes rounded to f32: 4 · 1e-6 rad per interval² at most.
                prop_assert!(jump.abs() < 2e-6 * jerk_bound + 4e-4, "point {i}: jump of {jump} rad/s²");
            }
        }
        let start = trajectory.reference::<f64>(0);
        let end = trajectory.reference::<f64>(trajectory.duration_ns() - 1);
        for joint in 0..2 {
            prop_assert_eq!(start.velocity_rad_s[joint], 0.0);
            prop_assert!(end.velocity_rad_s[joint].abs() < 1e-5);
        }
    }

    #[test]
    fn an_approach_is_as_fast_as_the_limits_allow_and_no_faster(
        from in prop::array::uniform2(-3.0_f32..3.0), to in prop::array::uniform2(-1.5_f32..1.5),
        speed_rad_s in prop::array::uniform2(0.1_f32..5.0), acceleration_rad_s2 in prop::array::uniform2(0.5_f32..20.0),
        counts_per_tick in 1.0_f32..40.0,
    ) {
        let limits = MotionLimits {
            position_low_rad: [-1.5; 2], position_high_rad: [1.5; 2], speed_rad_s, acceleration_rad_s2, counts_per_tick,
        };
        let approach = Approach::new(from, to, &limits, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap();
        prop_assert_eq!(approach.reference::<f32>(0).position_rad, from);
        for late in [0, 1, 1_000_000_000_000] {
            let end = approach.reference::<f32>(approach.duration_ns() + late);
            prop_assert_eq!(end.position_rad, to);
            prop_assert_eq!((end.velocity_rad_s, end.acceleration_rad_s2), ([0.0; 2], [0.0; 2]));
        }
        let mut usage = 0.0_f32;
        for i in 0..4000 {
            let reference = approach.reference::<f32>((approach.duration_ns() as f64 * f64::from(i) / 4000.0) as u64);
            for joint in 0..2 {
                let speed = reference.velocity_rad_s[joint].abs();
                usage = usage
                    .max(speed / speed_rad_s[joint])
                    .max(reference.acceleration_rad_s2[joint].abs() / acceleration_rad_s2[joint])
                    .max(speed * COUNTS_PER_RAD_F32[joint].abs() * 0.0007 / counts_per_tick);
            }
        }
        prop_assert!((0.999..=1.0).contains(&usage), "{usage} of the limits");
    }
}

#[test]
fn sine_and_cosine_are_good_to_the_last_bits() {
    let (mut single, mut double) = (0.0_f64, 0.0_f64);
    for step in 0..400_000_u32 {
        let phase = step.wrapping_mul(10_737_419);
        // libstd's sine near 2π is only as good as its argument, so the argument is kept within half a turn.
        let (sin, cos) = (f64::from(phase.cast_signed()) * (TAU / 4_294_967_296.0)).sin_cos();
        let (s, c) = sin_cos_of_phase::<f32>(phase);
        single = single.max((f64::from(s) - sin).abs()).max((f64::from(c) - cos).abs());
        let (s, c) = sin_cos_of_phase::<f64>(phase);
        double = double.max((s - sin).abs()).max((c - cos).abs());
    }
    println!("sine and cosine: largest error {single:.3e} in f32, {double:.3e} in f64");
    assert!(single < 1.5e-7 && double < 5e-16, "{single:e} {double:e}");
    let quarters = [0, 1, 2, 3].map(|quarter| sin_cos_of_phase::<f32>(quarter << 30));
    assert_eq!(quarters, [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)]);
}

#[test]
fn simple_fractions_have_exact_phases() {
    for (eighths, exact) in [(0, 0), (1, 1 << 29), (2, 1 << 30), (4, 1 << 31), (7, 7 << 29), (8, 0), (80_001, 1 << 29)]
    {
        assert_eq!(phase(eighths * (PERIOD_NS / 8), PERIOD_NS), exact, "{eighths} eighths");
    }
    assert_eq!(phase(u64::MAX - 1, u64::MAX), u32::MAX);
    assert_eq!((phase(5, 1), phase(5, 0)), (0, 0));
}

/// Measures what the documentation of the module states.
#[test]
fn the_papers_movement_in_counts() {
    let trajectory = paper();
    assert_eq!(trajectory.duration_ns(), PERIOD_NS);
    assert_eq!(trajectory.record_periods(RECORD_PERIOD_NS), 5214);
    assert_eq!(trajectory.record_periods(0), 0);

    let mut single_error = [0.0_f64; 2];
    let mut double_error = [0.0_f64; 2];
    let mut most_per_tick = [0.0_f64; 2];
    let mut previous = [0.0; 2];
    for tick in 0..=5214_u64 {
        let time_ns = tick * RECORD_PERIOD_NS;
        let angle = TAU * (time_ns as f64 / PERIOD_NS as f64);
        let exact = [-FRAC_PI_4 + FRAC_PI_4 * angle.cos(), FRAC_PI_4 - FRAC_PI_4 * (2.0 * angle).cos()];
        let single = trajectory.reference::<f32>(time_ns);
        let double = trajectory.reference::<f64>(time_ns);
        for joint in 0..2 {
            let in_counts = |rad: f64| rad * COUNTS_PER_RAD[joint];
            let gap = (in_counts(f64::from(single.position_rad[joint])) - in_counts(exact[joint])).abs();
            single_error[joint] = single_error[joint].max(gap);
            let gap = (in_counts(double.position_rad[joint]) - in_counts(exact[joint])).abs();
            double_error[joint] = double_error[joint].max(gap);
            most_per_tick[joint] = most_per_tick[joint].max((in_counts(exact[joint]) - previous[joint]).abs());
            most_per_tick[joint] =
                most_per_tick[joint].max((in_counts(double.position_rad[joint]) - previous[joint]).abs());
            previous[joint] = in_counts(double.position_rad[joint]);
        }
    }
    println!("paper's movement, counts: f32 {single_error:.5?}, f64 {double_error:.7?}, per tick {most_per_tick:.2?}");
    assert!(single_error[0] < 0.0025 && single_error[1] < 0.0015, "{single_error:?} counts");
    assert!(double_error[0] < 2e-5 && double_error[1] < 2e-5, "{double_error:?} counts");
    assert!((12.9..13.1).contains(&most_per_tick[0]) && (16.1..16.3).contains(&most_per_tick[1]), "{most_per_tick:?}");
}

#[test]
fn the_papers_movement_starts_turns_and_ends_exactly() {
    let trajectory = paper();
    for time_ns in [0, PERIOD_NS, PERIOD_NS + 1, 1000 * PERIOD_NS] {
        let reference = trajectory.reference::<f32>(time_ns);
        assert_eq!((reference.position_rad, reference.velocity_rad_s), ([0.0; 2], [0.0; 2]));
    }
    let middle = trajectory.reference::<f64>(PERIOD_NS / 2);
    assert_eq!(middle.position_rad, [-FRAC_PI_2, 0.0]);
    let quarter = trajectory.reference::<f64>(PERIOD_NS / 4);
    assert!((quarter.position_rad[1] - FRAC_PI_2).abs() < 1e-15);
    let omega = TAU / 3.65;
    let start = trajectory.reference::<f64>(0).acceleration_rad_s2;
    assert!((start[0] + FRAC_PI_4 * omega * omega).abs() < 1e-12);
    assert!((start[1] - PI_OMEGA_SQUARED).abs() < 1e-12);
    // Held, it accelerates no more.
    assert_eq!(trajectory.reference::<f64>(PERIOD_NS).acceleration_rad_s2, [0.0; 2]);
}

/// π/4 (2ω)² = π ω² with ω = 2π/3.65.
const PI_OMEGA_SQUARED: f64 = std::f64::consts::PI * (TAU / 3.65) * (TAU / 3.65);

#[test]
fn a_late_period_repeats_the_first_to_the_bit() {
    let harmonics = [Harmonic { cosine_rad: [0.3, -0.2], sine_rad: [0.1, 0.05] }; 8];
    let trajectory = fourier(&harmonics, PERIOD_NS, 900, 0);
    let mut moved = 0;
    for tick in 0..500 {
        let time_ns = tick * 7 * RECORD_PERIOD_NS;
        let first = trajectory.reference::<f32>(time_ns);
        assert_eq!(first, trajectory.reference::<f32>(time_ns + 899 * PERIOD_NS));
        moved += u32::from(first.position_rad != trajectory.start_rad());
    }
    assert!(moved > 490);
}

#[test]
fn a_fourier_series_is_the_sum_it_says() {
    let harmonics = [
        Harmonic { cosine_rad: [0.25, -0.5], sine_rad: [0.125, 0.0] },
        Harmonic { cosine_rad: [0.0, 0.25], sine_rad: [-0.0625, 0.375] },
    ];
    let trajectory = fourier(&harmonics, 2_000_000_000, 3, 0);
    assert_eq!(trajectory.duration_ns(), 6_000_000_000);
    let (first, second) = ((0.3_f64 * TAU).sin_cos(), (0.6_f64 * TAU).sin_cos());
    let exact = [
        f64::from(-0.7_f32) + 0.25 * first.1 + 0.125 * first.0 - 0.0625 * second.0,
        f64::from(0.8_f32) - 0.5 * first.1 + 0.25 * second.1 + 0.375 * second.0,
    ];
    let reference = trajectory.reference::<f64>(2_600_000_000);
    for joint in 0..2 {
        assert!((reference.position_rad[joint] - exact[joint]).abs() < 1e-8, "{reference:?} {exact:?}");
    }
}

#[test]
fn a_fade_brings_any_series_to_rest() {
    let harmonics = [Harmonic { cosine_rad: [0.2, 0.1], sine_rad: [0.2, -0.3] }];
    let check =
        |fade_ns| check(&fourier(&harmonics, PERIOD_NS, 2, fade_ns), &generous(), COUNTS_PER_RAD_F32, RECORD_PERIOD_NS);
    let margins = check(PERIOD_NS / 2).unwrap();
    assert!(margins.starts_at_rest() && margins.ends_at_rest());
    let faded = fourier(&harmonics, PERIOD_NS, 2, PERIOD_NS / 2);
    assert_eq!((faded.start_rad(), faded.end_rad()), ([-0.7, 0.8], [-0.7, 0.8]));
    // At full amplitude the window does nothing.
    let plain = fourier(&harmonics, PERIOD_NS, 2, 0);
    assert_eq!(faded.reference::<f32>(PERIOD_NS), plain.reference::<f32>(PERIOD_NS));

    let error = check(0).unwrap_err();
    let speed = 0.2 * TAU / 3.65;
    let LimitError::Exceeded(margin) = error else { panic!("{error}") };
    assert_eq!((margin.quantity, margin.joint, margin.time_ns), (Quantity::StartSpeed, 0, 0));
    assert!((f64::from(margin.peak) - speed).abs() < 1e-6 && margin.limit == REST_SPEED_RAD_S);
    let margins = margins_of(&plain);
    assert!(!margins.starts_at_rest() && !margins.ends_at_rest());
    assert_eq!(margins.of(Quantity::EndSpeed, 1).time_ns, 2 * PERIOD_NS);

    let cosines = [Harmonic { cosine_rad: [0.2, 0.1], sine_rad: [0.0; 2] }; 3];
    assert!(margins_of(&fourier(&cosines, PERIOD_NS, 2, 0)).starts_at_rest());
}

fn margins_of(trajectory: &Trajectory) -> Margins {
    margins(trajectory, &generous(), COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap()
}

#[test]
fn a_clamped_spline_reproduces_a_cubic_that_rests_at_both_ends() {
    // 3u² − 2u³ has zero slope at both ends, so the spline through its points is the cubic itself.
    let cubic = |u: f64| u * u * (3.0 - 2.0 * u);
    for count in [2, 3, 5, 20, 33, 256] {
        let knots: Vec<[f32; 2]> = (0..count)
            .map(|i| cubic(f64::from(i) / f64::from(count - 1)))
            .map(|q| [q as f32, (-0.5 * q) as f32])
            .collect();
        let interval_ns = 20_000_000;
        let trajectory = points(interval_ns, &knots);
        let duration_ns = interval_ns * (count as u64 - 1);
        assert_eq!(trajectory.duration_ns(), duration_ns);
        for i in 0..1000 {
            let time_ns = duration_ns / 1000 * i;
            let u = time_ns as f64 / duration_ns as f64;
            let speed = 6.0 * u * (1.0 - u) / (duration_ns as f64 * 1e-9);
            let reference = trajectory.reference::<f64>(time_ns);
            assert!((reference.position_rad[0] - cubic(u)).abs() < 1e-7, "{count} points, u = {u}: {reference:?}");
            assert!((reference.position_rad[1] + 0.5 * cubic(u)).abs() < 1e-7);
            // Points rounded to f32 (3e-8 rad) 20 ms apart.
            assert!((reference.velocity_rad_s[0] - speed).abs() < 1e-5, "{count} points, u = {u}: {reference:?}");
        }
    }
}

#[test]
fn the_check_names_each_quantity_with_its_time() {
    let (omega, amplitude) = (TAU / 3.65, FRAC_PI_4);
    let (speed, acceleration) = (amplitude * omega, amplitude * omega * omega);
    let counts = |speed: f64, joint: usize| speed * COUNTS_PER_RAD[joint].abs() * 0.0007;
    let cases = [
        (Quantity::PositionLow, 0, -FRAC_PI_2, 0.5),
        (Quantity::PositionHigh, 0, 0.0, 0.0),
        (Quantity::Speed, 0, speed, 0.25),
        (Quantity::Acceleration, 0, acceleration, 0.0),
        (Quantity::CountsPerTick, 0, counts(speed, 0), 0.25),
        (Quantity::PositionLow, 1, 0.0, 0.0),
        (Quantity::PositionHigh, 1, FRAC_PI_2, 0.25),
        (Quantity::Speed, 1, 2.0 * speed, 0.125),
        (Quantity::Acceleration, 1, 4.0 * acceleration, 0.0),
        (Quantity::CountsPerTick, 1, counts(2.0 * speed, 1), 0.125),
    ];
    for (quantity, joint, peak, place) in cases {
        // `beyond` is how far the limit lies outside the peak.
        let limited = |beyond: f64| {
            let mut limits = generous();
            let outward = if quantity == Quantity::PositionLow { -1.0 } else { 1.0 };
            let limit = (peak + outward * beyond) as f32;
            match quantity {
                Quantity::PositionLow => limits.position_low_rad[joint] = limit,
                Quantity::PositionHigh => limits.position_high_rad[joint] = limit,
                Quantity::Speed => limits.speed_rad_s[joint] = limit,
                Quantity::Acceleration => limits.acceleration_rad_s2[joint] = limit,
                _ => limits.counts_per_tick = limit,
            }
            // Only the joint under test has an encoder fine enough to come near the limit.
            let mut counts_per_rad = [1.0; 2];
            counts_per_rad[joint] = COUNTS_PER_RAD_F32[joint];
            check(&paper(), &limits, counts_per_rad, RECORD_PERIOD_NS)
        };
        let margins = limited(0.001).unwrap_or_else(|error| panic!("{error}"));
        let left = margins.of(quantity, joint).left();
        assert!((left - 0.001).abs() < 3e-5, "{quantity:?} of joint {joint}: {left} left");
        let error = limited(-0.001).unwrap_err();
        let LimitError::Exceeded(margin) = error else { panic!("{error}") };
        assert_eq!((margin.quantity, usize::from(margin.joint)), (quantity, joint));
        assert!((f64::from(margin.peak) - peak).abs() < 3e-5, "{margin}, not {peak}");
        // Near a smooth peak several samples are equal in f32; the movement repeats after half a period.
        let place_ns = place * PERIOD_NS as f64;
        let early = (margin.time_ns as f64 - place_ns).rem_euclid(PERIOD_NS as f64 / 2.0);
        assert!(early.min(PERIOD_NS as f64 / 2.0 - early) < 3e6, "{margin}, not at {place_ns} ns");
    }
}

#[test]
fn the_reference_limits_allow_the_papers_movement_but_not_half_its_period() {
    let limits = MotionLimits::reference_robot();
    let check =
        |period_ns| check(&Trajectory::Paper(Paper { period_ns }), &limits, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS);
    let margins = check(PERIOD_NS).unwrap();
    let text = margins.of(Quantity::Speed, 0).to_string();
    assert!(text.starts_with("joint 2 speed: 1.3520 rad/s at 0.91"), "{text}");
    assert!(text.ends_with(" s, limit 2.7000, left 1.3480"), "{text}");
    let text = check(PERIOD_NS / 2).unwrap_err().to_string();
    assert!(text.starts_with("the speed of joint 2 reaches 2.7040 rad/s at 0.45"), "{text}");
    assert!(text.contains("beyond its limit of 2.7000 rad/s; make the movement slower or smaller"), "{text}");
}

#[test]
fn a_peak_between_samples_is_not_missed() {
    // Samples 100 ms apart all fall where the eighth harmonic's speed is zero.
    let mut harmonics = [Harmonic { cosine_rad: [0.0; 2], sine_rad: [0.0; 2] }; 8];
    harmonics[7].cosine_rad[0] = 0.5;
    harmonics[0].cosine_rad[0] = -0.5;
    let trajectory = fourier(&harmonics, 800_000_000, 1, 0);
    let true_peak = 0.5 * TAU / 0.8 * 8.0;
    for record_period_ns in [700_000, 10_000_000, 100_000_000] {
        let margins = margins(&trajectory, &generous(), COUNTS_PER_RAD_F32, record_period_ns).unwrap();
        let peak = f64::from(margins.of(Quantity::Speed, 0).peak);
        assert!(peak > true_peak * 0.99, "{peak} rad/s with samples {record_period_ns} ns apart");
    }
}

#[test]
fn a_long_movement_is_checked_in_bounded_time_and_still_on_the_safe_side() {
    // 0.5 h of spline: 2.6 million record periods, but at most 66 046 samples.
    let trajectory = wavy(7_000_000_000, 256);
    let started = std::time::Instant::now();
    let margins = margins_of(&trajectory);
    assert!(started.elapsed().as_secs_f64() < 1.0);
    let speed = scale(|t| trajectory.reference(t), trajectory.duration_ns())[0];
    let peak = f64::from(margins.of(Quantity::Speed, 0).peak);
    assert!(peak >= speed * 0.99999 && peak < speed * 1.01, "{peak} {speed}");
}

#[test]
fn malformed_movements_are_named() {
    let fault = |trajectory: &Trajectory| {
        let limits = MotionLimits::reference_robot();
        check(trajectory, &limits, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap_err()
    };
    let still = [Harmonic { cosine_rad: [0.1; 2], sine_rad: [0.0; 2] }; 2];
    let is_zero = |error, part| assert_eq!(error, LimitError::Zero { part });
    is_zero(fault(&Trajectory::Paper(Paper { period_ns: 0 })), Part::Period);
    is_zero(fault(&fourier(&still, 0, 1, 0)), Part::Period);
    is_zero(fault(&fourier(&still, PERIOD_NS, 0, 0)), Part::Repeats);
    is_zero(Points::new(0, &[[0.0; 2]; 3]).unwrap_err(), Part::Interval);
    assert_eq!(fault(&fourier(&still, 1000, 1, 501)), LimitError::FadeTooLong { fade_ns: 501, longest_ns: 500 });
    let mut broken = still;
    broken[1].sine_rad[1] = f32::NAN;
    let error = fault(&fourier(&broken, PERIOD_NS, 1, 0));
    assert!(matches!(error, LimitError::NotFinite { part: Part::Harmonic(2), joint: 1, .. }), "{error}");
    assert_eq!(error.to_string(), "harmonic 2 of the movement is NaN for joint 3, not a finite number; correct it");
    let mut knots = [[0.0; 2]; 5];
    knots[3][0] = f32::INFINITY;
    let error = Points::new(1_000_000, &knots).unwrap_err();
    assert_eq!(error, LimitError::NotFinite { part: Part::Point(3), joint: 0, value: f32::INFINITY });
    assert_eq!(Points::new(1_000_000, &[[0.0; 2]]).unwrap_err(), LimitError::TooFewPoints { points: 1 });
    assert_eq!(Points::new(1_000_000, &[[0.0; 2]; 257]).unwrap_err(), LimitError::TooManyPoints { points: 257 });
    assert_eq!(fault(&Trajectory::Paper(Paper { period_ns: u64::MAX })), LimitError::TooLong { duration_ns: u64::MAX });
    let mut huge = still;
    huge[0].cosine_rad[0] = f32::MAX;
    huge[1].cosine_rad[0] = f32::MAX;
    assert!(matches!(fault(&fourier(&huge, PERIOD_NS, 1, 0)), LimitError::Overflow { joint: 0, .. }));
}

#[test]
fn unusable_limits_are_named() {
    let fault = |limits: MotionLimits| check(&paper(), &limits, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap_err();
    let good = MotionLimits::reference_robot();
    let error = fault(MotionLimits { speed_rad_s: [1.0, f32::NAN], ..good });
    assert!(matches!(error, LimitError::UnusableLimit { quantity: Quantity::Speed, joint: 1, .. }), "{error}");
    let error = fault(MotionLimits { acceleration_rad_s2: [0.0, 1.0], ..good });
    assert!(matches!(error, LimitError::UnusableLimit { quantity: Quantity::Acceleration, joint: 0, .. }), "{error}");
    let error = fault(MotionLimits { position_high_rad: [-2.0, 1.0], ..good });
    assert!(matches!(error, LimitError::UnusableLimit { quantity: Quantity::PositionHigh, joint: 0, .. }), "{error}");
    let error = fault(MotionLimits { counts_per_tick: -1.0, ..good });
    assert!(matches!(error, LimitError::UnusableLimit { quantity: Quantity::CountsPerTick, .. }), "{error}");
    assert_eq!(
        check(&paper(), &good, [1.0, 0.0], RECORD_PERIOD_NS).unwrap_err(),
        LimitError::CountsPerRad { joint: 1, counts_per_rad: 0.0 }
    );
    assert_eq!(
        check(&paper(), &good, COUNTS_PER_RAD_F32, 0).unwrap_err(),
        LimitError::Zero { part: Part::RecordPeriod }
    );
}

#[test]
fn an_approach_refuses_an_end_outside_but_comes_in_from_outside() {
    let limits = MotionLimits::reference_robot();
    let approach = |from, to| Approach::new(from, to, &limits, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS);
    let error = approach([0.0; 2], [0.0, 2.5]).unwrap_err();
    let LimitError::Exceeded(margin) = error else { panic!("{error}") };
    assert_eq!((margin.quantity, margin.joint, margin.peak), (Quantity::PositionHigh, 1, 2.5));
    assert!(approach([0.0; 2], [-3.0, 0.0]).is_err());
    assert_eq!(approach([0.0, 2.5], [0.0; 2]).unwrap().reference::<f32>(0).position_rad, [0.0, 2.5]);
    assert_eq!(approach([0.1, 0.2], [0.1, 0.2]).unwrap().duration_ns(), 0);
    assert_eq!(approach([0.1, 0.2], [0.1, 0.2]).unwrap().reference::<f32>(0).position_rad, [0.1, 0.2]);
    assert!(matches!(
        approach([f32::NAN, 0.0], [0.0; 2]).unwrap_err(),
        LimitError::NotFinite { part: Part::Start, joint: 0, .. }
    ));
    let crawl = MotionLimits { speed_rad_s: [1e-6; 2], ..limits };
    let error = Approach::new([0.3, 0.0], [0.0; 2], &crawl, COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap_err();
    assert!(matches!(error, LimitError::TooLong { .. }), "{error}");
}

#[test]
fn malformed_movements_from_outside_are_safe_to_evaluate() {
    let evaluate = |trajectory: &Trajectory| {
        for time_ns in [0, 1, 1_000_000_000, u64::MAX] {
            let reference = trajectory.reference::<f32>(time_ns);
            assert_eq!(reference.velocity_rad_s, [0.0; 2], "{trajectory:?} at {time_ns}");
        }
        trajectory.start_rad()
    };
    assert_eq!(evaluate(&Trajectory::Paper(Paper { period_ns: 0 })), [0.0; 2]);
    let still = [Harmonic { cosine_rad: [0.1; 2], sine_rad: [0.1; 2] }; 2];
    assert_eq!(evaluate(&fourier(&still, 0, 3, 5)), [-0.7, 0.8]);
    assert_eq!(evaluate(&fourier(&still, PERIOD_NS, 0, 5)), [-0.7, 0.8]);
    // Splines with no, one, or two points, and with no time between them, as a broken sender could encode them:
    // variant, interval, count, coordinates.
    let spline = |interval: u8, count: u8| {
        let mut bytes = vec![2, interval, count];
        (0..2 * count).for_each(|_| bytes.extend(0.25_f32.to_le_bytes()));
        postcard::from_bytes::<Trajectory>(&bytes).unwrap()
    };
    assert_eq!(evaluate(&spline(7, 0)), [0.0; 2]);
    assert_eq!(evaluate(&spline(7, 1)), [0.25; 2]);
    assert_eq!(evaluate(&spline(0, 2)), [0.25; 2]);
    let refuse = |trajectory| margins(&trajectory, &generous(), COUNTS_PER_RAD_F32, RECORD_PERIOD_NS).unwrap_err();
    assert_eq!(refuse(spline(7, 0)), LimitError::TooFewPoints { points: 0 });
    assert_eq!(refuse(spline(0, 2)), LimitError::Zero { part: Part::Interval });
    // Whatever the fade and the period, evaluation does not panic.
    for (period_ns, repeats, fade_ns) in [(u64::MAX, u32::MAX, u64::MAX), (1, 1, u64::MAX), (u64::MAX, 1, 1)] {
        let trajectory = fourier(&still, period_ns, repeats, fade_ns);
        for time_ns in [0, 1, u64::MAX - 1, u64::MAX] {
            assert!(trajectory.reference::<f32>(time_ns).position_rad[0].is_finite());
        }
    }
}

#[test]
fn what_travels_is_small_and_verdicts_travel_too() {
    let knots: Vec<[f32; 2]> = (0..256).map(|i| [0.01 * i as f32, -0.01 * i as f32]).collect();
    let mut buffer = [0; 4096];
    // Variant, interval of 4 bytes, count of 2 bytes, 256 × 8 bytes: the slopes stay at home.
    assert_eq!(postcard::to_slice(&points(30_000_000, &knots), &mut buffer).unwrap().len(), 1 + 4 + 2 + 2048);
    let limits = MotionLimits::reference_robot();
    let bytes = postcard::to_slice(&limits, &mut buffer).unwrap();
    assert_eq!(postcard::from_bytes::<MotionLimits>(bytes).unwrap(), limits);
    let margins = margins_of(&paper());
    let bytes = postcard::to_slice(&margins, &mut buffer).unwrap();
    assert_eq!(postcard::from_bytes::<Margins>(bytes).unwrap(), margins);
    let error = check(&paper(), &MotionLimits { counts_per_tick: 10.0, ..limits }, COUNTS_PER_RAD_F32, 700_000);
    let bytes = postcard::to_slice(&error, &mut buffer).unwrap();
    assert_eq!(postcard::from_bytes::<Result<Margins, LimitError>>(bytes).unwrap(), error);
    assert!(error.is_err());
}

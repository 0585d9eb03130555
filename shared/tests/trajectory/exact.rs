//! Movements whose values are known.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use shared::trajectory::*;

use crate::common::{
    COUNTS_PER_RAD, COUNTS_PER_RAD_F32, PERIOD_NS, RECORD_PERIOD_NS, fourier, generous, margins_of, paper, points,
};

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

//! What is true of every movement.

use proptest::prelude::*;
use shared::trajectory::*;

use crate::common::{
    COUNTS_PER_RAD, COUNTS_PER_RAD_F32, PERIOD_NS, RECORD_PERIOD_NS, any_points, any_trajectory, apart_counts,
    assert_derivatives, generous, margins_of, points, scale,
};

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
        // A fade of a few dozen samples is bounded too, but not closely.
        let closely = match &trajectory {
            Trajectory::Fourier(fourier) => fourier.fade_ns == 0 || fourier.fade_ns > 200_000_000,
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

//! The check against limits, and movements that are refused.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use shared::trajectory::*;

use crate::common::{
    COUNTS_PER_RAD, COUNTS_PER_RAD_F32, PERIOD_NS, RECORD_PERIOD_NS, fourier, generous, margins_of, paper, points,
    scale, wavy,
};

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

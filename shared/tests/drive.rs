//! The drive: gear and encoder, truncation and its mean, current limit, offset.

mod robot;

use proptest::prelude::*;
use robot::{Random, drives};
use shared::drive::{centre_of_count, mean_count};

#[test]
fn counts_per_radian_are_those_of_the_paper_and_joint_3_turns_the_other_way() {
    let [joint2, joint3] = drives().map(|drive| drive.counts_per_rad());
    // design.md §3, printed to a tenth.
    assert!((joint2 - 13_725.5).abs() < 0.05, "{joint2}");
    assert!((joint3 + 8_546.6).abs() < 0.05, "{joint3}");
}

#[test]
fn encoder_truncates_toward_zero_on_both_sides() {
    for drive in drives() {
        let shown = |counts: f64| drive.encoder_counts(counts / drive.counts_per_rad());
        for (position, count) in
            [(0.0, 0.0), (0.999, 0.0), (-0.999, 0.0), (1.001, 1.0), (-1.001, -1.0), (41.9, 41.0), (-41.9, -41.0)]
        {
            assert_eq!(shown(position), count, "at {position}");
        }
    }
}

#[test]
fn positive_motion_of_joint_3_counts_down() {
    let [joint2, joint3] = drives();
    assert_eq!(joint2.encoder_counts(0.1), 1372.0);
    assert_eq!(joint3.encoder_counts(0.1), -854.0);
}

proptest! {
    #[test]
    fn position_lies_in_the_cell_of_its_count(counts in -1e6..1e6_f64) {
        let count = counts.trunc();
        let half_width = if count == 0.0 { 1.0 } else { 0.5 };
        prop_assert!((counts - centre_of_count(count)).abs() <= half_width);
        if count != 0.0 {
            // The centre is no guess at an edge: both edges of the cell are equally far.
            prop_assert_eq!(centre_of_count(count), count + 0.5_f64.copysign(count));
        }
    }

    #[test]
    fn mean_count_and_centre_of_count_undo_each_other_away_from_zero(counts in 1..1_000_000_i32, negative: bool) {
        let count = f64::from(if negative { -counts } else { counts });
        prop_assert_eq!(mean_count(centre_of_count(count)), count);
    }
}

#[test]
fn mean_count_is_the_average_of_truncated_positions_under_a_dither_of_one_count() {
    // A dither of one count's width: what fix() shows on average while an arm passes. It holds at zero as well.
    let positions = 20_000;
    for middle in [-37.3, -3.0, -1.2, -0.8, -0.3, 0.0, 0.2, 0.5, 0.9, 1.0, 1.7, 12.25, 900.6] {
        let sum: f64 =
            (0..positions).map(|k| (middle + (f64::from(k) + 0.5) / f64::from(positions) - 0.5).trunc()).sum();
        let average = sum / f64::from(positions);
        assert!((average - mean_count(middle)).abs() < 1e-3, "{average} at {middle}");
    }
}

#[test]
fn centre_of_count_is_unbiased_on_both_sides_and_across_zero() {
    let mut random = Random::new(1);
    for (low, high) in [(3.0, 40.0), (-40.0, -3.0), (-1.0, 1.0), (-9.0, 9.0)] {
        let samples = 100_000;
        let bias: f64 = (0..samples)
            .map(|_| {
                let position = random.between(low, high);
                centre_of_count(position.trunc()) - position
            })
            .sum::<f64>()
            / f64::from(samples);
        // The error is uniform over at most two counts: 1/√3 rms, its mean over 1e5 samples 0.0018; five times that.
        assert!(bias.abs() < 0.0092, "bias {bias} over {low}..{high}");
    }
}

#[test]
fn amplifier_limits_the_current_on_both_sides_and_passes_what_is_below() {
    for drive in drives() {
        // 12 A at 0.25 N m/A.
        assert_eq!(drive.motor_torque_nm(40.0), 3.0);
        assert_eq!(drive.motor_torque_nm(-40.0), -3.0);
        assert_eq!(drive.motor_torque_nm(12.0), 3.0);
        assert_eq!(drive.motor_torque_nm(-7.0), -1.75);
    }
}

#[test]
fn current_that_is_no_number_does_not_become_a_full_one() {
    for drive in drives() {
        assert!(drive.motor_torque_nm(f64::NAN).is_nan());
    }
}

#[test]
fn offset_is_a_torque_the_motor_has_to_overcome() {
    let mut drive = drives()[0];
    drive.torque_offset_nm = 0.2;
    // Balanced by 0.8 A; beyond the amplifier's limit it still acts.
    assert!(drive.motor_torque_nm(0.8).abs() < 1e-15);
    assert_eq!(drive.motor_torque_nm(0.0), -0.2);
    assert!((drive.motor_torque_nm(100.0) - 2.8).abs() < 1e-15);
}

#[test]
fn single_precision_counts_as_double_precision_does_but_at_a_cell_s_edge() {
    let double = robot::plant();
    let single = robot::single_precision(&double);
    let mut random = Random::new(2);
    for joint in 0..2 {
        for _ in 0..2000 {
            let position = random.between(-1.6, 1.6);
            let exact = position * double.drives[joint].counts_per_rad();
            let shown = f64::from(single.drives[joint].encoder_counts(position as f32));
            // 22 000 counts with four roundings of 6e-8 each: 0.006 count.
            let near_edge = (exact - exact.round()).abs() < 0.006;
            assert!(shown == exact.trunc() || near_edge, "{shown} for {exact}");
        }
    }
}

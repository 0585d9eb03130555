//! What messages carry: packed rows, CRCs, limits, configurations, texts.

use crate::samples::{any_sample, compensation, configuration, model};
use proptest::prelude::*;
use shared::protocol::*;

proptest! {
    #[test]
    fn packed_rows_come_back_whole(
        first in [-1_000_000_000..1_000_000_000, -1_000_000_000..1_000_000_000],
        steps in proptest::collection::vec(([-32_000..32_000, -32_000..32_000], any_sample()), 1..40),
        movement in any::<u32>(), from in 0_u32..1_000_000,
    ) {
        let mut reference = first;
        let samples: Vec<Sample> = (from..).zip(&steps).map(|(index, (step, sample))| {
            reference = [reference[0] + step[0], reference[1] + step[1]];
            Sample { index, reference_counts: reference, ..*sample }
        }).collect();
        for chunk in samples.chunks(ROWS_PER_FRAME) {
            let rows = RecordingRows {
                movement,
                from: chunk[0].index,
                first_reference_counts: chunk[0].reference_counts,
                rows: chunk.iter().map(PackedSample::pack).collect(),
            };
            prop_assert_eq!(rows.samples().collect::<Vec<_>>(), chunk);
        }
    }

    /// Every constant is part of the CRC: a configuration that differs in one number is another.
    #[test]
    fn the_model_crc_covers_every_number(place in 0_usize..13, change in 1.0e-12_f64..1.0) {
        let original = model();
        let mut changed = original;
        match place {
            0..=8 => changed.f[place] += change,
            9..=10 => changed.viscous_friction_nm_s_per_rad[place - 9] += change,
            _ => changed.coulomb_friction_nm[place - 11] += change,
        }
        prop_assert_ne!(changed.crc(), original.crc());
    }
}

/// Numbers of effects too, down to their last bits; and they come back as they were sent.
#[test]
fn the_model_crc_covers_every_number_of_its_effects() {
    let numbers = JointCompensation::NAMES.len();
    for joint in 0..2 {
        for number in 0..numbers {
            let mut original = model();
            original.compensation[joint] = compensation();
            let mut buffer = [0; 256];
            let bytes = postcard::to_slice(&original.compensation[joint], &mut buffer).unwrap();
            assert_eq!(bytes.len(), 1 + 4 * numbers);
            bytes[1 + 4 * number] ^= 1;
            let mut changed = original;
            changed.compensation[joint] = postcard::from_bytes(bytes).unwrap();
            assert_ne!(changed, original);
            assert_ne!(changed.crc(), original.crc(), "{}", JointCompensation::NAMES[number]);
        }
    }
}

#[test]
fn limits_are_a_set_with_names() {
    let mut limits = LimitsActive::NONE;
    assert!(limits.is_empty());
    limits.insert(ActiveLimit::current(Joint::Third));
    limits.insert(ActiveLimit::converter(Joint::Second));
    assert!(limits.contains(ActiveLimit::CurrentLimitThird) && !limits.contains(ActiveLimit::CurrentLimitSecond));
    let names: Vec<_> = limits.iter().map(ActiveLimit::name).collect();
    assert_eq!(names, ["current_limit_a of joint 3", "converter range (dac_a_per_code) of joint 2"]);
}

#[test]
fn the_robots_identity_is_what_gives_f_its_meaning() {
    let robot = configuration();
    let changed = |change: fn(&mut Configuration)| {
        let mut other = robot;
        change(&mut other);
        assert_ne!(other.crc(), robot.crc());
        other.robot_identity()
    };
    let identity = robot.robot_identity();
    assert_ne!(changed(|robot| robot.joints[0].gear_ratio = 107.9), identity);
    assert_ne!(changed(|robot| robot.joints[1].counts_per_rev = 800.0), identity);
    assert_ne!(changed(|robot| robot.joints[1].torque_constant_nm_per_a = 0.26), identity);
    assert_ne!(changed(|robot| robot.common.gravity_m_s2 = 0.0), identity);
    // Gains and limits may change without making a model worthless.
    assert_eq!(changed(|robot| robot.joints[0].position_gain_a_per_count = 0.02), identity);
    assert_eq!(changed(|robot| robot.common.link_timeout_ns += 1_000_000), identity);
    assert_eq!(changed(|robot| robot.motion_limits.counts_per_tick += 1.0), identity);
    assert_eq!(changed(|robot| robot.model_range.high[8] += 1.0), identity);
}

/// Every way a configuration can be wrong: the error names field, joint, value, limit and remedy.
#[test]
fn a_bad_configuration_is_refused_by_name() {
    assert_eq!(configuration().check(), Ok(()));
    let refused = |change: fn(&mut Configuration), words: &[&str]| {
        let mut robot = configuration();
        change(&mut robot);
        let message = robot.check().expect_err(words[0]).to_string();
        for word in words {
            assert!(message.contains(word), "{message:?} lacks {word:?}");
        }
    };
    refused(|robot| robot.joints[1].gear_ratio = 0.0, &["joint 3", "gear_ratio", " 0,", "must not be 0", "correct"]);
    refused(|robot| robot.joints[0].gear_ratio = f64::NAN, &["joint 2", "gear_ratio", "NaN", "not a finite"]);
    refused(|robot| robot.joints[0].coulomb_friction_nm = -0.1, &["coulomb_friction_nm", "-0.1", "at least 0"]);
    refused(|robot| robot.joints[0].counts_per_rev = -800.0, &["counts_per_rev", "-800", "at least"]);
    refused(|robot| robot.joints[1].over_current_limit_a = 11.0, &["over_current_limit_a", "11", "at least 12"]);
    refused(|robot| robot.joints[1].following_error_limit_counts = 4e4, &["40000", "at most 32767", "lower"]);
    refused(|robot| robot.joints[1].current_scale.dac_a_per_code = 0.0, &["dac_a_per_code", "must not be 0"]);
    refused(|robot| robot.common.loop_period_ns = 0, &["loop_period_ns is 0", "700000"]);
    refused(|robot| robot.common.loop_period_ns = 200_000, &["loop_period_ns is 200000", "350000"]);
    refused(|robot| robot.common.record_period_ns = 0, &["record_period_ns", "at least"]);
    refused(|robot| robot.common.record_period_ns = 1_000_000, &["record_period_ns is 1000000", "700000", "multiple"]);
    refused(|robot| robot.common.command_delay_ns = 700_001, &["command_delay_ns", "700001", "at most 700000"]);
    refused(|robot| robot.common.link_timeout_ns = 0, &["link_timeout_ns", "at least 1000000"]);
    refused(|robot| robot.common.computed_torque.friction_switch_motor_rad_s = 2.0, &["friction_switch", "at most 1"]);
    refused(|robot| robot.motion_limits.speed_rad_s[1] = -1.0, &["speed", "joint 3", "-1"]);
    refused(|robot| robot.motion_limits.counts_per_tick = 40_000.0, &["counts_per_tick", "32000"]);
    refused(|robot| robot.model_range.low[4] = f64::NAN, &["f5", "NaN"]);
    // Design §4: Bv 2π / (N Td) is 0.0169 N m/count at Td = 0.38 ms, and 0.25 N m/A makes that 0.0675 A/count.
    refused(
        |robot| robot.joints[0].position_gain_a_per_count = 0.08,
        &["joint 2", "0.08000", "stability limit 0.067", "viscous friction", "lower the gain"],
    );
    refused(
        |robot| {
            robot.joints[0].lead = 2.0;
            robot.joints[0].least_motor_inertia_kg_m2 = 1.0e-7;
        },
        &["joint 2", "stability limit", "lead's gain"],
    );
}

/// Texts are for people: no fault or refusal without its name, its numbers and what to do.
#[test]
fn faults_and_refusals_say_what_to_do() {
    let fault = Fault::FollowingError { joint: Joint::Third, error_counts: -3100, limit_counts: 3000 };
    let text = fault.to_string();
    for word in ["following-error", "joint 3", "-3100", "3000", fault.remedy()] {
        assert!(text.contains(word), "{text}");
    }
    let refusal = Refusal::WrongMode { mode: Mode::Running(ControlLaw::Position) };
    assert_eq!(refusal.to_string(), "not possible while running-p; wait for the end of the movement, or stop it");
}

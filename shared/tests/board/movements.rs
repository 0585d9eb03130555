//! What a movement does to the arm, and what is recorded of it.

use crate::rig::{PAPER_PERIOD_NS, Rig, configuration, exact_model, paper_counts};
use shared::board::MID_SCALE;
use shared::protocol::*;

/// Largest absolute error of each joint.
fn largest_errors(samples: &[Sample]) -> [u16; 2] {
    [0, 1].map(|joint: usize| samples.iter().map(|sample| sample.error_counts[joint].unsigned_abs()).max().unwrap())
}

/// Share of rows whose exact motor position is within a count of the exact reference, per joint, and the largest gap.
fn tracking(rig: &Rig) -> [(f64, f64); 2] {
    let record_ns = u64::from(rig.configuration.common.record_period_ns);
    [0, 1].map(|joint: usize| {
        let gaps: Vec<f64> = (0..)
            .zip(&rig.true_positions)
            .map(|(row, position)| (paper_counts(&rig.configuration, row * record_ns)[joint] - position[joint]).abs())
            .collect();
        let inside = gaps.iter().filter(|&&gap| gap <= 1.0).count();
        (inside as f64 / gaps.len() as f64, gaps.iter().copied().fold(0.0, f64::max))
    })
}

/// design §4: gains half the limit, errors about ±105..170 and ±75..100 counts (here −125..98 and −104..91; the ringing
/// from the start adds a few).
#[test]
fn the_position_loop_errs_as_much_as_it_should() {
    let mut rig = Rig::armed(configuration());
    rig.tick();
    rig.movement(ControlLaw::Position);
    let samples = rig.recording();
    assert_eq!(samples.len(), 5214);
    let [second, third] = largest_errors(&samples);
    assert!((105..=170).contains(&second), "joint 2: {second}");
    assert!((75..=105).contains(&third), "joint 3: {third}");
    let info = rig.recording_info();
    assert_eq!((info.rows, info.planned_rows, info.ended), (5214, 5214, Some(EndedBy::Completed)));
    assert!(info.limits_active.is_empty());
    assert_eq!((info.configuration_crc, info.model_crc), (rig.configuration.crc(), None));
    let path = [Mode::Armed, Mode::Approaching(ControlLaw::Position), Mode::Running(ControlLaw::Position)];
    assert_eq!(rig.events, [&path[..], &[Mode::Holding(ControlLaw::Position)]].concat());
}

/// What a second link sees of a movement: at every row the errors of that row, and none with the amplifiers off.
#[test]
fn the_status_tells_the_errors_of_the_last_tick() {
    let mut rig = Rig::loaded(configuration());
    assert_eq!(rig.status().error_counts, [0, 0]);
    let mut rig = Rig::running(configuration());
    let mut compared = 0;
    for _ in 0..1000 {
        if let Some(telemetry) = rig.tick().telemetry {
            assert_eq!(rig.status().error_counts, telemetry.sample.error_counts.map(i32::from));
            compared += i32::from(telemetry.sample.error_counts != [0, 0]);
        }
    }
    assert!(compared > 500, "{compared} rows with an error");
    rig.ok(Request::Disarm);
    assert_eq!(rig.status().error_counts, [0, 0]);
}

/// The promise of the method: an exact model holds the arm within ±1 count.
#[test]
fn computed_torque_with_the_exact_model_stays_within_a_count() {
    let mut rig = Rig::armed(configuration());
    rig.upload(exact_model());
    rig.movement(ControlLaw::ComputedTorque);
    for (joint, (inside, largest)) in ["2", "3"].into_iter().zip(tracking(&rig)) {
        assert!(inside >= 0.99, "joint {joint}: {:.2} % within a count, largest {largest:.2}", 100.0 * inside);
        // Half a count is what the encoder hides; the rest is friction where the motion turns.
        assert!((0.3..1.0).contains(&largest), "joint {joint}: {largest:.2}");
    }
    assert_eq!(rig.recording_info().model_crc, Some(exact_model().crc()));
    // The same arm under a model 20 % off does not, so the test can tell.
    let mut wrong = exact_model();
    wrong.f = wrong.f.map(|value| value * 1.2);
    rig.ok(Request::Stop);
    rig.upload(wrong);
    rig.movement(ControlLaw::ComputedTorque);
    let [(second, _), (third, _)] = tracking(&rig);
    assert!(second < 0.99 && third < 0.99, "{second} {third}");
}

#[test]
fn what_is_streamed_is_what_is_recorded_and_can_be_read_again() {
    let mut rig = Rig::armed(configuration());
    rig.movement(ControlLaw::Position);
    let recorded = rig.recording();
    let streamed: Vec<Sample> = rig.streamed.iter().map(|telemetry| telemetry.sample).collect();
    assert_eq!(recorded, streamed);
    assert!(rig.streamed.iter().all(|telemetry| telemetry.link == Link::Usb && telemetry.movement == 1));
    assert_eq!(rig.recording(), recorded, "read a second time");
    // Any row alone, in any order, with its full reference.
    for from in (0..5214).rev().step_by(7) {
        let Reply::Rows(rows) = rig.ok(Request::ReadRecording { from, count: 1 }) else { panic!() };
        assert_eq!(rows.samples().collect::<Vec<_>>(), [recorded[from as usize]]);
        assert_eq!(rows.first_reference_counts, recorded[from as usize].reference_counts);
    }
    for from in [5214, 10_499, 10_500, u32::MAX] {
        let Reply::Rows(rows) = rig.ok(Request::ReadRecording { from, count: 5 }) else { panic!() };
        assert!(rows.rows.is_empty(), "nothing is recorded at {from}");
    }
    // It survives disarming, and ends with the next movement.
    rig.ok(Request::Disarm);
    assert_eq!(rig.recording(), recorded);
    rig.ok(Request::Arm);
    rig.run(ControlLaw::Position);
    assert_eq!(rig.recording_info().rows, 0);
    assert_eq!(rig.recording_info().movement, 2);
}

/// design §8: the row's command follows from its error; its current is the command of the tick before.
#[test]
fn a_row_holds_reference_error_current_and_command_of_one_instant() {
    let mut rig = Rig::armed(configuration());
    rig.movement(ControlLaw::Position);
    let samples = rig.recording();
    let gains = rig.configuration.joints.map(|joint| joint.position_gain_a_per_count);
    for (row, sample) in samples.iter().enumerate() {
        let exact = paper_counts(&rig.configuration, row as u64 * 700_000);
        for joint in 0..2 {
            let scale = rig.configuration.joints[joint].current_scale;
            // The board evaluates the reference in f32, good to 0.003 count.
            let reference = f64::from(sample.reference_counts[joint]);
            assert!((exact[joint] - reference).abs() < 1.01 && reference.abs() < exact[joint].abs() + 0.01);
            let command = scale.command_a(sample.command_code[joint]);
            let asked = gains[joint] * f64::from(sample.error_counts[joint]);
            assert!((command - asked).abs() <= 0.501 * scale.dac_a_per_code, "row {row}: {command} for {asked}");
            let actual = rig.true_positions[row][joint].trunc() as i32;
            assert_eq!(sample.reference_counts[joint] - i32::from(sample.error_counts[joint]), actual);
            if let Some(before) = row.checked_sub(1) {
                assert_eq!(sample.current_code[joint], samples[before].command_code[joint]);
            }
        }
    }
}

/// The paper's own gains, stable at 50 µs: errors of ±10 counts, and a row still every 0.7 ms.
#[test]
fn a_fast_loop_records_at_the_same_rows() {
    let mut fast = configuration();
    fast.common.loop_period_ns = 50_000;
    fast.joints[0].position_gain_a_per_count = 0.096 / 0.25;
    fast.joints[1].position_gain_a_per_count = 0.094 / 0.25;
    let mut rig = Rig::armed(fast);
    assert_eq!(rig.board.loop_period_ns(), 50_000);
    rig.keep_alive_every = 1000;
    rig.run(ControlLaw::Position);
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    let mut ticks_between = Vec::new();
    let mut since = 0;
    while rig.board.mode() != Mode::Holding(ControlLaw::Position) {
        since += 1;
        if rig.tick().telemetry.is_some() {
            ticks_between.push(since);
            since = 0;
        }
    }
    assert_eq!(ticks_between.len(), 5214);
    assert_eq!(ticks_between[0], 1);
    assert!(ticks_between[1..].iter().all(|&ticks| ticks == 14));
    let samples = rig.recording();
    let slow_references: Vec<_> = {
        let mut rig = Rig::armed(configuration());
        rig.movement(ControlLaw::Position);
        rig.recording().iter().map(|sample| sample.reference_counts).collect()
    };
    assert_eq!(samples.iter().map(|sample| sample.reference_counts).collect::<Vec<_>>(), slow_references);
    let [second, third] = largest_errors(&samples);
    assert!((8..=18).contains(&second) && (6..=18).contains(&third), "{second} {third}");
}

#[test]
fn every_offered_loop_period_runs() {
    for loop_period_ns in LOOP_PERIODS_NS {
        let mut configuration = configuration();
        configuration.common.loop_period_ns = loop_period_ns;
        let mut rig = Rig::armed(configuration);
        rig.load_paper(2_500_000_000);
        rig.movement(ControlLaw::Position);
        assert_eq!(rig.recording().len(), 3571, "{loop_period_ns}");
    }
}

/// The counters are 32 bits wide and may start anywhere: a movement across their ends is the same movement.
#[test]
fn counters_may_wrap() {
    let recorded = |offset: [i32; 2]| {
        let mut rig = Rig::bare(configuration());
        rig.counter_offset = offset;
        rig.configure();
        rig.tick();
        let position_rad = rig.state.position_rad;
        rig.ok(Request::SetPosition { position_rad });
        rig.load_paper(PAPER_PERIOD_NS);
        rig.ok(Request::Arm);
        rig.movement(ControlLaw::Position);
        rig.recording()
    };
    let plain = recorded([0, 0]);
    // Both joints count down by some 20 000 and 13 000: from just above the least number.
    assert_eq!(recorded([i32::MIN + 10_000, i32::MIN + 8_000]), plain);
    assert_eq!(recorded([i32::MAX, i32::MAX]), plain);
}

/// Standing, armed, under gravity: the arm sags until the loop carries it, and stays.
#[test]
fn arming_holds_the_pose() {
    let mut rig = Rig::loaded(configuration());
    let before = rig.state.position_rad;
    let first = {
        rig.ok(Request::Arm);
        rig.tick()
    };
    assert!(first.amplifier_enable);
    assert_eq!(first.command_code, [MID_SCALE; 2], "no error yet, so no current");
    rig.seconds(2.0);
    for (joint, constants) in rig.configuration.joints.iter().enumerate() {
        let sagged = (rig.state.position_rad[joint] - before[joint]).abs() * constants.counts_per_rad().abs();
        assert!(sagged < 60.0, "joint {joint} sagged {sagged:.0} counts");
        assert!(rig.state.velocity_rad_s[joint].abs() < 1.0e-3);
    }
    assert_eq!(rig.board.mode(), Mode::Armed);
}

/// A stop keeps to the path, slows down, holds where it ends, and what was recorded stays.
#[test]
fn a_stop_slows_down_along_the_path() {
    let mut rig = Rig::running(configuration());
    let rows = rig.recording_info().rows;
    assert!((1400..1450).contains(&rows), "{rows}");
    rig.ok(Request::Stop);
    assert_eq!(rig.board.mode(), Mode::Stopping(ControlLaw::Position));
    let from = rig.state.position_rad;
    let mut ticks = 0;
    let mut last_speed = f64::INFINITY;
    while rig.board.mode() != Mode::Armed {
        rig.tick();
        ticks += 1;
        last_speed = rig.state.velocity_rad_s[0].abs();
    }
    assert_eq!(ticks, 286, "the first tick 200 ms after the stop");
    assert!(last_speed < 0.2, "{last_speed}");
    // Half of 200 ms at 1.3 rad/s.
    let travel = (rig.state.position_rad[0] - from[0]).abs();
    assert!((0.10..0.16).contains(&travel), "{travel}");
    let info = rig.recording_info();
    assert_eq!((info.rows, info.ended), (rows, Some(EndedBy::Stopped)));
    rig.seconds(2.0);
    assert_eq!(rig.board.mode(), Mode::Armed);
    assert!(rig.state.velocity_rad_s.iter().all(|speed| speed.abs() < 1.0e-3));
}

/// Braking is part of the reference: computed torque stays with it, within 3 counts as it does on the movement.
#[test]
fn a_stop_under_computed_torque_stays_on_the_path() {
    let mut configuration = configuration();
    // Without gravity the arm does not sag when armed, so that so strict a limit lets it get going.
    configuration.common.gravity_m_s2 = 0.0;
    configuration.joints.iter_mut().for_each(|joint| joint.following_error_limit_counts = 3.0);
    let mut rig = Rig::armed(configuration);
    rig.upload(Model { robot_identity: configuration.robot_identity(), ..exact_model() });
    rig.run(ControlLaw::ComputedTorque);
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    rig.seconds(0.9);
    rig.ok(Request::Stop);
    rig.until(|mode| !matches!(mode, Mode::Stopping(_)));
    assert_eq!(rig.board.mode(), Mode::Armed);
}

/// From computed torque to the position loop the current must not jump, or the arm falls a few counts: not on a stop,
/// not at the start of the next movement, and not because a lead takes the new reference for a speed.
#[test]
fn the_position_loop_takes_over_without_a_jerk() {
    let run = Request::Run { law: ControlLaw::Position, stream: true, settle_ns: 0 };
    for (lead, takeover) in [(0.0, Request::Stop), (1.0, Request::Stop), (1.0, run)] {
        let mut configuration = configuration();
        configuration.joints.iter_mut().for_each(|joint| joint.lead = lead);
        let mut rig = Rig::armed(configuration);
        rig.upload(exact_model());
        rig.movement(ControlLaw::ComputedTorque);
        rig.seconds(0.5);
        let before = rig.tick().command_code;
        rig.ok(takeover);
        assert_eq!(rig.board.mode().law(), Some(ControlLaw::Position));
        let after = rig.tick().command_code;
        for (joint, constants) in rig.configuration.joints.iter().enumerate() {
            let scale = constants.current_scale.dac_a_per_code;
            let change_a = (f64::from(after[joint]) - f64::from(before[joint])).abs() * scale;
            // The error is a whole number of counts, and the arm may move by one meanwhile.
            let allowed_a = (2.0 + lead) * constants.position_gain_a_per_count;
            assert!(change_a <= allowed_a, "joint {joint}, lead {lead}: {change_a:.3} A");
        }
        // And the current was not zero: the upper arm is horizontal at the end, with all its weight.
        assert!(before[0].abs_diff(MID_SCALE) > 100, "{before:?}");
    }
}

#[test]
fn a_second_movement_starts_where_the_first_ended() {
    let mut rig = Rig::armed(configuration());
    rig.upload(exact_model());
    rig.movement(ControlLaw::Position);
    let first = rig.recording();
    // The trajectory ends where it starts: nothing to approach, only to settle.
    let Reply::Started { movement, approach_ns, rows } = rig.run(ControlLaw::Position) else { panic!() };
    assert_eq!((movement, rows), (2, 5214));
    assert!(approach_ns < 1_100_000_000, "{approach_ns}");
    rig.until(|mode| mode == Mode::Holding(ControlLaw::Position));
    let second = rig.recording();
    assert_eq!(first.len(), second.len());
    rig.movement(ControlLaw::ComputedTorque);
    rig.movement(ControlLaw::Position);
    assert_eq!(rig.recording_info().movement, 4);
}

/// The gain is limited by the amplifier, and says so.
#[test]
fn a_limited_current_is_reported_by_name() {
    let mut weak = configuration();
    weak.joints[0].current_limit_a = 4.2;
    weak.common.current_limit_time_ns = 60_000_000_000;
    let mut rig = Rig::armed(weak);
    rig.movement(ControlLaw::Position);
    let info = rig.recording_info();
    let names: Vec<_> = info.limits_active.iter().map(ActiveLimit::name).collect();
    assert_eq!(names, ["current_limit_a of joint 2"]);
    assert_eq!(rig.status().limits_active, info.limits_active);
    // The cut command is what is recorded.
    let scale = rig.configuration.joints[0].current_scale;
    let largest = rig.recording().iter().map(|row| scale.command_a(row.command_code[0]).abs()).fold(0.0, f64::max);
    assert!((largest - 4.2).abs() <= scale.dac_a_per_code, "{largest}");
}

/// Phases of ripple and cogging count from where the encoders were switched on. So they hold for the pose that was known
/// when the model was uploaded, and no longer.
#[test]
fn ripple_and_cogging_are_compensated_until_a_pose_is_declared_anew() {
    let mut rig = Rig::loaded(configuration());
    // The arm has no cogging, so that its compensation disturbs, by as much as cogging does.
    let cogging = JointCompensation { cogging_nm: 0.15, cogging_order: 4.0, ..JointCompensation::NONE };
    let model = Model { compensation: [cogging, JointCompensation::NONE], ..exact_model() };
    let rms_counts = |rig: &mut Rig| {
        rig.ok(Request::Arm);
        rig.movement(ControlLaw::ComputedTorque);
        let rows = rig.recording();
        rig.ok(Request::Disarm);
        let squares: f64 = rows.iter().map(|row| f64::from(row.error_counts[0]).powi(2)).sum();
        (squares / rows.len() as f64).sqrt()
    };
    rig.upload(exact_model());
    let plain = rms_counts(&mut rig);
    rig.upload(model);
    let disturbed = rms_counts(&mut rig);
    assert!(disturbed > 2.0 * plain, "{disturbed} {plain}");

    let position_rad = rig.state.position_rad;
    rig.ok(Request::SetPosition { position_rad });
    let forgotten = rms_counts(&mut rig);
    assert!(forgotten < 1.2 * plain, "{forgotten} {plain}");
    assert_eq!(rig.board.active_model(), Some(&model), "the model is what it was");
    rig.upload(model);
    assert!(rms_counts(&mut rig) > 0.8 * disturbed);
}

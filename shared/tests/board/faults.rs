//! Everything that switches the arm off: by its name, in the tick that sees it.

use crate::rig::{Rig, configuration, exact_model};
use proptest::prelude::*;
use shared::board::{Board, Inputs, MID_SCALE, Outputs};
use shared::protocol::*;

/// The arm is running; after `upset` the very next tick must end in the fault, switched off, with the rows so far kept.
fn faults_at_once(mut rig: Rig, upset: fn(&mut Inputs)) -> Fault {
    rig.tick();
    let rows = rig.recording_info().rows;
    assert!(rows > 0);
    rig.tamper = Some(upset);
    let outputs = rig.tick();
    fault_of(&mut rig, &outputs, rows)
}

fn fault_of(rig: &mut Rig, outputs: &Outputs, rows: u32) -> Fault {
    let Mode::Fault(fault) = rig.board.mode() else { panic!("{:?}", rig.board.mode()) };
    assert_eq!((outputs.command_code, outputs.amplifier_enable), ([MID_SCALE; 2], false));
    assert!(matches!(outputs.event, Some(Event::Mode { mode: Mode::Fault(told), .. }) if told == fault));
    assert!(outputs.telemetry.is_none());
    let info = rig.recording_info();
    assert_eq!((info.rows, info.ended), (rows, Some(EndedBy::Fault(fault))));
    assert_eq!(rig.recording().len() as u32, rows);
    // It stays so until cleared, and then does not move by itself.
    rig.seconds(0.1);
    assert_eq!(rig.board.mode(), Mode::Fault(fault));
    assert!(matches!(rig.refused(Request::Arm), Refusal::WrongMode { mode: Mode::Fault(_) }));
    rig.ok(Request::Disarm);
    assert_eq!(rig.board.mode(), Mode::Fault(fault), "disarming does not forget a fault");
    rig.ok(Request::ClearFault);
    assert_eq!(rig.board.mode(), Mode::Idle);
    rig.seconds(0.1);
    assert_eq!(rig.board.mode(), Mode::Idle);
    let Reply::Info(info) = rig.ok(Request::Hello { protocol_version: PROTOCOL_VERSION }) else { panic!() };
    assert_eq!(info.last_fault, Some(fault));
    fault
}

fn running() -> Rig {
    Rig::running(configuration())
}

#[test]
fn emergency_stop() {
    assert_eq!(faults_at_once(running(), |inputs| inputs.emergency_stop = true).name(), "emergency-stop");
}

#[test]
fn deadline_missed() {
    assert_eq!(faults_at_once(running(), |inputs| inputs.deadline_missed = true).name(), "deadline-missed");
}

#[test]
fn over_current() {
    // 14 A is code 2048 ± 1792.
    let fault = faults_at_once(running(), |inputs| inputs.current_code[1] = 2048 - 1793);
    let Fault::OverCurrent { joint: Joint::Third, current_a, limit_a: 14.0 } = fault else { panic!("{fault}") };
    assert!((current_a + 14.0).abs() < 0.02);
    let mut rig = running();
    rig.tamper = Some(|inputs| inputs.current_code = [2048 + 1792, 2048 - 1792]);
    rig.tick();
    assert!(matches!(rig.board.mode(), Mode::Running(_)), "the limit itself is allowed");
}

#[test]
fn encoder_jump() {
    let mut rig = running();
    // 6 rad/s are 58 counts in 0.7 ms; four times that and two counts more is no movement.
    rig.tamper = Some(|inputs| inputs.counts[0] = inputs.counts[0].wrapping_add(400));
    rig.tick();
    let Mode::Fault(Fault::EncoderJump { joint: Joint::Second, jump_counts, limit_counts }) = rig.board.mode() else {
        panic!("{:?}", rig.board.mode())
    };
    assert!((380..420).contains(&jump_counts));
    assert_eq!(limit_counts, 233);
    // Nobody knows where the arm is now.
    rig.ok(Request::ClearFault);
    assert!(!rig.status().pose_known);
    assert_eq!(rig.refused(Request::Arm), Refusal::PoseUnknown);
    let position_rad = rig.state.position_rad;
    rig.ok(Request::SetPosition { position_rad });
    rig.ok(Request::Arm);
}

#[test]
fn an_encoder_that_jumps_while_idle_loses_the_pose_but_is_no_fault() {
    let mut rig = Rig::loaded(configuration());
    rig.tamper = Some(|inputs| inputs.counts[1] = inputs.counts[1].wrapping_sub(100_000));
    rig.tick();
    assert_eq!(rig.board.mode(), Mode::Idle);
    assert!(!rig.status().pose_known);
}

#[test]
fn over_speed() {
    // At rest, then faster than 6 rad/s and slower than a jump: a step of 70 counts at joint 2, where 59.7 are allowed.
    let mut rig = Rig::armed(configuration());
    rig.seconds(1.0);
    rig.tamper = Some(|inputs| inputs.counts[0] += 70);
    let outputs = rig.tick();
    let Mode::Fault(Fault::OverSpeed { joint: Joint::Second, speed_rad_s, limit_rad_s: 6.0 }) = rig.board.mode() else {
        panic!("{:?}", rig.board.mode())
    };
    assert!((7.0..7.5).contains(&speed_rad_s), "{speed_rad_s}");
    assert!(!outputs.amplifier_enable);
}

#[test]
fn following_error() {
    let mut strict = configuration();
    strict.joints[1].following_error_limit_counts = 60.0;
    let mut rig = Rig::armed(strict);
    rig.run(ControlLaw::Position);
    let mut rows = 0;
    let outputs = rig.until_off(|_, outputs| rows += u32::from(outputs.telemetry.is_some()));
    let fault = fault_of(&mut rig, &outputs, rows);
    let Fault::FollowingError { joint: Joint::Third, error_counts, limit_counts: 60 } = fault else {
        panic!("{fault}")
    };
    assert_eq!(error_counts.abs(), 61, "found as soon as it is true");
}

#[test]
fn current_limit_held_too_long() {
    let mut weak = configuration();
    weak.joints[0].current_limit_a = 0.5;
    weak.common.current_limit_time_ns = 10_000_000;
    let mut rig = Rig::loaded(weak);
    rig.ok(Request::Arm);
    // Half an ampere does not carry the arm: it sinks, and the command stays at its limit.
    let mut ticks_at_limit = 0;
    let code = |outputs: &Outputs| outputs.command_code[0].abs_diff(MID_SCALE);
    let outputs = rig.until_off(|_, outputs| ticks_at_limit = if code(outputs) == 64 { ticks_at_limit + 1 } else { 0 });
    let Mode::Fault(Fault::CurrentLimit { joint: Joint::Second, limit_a: 0.5, held_ns }) = rig.board.mode() else {
        panic!("{:?}", rig.board.mode())
    };
    assert_eq!(outputs.command_code, [MID_SCALE; 2]);
    assert_eq!(held_ns, 10_500_000, "the first tick after 10 ms");
    assert!((14..=15).contains(&ticks_at_limit), "{ticks_at_limit}");
    assert!(rig.status().limits_active.contains(ActiveLimit::CurrentLimitSecond));
}

/// Only a command that stays at its limit is a fault; one that is there every other tick is not.
#[test]
fn a_current_limit_touched_again_and_again_is_no_fault() {
    let mut weak = configuration();
    weak.common.gravity_m_s2 = 0.0;
    weak.joints[0].current_limit_a = 0.4;
    weak.common.current_limit_time_ns = 10_000_000;
    let mut rig = Rig::loaded(weak);
    rig.ok(Request::Arm);
    let mut at_limit = 0;
    for tick in 0..200 {
        // 20 counts ask for 0.72 A; friction alone holds the arm against 0.4 A.
        rig.tamper = (tick % 2 == 1).then_some(|inputs: &mut Inputs| inputs.counts[0] += 20);
        at_limit += u32::from(rig.tick().command_code[0].abs_diff(MID_SCALE) == 51);
    }
    assert_eq!(at_limit, 100);
    assert_eq!(rig.board.mode(), Mode::Armed);
}

#[test]
fn link_lost() {
    let mut rig = running();
    rig.keep_alive_every = 0;
    rig.ok(Request::KeepAlive);
    let rows = rig.recording_info().rows;
    let mut ticks = 1;
    let outputs = rig.until_off(|rig, _| {
        ticks += 1;
        // Another link does not speak for the host that started the movement.
        rig.board.handle(Link::Serial, ticks, &Request::Hello { protocol_version: PROTOCOL_VERSION });
    });
    assert_eq!(ticks, 715, "the first tick after 500 ms");
    let fault = fault_of(&mut rig, &outputs, rows + ticks - 1);
    assert_eq!(fault, Fault::LinkLost { silent_ns: 500_500_000, limit_ns: 500_000_000 });
}

/// An arm that stands is left to its brakes, too, when nobody looks after it any more: before a movement and after it.
#[test]
fn a_silent_host_loses_the_arm_that_stands() {
    let mut rig = Rig::armed(configuration());
    rig.seconds(2.0);
    assert_eq!(rig.board.mode(), Mode::Armed);
    rig.ok(Request::KeepAlive);
    rig.keep_alive_every = 0;
    let mut ticks = 1;
    rig.until_off(|_, _| ticks += 1);
    let lost = Mode::Fault(Fault::LinkLost { silent_ns: 500_500_000, limit_ns: 500_000_000 });
    assert_eq!((rig.board.mode(), ticks), (lost, 715));

    let mut rig = running();
    rig.until(|mode| mode == Mode::Holding(ControlLaw::Position));
    rig.seconds(2.0);
    assert_eq!(rig.board.mode(), Mode::Holding(ControlLaw::Position));
    rig.keep_alive_every = 0;
    rig.seconds(0.6);
    assert_eq!(rig.board.mode(), lost);
    assert_eq!(rig.recording_info().ended, Some(EndedBy::Completed), "the movement itself was complete");
    assert_eq!(rig.recording().len(), 5214);
}

/// 400 ms without a word, in the middle of a movement: not a row is lost.
#[test]
fn a_short_silence_loses_nothing() {
    let mut rig = running();
    rig.keep_alive_every = 0;
    rig.seconds(0.4);
    rig.keep_alive_every = 100;
    rig.until(|mode| mode == Mode::Holding(ControlLaw::Position));
    assert_eq!(rig.recording().len(), 5214);
}

/// A model that passes every check and still gives no number: velocities that overflow.
#[test]
fn bad_model() {
    let mut wide = configuration();
    let mut model = exact_model();
    wide.model_range.low = [-1.0e300; 9];
    wide.model_range.high = [1.0e300; 9];
    model.f[8] = 1.0e200;
    let mut rig = Rig::armed(wide);
    rig.upload(model);
    rig.run(ControlLaw::ComputedTorque);
    let outputs = rig.tick();
    assert_eq!(fault_of(&mut rig, &outputs, 0), Fault::BadModel { joint: Joint::Second });
}

/// None of what is a fault under power is one without.
#[test]
fn idle_inputs_are_no_faults() {
    let mut rig = Rig::loaded(configuration());
    for upset in [
        (|inputs| inputs.emergency_stop = true) as fn(&mut Inputs),
        |inputs| inputs.deadline_missed = true,
        |inputs| inputs.current_code = [0, 4095],
        |inputs| inputs.counts[0] += 200,
    ] {
        rig.tamper = Some(upset);
        rig.tick();
        assert_eq!(rig.board.mode(), Mode::Idle);
    }
    rig.tamper = Some(|inputs| inputs.emergency_stop = true);
    rig.tick();
    assert_eq!(rig.refused(Request::Arm), Refusal::EmergencyStop);
    assert!(rig.status().emergency_stop);
}

#[test]
fn a_pressed_emergency_stop_cannot_be_cleared() {
    let mut rig = running();
    rig.tamper = Some(|inputs| inputs.emergency_stop = true);
    rig.tick();
    assert_eq!(rig.refused(Request::ClearFault), Refusal::EmergencyStop);
    rig.tick();
    rig.ok(Request::ClearFault);
    assert_eq!(rig.board.mode(), Mode::Idle);
}

#[test]
fn disarm_switches_off_whatever_happens() {
    let mut rig = running();
    rig.ok(Request::Disarm);
    let outputs = rig.tick();
    assert_eq!((outputs.command_code, outputs.amplifier_enable), ([MID_SCALE; 2], false));
    assert_eq!(rig.board.mode(), Mode::Idle);
    assert_eq!(rig.recording_info().ended, Some(EndedBy::Stopped));
}

fn any_inputs() -> impl Strategy<Value = Inputs> {
    (any::<[i32; 2]>(), [0_u16..4096, 0_u16..4096], any::<bool>(), any::<bool>()).prop_map(
        |(counts, current_code, emergency_stop, deadline_missed)| Inputs {
            counts,
            current_code,
            emergency_stop,
            deadline_missed,
        },
    )
}

fn any_request() -> impl Strategy<Value = Request> {
    let configuration = configuration();
    let crc = configuration.crc();
    let model = exact_model();
    prop_oneof![
        proptest::sample::select(configuration.parts().map(Request::Configure).to_vec()),
        Just(Request::ApplyConfiguration { crc }),
        Just(Request::SetPosition { position_rad: [0.0; 2] }),
        Just(Request::LoadTrajectory(TrajectoryPart::Paper(shared::trajectory::Paper { period_ns: 20_000_000 }))),
        (any::<u16>(), 0_u16..300).prop_map(|(interval, points)| Request::LoadTrajectory(
            TrajectoryPart::BeginPoints { interval_ns: u64::from(interval) * 100, points }
        )),
        (0_u16..30, any::<[[f32; 2]; 3]>()).prop_map(|(from, points)| Request::LoadTrajectory(
            TrajectoryPart::Points { from, points_rad: points.into_iter().collect() }
        )),
        Just(Request::Run { law: ControlLaw::Position, stream: true, settle_ns: 0 }),
        Just(Request::Run { law: ControlLaw::ComputedTorque, stream: true, settle_ns: 0 }),
        Just(Request::Stop),
        Just(Request::Disarm),
        Just(Request::ClearFault),
        (any::<u32>(), any::<u16>()).prop_map(|(from, count)| Request::ReadRecording { from, count }),
        Just(Request::StageModel { model, crc: model.crc() }),
        Just(Request::CommitModel { crc: model.crc() }),
        Just(Request::Status),
        any::<u8>().prop_map(|protocol_version| Request::Hello { protocol_version }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Whatever is asked for and whatever the inputs are: without `Arm` nothing is switched on and nothing is commanded.
    #[test]
    fn nothing_moves_before_arming(
        steps in proptest::collection::vec((any_request(), any::<bool>(), any_inputs()), 1..200),
    ) {
        let mut board = Board::new(crate::rig::identity(), [PackedSample::EMPTY; 100]);
        let hello = Request::Hello { protocol_version: PROTOCOL_VERSION };
        board.handle(Link::Serial, 0, &hello);
        for (sequence, (request, serial, inputs)) in (1..).zip(steps) {
            board.handle(if serial { Link::Serial } else { Link::Usb }, sequence, &request);
            board.handle(Link::Serial, sequence, &hello);
            let outputs = board.tick(&inputs);
            board.advance_check();
            prop_assert_eq!((outputs.command_code, outputs.amplifier_enable), ([MID_SCALE; 2], false));
            prop_assert_eq!(board.mode(), Mode::Idle);
        }
    }

    /// The same with `Arm` and `Run` among the requests, from a board that may arm and run: on only in a powered mode,
    /// mid-scale in every other, codes of 12 bits, no panic.
    #[test]
    fn amplifiers_are_on_only_in_powered_modes(
        steps in proptest::collection::vec((any_request(), 0_u8..6, any_inputs(), 1_u32..300), 1..60),
    ) {
        let mut board = ready();
        let mut sequence = 1;
        let mut quiet = QUIET;
        for (request, kind, inputs, ticks) in steps {
            sequence += 1;
            let request = match kind {
                0 => request,
                1 => Request::Run { law: ControlLaw::ComputedTorque, stream: true, settle_ns: 0 },
                _ => Request::Arm,
            };
            let powered = board.mode().is_powered();
            let reply = board.handle(Link::Usb, sequence, &request);
            if !powered && board.mode().is_powered() {
                prop_assert_eq!((request, reply), (Request::Arm, Reply::Done));
            }
            for tick in 0..ticks {
                quiet.counts[0] += i32::from(tick % 3 == 0);
                let disturbed = tick == ticks - 1 && inputs.deadline_missed && inputs.emergency_stop;
                let outputs = board.tick(if disturbed { &inputs } else { &quiet });
                board.advance_check();
                prop_assert_eq!(outputs.amplifier_enable, board.mode().is_powered());
                prop_assert!(outputs.command_code.iter().all(|&code| code < 4096));
                if !outputs.amplifier_enable {
                    prop_assert_eq!(outputs.command_code, [MID_SCALE; 2]);
                    prop_assert!(outputs.telemetry.is_none());
                }
            }
        }
    }
}

const QUIET: Inputs = Inputs { counts: [0; 2], current_code: [2048; 2], emergency_stop: false, deadline_missed: false };

/// Configured, at a known pose, with model and trajectory: everything but armed.
fn ready() -> Board<Vec<PackedSample>> {
    let mut board = Board::new(crate::rig::identity(), vec![PackedSample::EMPTY; 4000]);
    board.restore(&configuration(), Some(&exact_model())).unwrap();
    board.handle(Link::Usb, 0, &Request::Hello { protocol_version: PROTOCOL_VERSION });
    board.handle(Link::Usb, 1, &Request::SetPosition { position_rad: [0.0; 2] });
    let paper = shared::trajectory::Paper { period_ns: 2_500_000_000 };
    board.handle(Link::Usb, 2, &Request::LoadTrajectory(TrajectoryPart::Paper(paper)));
    for _ in 0..400 {
        board.tick(&QUIET);
        board.advance_check();
    }
    assert_eq!(board.handle(Link::Usb, 3, &Request::Arm), Reply::Done);
    let run = Request::Run { law: ControlLaw::ComputedTorque, stream: false, settle_ns: 0 };
    assert!(matches!(board.handle(Link::Usb, 4, &run), Reply::Started { .. }), "it can run");
    board.handle(Link::Usb, 5, &Request::Disarm);
    board.handle(Link::Usb, 0, &Request::Hello { protocol_version: PROTOCOL_VERSION });
    board
}

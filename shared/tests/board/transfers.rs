//! From one law or model to another while the amplifiers are on: neither current nor arm may jump.

use crate::rig::{Rig, configuration, exact_model, paper_counts};
use shared::arm::{Load, PUMA_UPPER_ARM_M};
use shared::board::MID_SCALE;
use shared::protocol::*;

/// The exact model less a 2 kg tool: what the arm weighs more than it knows.
fn unladen_model() -> Model {
    let tool = Load { mass_kg: 2.0, centre_m: [-0.02, -0.5], inertia_kg_m2: 0.01 };
    let mut model = exact_model();
    for (f, delta) in model.f.iter_mut().zip(tool.delta_f(PUMA_UPPER_ARM_M)) {
        *f -= delta;
    }
    model
}

/// Commanded currents in A.
fn command_a(rig: &Rig, command_code: [u16; 2]) -> [f64; 2] {
    [0, 1].map(|joint: usize| rig.configuration.joints[joint].current_scale.command_a(command_code[joint]))
}

/// The largest change of the command from tick to tick over `ticks`, in A, and the largest error seen, in counts.
fn watch(rig: &mut Rig, mut before_a: [f64; 2], ticks: u32) -> ([f64; 2], [i32; 2], [f64; 2]) {
    let (mut steps_a, mut errors) = ([0.0_f64; 2], [0; 2]);
    for _ in 0..ticks {
        let code = rig.tick().command_code;
        let now_a = command_a(rig, code);
        let error = rig.status().error_counts;
        for joint in 0..2 {
            steps_a[joint] = steps_a[joint].max((now_a[joint] - before_a[joint]).abs());
            errors[joint] = errors[joint].max(error[joint].abs());
        }
        before_a = now_a;
    }
    (steps_a, errors, before_a)
}

/// The arm stands under the position loop, held by its error and by the friction at rest. Computed torque knows neither
/// that error nor on which side the friction pushes: its own current would be another.
#[test]
fn computed_torque_takes_over_without_a_jerk() {
    for (model, allowed_a) in [(exact_model(), 0.3), (unladen_model(), 0.5)] {
        let mut rig = Rig::armed(configuration());
        rig.upload(model);
        rig.movement(ControlLaw::Position);
        rig.seconds(1.0);
        let code = rig.tick().command_code;
        let before_a = command_a(&rig, code);
        rig.ok(Request::Run { law: ControlLaw::ComputedTorque, stream: false, settle_ns: 1_000_000_000 });
        let (steps_a, _, _) = watch(&mut rig, before_a, 1);
        println!("first step {steps_a:.3?} A from {before_a:.3?} A");
        // The approach begins at once: over the 48 counts to go it asks for 1.2 rad/s² after half a period, 0.24 A of
        // joint 2. What the unladen model does not know of the weight is 0.7 A, of which 0.5 A may be friction.
        assert!(steps_a.iter().all(|&step_a| step_a < allowed_a), "{steps_a:?}");
        watch(&mut rig, before_a, 400);
        assert!(rig.status().limits_active.is_empty());
    }
}

/// Straight after arming the position loop has not taken up the weight yet. Computed torque does so at once: if it began
/// from no current, the arm would sag, and friction would keep it there.
#[test]
fn an_arm_just_let_go_of_does_not_sag_under_computed_torque() {
    let mut rig = Rig::armed(configuration());
    rig.upload(exact_model());
    rig.ok(Request::Run { law: ControlLaw::ComputedTorque, stream: false, settle_ns: 0 });
    let (_, errors, _) = watch(&mut rig, [0.0; 2], 60);
    println!("{errors:?} counts");
    assert!(errors.iter().all(|&error| error <= 1), "{errors:?}");
}

/// The position loop leaves the arm up to a hundred counts beside the start of the next movement, and pushing against friction.
/// None of that is left when computed torque begins to move.
#[test]
fn a_movement_after_the_position_loop_s_begins_within_the_count() {
    let mut rig = Rig::armed(configuration());
    rig.upload(exact_model());
    for _ in 0..3 {
        rig.movement(ControlLaw::Position);
        rig.movement(ControlLaw::ComputedTorque);
        let exact = paper_counts(&rig.configuration, 0);
        let start = [0, 1].map(|joint: usize| (exact[joint] - rig.true_positions[0][joint]).abs());
        let largest = rig.recording().iter().flat_map(|row| row.error_counts).map(i16::abs).max();
        println!("{start:.2?} counts at the start, {largest:?} at most");
        assert!(start.iter().all(|&error| error < 0.9) && largest <= Some(1), "{start:?} {largest:?}");
    }
}

/// In the middle of a movement a model comes that knows the tool: the error falls without ever being larger than before.
/// (That the current does not jump the rounding of the encoders hides here; see the tests of the controller.)
#[test]
fn a_model_committed_in_a_movement_takes_over_without_a_jerk() {
    let mut rig = Rig::armed(configuration());
    rig.upload(unladen_model());
    rig.run(ControlLaw::ComputedTorque);
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    rig.seconds(0.6);
    let code = rig.tick().command_code;
    let start_a = command_a(&rig, code);
    let (_, before, last_a) = watch(&mut rig, start_a, 150);
    rig.upload(exact_model());
    let (_, during, last_a) = watch(&mut rig, last_a, 150);
    let (_, after, _) = watch(&mut rig, last_a, 300);
    println!("errors {before:?}, {during:?}, {after:?} counts");
    for joint in 0..2 {
        assert!(during[joint] <= before[joint], "joint {joint}: {during:?} counts, before {before:?}");
        assert!(before[joint] >= 2 && after[joint] <= 1, "joint {joint}: {before:?} {after:?}");
    }
}

/// Models in turn, every 50 ms, one of them without the tool: nothing adds up.
#[test]
fn models_may_change_as_often_as_they_like() {
    let largest_errors = |other: Model| {
        let mut rig = Rig::armed(configuration());
        rig.upload(unladen_model());
        rig.run(ControlLaw::ComputedTorque);
        rig.until(|mode| matches!(mode, Mode::Running(_)));
        let mut largest = [0; 2];
        for change in 0..40 {
            rig.upload(if change % 2 == 0 { unladen_model() } else { other });
            let (_, errors, _) = watch(&mut rig, [0.0; 2], 71);
            largest = [0, 1].map(|joint| largest[joint].max(errors[joint]));
        }
        assert!(matches!(rig.board.mode(), Mode::Running(_)));
        largest
    };
    let (alone, in_turn) = (largest_errors(unladen_model()), largest_errors(exact_model()));
    println!("largest errors {alone:?} counts without the tool, {in_turn:?} in turn");
    assert!((0..2).all(|joint| in_turn[joint] <= alone[joint]), "{alone:?} {in_turn:?}");
}

/// A weak amplifier under computed torque: what it limits is named, joint by joint, and the command is what it gives.
#[test]
fn a_limit_under_computed_torque_is_reported_by_name() {
    let mut weak = configuration();
    weak.joints[1].current_limit_a = 3.5;
    weak.common.current_limit_time_ns = 60_000_000_000;
    let mut rig = Rig::armed(weak);
    rig.upload(Model { robot_identity: weak.robot_identity(), ..exact_model() });
    rig.movement(ControlLaw::ComputedTorque);
    let info = rig.recording_info();
    let names: Vec<_> = info.limits_active.iter().map(ActiveLimit::name).collect();
    assert_eq!(names, ["current_limit_a of joint 3"]);
    let scale = rig.configuration.joints[1].current_scale;
    let largest = rig.recording().iter().map(|row| scale.command_a(row.command_code[1]).abs()).fold(0.0, f64::max);
    assert!((largest - 3.5).abs() <= scale.dac_a_per_code, "{largest}");
    assert_ne!(rig.tick().command_code, [MID_SCALE; 2]);
}

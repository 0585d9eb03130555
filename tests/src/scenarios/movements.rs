//! Movements as they should be, and their end by the emergency stop.

use std::time::Duration;

use armid::client::{Client, MovementProgress};
use armid::compensation::{board_model, without_effects};
use armid::model::Effect;
use shared::protocol::{ControlLaw, Fault, Mode, Request};

use super::{
    BoardUnderTest, Setup, check_whole, largest_errors_counts, loaded, nod, paper_movement, plan, ready,
    rms_errors_counts, robot, run_undisturbed, true_model, within_one_count_percent,
};

/// From a request on, everything is off within a loop period, a run of the control interrupt, and some slack.
const OFF_WITHIN_NS: u64 = 750_000;

/// The stream brings every row, as it stands in the board's memory.
pub fn a_movement_is_recorded_whole<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let movement = run_undisturbed(&mut client);
    check_whole(&movement);
    assert_eq!(client.status().expect("a status").mode, Mode::Idle);
    assert_eq!((client.repeats(), client.frames().bad()), (0, 0));
    let counters = client.hello().expect("an answer").links[B::LINK as usize];
    assert_eq!((counters.bad_frames, counters.telemetry_dropped, counters.replies_dropped), (0, 0, 0));
    board.finish();
}

/// The same run twice gives the same recording and the same outputs at the same instants.
pub fn two_runs_are_the_same_to_the_bit<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let once = || {
        let board = switch_on(Setup::default());
        let mut client = loaded(&board);
        let movement = run_undisturbed(&mut client);
        (movement, board.finish())
    };
    let (first, second) = (once(), once());
    check_whole(&first.0);
    assert!(first.0 == second.0, "the recordings differ");
    assert!(first.1 == second.1, "what was seen at the pins differs");
}

/// With the hidden robot's own parameters, computed torque follows the paper's movement to the count.
pub fn computed_torque_with_the_true_model_stays_within_one_count<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    let model = true_model();
    assert_eq!(client.upload(&model).expect("an accepted model").active, model);
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let movement = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
    check_whole(&movement);
    let within_percent = within_one_count_percent(&movement);
    println!("{within_percent:.3} % within one count, largest {:?}", largest_errors_counts(&movement));
    assert!(within_percent >= 99.0);
    board.finish();
}

/// In the middle of a movement under a model of half the arm's inertia and weight the true one is uploaded: computed torque
/// goes on with it, never errs by more than before, and soon by a count at most.
pub fn a_model_committed_in_a_movement_takes_over_smoothly<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let mut half = true_model();
    half.f.iter_mut().for_each(|f| *f *= 0.5);
    client.upload(&half).expect("an accepted model");
    client.arm().expect("armed");
    let run = Request::Run { law: ControlLaw::ComputedTorque, stream: false, settle_ns: 300_000_000 };
    client.request(run).expect("begun");
    let recorded = |client: &mut Client| client.status().expect("a status").recording.rows;
    while recorded(&mut client) < 300 {
        board.run(Duration::from_millis(5));
    }
    let before = recorded(&mut client) as usize;
    client.upload(&true_model()).expect("a model accepted while it moves");
    let after = recorded(&mut client) as usize;
    while !matches!(client.status().expect("a status").mode, Mode::Holding(_)) {
        board.run(Duration::from_millis(5));
    }
    client.command(Request::Disarm).expect("disarmed");
    let movement = client.last_movement(&mut |_| {}).expect("an answer").expect("a movement");
    let largest = |rows: std::ops::Range<usize>| -> [i16; 2] {
        [0, 1].map(|joint: usize| {
            movement.samples[rows.clone()].iter().map(|row| row.error_counts[joint].abs()).max().unwrap_or(0)
        })
    };
    // What would have been a jump fades within some 20 ms; the nod takes 900.
    let (first, change, last) =
        (largest(0..before), largest(before..after + 300), largest(after + 300..movement.samples.len()));
    println!("largest errors {first:?} counts, {change:?} from row {before} on, {last:?} at last");
    for joint in 0..2 {
        assert!(change[joint] <= first[joint] && last[joint] <= 1, "joint {joint}");
    }
    assert!(first[0] >= 2, "the model of half the arm tracks as well");
    board.finish();
}

/// An arm with friction that depends on direction and speed, an offset and cogging: a model that does not know of them
/// tracks it worse than one that does, which holds it as well as an arm without.
pub fn effects_that_the_model_knows_are_compensated<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let effects: Vec<Effect> = [
        "asymmetric-viscous-friction:joint=2,difference_nm_s_per_rad=0.0008",
        "stribeck-friction:joint=2,extra_nm=0.08,velocity_rad_s=20",
        "asymmetric-friction:joint=3,difference_nm=0.06",
        "cogging:joint=3,amplitude_nm=0.1,order=3,phase_rad=1.1",
    ]
    .map(|text| armid::effects::parse(text).expect("an effect"))
    .into();
    let setup = Setup { effects, ..Setup::default() };
    let whole = setup.hidden().to_model(toml::Table::new());
    let board = switch_on(setup);
    let mut client = ready(&board);
    let mut tracked = |model: &armid::model::Model| {
        let model = board_model(&robot(), model).expect("a model for the board");
        assert_eq!(client.upload(&model).expect("an accepted model").active, model);
        client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
        let movement = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
        check_whole(&movement);
        (rms_errors_counts(&movement), within_one_count_percent(&movement), largest_errors_counts(&movement))
    };
    let (rms_without, within_without, largest_without) =
        tracked(&without_effects(&whole).expect("effects that can be compensated"));
    let (rms, within, largest) = tracked(&whole);
    println!("without: {rms_without:.2?} counts rms, {within_without:.2} % within one, largest {largest_without:?}");
    println!("with:    {rms:.2?} counts rms, {within:.2} % within one, largest {largest:?}");
    assert!((0..2).all(|joint| rms[joint] < 0.5 * rms_without[joint]));
    assert!(within >= 99.0 && within_without < 90.0);
    board.finish();
}

/// Pressed in the middle of a movement, it takes everything off in the next tick, and leaves it off when released.
pub fn the_emergency_stop_switches_off_in_the_next_tick<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let mut pressed_ns = None;
    let movement = client
        .run(&plan(ControlLaw::Position), &mut |progress| {
            if matches!(progress, MovementProgress::Running { rows: 300.., .. }) && pressed_ns.is_none() {
                board.set_emergency_stop(true);
                pressed_ns = Some(board.now().as_nanos() as u64);
            }
        })
        .expect("a movement");
    assert!(movement.partial.as_deref().is_some_and(|reason| reason.contains("emergency")), "{:?}", movement.partial);
    assert!((300..movement.planned_rows).contains(&(movement.samples.len() as u32)));
    assert_eq!(client.status().expect("a status").mode, Mode::Fault(Fault::EmergencyStop));
    assert!(client.load_trajectory(&nod()).is_ok() && client.command(Request::Arm).is_err());

    board.set_emergency_stop(false);
    board.run(Duration::from_millis(50));
    assert_eq!(client.status().expect("a status").mode, Mode::Fault(Fault::EmergencyStop));

    let observations = board.finish();
    let after_ns = observations.off_after_ns(pressed_ns.expect("pressed")).expect("switched off");
    println!("off {:.0} µs after the contact opened", after_ns as f64 * 1e-3);
    assert!(after_ns <= OFF_WITHIN_NS);
    assert!(observations.ends_safe());
}

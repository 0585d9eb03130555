//! Every scenario on the real firmware image, with armid's own client at its serial line, and the image's timing.
//!
//! `tests/run emulated` builds the image and runs these. Without an image in the environment they pass without having
//! shown anything, and say so.

use std::time::Duration;

use armid::client::Client;
use armid_tests::emulated_board::EmulatedBoard;
use armid_tests::emulated_board::control_time::{COMPUTED_TORQUE_LIMIT_US, ControlTime, POSITION_LIMIT_US};
use armid_tests::emulated_board::observations::Observations;
use armid_tests::scenarios::{
    BoardUnderTest, Setup, check_whole, largest_errors_counts, loaded, paper_movement, plan, ready, switched_on,
    true_model, within_one_count_percent,
};
use shared::protocol::{ControlLaw, Mode};

armid_tests::test_every_scenario!(switched_on);

const PERIOD_NS: f64 = 700_000.0;

#[test]
fn the_board_boots_and_ticks_exactly() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    board.run(Duration::from_millis(100));
    let mut client = loaded(&board);
    assert_eq!(client.info().identity.board, "nucleo-f429zi");
    let idle_from_ns = board.now().as_nanos() as u64;
    board.run(Duration::from_secs(10));
    let idle_to_ns = board.now().as_nanos() as u64;
    assert_eq!(client.status().expect("a status").mode, Mode::Idle);
    let observations = BoardUnderTest::finish(board);

    let first = observations.ticks.first().expect("a control tick");
    println!("first control tick after {:.3} ms", first.start_ns as f64 * 1e-6);
    assert!(first.start_ns < 20_000_000);
    let mut periods = Vec::new();
    let mut earliest_and_latest_steps = (u64::MAX, 0);
    for tick in &observations.ticks {
        let since_first = (tick.overflow_ns() - first.overflow_ns()) / PERIOD_NS;
        let off_ns = (since_first - since_first.round()) * PERIOD_NS;
        assert!(off_ns.abs() < 30.0, "the overflow at {} ns is off by {off_ns} ns", tick.overflow_ns());
        if (idle_from_ns..idle_to_ns).contains(&tick.start_ns) {
            periods.push(since_first.round() as u64);
            let (earliest, latest) = earliest_and_latest_steps;
            earliest_and_latest_steps = (tick.timer_steps.min(earliest), tick.timer_steps.max(latest));
        }
    }
    assert!(periods.windows(2).all(|pair| pair[1] == pair[0] + 1), "a control tick is missing");
    assert!((14_285..=14_286).contains(&periods.len()), "{} control ticks in 10 s", periods.len());
    println!("started {earliest_and_latest_steps:?} steps of TIM1 after the overflow");
    assert!(observations.restarts.is_empty(), "{:?}", observations.restarts);
}

#[test]
fn the_position_loop_is_computed_in_time() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let started = std::time::Instant::now();
    let from = board.now();
    let movement = client.run(&plan(ControlLaw::Position), &mut |_| {}).expect("a movement");
    let virtual_s = (board.now() - from).as_secs_f64();
    println!("{virtual_s:.2} virtual seconds in {:.2} s", started.elapsed().as_secs_f64());
    check_whole(&movement);
    let largest = largest_errors_counts(&movement);
    println!("largest errors {largest:?} counts");
    // What the simulated board shows for robots of this kind.
    assert!((60..250).contains(&largest[0]) && (40..200).contains(&largest[1]), "{largest:?}");

    let observations = finish_within(board, client, POSITION_LIMIT_US);
    assert!(observations.edges.iter().all(|&edges| edges > 10_000), "{:?}", observations.edges);
}

#[test]
fn computed_torque_is_computed_in_time() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    client.upload(&true_model()).expect("an accepted model");
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let movement = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
    check_whole(&movement);
    assert!(within_one_count_percent(&movement) >= 99.0);
    finish_within(board, client, COMPUTED_TORQUE_LIMIT_US);
}

/// Ends the run, prints how long the control interrupt took while the amplifiers were on, and checks that no run of it
/// was longer than `limit_us` on the emulated core.
fn finish_within(board: EmulatedBoard, mut client: Client, limit_us: f64) -> Observations {
    let timing = client.hello().expect("an answer").timing;
    let observations = BoardUnderTest::finish(board);
    let time = ControlTime::while_powered(&observations).expect("switched on and off again");
    println!("control interrupt while powered: {time}");
    assert!(time.longest().duration_us() <= limit_us, "{time}");
    assert_eq!(timing.missed_deadlines, 0);
    observations
}

//! The real firmware image on an emulated board, with armid's own client at its serial line.
//!
//! `tests/run emulated` builds the image and runs these. Without an image in the environment they pass without having
//! shown anything, and say so.

use std::path::PathBuf;
use std::time::Duration;

use armid::board_setup::{board_model, configuration};
use armid::client::{Client, Movement, MovementPlan, MovementProgress, Pose};
use armid::hidden_robot::HiddenRobot;
use armid::robot::Robot;
use armid_tests::emulated_board::control_time::{COMPUTED_TORQUE_LIMIT_US, ControlTime, POSITION_LIMIT_US};
use armid_tests::emulated_board::observations::Observations;
use armid_tests::emulated_board::{EmulatedBoard, FIRMWARE_VARIABLE, firmware_from_environment};
use shared::board::MID_SCALE;
use shared::protocol::{ControlLaw, Fault, Mode};
use shared::trajectory::{Points, Trajectory};

const SEED: u64 = 5;
const SETTLE_NS: u64 = 200_000_000;
const PERIOD_NS: f64 = 700_000.0;

/// Registers that the firmware may touch although no model answers for them, each for a reason.
const UNMODELLED: [&str; 0] = [];

fn firmware() -> Option<PathBuf> {
    let path = firmware_from_environment();
    if path.is_none() {
        println!("SKIPPED: {FIRMWARE_VARIABLE} names no image; run `tests/run emulated`, which builds one");
    }
    path
}

fn hidden() -> HiddenRobot {
    HiddenRobot::draw(&Robot::paper(), SEED)
}

fn switched_on() -> Option<EmulatedBoard> {
    Some(EmulatedBoard::start(&firmware()?, &Robot::paper(), &hidden()).expect("an image that runs"))
}

fn ready(board: &EmulatedBoard) -> Client {
    // Always the same sequence numbers, or the same run would not send the same bytes.
    let mut client = Client::connect_from(Box::new(board.link()), 1).expect("a board that answers");
    client
        .prepare(&configuration(&Robot::paper()).expect("a safe robot"), Pose::DefaultsTo([0.0; 2]), false)
        .expect("a board that accepts its robot");
    client
}

fn plan(law: ControlLaw) -> MovementPlan {
    MovementPlan { law, settle_ns: SETTLE_NS }
}

fn paper_movement() -> Trajectory {
    armid::trajectory_file::paper(3.65).expect("the paper's movement")
}

/// A small, quick movement.
fn nod() -> Trajectory {
    let points = [[0.0, 0.0], [-0.1, 0.15], [-0.15, 0.1], [0.0, 0.0]];
    Trajectory::Points(Points::new(300_000_000, &points).expect("a movement through points"))
}

/// What must be true of every run, whatever happened in it.
fn check_always(observations: &Observations) {
    assert_eq!(observations.unmodelled, UNMODELLED);
    let mut mid_scale_was_written = false;
    for change in &observations.outputs {
        let at_mid_scale = change.outputs.command_code == [Some(MID_SCALE); 2];
        mid_scale_was_written |= at_mid_scale;
        if change.outputs.amplifiers_enabled {
            assert!(mid_scale_was_written, "enabled before there was a command: {change:?}");
            assert!(change.outputs.command_code.iter().all(Option::is_some), "enabled without a command: {change:?}");
        }
    }
    for pair in observations.outputs.windows(2) {
        // Off first, then mid-scale, within one run of the interrupt; an output that is on leaves mid-scale only when
        // the amplifiers are about to be enabled in the same run.
        let [now, next] = [&pair[0], &pair[1]];
        let codes_are_off_centre = now.outputs.command_code.iter().flatten().any(|&code| code != MID_SCALE);
        if !now.outputs.amplifiers_enabled && codes_are_off_centre {
            let lasts_ns = next.at_ns - now.at_ns;
            let settled = next.outputs.amplifiers_enabled || next.outputs.command_code == [Some(MID_SCALE); 2];
            // Both channels come up at code 0 for as long as it takes to switch the second one on.
            assert!(settled && lasts_ns < 5_000, "disarmed but not at mid-scale for {lasts_ns} ns: {now:?}");
        }
    }
}

fn largest_errors(movement: &Movement) -> [i16; 2] {
    [0, 1].map(|joint: usize| movement.samples.iter().map(|sample| sample.error_counts[joint].abs()).max().unwrap_or(0))
}

fn check_whole(movement: &Movement) {
    assert_eq!(movement.partial, None);
    assert_eq!(movement.samples.len() as u32, movement.planned_rows);
    assert_eq!(movement.streamed_rows, movement.planned_rows, "every row came with the stream");
    assert_eq!((movement.reread_rows, movement.differing_rows), (0, 0), "and as it stands in the board's memory");
}

#[test]
fn the_board_boots_ticks_exactly_and_moves_nothing_before_it_is_armed() {
    let Some(board) = switched_on() else { return };
    board.run(Duration::from_millis(100));
    let mut client = ready(&board);
    client.load_trajectory(&nod()).expect("an accepted movement");
    assert_eq!(client.info().identity.board, "nucleo-f429zi");
    assert_eq!(client.repeats(), 0);
    let idle_from_ns = board.now().as_nanos() as u64;
    board.run(Duration::from_secs(10));
    let idle_to_ns = board.now().as_nanos() as u64;
    assert_eq!(client.status().expect("a status").mode, Mode::Idle);
    let observations = board.finish().expect("a run without error");
    check_always(&observations);

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

    assert!(observations.outputs.iter().all(|change| !change.outputs.amplifiers_enabled));
    assert_eq!(observations.edges, [0, 0]);
    assert!(observations.restarts.is_empty(), "{:?}", observations.restarts);
}

#[test]
fn a_movement_under_the_position_loop_is_recorded_whole() {
    let Some(board) = switched_on() else { return };
    let mut client = ready(&board);
    client.load_trajectory(&paper_movement()).expect("an accepted movement");
    let started = std::time::Instant::now();
    let from = board.now();
    let movement = client.run(&plan(ControlLaw::Position), &mut |_| {}).expect("a movement");
    let virtual_s = (board.now() - from).as_secs_f64();
    println!("{virtual_s:.2} virtual seconds in {:.2} s", started.elapsed().as_secs_f64());
    check_whole(&movement);
    let largest = largest_errors(&movement);
    println!("largest errors {largest:?} counts");
    // What the simulated board shows for robots of this kind.
    assert!((60..250).contains(&largest[0]) && (40..200).contains(&largest[1]), "{largest:?}");

    let observations = finish_within(board, client, POSITION_LIMIT_US);
    check_always(&observations);
    assert!(observations.edges.iter().all(|&edges| edges > 10_000), "{:?}", observations.edges);
}

#[test]
fn computed_torque_with_the_true_model_stays_within_one_count() {
    let Some(board) = switched_on() else { return };
    let mut client = ready(&board);
    let robot = Robot::paper();
    let model = board_model(&robot, &hidden().to_model(toml::Table::new())).expect("a model for the board");
    let receipt = client.upload(&model).expect("an accepted model");
    assert_eq!(receipt.active, model);
    client.load_trajectory(&paper_movement()).expect("an accepted movement");
    let movement = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
    check_whole(&movement);
    let within =
        movement.samples.iter().filter(|sample| sample.error_counts.iter().all(|error| error.abs() <= 1)).count();
    println!(
        "{:.3} % within one count, largest {:?}",
        100.0 * within as f64 / movement.samples.len() as f64,
        largest_errors(&movement)
    );
    assert!(within as f64 >= 0.99 * movement.samples.len() as f64, "{within} of {}", movement.samples.len());
    check_always(&finish_within(board, client, COMPUTED_TORQUE_LIMIT_US));
}

/// Ends the run, prints how long the control interrupt took while the amplifiers were on, and checks that no run of it
/// was longer than `limit_us` on the emulated core.
fn finish_within(board: EmulatedBoard, mut client: Client, limit_us: f64) -> Observations {
    let timing = client.hello().expect("an answer").timing;
    let observations = board.finish().expect("a run without error");
    let time = ControlTime::while_powered(&observations).expect("switched on and off again");
    println!("control interrupt while powered: {time}");
    assert!(time.longest().duration_us() <= limit_us, "{time}");
    assert_eq!(timing.missed_deadlines, 0);
    observations
}

#[test]
fn two_runs_are_the_same_to_the_bit() {
    let once = || {
        let board = switched_on()?;
        let mut client = ready(&board);
        client.load_trajectory(&nod()).expect("an accepted movement");
        let movement = client.run(&plan(ControlLaw::Position), &mut |_| {}).expect("a movement");
        Some((movement, board.finish().expect("a run without error")))
    };
    let (Some(first), Some(second)) = (once(), once()) else { return };
    check_whole(&first.0);
    assert!(first.0 == second.0, "the recordings differ");
    assert!(first.1 == second.1, "what was seen at the pins differs");
}

#[test]
fn the_emergency_stop_switches_off_in_the_next_tick() {
    let Some(board) = switched_on() else { return };
    let mut client = ready(&board);
    client.load_trajectory(&nod()).expect("an accepted movement");
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
    assert!(matches!(client.status().expect("a status").mode, Mode::Fault(Fault::EmergencyStop)));
    assert!(client.load_trajectory(&nod()).is_ok() && client.command(shared::protocol::Request::Arm).is_err());

    // Released, it stays off until the fault is cleared.
    board.set_emergency_stop(false);
    board.run(Duration::from_millis(50));
    assert!(matches!(client.status().expect("a status").mode, Mode::Fault(Fault::EmergencyStop)));

    let observations = board.finish().expect("a run without error");
    check_always(&observations);
    let pressed_ns = pressed_ns.expect("pressed");
    let off =
        observations.outputs.iter().find(|change| change.at_ns > pressed_ns && !change.outputs.amplifiers_enabled);
    let after_ns = off.expect("switched off").at_ns - pressed_ns;
    println!("off {:.0} µs after the contact opened", after_ns as f64 * 1e-3);
    assert!(after_ns < 750_000);
    let last = observations.outputs.last().expect("outputs");
    assert!(!last.outputs.amplifiers_enabled && last.outputs.command_code == [Some(MID_SCALE); 2], "{last:?}");
}

//! The whole chain over the wire to the real image: record, identify, upload, track. And what the image recorded beside
//! what the simulated board records of the same arm.

use std::path::PathBuf;

use armid::board_setup::board_model;
use armid::capture::{self, Circumstances};
use armid::client::{Client, Movement};
use armid::identified_model;
use armid::identify::{Options, identify};
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use armid_tests::emulated_board::observations::Observations;
use armid_tests::scenarios::{
    BoardUnderTest, NativeBoard, check_whole, hidden, largest_errors_counts, paper_movement, plan, ready, robot,
    run_undisturbed, switched_on, within_one_count_percent,
};
use shared::protocol::ControlLaw;

/// Periods of the movements to identify from, in s: one alone leaves a combination of f7, f8 and f9 nearly free.
const TRAINING_PERIODS_S: [f64; 2] = [3.65, 5.0];

fn record(client: &mut Client, period_s: f64) -> Movement {
    client.load_trajectory(&paper_movement(period_s)).expect("an accepted movement");
    let movement = run_undisturbed(client);
    check_whole(&movement);
    movement
}

fn recording(client: &Client, movement: &Movement) -> Recording {
    let robot = robot();
    let circumstances =
        Circumstances { robot: &robot, mode: Mode::P, trajectory: "paper".into(), board: client.info(), seed: None };
    capture::recording(movement, &circumstances, PathBuf::from("emulated.csv"))
}

#[test]
fn identified_over_the_wire_the_arm_is_tracked_to_the_count() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on();
    let mut client = ready(&board);
    let training: Vec<Movement> = TRAINING_PERIODS_S.iter().map(|&period_s| record(&mut client, period_s)).collect();
    let recordings: Vec<Recording> = training.iter().map(|movement| recording(&client, movement)).collect();
    let options = Options { seed: 1, ..Options::default() };
    let found = identify(&robot(), &recordings, &[], &options, &|_| {}).expect("an identification");
    println!("closed-loop rms {:.3?} counts", found.rms_counts);
    let model = identified_model::from_identification(&robot(), &found, toml::Table::new());
    for (index, (found, truth)) in model.f.iter().zip(hidden().f).enumerate() {
        println!("f{}: found {found:.5}, true {truth:.5}", index + 1);
    }
    client.upload(&board_model(&robot(), &model).expect("a model for the board")).expect("an accepted model");
    client.load_trajectory(&paper_movement(TRAINING_PERIODS_S[0])).expect("an accepted movement");
    let tracked = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
    check_whole(&tracked);
    let within_percent = within_one_count_percent(&tracked);
    println!(
        "position loop: largest {:?} counts; computed torque: largest {:?} counts, {within_percent:.3} % within one",
        largest_errors_counts(&training[0]),
        largest_errors_counts(&tracked),
    );
    assert!(within_percent >= 99.0);
    let observations = BoardUnderTest::finish(board);
    compare_with_the_simulated_board(&training[0], &observations);
}

/// Largest difference that rounding explains, in counts rms.
///
/// Both loops round what they measure. Once they differ by a count at one instant, by whatever cause, they round
/// differently ever after: two simulated boards whose commands act 0.1 µs apart differ by about as much.
const ROUNDING_FLOOR_COUNTS: f64 = 0.5;

/// What another delay of the command adds to that.
const WITH_ASSUMED_DELAY_COUNTS: f64 = 0.6;

/// What the paper's `fix()` adds to that: its cell of 0 is two counts wide, so a loop that passes zero, which this
/// movement does at both its ends, is pushed by a count that a real encoder does not have.
const WITH_WIDE_CELL_COUNTS: f64 = 0.9;

fn compare_with_the_simulated_board(emulated: &Movement, observations: &Observations) {
    let delay_s = command_delay_s(observations);
    let after = |command_delay_s: f64| Robot { command_delay_s, ..robot() };
    let record = |board: NativeBoard| {
        let movement = record(&mut ready(&board), TRAINING_PERIODS_S[0]);
        board.finish();
        movement
    };
    let native = record(NativeBoard::with_equal_cells(&after(delay_s), hidden()));
    let differing_by = |other: NativeBoard| difference_rms_counts(&native, &record(other));
    let floor = differing_by(NativeBoard::with_equal_cells(&after(delay_s + 1e-7), hidden()));
    let assumed = difference_rms_counts(emulated, &record(NativeBoard::with_equal_cells(&robot(), hidden())));
    let wide = difference_rms_counts(emulated, &record(NativeBoard::start(&after(delay_s), hidden())));
    let difference = difference_rms_counts(emulated, &native);
    println!(
        "emulated and simulated board differ by {difference:.3?} counts rms with the delay measured ({:.1} µs), by \
         {assumed:.3?} with the one assumed ({:.1} µs), by {wide:.3?} with the paper's cell of 0; two simulated boards \
         0.1 µs apart by {floor:.3?}",
        delay_s * 1e6,
        robot().command_delay_s * 1e6
    );
    assert!((10e-6..40e-6).contains(&delay_s), "{delay_s} s");
    assert!(difference.iter().all(|&rms| rms <= ROUNDING_FLOOR_COUNTS), "{difference:?}");
    assert!(assumed.iter().all(|&rms| rms <= WITH_ASSUMED_DELAY_COUNTS), "{assumed:?}");
    assert!(wide.iter().all(|&rms| rms <= WITH_WIDE_CELL_COUNTS), "{wide:?}");
}

/// Mean time from the overflow of the control timer, at which the counters are read, to the command, in s. Only ticks
/// that changed it.
fn command_delay_s(observations: &Observations) -> f64 {
    let mut delays_ns = Vec::new();
    let mut ticks = observations.ticks.iter().peekable();
    for change in &observations.outputs {
        while ticks.peek().is_some_and(|next| next.start_ns <= change.at_ns)
            && let Some(tick) = ticks.next()
        {
            let later = ticks.peek().is_some_and(|next| next.start_ns <= change.at_ns);
            if !later && change.outputs.amplifiers_enabled {
                delays_ns.push(change.at_ns as f64 - tick.overflow_ns());
            }
        }
    }
    delays_ns.iter().sum::<f64>() / delays_ns.len() as f64 * 1e-9
}

/// Root mean square of the difference of the errors, for both joints, in counts.
fn difference_rms_counts(one: &Movement, other: &Movement) -> [f64; 2] {
    assert_eq!(one.samples.len(), other.samples.len());
    [0, 1].map(|joint: usize| {
        let differences = one.samples.iter().zip(&other.samples).map(|(one, other)| {
            assert_eq!(one.reference_counts, other.reference_counts);
            f64::from(one.error_counts[joint] - other.error_counts[joint]).powi(2)
        });
        (differences.sum::<f64>() / one.samples.len() as f64).sqrt()
    })
}

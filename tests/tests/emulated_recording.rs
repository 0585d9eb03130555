//! What the real image records beside what the simulated board records of the same arm.

use armid::client::Movement;
use armid::robot::Robot;
use armid_tests::emulated_board::observations::Observations;
use armid_tests::scenarios::{BoardUnderTest, NativeBoard, Setup, hidden, ready, record, robot, switched_on};

/// Period of the movement that is recorded twice, in s.
const PERIOD_S: f64 = 3.65;

/// Largest difference that rounding explains, in counts rms.
///
/// Both loops round what they measure. Once they differ by a count at one instant, by whatever cause, they round
/// differently ever after: simulated boards whose commands act tenths of a microsecond apart differ by 0.3 to 0.6, as
/// luck has it. The test draws some of these, and an image must not be further from the simulated board than they may be.
const ROUNDING_FLOOR_COUNTS: f64 = 0.6;

/// Simulated boards drawn to see what rounding alone does, and by how much more each one's command is delayed.
const DRAWN_BOARDS: u32 = 8;
const DELAYED_BY_S: f64 = 1e-7;

/// One more board like those drawn is further away than the furthest of them once in nine times, but not by much.
const LUCK: f64 = 1.15;

/// What another delay of the command adds to that: 18 µs are a quarter of a count at top speed, and where the rounding
/// falls differently for it is a matter of luck.
const WITH_ASSUMED_DELAY_COUNTS: f64 = 0.75;

#[test]
fn image_and_simulated_board_record_the_same_to_the_rounding_floor() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    let emulated = record(&mut ready(&board), PERIOD_S);
    let observations = BoardUnderTest::finish(board);
    let delay_s = command_delay_s(&observations);
    let after = |command_delay_s: f64| Robot { command_delay_s, ..robot() };
    let record = |board: NativeBoard| {
        let movement = record(&mut ready(&board), PERIOD_S);
        board.finish();
        movement
    };
    let emulated = &emulated;
    let native = record(NativeBoard::start(&after(delay_s), hidden()));
    let differing_by = |other: NativeBoard| difference_rms_counts(&native, &record(other));
    let drawn: Vec<[f64; 2]> = (1..=DRAWN_BOARDS)
        .map(|number| {
            let later = after(delay_s + f64::from(number) * DELAYED_BY_S);
            differing_by(NativeBoard::start(&later, hidden()))
        })
        .collect();
    let floor = [0, 1].map(|joint: usize| drawn.iter().map(|difference| difference[joint]).fold(0.0, f64::max));
    let assumed = difference_rms_counts(emulated, &record(NativeBoard::start(&robot(), hidden())));
    let difference = difference_rms_counts(emulated, &native);
    println!(
        "emulated and simulated board differ by {difference:.3?} counts rms with the delay measured ({:.1} µs), by \
         {assumed:.3?} with the one assumed ({:.1} µs); simulated boards 0.1 to 0.8 µs apart by up to {floor:.3?}",
        delay_s * 1e6,
        robot().command_delay_s * 1e6
    );
    assert!((10e-6..40e-6).contains(&delay_s), "{delay_s} s");
    assert!(difference.iter().all(|&rms| rms <= ROUNDING_FLOOR_COUNTS), "{difference:?}");
    assert!((0..2).all(|joint| difference[joint] <= LUCK * floor[joint]), "{difference:?} {floor:?}");
    assert!(assumed.iter().all(|&rms| rms <= WITH_ASSUMED_DELAY_COUNTS), "{assumed:?}");
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

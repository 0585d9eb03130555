//! What the encoders may do: wrap, reverse, and be fast.

use std::time::Duration;

use super::{BoardUnderTest, Setup, check_whole, loaded, ready, run_undisturbed};
use crate::emulated_board::Turn;

/// Counts per second of the fastest movement, and ten times that.
const RATES_COUNTS_PER_S: [u64; 2] = [25_000, 250_000];

/// Both counters pass the ends of their 32 bits in the middle of a movement, one where its number is without a sign,
/// the other where it has one; the recording is that of counters that do not.
pub fn counters_may_wrap_during_a_movement<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let run = |counts: Option<[u32; 2]>| {
        let board = switch_on(Setup::default());
        board.run(Duration::from_millis(20));
        if let Some(counts) = counts {
            board.set_counters(counts);
        }
        board.run(Duration::from_millis(20));
        let mut client = loaded(&board);
        let movement = run_undisturbed(&mut client);
        check_whole(&movement);
        board.finish();
        movement
    };
    let plain = run(None);
    // Both joints count down from zero, by more than a thousand counts.
    for joint in 0..2 {
        let lowest = plain.samples.iter().map(|row| row.reference_counts[joint]).min();
        assert!(lowest.is_some_and(|lowest| lowest < -1000), "{lowest:?}");
    }
    let wrapped = run(Some([500, i32::MIN.cast_unsigned() + 500]));
    assert!(plain.samples == wrapped.samples, "the recordings differ");
}

/// Turned by hand at the speed of the fastest movement and at ten times that, forwards and back, both motors count
/// every edge.
pub fn every_edge_counts_up_to_ten_times_the_fastest_movement<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    let mut expected = client.status().expect("a status").position_counts;
    for joint in 0..2 {
        for rate in RATES_COUNTS_PER_S {
            for sign in [1, -1] {
                let counts = sign * (rate / 10 + 7) as i32;
                let interval_ns = 1_000_000_000 / rate;
                board.turn_by_hand(Turn { joint, counts, interval_ns });
                board.run(Duration::from_millis(110));
                expected[joint] += counts;
                let position_counts = client.status().expect("a status").position_counts;
                assert_eq!(position_counts, expected, "{counts} counts at {rate} counts/s, joint {joint}");
            }
            // Not back to where it was, so that a count lost each way does not go unnoticed.
            board.turn_by_hand(Turn { joint, counts: 3, interval_ns: 1_000_000 });
            board.run(Duration::from_millis(10));
            expected[joint] += 3;
        }
    }
    assert_eq!(client.status().expect("a status").position_counts, expected);
    board.finish();
}

/// A motor that goes to and fro about one edge, in each of the four places an edge can have, ends where it was.
pub fn a_motor_that_trembles_about_an_edge_loses_no_count<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    let start = client.status().expect("a status").position_counts;
    for place in 0..4 {
        for joint in 0..2 {
            for counts in [1, -1, 1, -1, 1, -1, 1] {
                board.turn_by_hand(Turn { joint, counts, interval_ns: 4_000 });
                board.run(Duration::from_micros(900));
            }
            let position_counts = client.status().expect("a status").position_counts;
            assert_eq!(position_counts[joint], start[joint] + place + 1, "joint {joint}");
        }
    }
    board.finish();
}

//! What only the real image has in front of its counters: input filters.

use std::time::Duration;

use armid_tests::scenarios::{BoardUnderTest, Setup, ready, switched_on};

/// A spike shorter than the filters' 0.76 µs, as motor cables induce them, is no edge; neither is one on both channels
/// at once.
#[test]
fn spikes_on_the_encoder_lines_do_not_count() {
    let Some(switch_on) = switched_on() else { return };
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    let before = client.status().expect("a status").position_counts;
    // The motors stand where both channels are low.
    for spike in [[true, false], [false, true], [true, true]] {
        for joint in 0..2 {
            for levels in [spike, [false; 2]] {
                board.intervene(move |session, _, at| session.board_mut().set_encoder(at, joint, levels));
                board.run(Duration::from_nanos(400));
            }
            board.run(Duration::from_millis(2));
            assert_eq!(client.status().expect("a status").position_counts, before, "{spike:?} on joint {joint}");
        }
    }
    // One that lasts is an edge: the test can tell.
    board.intervene(|session, _, at| session.board_mut().set_encoder(at, 0, [true, false]));
    board.run(Duration::from_millis(2));
    let after = client.status().expect("a status").position_counts;
    assert_eq!(after, [before[0] + 1, before[1]]);
    BoardUnderTest::finish(board);
}

//! Faults of the board that every board can have.

use armid::client::MovementProgress;
use shared::protocol::{ControlLaw, Fault, Mode, Request};

use super::{BoardUnderTest, Setup, check_whole, loaded, plan, run_undisturbed};

/// Two loop periods and some slack: the tick that is late, and the next one, which finds that.
const OFF_WITHIN_NS: u64 = 1_500_000;

/// A control tick that is not over when the next one is due ends the movement, switches off, and is named; after that has
/// been acknowledged, everything goes on.
pub fn a_late_tick_is_a_fault_of_that_name<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let mut late_ns = None;
    let movement = client
        .run(&plan(ControlLaw::Position), &mut |progress| {
            if matches!(progress, MovementProgress::Running { rows: 300.., .. }) && late_ns.is_none() {
                late_ns = Some(board.now().as_nanos() as u64);
                board.delay_a_tick();
            }
        })
        .expect("a movement");
    assert!(movement.partial.is_some() && movement.samples.len() >= 300, "{:?}", movement.partial);
    assert_eq!(client.status().expect("a status").mode, Mode::Fault(Fault::DeadlineMissed));
    assert_eq!(client.hello().expect("an answer").last_fault, Some(Fault::DeadlineMissed));
    client.command(Request::ClearFault).expect("cleared");
    check_whole(&run_undisturbed(&mut client));

    let observations = board.finish();
    let off_ns = observations.off_after_ns(late_ns.expect("it came to that")).expect("switched off");
    println!("off {:.3} ms after the tick was to be late", off_ns as f64 * 1e-6);
    assert!(off_ns <= OFF_WITHIN_NS);
    assert!(observations.ends_safe());
    assert_eq!(observations.restarts, []);
}

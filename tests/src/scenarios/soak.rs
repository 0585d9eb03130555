//! Movement after movement, with trouble on the line at random.

use std::time::Duration;

use armid::client::MovementProgress;
use armid::random::Random;
use shared::protocol::ControlLaw;

use super::{BoardUnderTest, Setup, check_complete, paper_movement, plan, ready, true_model};
use crate::line::Trouble;

/// How long, in s of the board's time, if `ARMID_SOAK_S` does not say it.
const SOAK_S: f64 = 20.0;

/// Longest trouble, s: less than the host may be silent.
const LONGEST_TROUBLE_S: f64 = 0.4;

/// Whatever the line does for less than the host may be silent, every movement is recorded whole, and no tick is late.
pub fn movements_follow_each_other_whatever_the_line_does<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let asked_s = std::env::var("ARMID_SOAK_S").ok().map(|text| text.parse().expect("ARMID_SOAK_S in s"));
    let until = Duration::from_secs_f64(asked_s.unwrap_or(SOAK_S));
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    client.upload(&true_model()).expect("an accepted model");
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let mut random = Random::new(1, 20);
    let (mut movements, mut rows, mut reread_rows) = (0, 0, 0);
    while board.now() < until {
        let at_row = random.between(50.0, 4500.0) as u32;
        let lasting = Duration::from_secs_f64(random.between(0.01, LONGEST_TROUBLE_S));
        let kind = random.between(0.0, 3.0) as u32;
        let mut begun = false;
        let law = if movements % 2 == 0 { ControlLaw::Position } else { ControlLaw::ComputedTorque };
        let movement = client
            .run(&plan(law), &mut |progress| {
                if matches!(progress, MovementProgress::Running { rows, .. } if rows >= at_row) && !begun {
                    begun = true;
                    match kind {
                        0 => board.disturb_line(Trouble::Cut, lasting),
                        1 => board.disturb_line(Trouble::Noise { per_million: 2_000 }, lasting),
                        _ => board.stall_reader(lasting),
                    }
                }
            })
            .expect("a movement");
        check_complete(&movement);
        movements += 1;
        rows += movement.samples.len();
        reread_rows += movement.reread_rows;
    }
    let said = client.hello().expect("an answer");
    println!(
        "{movements} movements in {:.0} s: {rows} rows, none missing, {reread_rows} read again; longest tick {} cycles",
        board.now().as_secs_f64(),
        said.timing.worst_tick_cycles
    );
    assert_eq!(said.timing.missed_deadlines, 0);
    board.finish();
}

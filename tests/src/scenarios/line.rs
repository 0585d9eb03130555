//! Trouble on the line: rows are lost on the way, but never from the recording, and the arm does not notice.

use std::time::Duration;

use armid::client::{Client, Movement, MovementProgress};
use shared::protocol::{ControlLaw, EndedBy, Fault, Mode, Request};

use super::{BoardUnderTest, Setup, check_complete, check_whole, loaded, paper_movement, plan, ready, run_undisturbed};
use crate::line::Trouble;

/// Row at which trouble begins: the arm is moving fast then.
const TROUBLE_AT_ROW: u32 = 300;

/// Longer than any of these runs.
const FOR_EVER: Duration = Duration::from_secs(3600);

/// Runs what is loaded; in the middle of it trouble begins.
fn run_disturbed<B: BoardUnderTest>(board: &B, client: &mut Client, disturb: impl Fn(&B)) -> Movement {
    let mut begun = false;
    client
        .run(&plan(ControlLaw::Position), &mut |progress| {
            if matches!(progress, MovementProgress::Running { rows: TROUBLE_AT_ROW.., .. }) && !begun {
                begun = true;
                disturb(board);
            }
        })
        .expect("a movement")
}

fn undisturbed<B: BoardUnderTest>(switch_on: &impl Fn(Setup) -> B) -> Movement {
    let board = switch_on(Setup::default());
    let movement = run_undisturbed(&mut loaded(&board));
    check_whole(&movement);
    board.finish();
    movement
}

/// Pulled out for 400 ms in the middle of a movement, the line loses rows; the board has them all, and its recording is
/// to the bit that of a run with a sound line.
pub fn a_cut_line_loses_no_row_and_leaves_control_alone<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let cut = |board: &B| board.disturb_line(Trouble::Cut, Duration::from_millis(400));
    let movement = run_disturbed(&board, &mut client, cut);
    check_complete(&movement);
    // 571 rows in 400 ms; what the host had under way when the line was pulled is lost with them.
    assert!((560..=640).contains(&movement.reread_rows), "{} rows re-read", movement.reread_rows);
    assert!(client.repeats() > 0, "the host had to ask again");
    assert!(movement.samples == undisturbed(&switch_on).samples, "control was disturbed");

    let observations = board.finish();
    println!("{} rows re-read, {:?}", movement.reread_rows, observations.line_losses);
    assert!(observations.line_losses.iter().all(|losses| losses.lost > 0 && losses.damaged == 0));
}

/// Noise on every thousandth byte in both directions damages frames; each damaged frame is noticed, and nothing is
/// missing or wrong in the end.
pub fn a_noisy_line_loses_no_row_and_leaves_control_alone<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let noise = |board: &B| board.disturb_line(Trouble::Noise { per_million: 1_000 }, FOR_EVER);
    let movement = run_disturbed(&board, &mut client, noise);
    check_complete(&movement);
    assert!(movement.reread_rows > 10, "{} rows re-read", movement.reread_rows);
    assert!(client.frames().bad() > 10 && client.repeats() > 0);
    let counters = client.hello().expect("an answer").links[B::LINK as usize];
    assert!(counters.bad_frames > 0, "the board counts what it threw away");
    assert!(movement.samples == undisturbed(&switch_on).samples, "control was disturbed");

    let observations = board.finish();
    println!(
        "{} rows re-read, {} requests repeated, {} bad frames at the host, {} at the board, {:?}",
        movement.reread_rows,
        client.repeats(),
        client.frames().bad(),
        counters.bad_frames,
        observations.line_losses
    );
    // A host says little while it listens.
    let [to_board, from_board] = observations.line_losses;
    assert!(to_board.lost + to_board.damaged > 0 && from_board.lost > 0 && from_board.damaged > 0);
}

/// On a line that damages one byte in two hundred most long frames are lost; the recording is read all the same.
pub fn a_very_noisy_line_only_slows_down_the_reading<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let movement = run_undisturbed(&mut client);
    board.disturb_line(Trouble::Noise { per_million: 5_000 }, FOR_EVER);
    let info = movement.recording.expect("what the board says");
    let from = board.now();
    let rows = client.read_recording(&info, &mut |_| {}).expect("every row");
    println!("{} repeats, {:.1} s", client.repeats(), (board.now() - from).as_secs_f64());
    assert!(client.repeats() > 100, "{} repeats", client.repeats());
    assert!(rows == movement.samples, "rows differ");
    board.finish();
}

/// A program that does not read for 400 ms loses what neither the board nor the system has room for; it is in the
/// recording.
pub fn a_reader_that_stalls_loses_no_row_and_leaves_control_alone<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let stall = |board: &B| board.stall_reader(Duration::from_millis(400));
    let movement = run_disturbed(&board, &mut client, stall);
    check_complete(&movement);
    println!("{} rows re-read", movement.reread_rows);
    // 571 rows in 400 ms, of which there is room for 100 to 300.
    assert!((250..=500).contains(&movement.reread_rows), "{} rows re-read", movement.reread_rows);
    assert!(movement.samples == undisturbed(&switch_on).samples, "control was disturbed");
    board.finish();
}

/// A host that never comes back ends the movement with a fault of that name; what was recorded until then can be read
/// when it does.
pub fn a_line_that_stays_cut_ends_the_movement<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    // Longer than the host may be silent.
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let configuration = armid::board_setup::configuration(&super::robot()).expect("a safe robot");
    let timeout = Duration::from_nanos(configuration.common.link_timeout_ns);
    // Begun by hand: the client's own way would give up, too.
    client.command(Request::Arm).expect("armed");
    client.request(Request::Run { law: ControlLaw::Position, stream: true, settle_ns: 0 }).expect("a movement");
    let cut_at_ns = board.now().as_nanos() as u64;
    board.disturb_line(Trouble::Cut, timeout + Duration::from_millis(100));
    board.run(timeout + Duration::from_millis(100));
    let status = client.status().expect("a status, now that the line is back");
    assert!(matches!(status.mode, Mode::Fault(Fault::LinkLost { .. })), "{:?}", status.mode);
    assert!(matches!(status.recording.ended, Some(EndedBy::Fault(Fault::LinkLost { .. }))));
    let rows = client.read_recording(&status.recording, &mut |_| {}).expect("what was recorded");
    assert_eq!(rows.len() as u32, status.recording.rows);
    assert!(status.recording.rows > 100 && status.recording.rows < status.recording.planned_rows);

    let observations = board.finish();
    let after_ns = observations.off_after_ns(cut_at_ns).expect("switched off");
    println!("off {:.1} ms after the line was cut", after_ns as f64 * 1e-6);
    assert!(after_ns.abs_diff(timeout.as_nanos() as u64) < 10_000_000, "{after_ns} ns");
    assert!(observations.ends_safe());
}

//! Before anything moves.

use std::time::Duration;

use shared::board::MID_SCALE;
use shared::protocol::{ControlLaw, Mode, PROTOCOL_VERSION, Refusal, Request};

use super::{BoardUnderTest, Setup, greeted, loaded};
use armid::client::ClientError;

/// The board answers soon after the start, says who it is, and has everything off.
pub fn the_board_starts_with_everything_off<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = greeted(&board);
    let info = client.info().clone();
    assert_eq!(info.protocol_version, PROTOCOL_VERSION);
    assert_eq!(info.identity.firmware_version, env!("CARGO_PKG_VERSION"));
    assert_eq!((info.robot_identity, info.last_fault), (None, None));
    let status = client.status().expect("a status");
    assert_eq!(status.mode, Mode::Idle);
    assert!(status.tick > 20, "{} ticks in 50 ms", status.tick);
    assert!(!status.pose_known && !status.emergency_stop);
    assert_eq!((status.configuration_crc, status.active_model_crc), (None, None));
    assert_eq!(client.repeats(), 0);

    let observations = board.finish();
    let last = observations.outputs.last().expect("outputs");
    assert_eq!(last.outputs.command_code, [Some(MID_SCALE); 2]);
    assert!(observations.outputs.iter().all(|change| !change.outputs.amplifiers_enabled));
}

/// With everything loaded, but not armed, a run is refused, and nothing is ever switched on.
pub fn nothing_moves_before_the_board_is_armed<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = loaded(&board);
    let before = client.status().expect("a status");
    let run = Request::Run { law: ControlLaw::Position, stream: true, settle_ns: 0 };
    let refused = client.command(run);
    assert!(
        matches!(refused, Err(ClientError::Refused { refusal: Refusal::WrongMode { mode: Mode::Idle }, .. })),
        "{refused:?}"
    );
    board.run(Duration::from_millis(500));
    let after = client.status().expect("a status");
    assert_eq!((after.mode, after.position_counts), (Mode::Idle, before.position_counts));
    assert_eq!(after.recording.movement, 0);

    let observations = board.finish();
    assert!(observations.outputs.iter().all(|change| !change.outputs.amplifiers_enabled));
    assert_eq!(observations.edges, [0, 0]);
}

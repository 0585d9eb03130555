//! Bytes of a host, on a board that is ready to be armed.
//!
//! The first byte says how to read the rest: as the bytes on the wire, or as the insides of frames, which are then
//! closed properly. A fuzzer guesses no CRC, so only the second kind gets past the decoder; only the first tests it.
//!
//! What must hold whatever comes: nothing panics, every reply fits a frame, the amplifiers come on by an accepted
//! `Arm` alone, and the outputs are safe whenever they are off.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use shared::board::{Board, Inputs, MID_SCALE};
use shared::protocol::*;
use shared::trajectory::Paper;

// Robot and model of the board's own tests.
#[allow(dead_code)]
#[path = "../../../shared/tests/board/rig.rs"]
mod rig;

const QUIET: Inputs =
    Inputs { counts: [0; 2], current_code: [MID_SCALE; 2], emergency_stop: false, deadline_missed: false };

/// Rows of the recording: a movement of the shortest trajectories fits, and copying them costs little.
const ROWS: usize = 4000;

/// With configuration, pose, model and trajectory: everything but armed.
static READY: LazyLock<Board<Vec<PackedSample>>> = LazyLock::new(|| {
    let mut board = Board::new(rig::identity(), vec![PackedSample::EMPTY; ROWS]);
    board.restore(&rig::configuration(), Some(&rig::exact_model())).expect("a robot and a model that are accepted");
    board.handle(Link::Usb, 0, &Request::Hello { protocol_version: PROTOCOL_VERSION });
    board.handle(Link::Usb, 1, &Request::SetPosition { position_rad: [0.0; 2] });
    board.handle(Link::Usb, 2, &Request::LoadTrajectory(TrajectoryPart::Paper(Paper { period_ns: 2_500_000_000 })));
    for _ in 0..400 {
        board.tick(&QUIET);
        board.advance_check();
    }
    let state = board.handle(Link::Usb, 3, &Request::ReadTrajectory);
    assert!(matches!(state, Reply::Trajectory(TrajectoryState::Accepted { .. })), "{state:?}");
    board.handle(Link::Usb, 0, &Request::Hello { protocol_version: PROTOCOL_VERSION });
    board
});

fuzz_target!(|input: &[u8]| {
    let Some((&kind, bytes)) = input.split_first() else { return };
    let mut board = READY.clone();
    let mut decoder: Decoder = Decoder::new();
    if kind % 2 == 0 {
        for &byte in bytes {
            receive(&mut board, &mut decoder, byte);
        }
    } else {
        let mut rest = bytes;
        while let Some((&length, after)) = rest.split_first() {
            let (inside, after) = after.split_at(usize::from(length).min(after.len()));
            rest = after;
            for byte in frame(inside) {
                receive(&mut board, &mut decoder, byte);
            }
        }
    }
});

/// One byte, and the tick after it where it completes a frame.
fn receive(board: &mut Board<Vec<PackedSample>>, decoder: &mut Decoder, byte: u8) {
    let Some(message) = decoder.host_message(byte) else { return };
    if let Ok(HostMessage { sequence, request }) = message {
        let powered = board.mode().is_powered();
        let reply = board.handle(Link::Usb, sequence, &request);
        if !powered && board.mode().is_powered() {
            assert!(request == Request::Arm && reply == Reply::Done, "switched on by {request:?}: {reply:?}");
        }
        encode_board_message(&BoardMessage::Reply { sequence, reply }, &mut [0; MAX_FRAME])
            .expect("every reply fits a frame");
    }
    let outputs = board.tick(&QUIET);
    board.advance_check();
    assert_eq!(outputs.amplifier_enable, board.mode().is_powered());
    assert!(outputs.command_code.iter().all(|&code| code < 4096), "{outputs:?}");
    if !outputs.amplifier_enable {
        assert_eq!(outputs.command_code, [MID_SCALE; 2]);
    }
}

/// A frame with header and message as given and a CRC that fits.
fn frame(inside: &[u8]) -> Vec<u8> {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(inside);
    let content = [inside, &crc.to_le_bytes()].concat();
    let mut frame = vec![0; cobs::max_encoding_length(content.len()) + 1];
    let length = cobs::encode(&content, &mut frame);
    frame.truncate(length + 1);
    frame
}

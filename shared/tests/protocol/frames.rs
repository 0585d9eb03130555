//! Frames: round trips in any chunks, corruption, the handshake.

use crate::samples::{any_request, any_sample, longest_board_messages, longest_requests, longest_sample, model};
use proptest::prelude::*;
use shared::protocol::*;

fn host_frame(message: &HostMessage) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    encode_host_message(message, &mut buffer).expect("fits a frame").to_vec()
}

fn board_frame(message: &BoardMessage) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    encode_board_message(message, &mut buffer).expect("fits a frame").to_vec()
}

fn decode_host(bytes: &[u8]) -> Vec<Result<HostMessage, FrameError>> {
    let mut decoder: Decoder = Decoder::new();
    bytes.iter().filter_map(|&byte| decoder.host_message(byte)).collect()
}

fn decode_board(bytes: &[u8]) -> Vec<Result<BoardMessage, FrameError>> {
    let mut decoder: Decoder = Decoder::new();
    bytes.iter().filter_map(|&byte| decoder.board_message(byte)).collect()
}

/// Every kind, at its longest: `MAX_FRAME` is a promise to the board's buffers.
#[test]
fn every_message_fits_a_frame_and_comes_back() {
    for request in longest_requests() {
        let message = HostMessage { sequence: u32::MAX, request };
        let frame = host_frame(&message);
        assert_eq!(frame.iter().position(|&byte| byte == 0), Some(frame.len() - 1), "one zero, at the end");
        assert_eq!(decode_host(&frame), [Ok(message)]);
    }
    for message in longest_board_messages() {
        let frame = board_frame(&message);
        assert!(frame.len() <= MAX_FRAME);
        assert_eq!(decode_board(&frame), [Ok(message)]);
    }
}

/// A row must leave in 0.7 ms with room to spare: 1 Mbaud is 70 bytes.
#[test]
fn a_streamed_row_is_short() {
    let message = BoardMessage::Telemetry { movement: 1000, sample: longest_sample() };
    assert!(board_frame(&message).len() <= 45, "{} bytes", board_frame(&message).len());
}

#[test]
fn a_buffer_too_small_is_an_error_with_its_size() {
    let message = HostMessage { sequence: 1, request: Request::StageModel { model: model(), crc: 0 } };
    for max in 0..host_frame(&message).len() {
        let mut buffer = vec![0; max];
        match encode_host_message(&message, &mut buffer) {
            Err(EncodeError::Buffer { len, max: reported }) => assert!(len > max && reported == max),
            other => panic!("{max} bytes gave {other:?}"),
        }
    }
}

proptest! {
    /// The stream is cut into pieces of any size; the decoder keeps its state between them.
    #[test]
    fn requests_survive_any_chunking(
        messages in proptest::collection::vec((any::<u32>(), any_request()), 1..8),
        cuts in proptest::collection::vec(1_usize..40, 1..200),
    ) {
        let messages: Vec<_> =
            messages.into_iter().map(|(sequence, request)| HostMessage { sequence, request }).collect();
        let stream: Vec<u8> = messages.iter().flat_map(host_frame).collect();
        let mut decoder: Decoder = Decoder::new();
        let mut got = Vec::new();
        let mut rest = stream.as_slice();
        for cut in cuts.into_iter().cycle() {
            if rest.is_empty() {
                break;
            }
            let (piece, after) = rest.split_at(cut.min(rest.len()));
            got.extend(piece.iter().filter_map(|&byte| decoder.host_message(byte)).map(|message| message.unwrap()));
            rest = after;
        }
        prop_assert_eq!(decoder.counters().received as usize, messages.len());
        prop_assert_eq!(decoder.counters().bad(), 0);
        prop_assert_eq!(got, messages);
    }

    #[test]
    fn samples_survive(sample in any_sample(), movement in any::<u32>()) {
        let message = BoardMessage::Telemetry { movement, sample };
        prop_assert_eq!(decode_board(&board_frame(&message)), [Ok(message)]);
    }

    /// Whatever happens to one byte, no other message comes out, and the frame after the next zero is read again.
    #[test]
    fn a_corrupted_byte_never_makes_another_message(
        request in any_request(), sequence in any::<u32>(), place in any::<prop::sample::Index>(), flip in 1_u8..=255,
    ) {
        let message = HostMessage { sequence, request };
        let after = HostMessage { sequence: sequence.wrapping_add(1), request: Request::KeepAlive };
        let mut stream = host_frame(&message);
        let place = place.index(stream.len());
        stream[place] ^= flip;
        stream.extend(host_frame(&after));
        // A corrupted closing zero joins both frames; then the second is lost too.
        stream.extend(host_frame(&after));
        let got: Vec<_> = decode_host(&stream).into_iter().flatten().collect();
        prop_assert!(got.iter().all(|got| *got == after), "{got:?}");
        prop_assert!(!got.is_empty());
    }

    /// The failure that made the CRC necessary: the head of one frame and the tail of another.
    #[test]
    fn halves_of_two_frames_never_make_a_message(
        requests in [any_request(), any_request()],
        cuts in [any::<prop::sample::Index>(), any::<prop::sample::Index>()],
    ) {
        let messages = requests.map(|request| HostMessage { sequence: 9, request });
        let [head, tail] = [host_frame(&messages[0]), host_frame(&messages[1])];
        let mut stream = head[..cuts[0].index(head.len())].to_vec();
        stream.extend(&tail[cuts[1].index(tail.len())..]);
        for got in decode_host(&stream).into_iter().flatten() {
            prop_assert!(messages.contains(&got), "{got:?}");
        }
    }

    /// Noise of any length: no panic, no message, and the next frame is read.
    #[test]
    fn noise_is_counted_and_left_behind(noise in proptest::collection::vec(any::<u8>(), 0..2000)) {
        let message = HostMessage { sequence: 1, request: Request::Stop };
        let mut stream = noise;
        stream.push(0);
        let frames_of_noise = stream.split(|&byte| byte == 0).filter(|frame| !frame.is_empty()).count();
        stream.extend(host_frame(&message));
        let mut decoder: Decoder = Decoder::new();
        let got: Vec<_> = stream.iter().filter_map(|&byte| decoder.host_message(byte)).collect();
        prop_assert_eq!(got.last(), Some(&Ok(message)));
        prop_assert_eq!(got.len(), frames_of_noise + 1);
        prop_assert_eq!(decoder.counters().bad() as usize, frames_of_noise);
    }
}

#[test]
fn each_kind_of_bad_frame_is_counted_apart() {
    let good = host_frame(&HostMessage { sequence: 5, request: Request::Status });
    let mut decoder: Decoder = Decoder::new();
    let mut last = |bytes: &[u8]| bytes.iter().filter_map(|&byte| decoder.host_message(byte)).last();

    let long = [&[7_u8; MAX_FRAME + 40][..], &[0]].concat();
    assert!(matches!(last(&long), Some(Err(FrameError::FrameTooLong { len, max: MAX_CONTENT })) if len > MAX_CONTENT));
    assert_eq!(last(&[3, 1, 1, 0]), Some(Err(FrameError::TooShort { len: 2, min: 5 })));
    assert_eq!(last(&[5, 1, 1, 0]), Some(Err(FrameError::Cobs { len: 2 })));
    let mut flipped = good.clone();
    flipped[2] ^= 0x10;
    assert!(matches!(last(&flipped), Some(Err(FrameError::Crc { received, computed })) if received != computed));
    assert_eq!(last(&seal(&[99, 5, 1])), Some(Err(FrameError::Version { theirs: 99, ours: PROTOCOL_VERSION })));
    // An intact frame of our version, with a request that does not exist.
    assert_eq!(last(&seal(&[PROTOCOL_VERSION, 5, 120])), Some(Err(FrameError::Message { len: 7 })));
    // An intact frame with a byte too many.
    assert_eq!(last(&seal(&[PROTOCOL_VERSION, 5, 1, 0])), Some(Err(FrameError::Message { len: 8 })));
    assert_eq!(last(&good), Some(Ok(HostMessage { sequence: 5, request: Request::Status })));
    let expected = FrameCounters { received: 1, too_long: 1, too_short: 1, cobs: 1, crc: 1, version: 1, message: 2 };
    assert_eq!(decoder.counters(), expected);
    assert_eq!(expected.bad(), 7);
}

/// An intact frame around any content, built here from scratch: bitwise CRC-32, COBS without blocks over 254.
fn seal(content: &[u8]) -> Vec<u8> {
    let mut crc = !0_u32;
    for &byte in content {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
        }
    }
    let content = [content, &(!crc).to_le_bytes()].concat();
    let mut frame = Vec::new();
    for block in content.split(|&byte| byte == 0) {
        frame.push(block.len() as u8 + 1);
        frame.extend(block);
    }
    frame.push(0);
    frame
}

/// These bytes must never change: they are how hosts and boards of all versions recognise each other.
#[test]
fn the_handshake_is_frozen() {
    let hello = HostMessage { sequence: 3, request: Request::Hello { protocol_version: 1 } };
    assert_eq!(host_frame(&hello), seal(&[0, 3, 0, 1]));
    let reply = Reply::WrongVersion { board: 2, host: 1, firmware_version: "1.2".parse().unwrap() };
    let refusal = BoardMessage::Reply { sequence: 3, reply };
    assert_eq!(board_frame(&refusal), seal(&[0, 0, 3, 0, 2, 1, 3, b'1', b'.', b'2']));
    // A later version may say more after what is known.
    assert_eq!(decode_host(&seal(&[0, 3, 0, 1, 77, 78])), [Ok(hello)]);
    assert_eq!(decode_board(&seal(&[0, 0, 3, 0, 2, 1, 3, b'1', b'.', b'2', 9])), [Ok(refusal)]);
    // Nothing but a handshake may use the frozen header.
    let arm = HostMessage { sequence: 3, request: Request::Arm };
    let mut buffer = [0; 64];
    let content = [&[0_u8][..], postcard::to_slice(&arm, &mut buffer).unwrap()].concat();
    assert!(matches!(decode_host(&seal(&content))[..], [Err(FrameError::Message { .. })]));
}

//! Frames that should not have come: damaged, too long, old, or of another version.

use std::time::Duration;

use armid::link::Link;
use shared::protocol::{
    BoardMessage, ControlLaw, Decoder, HostMessage, Info, MAX_FRAME, Mode, PROTOCOL_VERSION, Refusal, Reply, Request,
    Status, encode_host_message,
};

use super::{BoardUnderTest, Setup, loaded};

/// Long enough for the longest frame there, its answer back, and a loop period in between.
const ANSWER_WITHIN: Duration = Duration::from_millis(10);

/// A connection that sends bytes as they are.
struct RawLink {
    link: Box<dyn Link>,
    decoder: Decoder,
}

impl RawLink {
    fn new(board: &impl BoardUnderTest) -> Self {
        Self { link: board.link(), decoder: Decoder::new() }
    }

    /// Sends bytes and returns the replies to them.
    fn exchange(&mut self, bytes: &[u8]) -> Vec<(u32, Reply)> {
        self.link.send(bytes).expect("a link that holds");
        let until = self.link.now() + ANSWER_WITHIN;
        let mut replies = Vec::new();
        let mut buffer = [0; 4096];
        while self.link.now() < until {
            let count = self.link.receive(&mut buffer, until - self.link.now()).expect("a link that holds");
            let messages = buffer[..count].iter().filter_map(|&byte| self.decoder.board_message(byte));
            for message in messages {
                if let BoardMessage::Reply { sequence, reply } = message.expect("a sound frame") {
                    replies.push((sequence, reply));
                }
            }
        }
        replies
    }

    /// Sends a request in a sound frame and returns the one reply to it.
    fn ask(&mut self, sequence: u32, request: Request) -> Reply {
        let replies = self.exchange(&frame(sequence, request));
        let [(of, reply)] = &replies[..] else { panic!("one reply, not {replies:?}") };
        assert_eq!(*of, sequence);
        reply.clone()
    }

    fn hello(&mut self, sequence: u32) -> Info {
        let reply = self.ask(sequence, Request::Hello { protocol_version: PROTOCOL_VERSION });
        let Reply::Info(info) = reply else { panic!("{reply:?}") };
        info
    }

    fn status(&mut self, sequence: u32) -> Status {
        let reply = self.ask(sequence, Request::Status);
        let Reply::Status(status) = reply else { panic!("{reply:?}") };
        status
    }
}

fn frame(sequence: u32, request: Request) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    encode_host_message(&HostMessage { sequence, request }, &mut buffer).expect("a request fits a frame").to_vec()
}

/// A frame around these bytes, with a CRC that is right but for `wrong`.
fn closed(inside: &[u8], wrong: u32) -> Vec<u8> {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(inside) ^ wrong;
    let mut frame = cobs::encode_vec(&[inside, &crc.to_le_bytes()].concat());
    frame.push(0);
    frame
}

/// Without what changes by itself.
fn lasting(status: Status) -> Status {
    Status { tick: 0, current_a: [0.0; 2], ..status }
}

/// Whatever is wrong with a frame, it is thrown away, counted, and not answered; the next one is understood.
pub fn damaged_frames_change_nothing_and_are_counted<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    drop(loaded(&board));
    let mut link = RawLink::new(&board);
    let bad_frames = |link: &mut RawLink, sequence| link.hello(sequence).links[B::LINK as usize].bad_frames;
    let mut bad = bad_frames(&mut link, 100);
    let before = lasting(link.status(101));
    assert_eq!(before.mode, Mode::Idle);

    let arm = frame(102, Request::Arm);
    let cut = [&arm[..arm.len() / 2], &[0]].concat();
    let too_long = [&[1; 300][..], &[0]].concat();
    let short = closed(&[], 0);
    let wrong_crc = closed(&[PROTOCOL_VERSION, 102, 6], 1);
    let unknown_request = closed(&[PROTOCOL_VERSION, 102, 200], 0);
    let too_much = closed(&[PROTOCOL_VERSION, 102, 6, 0], 0);
    let arm_as_handshake = closed(&[0, 102, 6], 0);
    let noise: Vec<u8> = (1..=200).chain([0]).collect();
    for (name, bytes) in [
        ("cut", cut),
        ("too long", too_long),
        ("too short", short),
        ("CRC", wrong_crc),
        ("unknown request", unknown_request),
        ("too much in it", too_much),
        ("Arm among the handshakes", arm_as_handshake),
        ("noise", noise),
    ] {
        assert_eq!(link.exchange(&bytes), [], "{name}");
        let now = bad_frames(&mut link, 100);
        assert_eq!(now, bad + 1, "{name}");
        bad = now;
        assert_eq!(lasting(link.status(101)), before, "{name}");
    }
    // Armed by none of the frames that differ from the right one by a bit.
    for bit in 0..8 * arm.len() {
        let mut flipped = arm.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        // A flipped end would make one frame of two.
        flipped.push(0);
        assert_eq!(link.exchange(&flipped), [], "bit {bit}");
    }
    assert!(bad_frames(&mut link, 100) >= bad + 8 * arm.len() as u32);
    assert_eq!(lasting(link.status(101)), before);
    // And by the right one.
    assert_eq!(link.exchange(&arm), [(102, Reply::Done)]);
    assert_eq!(link.status(103).mode, Mode::Armed);
    assert_eq!(link.ask(104, Request::Disarm), Reply::Done);
    board.finish();
}

/// A request that comes again is answered again; one that comes late is refused; neither does anything.
pub fn old_frames_are_not_carried_out_again<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    board.run(Duration::from_millis(20));
    let mut link = RawLink::new(&board);
    assert_eq!(link.ask(5, Request::Status), Reply::Refused(Refusal::NotGreeted));
    drop(loaded(&board));
    // Numbers wrap in the middle of it.
    link.hello(u32::MAX - 1);
    let arm = frame(u32::MAX, Request::Arm);
    let run = frame(0, Request::Run { law: ControlLaw::Position, stream: false, settle_ns: 0 });
    let disarm = frame(2, Request::Disarm);
    let done = |sequence| [(sequence, Reply::Done)];
    let stale = |sequence, last| [(sequence, Reply::Refused(Refusal::StaleSequence { sequence, last }))];

    assert_eq!(link.exchange(&arm), done(u32::MAX));
    assert_eq!(link.exchange(&arm), done(u32::MAX));
    let started = link.exchange(&run);
    assert!(matches!(started[..], [(0, Reply::Started { movement: 1, .. })]), "{started:?}");
    assert_eq!(link.exchange(&run), started, "one movement, not two");
    // The request with number 1 is overtaken by number 2.
    assert_eq!(link.exchange(&disarm), done(2));
    assert_eq!(link.exchange(&frame(1, Request::Stop)), stale(1, 2));
    assert_eq!(link.exchange(&arm), stale(u32::MAX, 2));
    assert_eq!(link.exchange(&run), stale(0, 2));
    assert_eq!(link.exchange(&disarm), done(2));
    let status = link.status(3);
    assert_eq!((status.mode, status.recording.movement), (Mode::Idle, 1));

    let observations = board.finish();
    let switched_on = observations
        .outputs
        .windows(2)
        .filter(|pair| !pair[0].outputs.amplifiers_enabled && pair[1].outputs.amplifiers_enabled);
    assert_eq!(switched_on.count(), 1, "switched on once");
}

/// A board and a host of different versions understand that much of each other, and no more.
pub fn frames_of_another_version_are_answered_and_do_nothing<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    drop(loaded(&board));
    let mut link = RawLink::new(&board);
    let bad = link.hello(10).links[B::LINK as usize].bad_frames;
    let theirs = PROTOCOL_VERSION + 1;
    let is_refused = |replies: &[(u32, Reply)], expected: u32| {
        matches!(
            replies,
            [(sequence, Reply::WrongVersion { board: PROTOCOL_VERSION, host, .. })]
                if (*sequence, *host) == (expected, theirs)
        )
    };
    // `Arm` in a later version's frame. Its number cannot be known.
    let replies = link.exchange(&closed(&[theirs, 11, 6], 0));
    assert!(is_refused(&replies, 0), "{replies:?}");
    assert_eq!(link.status(11).mode, Mode::Idle);
    assert_eq!(link.hello(12).links[B::LINK as usize].bad_frames, bad + 1);

    // A host that introduces itself as another version is told so, and the link is closed to it.
    let replies = link.exchange(&frame(13, Request::Hello { protocol_version: theirs }));
    assert!(is_refused(&replies, 13), "{replies:?}");
    assert_eq!(link.ask(14, Request::Arm), Reply::Refused(Refusal::NotGreeted));
    link.hello(15);
    assert_eq!(link.status(16).mode, Mode::Idle);
    let observations = board.finish();
    assert!(observations.outputs.iter().all(|change| !change.outputs.amplifiers_enabled));
}

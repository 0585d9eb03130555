//! What every link to a host has in common: queues between its tasks and the control interrupt, and frames.
//!
//! ```text
//! receive task ── requests ─▶ control interrupt ── replies, events, telemetry ─▶ send task
//! ```
//!
//! All four queues are lock-free with one producer and one consumer. The interrupt never waits for one: what does not
//! fit is dropped and counted, so a stalled host cannot disturb control. A lost reply is asked for again, a lost
//! row is still in the recording.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use embassy_stm32::{
    interrupt,
    interrupt::{Interrupt, InterruptExt},
};
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, signal::Signal};
use embassy_time::Timer;
use heapless::spsc::{Consumer, Producer, Queue};
use shared::{
    board::{Findings, Telemetry},
    protocol::{
        BoardMessage, Decoder, Event, FrameError, HostMessage, LinkCounters, MAX_FRAME, PROTOCOL_VERSION, Reply,
        encode_board_message,
    },
};

/// One link, in static memory. A queue of N holds N - 1.
pub struct Link {
    requests: Queue<ExaminedRequest, 4>,
    /// Places for replies. They wait in `free_replies` to be written by the interrupt, and in `replies` to be sent.
    reply_places: [SequencedReply; REPLIES],
    free_replies: Queue<&'static mut SequencedReply, { REPLIES + 1 }>,
    replies: Queue<&'static mut SequencedReply, { REPLIES + 1 }>,
    events: Queue<Event, 8>,
    /// 44 ms of rows at 0.7 ms: as long as a host may look away without losing one on the way.
    telemetry: Queue<Telemetry, 64>,
}

/// Replies that may wait to be sent.
const REPLIES: usize = 3;

/// A reply and the number of its request. It is written in place and stays there until it is sent, because copying it
/// would take the interrupt as long as everything else it does.
struct SequencedReply {
    sequence: u32,
    reply: Reply,
}

/// A request with what the receiving task found out about it, so that the interrupt need not.
pub struct ExaminedRequest {
    /// The request.
    pub message: HostMessage,
    /// What follows from it alone.
    pub findings: Findings,
}

/// What the interrupt and the tasks of one link count, and how they wake each other.
pub struct LinkState {
    outgoing: Signal<CriticalSectionRawMutex, ()>,
    received: AtomicU32,
    bad_frames: AtomicU32,
    telemetry_dropped: AtomicU32,
    replies_dropped: AtomicU32,
    /// Header of a frame of another protocol version that is still to be answered; [`PROTOCOL_VERSION`] for none.
    other_version: AtomicU8,
}

impl LinkState {
    const fn new() -> Self {
        Self {
            outgoing: Signal::new(),
            received: AtomicU32::new(0),
            bad_frames: AtomicU32::new(0),
            telemetry_dropped: AtomicU32::new(0),
            replies_dropped: AtomicU32::new(0),
            other_version: AtomicU8::new(PROTOCOL_VERSION),
        }
    }
}

/// State of the serial link. Static, because the relay interrupt below wakes its task.
pub static SERIAL: LinkState = LinkState::new();

impl Link {
    /// A link with nothing under way.
    pub const fn new() -> Self {
        Self {
            requests: Queue::new(),
            reply_places: [const { SequencedReply { sequence: 0, reply: Reply::Done } }; REPLIES],
            free_replies: Queue::new(),
            replies: Queue::new(),
            events: Queue::new(),
            telemetry: Queue::new(),
        }
    }

    /// The ends for the control interrupt, for the receiving and for the sending task.
    pub fn split(&'static mut self, state: &'static LinkState) -> (ControlEnd, ReceiveEnd, SendEnd) {
        let (request_producer, requests) = self.requests.split();
        let (mut free_producer, free_replies) = self.free_replies.split();
        for place in &mut self.reply_places {
            // Room for all of them.
            let _ = free_producer.enqueue(place);
        }
        let (replies, reply_consumer) = self.replies.split();
        let (events, event_consumer) = self.events.split();
        let (telemetry, telemetry_consumer) = self.telemetry.split();
        (
            ControlEnd { requests, free_replies, replies, events, telemetry, state },
            ReceiveEnd { decoder: Decoder::new(), requests: request_producer, state },
            SendEnd {
                replies: reply_consumer,
                free_replies: free_producer,
                events: event_consumer,
                telemetry: telemetry_consumer,
                state,
            },
        )
    }
}

/// The control interrupt's end.
pub struct ControlEnd {
    requests: Consumer<'static, ExaminedRequest>,
    free_replies: Consumer<'static, &'static mut SequencedReply>,
    replies: Producer<'static, &'static mut SequencedReply>,
    events: Producer<'static, Event>,
    telemetry: Producer<'static, Telemetry>,
    state: &'static LinkState,
}

impl ControlEnd {
    /// Has the next request answered, if there is one and a place for its reply: `answer` is given the request and the
    /// place. Neither is ever moved. Returns whether there was one.
    pub fn answer_next(&mut self, answer: impl FnOnce(&ExaminedRequest, &mut Reply)) -> bool {
        let Some(request) = self.requests.peek() else { return false };
        let Some(place) = self.free_replies.dequeue() else { return false };
        place.sequence = request.message.sequence;
        answer(request, &mut place.reply);
        self.requests.dequeue();
        // As much room as there are places.
        let _ = self.replies.enqueue(place);
        wake_senders();
        true
    }

    /// Tells the host something it has not asked for.
    pub fn event(&mut self, event: Event) {
        if self.events.enqueue(event).is_err() {
            count(&self.state.replies_dropped);
        }
        wake_senders();
    }

    /// Sends a recorded row.
    pub fn telemetry(&mut self, telemetry: Telemetry) {
        if self.telemetry.enqueue(telemetry).is_err() {
            count(&self.state.telemetry_dropped);
        }
        wake_senders();
    }

    /// Traffic since the start.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            received: self.state.received.load(Ordering::Relaxed),
            bad_frames: self.state.bad_frames.load(Ordering::Relaxed),
            telemetry_dropped: self.state.telemetry_dropped.load(Ordering::Relaxed),
            replies_dropped: self.state.replies_dropped.load(Ordering::Relaxed),
        }
    }
}

/// The receiving task's end.
pub struct ReceiveEnd {
    decoder: Decoder,
    requests: Producer<'static, ExaminedRequest>,
    state: &'static LinkState,
}

impl ReceiveEnd {
    /// Takes in received bytes, and waits while the interrupt has not taken earlier requests: it takes one a period.
    pub async fn accept(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match self.decoder.host_message(byte) {
                None => {}
                Some(Ok(message)) => {
                    count(&self.state.received);
                    let mut request = ExaminedRequest { findings: Findings::of(&message.request), message };
                    while let Err(refused) = self.requests.enqueue(request) {
                        request = refused;
                        Timer::after_micros(100).await;
                    }
                }
                Some(Err(error)) => {
                    count(&self.state.bad_frames);
                    if let FrameError::Version { theirs, .. } = error {
                        self.state.other_version.store(theirs, Ordering::Relaxed);
                        self.state.outgoing.signal(());
                    }
                }
            }
        }
    }
}

/// The sending task's end.
pub struct SendEnd {
    replies: Consumer<'static, &'static mut SequencedReply>,
    free_replies: Producer<'static, &'static mut SequencedReply>,
    events: Consumer<'static, Event>,
    telemetry: Consumer<'static, Telemetry>,
    state: &'static LinkState,
}

impl SendEnd {
    /// Waits for the next message and puts it into a frame. Answers go before rows, which can be read again.
    pub async fn next_frame<'a>(&mut self, buffer: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
        loop {
            let Some(message) = self.next_message() else {
                self.state.outgoing.wait().await;
                continue;
            };
            // The borrow checker does not yet see that the buffer is free again after an error.
            match encode_board_message(&message, buffer).map(<[u8]>::len) {
                Ok(length) => return &buffer[..length],
                Err(_) => {
                    count(&self.state.replies_dropped);
                    defmt::error!("a message does not fit a frame of {} bytes", MAX_FRAME);
                }
            }
        }
    }

    fn next_message(&mut self) -> Option<BoardMessage> {
        if let Some(place) = self.replies.dequeue() {
            let reply = core::mem::replace(&mut place.reply, Reply::Done);
            let message = BoardMessage::Reply { sequence: place.sequence, reply };
            // As much room as there are places.
            let _ = self.free_replies.enqueue(place);
            return Some(message);
        }
        let other_version = self.state.other_version.swap(PROTOCOL_VERSION, Ordering::Relaxed);
        if other_version != PROTOCOL_VERSION {
            let firmware_version = crate::identity::firmware_version();
            let reply = Reply::WrongVersion { board: PROTOCOL_VERSION, host: other_version, firmware_version };
            // Its sequence number could not be read: the rest of the frame may mean anything.
            return Some(BoardMessage::Reply { sequence: 0, reply });
        }
        if let Some(event) = self.events.dequeue() {
            return Some(BoardMessage::Event(event));
        }
        self.telemetry.dequeue().map(|row| BoardMessage::Telemetry { movement: row.movement, sample: row.sample })
    }
}

fn count(counter: &AtomicU32) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// The control interrupt may not wake a task itself (see `critical_section.rs`). It requests this interrupt instead,
/// whose peripheral the board does not use, and which has a priority from which tasks may be woken.
const RELAY: Interrupt = Interrupt::DCMI;

/// Lets the relay run when requested; call it once, before the control interrupt starts.
pub fn enable_relay() {
    // SAFETY: its handler below uses nothing that has to be initialised first.
    unsafe { RELAY.enable() };
}

fn wake_senders() {
    RELAY.pend();
}

#[interrupt]
fn DCMI() {
    SERIAL.outgoing.signal(());
}

//! What every link to a host has in common: queues between its tasks and the control interrupt, and frames.
//!
//! ```text
//! receive task ── requests ─▶ control interrupt ── replies, events, telemetry ─▶ send task
//! ```
//!
//! All four queues are lock-free with one producer and one consumer. The interrupt never waits for one: what does not
//! fit is dropped and counted, so a stalled host cannot disturb control. A lost reply is asked for again, a lost
//! row is still in the recording.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

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
        Request, encode_board_message,
    },
};

/// One link, in static memory. A queue of N holds N - 1.
pub struct Link {
    /// Places for requests. They wait in `free_requests` to be written by the receiving task, and in `requests` to be
    /// answered.
    request_places: [ExaminedRequest; REQUESTS],
    free_requests: Queue<&'static mut ExaminedRequest, { REQUESTS + 1 }>,
    requests: Queue<&'static mut ExaminedRequest, { REQUESTS + 1 }>,
    /// Places for replies. They wait in `free_replies` to be written by the interrupt, and in `replies` to be sent.
    reply_places: [SequencedReply; REPLIES],
    free_replies: Queue<&'static mut SequencedReply, { REPLIES + 1 }>,
    replies: Queue<&'static mut SequencedReply, { REPLIES + 1 }>,
    events: Queue<Event, 8>,
    /// 44 ms of rows at 0.7 ms: as long as a host may look away without losing one on the way.
    telemetry: Queue<Telemetry, 64>,
}

/// Requests that may wait to be answered.
const REQUESTS: usize = 3;

/// Replies that may wait to be sent.
const REPLIES: usize = 3;

/// A reply and the number of its request. It is written in place and stays there until it is sent, because copying it
/// would take the interrupt as long as everything else it does.
struct SequencedReply {
    sequence: u32,
    reply: Reply,
}

/// A request with what the receiving task found out about it, so that the interrupt need not. Like a reply it stays in
/// its place.
pub struct ExaminedRequest {
    /// The request.
    pub message: HostMessage,
    /// What follows from it alone.
    pub findings: Findings,
}

/// What the interrupt and the tasks of one link count, and how they wake each other.
pub struct LinkState {
    /// Whether anybody may be listening. Nothing is queued for nobody.
    connected: AtomicBool,
    /// Whether the interrupt wants the sending task woken.
    wake: AtomicBool,
    outgoing: Signal<CriticalSectionRawMutex, ()>,
    received: AtomicU32,
    bad_frames: AtomicU32,
    telemetry_dropped: AtomicU32,
    replies_dropped: AtomicU32,
    /// Header of a frame of another protocol version that is still to be answered; [`PROTOCOL_VERSION`] for none.
    other_version: AtomicU8,
}

impl LinkState {
    const fn new(connected: bool) -> Self {
        Self {
            connected: AtomicBool::new(connected),
            wake: AtomicBool::new(false),
            outgoing: Signal::new(),
            received: AtomicU32::new(0),
            bad_frames: AtomicU32::new(0),
            telemetry_dropped: AtomicU32::new(0),
            replies_dropped: AtomicU32::new(0),
            other_version: AtomicU8::new(PROTOCOL_VERSION),
        }
    }

    /// Traffic since the start.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            received: self.received.load(Ordering::Relaxed),
            bad_frames: self.bad_frames.load(Ordering::Relaxed),
            telemetry_dropped: self.telemetry_dropped.load(Ordering::Relaxed),
            replies_dropped: self.replies_dropped.load(Ordering::Relaxed),
        }
    }
}

/// State of the USB link. Static, because the relay interrupt below wakes its task.
pub static USB: LinkState = LinkState::new(false);

/// State of the serial link, which cannot tell whether anybody listens.
pub static SERIAL: LinkState = LinkState::new(true);

impl Link {
    /// A link with nothing under way.
    #[inline(never)]
    pub const fn new() -> Self {
        Self {
            request_places: [const {
                ExaminedRequest {
                    message: HostMessage { sequence: 0, request: Request::Status },
                    findings: Findings::NONE,
                }
            }; REQUESTS],
            free_requests: Queue::new(),
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
        let (mut free_request_producer, free_requests) = self.free_requests.split();
        for place in &mut self.request_places {
            // Room for all of them.
            let _ = free_request_producer.enqueue(place);
        }
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
            ControlEnd {
                requests,
                free_requests: free_request_producer,
                free_replies,
                replies,
                events,
                telemetry,
                state,
            },
            ReceiveEnd { decoder: Decoder::new(), free_requests, requests: request_producer, state },
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
    requests: Consumer<'static, &'static mut ExaminedRequest>,
    free_requests: Producer<'static, &'static mut ExaminedRequest>,
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
        if !self.requests.ready() {
            return false;
        }
        let Some(place) = self.free_replies.dequeue() else { return false };
        let Some(request) = self.requests.dequeue() else { return false };
        place.sequence = request.message.sequence;
        answer(request, &mut place.reply);
        // As much room as there are places, here and below.
        let _ = self.free_requests.enqueue(request);
        let _ = self.replies.enqueue(place);
        self.wake_sender();
        true
    }

    /// Tells the host something it has not asked for.
    pub fn event(&mut self, event: &Event) {
        if !self.is_connected() {
            return;
        }
        if self.events.enqueue(*event).is_err() {
            count(&self.state.replies_dropped);
        }
        self.wake_sender();
    }

    /// Sends a recorded row. A host that asked for it and has gone since is told by the count what it missed.
    pub fn telemetry(&mut self, telemetry: Telemetry) {
        if !self.is_connected() || self.telemetry.enqueue(telemetry).is_err() {
            count(&self.state.telemetry_dropped);
        }
        self.wake_sender();
    }

    fn is_connected(&self) -> bool {
        self.state.connected.load(Ordering::Relaxed)
    }

    /// The interrupt may not wake a task itself (see `critical_section.rs`): the relay below does.
    fn wake_sender(&self) {
        self.state.wake.store(true, Ordering::Relaxed);
        RELAY.pend();
    }

    /// What is counted on the link.
    pub fn state(&self) -> &'static LinkState {
        self.state
    }
}

/// The receiving task's end.
pub struct ReceiveEnd {
    decoder: Decoder,
    free_requests: Consumer<'static, &'static mut ExaminedRequest>,
    requests: Producer<'static, &'static mut ExaminedRequest>,
    state: &'static LinkState,
}

impl ReceiveEnd {
    /// Forgets a frame of which only the beginning has come: another host sends now.
    pub fn restart(&mut self) {
        self.decoder = Decoder::new();
    }

    /// Takes in received bytes, and waits while the interrupt has not taken earlier requests: it takes one a period.
    pub async fn accept(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            // Before the byte that may end a request, so that a request never has to be kept while waiting.
            while !self.free_requests.ready() {
                Timer::after_micros(100).await;
            }
            self.accept_byte(byte);
        }
    }

    /// Takes in a byte, while there is a free place for a request.
    #[inline(never)]
    fn accept_byte(&mut self, byte: u8) {
        match self.decoder.host_message(byte) {
            None => {}
            Some(Ok(message)) => {
                count(&self.state.received);
                if let Some(place) = self.free_requests.dequeue() {
                    place.findings = Findings::of(&message.request);
                    place.message = message;
                    // As much room as there are places.
                    let _ = self.requests.enqueue(place);
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

/// The sending task's end.
pub struct SendEnd {
    replies: Consumer<'static, &'static mut SequencedReply>,
    free_replies: Producer<'static, &'static mut SequencedReply>,
    events: Consumer<'static, Event>,
    telemetry: Consumer<'static, Telemetry>,
    state: &'static LinkState,
}

/// What a frame carries, as far as its loss matters.
#[derive(Clone, Copy)]
pub enum Carries {
    /// A recorded row, which can be read again.
    Row,
    /// An answer, which can be asked for again, or an event.
    Other,
}

impl SendEnd {
    /// Waits for the next message and puts it into a frame.
    pub async fn next_frame<'a>(&mut self, buffer: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
        loop {
            // The borrow checker does not yet see that the buffer is free again where there is no frame.
            match self.try_next_frame(buffer) {
                Some((length, _)) => return &buffer[..length],
                None => self.wait().await,
            }
        }
    }

    /// Puts the next message into a frame and returns its length. Answers go before rows, which can be read again.
    pub fn try_next_frame(&mut self, buffer: &mut [u8; MAX_FRAME]) -> Option<(usize, Carries)> {
        loop {
            let message = self.next_message()?;
            let carries = if matches!(message, BoardMessage::Telemetry { .. }) { Carries::Row } else { Carries::Other };
            match encode_board_message(&message, buffer) {
                Ok(frame) => return Some((frame.len(), carries)),
                Err(_) => {
                    self.lost(0, 1);
                    defmt::error!("a message does not fit a frame of {} bytes", MAX_FRAME);
                }
            }
        }
    }

    /// Waits until there may be another message.
    pub async fn wait(&self) {
        self.state.outgoing.wait().await;
    }

    /// Counts what the host did not take.
    pub fn lost(&self, rows: u32, others: u32) {
        self.state.telemetry_dropped.fetch_add(rows, Ordering::Relaxed);
        self.state.replies_dropped.fetch_add(others, Ordering::Relaxed);
    }

    /// Throws away what is queued, and counts it.
    pub fn discard(&mut self) {
        let (mut rows, mut others) = (0, 0);
        while self.telemetry.dequeue().is_some() {
            rows += 1;
        }
        while let Some(place) = self.replies.dequeue() {
            // As much room as there are places.
            let _ = self.free_replies.enqueue(place);
            others += 1;
        }
        while self.events.dequeue().is_some() {
            others += 1;
        }
        self.lost(rows, others);
    }

    /// Somebody listens from now on, and gets nothing that was meant for somebody else.
    pub fn connect(&mut self) {
        self.discard();
        self.state.connected.store(true, Ordering::Relaxed);
    }

    /// Nobody listens any more.
    pub fn disconnect(&mut self) {
        self.state.connected.store(false, Ordering::Relaxed);
        self.discard();
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

/// An interrupt that the control interrupt requests to have tasks woken. The board does not use its peripheral, and it
/// has a priority from which tasks may be woken.
const RELAY: Interrupt = Interrupt::DCMI;

/// Lets the relay run when requested; call it once, before the control interrupt starts.
pub fn enable_relay() {
    // SAFETY: its handler below uses nothing that has to be initialised first.
    unsafe { RELAY.enable() };
}

#[interrupt]
fn DCMI() {
    for state in [&USB, &SERIAL] {
        // Not one swap: requested again in between, the relay runs again.
        if state.wake.load(Ordering::Relaxed) {
            state.wake.store(false, Ordering::Relaxed);
            state.outgoing.signal(());
        }
    }
}

//! Talking to a board: requests with sequence numbers, repeats, time limits, and what comes unasked.

mod interrupt;
mod movement;
mod session;

use std::collections::VecDeque;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use shared::protocol::{
    BoardMessage, Decoder, EncodeError, Fault, FrameCounters, FrameError, HostMessage, Info, MAX_FRAME,
    PROTOCOL_VERSION, Refusal, Reply, Request, encode_host_message,
};

pub use interrupt::{AskedBy, Interrupt};
pub use movement::{Movement, MovementPlan, MovementProgress, MovementWatcher, Unwatched};
pub use session::{ModelReceipt, Pose, SessionError};

use crate::link::{Link, LinkError};

/// How long to wait for an answer before asking again.
const REPLY_TIMEOUT: Duration = Duration::from_millis(250);
/// How often to ask.
const ATTEMPTS: u32 = 8;
/// How long a connection that broke has to come back. Not longer than anybody would wait before looking at the cable.
const RETURN_TIMEOUT: Duration = Duration::from_secs(5);

/// A connection to a board that has answered the handshake.
pub struct Client {
    link: Box<dyn Link>,
    decoder: Decoder,
    received: VecDeque<u8>,
    unasked: VecDeque<BoardMessage>,
    sequence: u32,
    repeats: u32,
    reconnections: u32,
    info: Info,
    interrupt: Interrupt,
}

/// Why a request brought nothing.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The connection could not be made, or broke.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The board does not answer.
    #[error(
        "no answer from {address} to {request} in {attempts} attempts of {} ms; check that armid's firmware is running \
         there (reset the board), and the baud rate of a serial line", timeout.as_millis()
    )]
    NoAnswer {
        /// The board.
        address: String,
        /// What was asked.
        request: &'static str,
        /// How often.
        attempts: u32,
        /// How long each time.
        timeout: Duration,
    },
    /// Board and host speak different versions.
    #[error(
        "the board speaks protocol version {board} (firmware {firmware}), this tool version {PROTOCOL_VERSION}; update \
         the {older}", older = if *board < PROTOCOL_VERSION { "firmware" } else { "tool" }
    )]
    WrongVersion {
        /// The board's version.
        board: u8,
        /// The firmware's version.
        firmware: String,
    },
    /// The board refused.
    #[error("the board refused {request}: {refusal}")]
    Refused {
        /// What was asked.
        request: &'static str,
        /// Why not.
        refusal: Refusal,
    },
    /// The board answered something else.
    #[error("the board answered {request} with something else; reset it, and report this if it happens again")]
    Unexpected {
        /// What was asked.
        request: &'static str,
    },
    /// The board switched off.
    #[error("the board switched the amplifiers off: {0}")]
    Fault(Fault),
    /// A request does not fit a frame.
    #[error("a request could not be sent: {0}")]
    Encode(#[from] EncodeError),
}

impl Client {
    /// Greets the board behind `link`.
    #[expect(clippy::disallowed_methods, reason = "only a number that differs from start to start")]
    pub fn connect(link: Box<dyn Link>) -> Result<Self, ClientError> {
        // Another start than the last program's, so that none of its requests can be taken for one of these.
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self::connect_from(link, since_1970.as_millis() as u32)
    }

    /// Greets the board behind `link`, with sequence numbers that follow `sequence`: the same bytes in every run, for a
    /// board that is new in every run.
    pub fn connect_from(mut link: Box<dyn Link>, sequence: u32) -> Result<Self, ClientError> {
        // Whatever an earlier program left in the pipes is read and thrown away; the hello sets the sequence.
        let mut rest = [0; 256];
        while link.receive(&mut rest, Duration::from_millis(1))? == rest.len() {}
        let mut client = Self {
            link,
            decoder: Decoder::new(),
            received: VecDeque::new(),
            unasked: VecDeque::new(),
            sequence,
            repeats: 0,
            reconnections: 0,
            info: empty_info(),
            interrupt: Interrupt::default(),
        };
        client.info = client.hello()?;
        Ok(client)
    }

    /// Greets the board again, for its counters of now.
    pub fn hello(&mut self) -> Result<Info, ClientError> {
        match self.request(Request::Hello { protocol_version: PROTOCOL_VERSION })? {
            Reply::Info(info) => Ok(info),
            _ => Err(ClientError::Unexpected { request: "hello" }),
        }
    }

    /// Lets `interrupt` end a movement before its time. Asked once, it ends every later movement too.
    pub fn end_movements_on(&mut self, interrupt: Interrupt) {
        self.interrupt = interrupt;
    }

    /// Who the board is, from the handshake.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// Where the link leads.
    pub fn address(&self) -> String {
        self.link.name()
    }

    /// How often a request had to be repeated.
    pub fn repeats(&self) -> u32 {
        self.repeats
    }

    /// How often the connection broke and came back.
    pub fn reconnections(&self) -> u32 {
        self.reconnections
    }

    /// Frames received, and thrown away.
    pub fn frames(&self) -> FrameCounters {
        self.decoder.counters()
    }

    /// Time on the link's clock.
    pub fn now(&self) -> Duration {
        self.link.now()
    }

    /// Asks until the board answers; a refusal is an error.
    pub fn request(&mut self, request: Request) -> Result<Reply, ClientError> {
        let name = request_name(&request);
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let mut buffer = [0; MAX_FRAME];
        let frame = encode_host_message(&HostMessage { sequence, request }, &mut buffer)?;
        for attempt in 0..ATTEMPTS {
            self.repeats += u32::from(attempt > 0);
            self.send(frame)?;
            let until = self.link.now() + REPLY_TIMEOUT;
            while let Some(message) = self.read_message(until)? {
                match message {
                    BoardMessage::Reply { reply: Reply::WrongVersion { board, firmware_version, .. }, .. } => {
                        return Err(ClientError::WrongVersion { board, firmware: firmware_version.to_string() });
                    }
                    BoardMessage::Reply { sequence: of, reply } if of == sequence => {
                        return match reply {
                            Reply::Refused(refusal) => Err(ClientError::Refused { request: name, refusal }),
                            reply => Ok(reply),
                        };
                    }
                    // The answer to an earlier attempt at something else.
                    BoardMessage::Reply { .. } => {}
                    unasked => self.unasked.push_back(unasked),
                }
            }
        }
        Err(ClientError::NoAnswer {
            address: self.link.name(),
            request: name,
            attempts: ATTEMPTS,
            timeout: REPLY_TIMEOUT,
        })
    }

    /// Asks for something that is answered by [`Reply::Done`].
    pub fn command(&mut self, request: Request) -> Result<(), ClientError> {
        let name = request_name(&request);
        match self.request(request)? {
            Reply::Done => Ok(()),
            _ => Err(ClientError::Unexpected { request: name }),
        }
    }

    /// The next telemetry row or event, waiting for it until `until` on the link's clock.
    pub fn next_unasked(&mut self, until: Duration) -> Result<Option<BoardMessage>, ClientError> {
        if let Some(message) = self.unasked.pop_front() {
            return Ok(Some(message));
        }
        while let Some(message) = self.read_message(until)? {
            if !matches!(message, BoardMessage::Reply { .. }) {
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    /// Sends a frame, over a new connection where the last one broke.
    fn send(&mut self, frame: &[u8]) -> Result<(), ClientError> {
        match self.link.send(frame) {
            Err(broken @ LinkError::Broken { .. }) => {
                self.reconnect(broken)?;
                Ok(self.link.send(frame)?)
            }
            sent => Ok(sent?),
        }
    }

    /// Waits for a connection that broke to come back. The board does not notice: it knows the link by its sequence
    /// numbers, so a request that was under way is simply repeated, and rows that were lost are read again.
    fn reconnect(&mut self, broken: LinkError) -> Result<(), ClientError> {
        // Why it broke is what matters, not how the attempts to open it again ended.
        self.link.reopen(RETURN_TIMEOUT).map_err(|_| broken)?;
        self.reconnections += 1;
        Ok(())
    }

    /// The next message of any kind; none if `until` passes first.
    fn read_message(&mut self, until: Duration) -> Result<Option<BoardMessage>, ClientError> {
        loop {
            while let Some(byte) = self.received.pop_front() {
                match self.decoder.board_message(byte) {
                    Some(Ok(message)) => return Ok(Some(message)),
                    Some(Err(FrameError::Version { theirs, .. })) => {
                        return Err(ClientError::WrongVersion { board: theirs, firmware: "unknown".into() });
                    }
                    // Damaged frames are counted by the decoder; what was in them is asked for again.
                    Some(Err(_)) | None => {}
                }
            }
            let now = self.link.now();
            if now >= until {
                return Ok(None);
            }
            let mut buffer = [0; 4096];
            match self.link.receive(&mut buffer, until - now) {
                Ok(count) => self.received.extend(&buffer[..count]),
                Err(broken @ LinkError::Broken { .. }) => self.reconnect(broken)?,
                Err(error) => return Err(error.into()),
            }
        }
    }
}

/// Stands in until the handshake is over.
fn empty_info() -> Info {
    Info {
        protocol_version: 0,
        identity: shared::protocol::BoardIdentity {
            firmware_version: heapless::String::new(),
            git_revision: heapless::String::new(),
            board: heapless::String::new(),
            chip_id: [0; 12],
            chip_revision: 0,
            reset_cause: shared::protocol::ResetCause::Other,
        },
        recording_capacity: 0,
        knot_capacity: 0,
        robot_identity: None,
        last_fault: None,
        timing: Default::default(),
        links: Default::default(),
    }
}

/// A request's name for messages.
fn request_name(request: &Request) -> &'static str {
    match request {
        Request::Hello { .. } => "hello",
        Request::Status => "the question for its status",
        Request::KeepAlive => "a keep-alive",
        Request::Configure(_) => "robot constants",
        Request::ApplyConfiguration { .. } => "applying the robot constants",
        Request::SetPosition { .. } => "declaring the pose",
        Request::Arm => "arming",
        Request::Disarm => "disarming",
        Request::LoadTrajectory(_) => "the trajectory",
        Request::ReadTrajectory => "the question for the trajectory",
        Request::Run { .. } => "running",
        Request::Stop => "stopping",
        Request::RecordingInfo => "the question for the recording",
        Request::ReadRecording { .. } => "reading the recording",
        Request::StageModel { .. } => "staging the model",
        Request::CommitModel { .. } => "activating the model",
        Request::ReadModel(_) => "reading the model back",
        Request::ClearFault => "clearing the fault",
        Request::ForgetParameters => "forgetting the stored parameters",
        Request::IdentifyLoad(_) => "identifying loads",
        Request::UseLoad(_) => "using a load",
        Request::ForgetLoad => "forgetting the load",
        Request::ReadLoad => "the question for the load",
    }
}

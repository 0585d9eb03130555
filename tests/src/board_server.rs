//! An emulated board behind a TCP port, for one host at a time.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use armid::link::{Link as _, LinkError};

use crate::emulated_board::probe::DebugProbe;
use crate::emulated_board::{EmulatedBoard, EmulatedLink};

/// How long the board runs between two looks at the host and the clock.
const STEP: Duration = Duration::from_millis(1);
/// How far the board may run ahead of the last thing it heard, where the host sets the pace: less than the board waits
/// for its host during a movement.
const LONGEST_SILENCE: Duration = Duration::from_millis(400);
/// How far the board's time may fall behind before this is given up and told.
const LARGEST_LAG: Duration = Duration::from_millis(250);
/// How long to wait for a host that sets the pace before looking for others.
const LOOK_AROUND: Duration = Duration::from_millis(20);
/// Most bytes kept for a host that does not read; the line has no handshake, so the rest is lost.
const MOST_WAITING_BYTES: usize = 1 << 20;

/// What a second host is told before it is let go.
const BUSY: &[u8] = b"The emulated board is talking to another host; try again when that one has gone.\n";

/// What drives the board's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// The clock on the wall, as far as this computer is fast enough.
    RealTime,
    /// The host: the board stands still while it has not heard from one for a while, nor a debug probe is in use. Then
    /// nothing depends on how fast this computer is.
    Host,
}

/// What happens meanwhile, to be told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ServerEvent {
    /// A host has connected.
    Connected(String),
    /// The host has gone.
    Gone,
    /// A second host was let go.
    Refused(String),
    /// This computer is too slow: the board's time has fallen behind by so much more.
    Lagging(Duration),
}

/// Why serving ended.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The port.
    #[error("the port cannot be used: {0}")]
    Port(#[from] std::io::Error),
    /// The emulation.
    #[error("the emulation ended: {0}")]
    Board(#[from] LinkError),
}

/// Serves `board` to whoever connects to `listener`, for ever.
pub fn serve(
    listener: &TcpListener,
    board: &EmulatedBoard,
    pace: Pace,
    tell: &mut dyn FnMut(ServerEvent),
) -> Result<std::convert::Infallible, ServerError> {
    listener.set_nonblocking(true)?;
    let mut link = board.link();
    let mut host: Option<Host> = None;
    let mut clock = Clock::new(&link);
    loop {
        match listener.accept() {
            Ok((stream, address)) => {
                // One that left just before the new one came has left, even if nobody has looked since.
                let present = host.as_mut().map_or(Ok(false), |host| host.is_still_there(&mut link))?;
                if host.is_some() && !present {
                    host = None;
                    tell(ServerEvent::Gone);
                }
                if present {
                    refuse(stream);
                    tell(ServerEvent::Refused(address.to_string()));
                } else {
                    host = Some(Host::new(stream, link.now())?);
                    tell(ServerEvent::Connected(address.to_string()));
                }
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => return Err(error.into()),
        }
        let is_probed = board.probe().is_some_and(DebugProbe::is_in_use);
        let board_waits = pace == Pace::Host
            && !is_probed
            && host.as_ref().is_none_or(|host| link.now() >= host.heard + LONGEST_SILENCE);
        if let Some(connected) = &mut host
            && connected.exchange(&mut link, board_waits)?.is_none()
        {
            host = None;
            tell(ServerEvent::Gone);
        }
        if board_waits {
            if host.is_none() {
                std::thread::sleep(LOOK_AROUND);
            }
            continue;
        }
        let mut bytes = [0; 4096];
        let count = link.receive(&mut bytes, STEP)?;
        if let Some(host) = &mut host {
            host.keep(&bytes[..count]);
        }
        if pace == Pace::RealTime
            && let Some(lag) = clock.keep_pace(&link)
        {
            tell(ServerEvent::Lagging(lag));
        }
    }
}

/// Says why, and closes.
fn refuse(mut stream: TcpStream) {
    // Whether the other end still reads it is its own affair.
    let _ = stream.write_all(BUSY);
    let _ = stream.shutdown(Shutdown::Both);
}

/// The host being served.
struct Host {
    stream: TcpStream,
    /// When it was last heard, on the board's clock.
    heard: Duration,
    /// Not yet taken.
    waiting: Vec<u8>,
}

impl Host {
    fn new(stream: TcpStream, now: Duration) -> Result<Self, std::io::Error> {
        stream.set_nodelay(true)?;
        Ok(Self { stream, heard: now, waiting: Vec::new() })
    }

    fn keep(&mut self, bytes: &[u8]) {
        let room = MOST_WAITING_BYTES - self.waiting.len();
        self.waiting.extend_from_slice(&bytes[..bytes.len().min(room)]);
    }

    /// Takes what it has sent, and sees whether the end of the connection is behind that.
    fn is_still_there(&mut self, link: &mut EmulatedLink) -> Result<bool, ServerError> {
        loop {
            if self.exchange(link, false)?.is_none() {
                return Ok(false);
            }
            match self.stream.peek(&mut [0]) {
                Ok(0) => return Ok(false),
                Ok(_) => {}
                Err(error) => return Ok(error.kind() == ErrorKind::WouldBlock),
            }
        }
    }

    /// Hands bytes over in both directions; waits for the host a moment if `wait`. None when the host has gone.
    fn exchange(&mut self, link: &mut EmulatedLink, wait: bool) -> Result<Option<()>, ServerError> {
        self.stream.set_nonblocking(true)?;
        while !self.waiting.is_empty() {
            match self.stream.write(&self.waiting) {
                Ok(0) => return Ok(None),
                Ok(count) => drop(self.waiting.drain(..count)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => return Ok(None),
            }
        }
        if wait {
            self.stream.set_nonblocking(false)?;
            self.stream.set_read_timeout(Some(LOOK_AROUND))?;
        }
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => Ok(None),
            Ok(count) => {
                self.heard = link.now();
                link.send(&bytes[..count])?;
                Ok(Some(()))
            }
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
            {
                Ok(Some(()))
            }
            Err(_) => Ok(None),
        }
    }
}

/// Board's time against the wall's.
struct Clock {
    /// Where both were together.
    wall: Instant,
    board: Duration,
}

impl Clock {
    fn new(link: &EmulatedLink) -> Self {
        Self { wall: Instant::now(), board: link.now() }
    }

    /// Waits where the board is ahead. Where it is too far behind, says by how much, and starts afresh from here.
    fn keep_pace(&mut self, link: &EmulatedLink) -> Option<Duration> {
        let board = link.now() - self.board;
        let wall = self.wall.elapsed();
        if let Some(ahead) = board.checked_sub(wall) {
            std::thread::sleep(ahead);
            return None;
        }
        let behind = wall - board;
        if behind < LARGEST_LAG {
            return None;
        }
        *self = Self::new(link);
        Some(behind)
    }
}

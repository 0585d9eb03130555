//! Ways to reach a board: bytes out, bytes in, and a clock to time both by.

mod open;
mod serial;
mod simulated;
mod tcp;
pub mod usb;

use std::time::Duration;

pub use open::{Address, AddressError, open};
pub use serial::SerialLink;
pub use simulated::{FlashHistory, LoadChange, MemoryFlash, POWER_CUT, SimulatedBoard, TorqueNoise, complete};
pub use tcp::TcpLink;

/// A byte stream to a board.
pub trait Link {
    /// Sends all of `bytes`.
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError>;

    /// Waits for bytes for at most `timeout`, puts them into `buffer` and says how many: 0 where none came.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError>;

    /// Opens a connection that broke again, waiting for the board to come back for at most `timeout`: a USB port is gone
    /// for a while when its cable is pulled. A link that cannot come back says that it is broken.
    fn reopen(&mut self, timeout: Duration) -> Result<(), LinkError> {
        let _ = timeout;
        Err(LinkError::Broken { address: self.name(), reason: "it cannot be opened again".into() })
    }

    /// Time on the link's clock: real time for a real board, virtual time for a simulated one.
    fn now(&self) -> Duration;

    /// Where the link leads, for messages.
    fn name(&self) -> String;
}

/// A board that cannot be reached.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The connection could not be made.
    #[error("cannot connect to {address}: {reason}; {remedy}")]
    Connect {
        /// Where to.
        address: String,
        /// What the system says.
        reason: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The connection broke.
    #[error("the connection to {address} broke: {reason}; check cable and power, then connect again")]
    Broken {
        /// Where to.
        address: String,
        /// What the system says.
        reason: String,
    },
    /// No board was given and none was found.
    #[error(
        "no board was found on USB; connect one, name it with --board serial:PATH or --board tcp:HOST:PORT, or use \
         the simulated one: --board sim{}",
        st_link_advice(st_links)
    )]
    NoBoard {
        /// Ports behind which a board may be.
        st_links: usb::Candidates,
    },
    /// No board was given and several were found.
    #[error("several boards are connected: {found}; choose one with --board usb:SERIAL or --board serial:PATH")]
    SeveralBoards {
        /// All of them.
        found: usb::Candidates,
    },
    /// The board named is not connected.
    #[error(
        "no board with the serial number {serial_number} is on USB; {}",
        if found.0.is_empty() { "nor is any other: connect it".into() } else { format!("there are: {found}") }
    )]
    NoSuchBoard {
        /// The one named.
        serial_number: String,
        /// Those that are there.
        found: usb::Candidates,
    },
}

fn st_link_advice(st_links: &usb::Candidates) -> String {
    let Some(first) = st_links.0.first() else { return String::new() };
    format!(". An ST-LINK is connected: try its serial port, --board serial:{}", first.path)
}

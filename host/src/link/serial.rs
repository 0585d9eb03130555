//! A board on a serial line, the ST-LINK's virtual COM port among them.

use std::io::{ErrorKind, Read as _, Write as _};
use std::time::{Duration, Instant};

use serialport::SerialPort;

use super::{Link, LinkError};

/// How long one write may take: a frame lasts 3 ms at the default rate.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// A serial line to a board.
pub struct SerialLink {
    port: Box<dyn SerialPort>,
    path: String,
    start: Instant,
}

impl SerialLink {
    /// Opens the line at `path` with `baud` bits per second.
    pub fn open(path: &str, baud: u32) -> Result<Self, LinkError> {
        let port = serialport::new(path, baud).timeout(WRITE_TIMEOUT).open().map_err(|error| LinkError::Connect {
            address: format!("serial:{path}"),
            reason: error.to_string(),
            remedy: "check the path, that no other program has it open, and that you may use it (group dialout)",
        })?;
        Ok(Self { port, path: path.into(), start: Instant::now() })
    }

    fn broken(&self, reason: impl ToString) -> LinkError {
        LinkError::Broken { address: self.name(), reason: reason.to_string() }
    }
}

impl Link for SerialLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.port.set_timeout(WRITE_TIMEOUT).map_err(|error| self.broken(error))?;
        self.port.write_all(bytes).map_err(|error| self.broken(error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        self.port.set_timeout(timeout).map_err(|error| self.broken(error))?;
        match self.port.read(buffer) {
            Ok(count) => Ok(count),
            Err(error)
                if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                Ok(0)
            }
            Err(error) => Err(self.broken(error)),
        }
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn name(&self) -> String {
        format!("serial:{}", self.path)
    }
}

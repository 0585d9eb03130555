//! A board on a serial line, the ST-LINK's virtual COM port among them.

use std::io::{ErrorKind, Read as _, Write as _};
use std::time::{Duration, Instant};

use serialport::SerialPort;

use super::usb::UsbPort;
use super::{Link, LinkError};

/// How long one write may take: a frame lasts 3 ms at the default rate.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// Bits per second asked for on USB, where the number means nothing.
const USB_BAUD: u32 = 1_000_000;

/// A serial line to a board.
pub struct SerialLink {
    port: Box<dyn SerialPort>,
    name: String,
    start: Instant,
}

impl SerialLink {
    /// Opens the line at `path` with `baud` bits per second.
    pub fn open(path: &str, baud: u32) -> Result<Self, LinkError> {
        Self::open_named(path, baud, format!("serial:{path}"))
    }

    /// Opens the port of a board on USB.
    pub fn open_usb(board: &UsbPort) -> Result<Self, LinkError> {
        Self::open_named(&board.path, USB_BAUD, board.to_string())
    }

    fn open_named(path: &str, baud: u32, name: String) -> Result<Self, LinkError> {
        // The board on USB sends only to a host that says it is there, which is what this line says.
        let port = serialport::new(path, baud).timeout(WRITE_TIMEOUT).dtr_on_open(true).open();
        let port = port.map_err(|error| LinkError::Connect {
            address: name.clone(),
            reason: error.to_string(),
            remedy: remedy(error.kind()),
        })?;
        Ok(Self { port, name, start: Instant::now() })
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
        self.name.clone()
    }
}

/// What to do about a port that does not open.
fn remedy(kind: serialport::ErrorKind) -> &'static str {
    match kind {
        serialport::ErrorKind::Io(ErrorKind::PermissionDenied) if cfg!(target_os = "linux") => {
            "install armid's udev rules (host/udev/60-armid.rules, see the README) and plug the board in again, or join \
             the group dialout"
        }
        // This is how the library calls a port that another program holds.
        serialport::ErrorKind::NoDevice => {
            "another program has it open; ModemManager looks at every new port for some seconds unless armid's udev \
             rules (host/udev/60-armid.rules) tell it not to"
        }
        _ => "check the path, that no other program has it open, and that you may use it (udev rules, group dialout)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_may_not_be_used_is_told_from_one_that_is_not_there() {
        let denied = remedy(serialport::ErrorKind::Io(ErrorKind::PermissionDenied));
        assert!(denied.contains("60-armid.rules") || !cfg!(target_os = "linux"), "{denied}");
        assert!(remedy(serialport::ErrorKind::NoDevice).contains("ModemManager"));
        assert!(remedy(serialport::ErrorKind::Io(ErrorKind::NotFound)).contains("check the path"));
    }
}

//! A board on a serial line, the ST-LINK's virtual COM port among them.

use std::io::{ErrorKind, Read as _, Write as _};
use std::time::{Duration, Instant};

use serialport::SerialPort;

use super::usb::{self, UsbPort};
use super::{Link, LinkError};

/// How long one write may take: a frame lasts 3 ms at the default rate.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// Bits per second asked for on USB, where the number means nothing.
const USB_BAUD: u32 = 1_000_000;

/// How long to wait between two attempts to open a port that went away.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// Where a serial port is found, now and after it went away.
#[derive(Clone, Debug)]
enum Place {
    /// Always under the same name.
    Line {
        /// Device file or port name.
        path: String,
        /// Bits per second.
        baud: u32,
    },
    /// Wherever the system puts this board.
    Usb(UsbPort),
}

impl Place {
    fn name(&self) -> String {
        match self {
            Self::Line { path, .. } => format!("serial:{path}"),
            Self::Usb(board) => board.to_string(),
        }
    }

    fn open(&self) -> Result<Box<dyn SerialPort>, LinkError> {
        let (path, baud) = match self {
            Self::Line { path, baud } => (path, *baud),
            Self::Usb(board) => (&board.path, USB_BAUD),
        };
        // The board on USB sends only to a host that says it is there, which is what this line says.
        let port = serialport::new(path, baud).timeout(WRITE_TIMEOUT).dtr_on_open(true).open();
        port.map_err(|error| LinkError::Connect {
            address: self.name(),
            reason: error.to_string(),
            remedy: remedy(error.kind()),
        })
    }

    /// The same board, which may have another name by now.
    fn found_again(&self) -> Result<Self, LinkError> {
        match self {
            Self::Usb(board) if board.serial_number.is_some() => {
                usb::choose(&usb::ports(), board.serial_number.as_deref()).map(Self::Usb)
            }
            same => Ok(same.clone()),
        }
    }
}

/// A serial line to a board.
pub struct SerialLink {
    port: Box<dyn SerialPort>,
    place: Place,
    start: Instant,
}

impl SerialLink {
    /// Opens the line at `path` with `baud` bits per second.
    pub fn open(path: &str, baud: u32) -> Result<Self, LinkError> {
        Self::open_at(Place::Line { path: path.into(), baud })
    }

    /// Opens the port of a board on USB.
    pub fn open_usb(board: &UsbPort) -> Result<Self, LinkError> {
        Self::open_at(Place::Usb(board.clone()))
    }

    fn open_at(place: Place) -> Result<Self, LinkError> {
        Ok(Self { port: place.open()?, place, start: Instant::now() })
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

    fn reopen(&mut self, timeout: Duration) -> Result<(), LinkError> {
        let until = Instant::now() + timeout;
        loop {
            let opened = self.place.found_again().and_then(|place| Ok((place.open()?, place)));
            match opened {
                Ok((port, place)) => {
                    (self.port, self.place) = (port, place);
                    return Ok(());
                }
                Err(error) if Instant::now() >= until => return Err(error),
                Err(_) => std::thread::sleep(LOOK_AGAIN),
            }
        }
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn name(&self) -> String {
        self.place.name()
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

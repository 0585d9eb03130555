//! `--board`: the name of a board, and opening the link to it.

use std::str::FromStr;

use super::{Link, LinkError, SerialLink, SimulatedBoard, TcpLink, usb};
use crate::robot::Robot;

/// Baud rate of a serial line where none is given: what the firmware sets its USART to.
const DEFAULT_BAUD: u32 = 1_000_000;

/// Where a board is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// On USB: the one with this serial number, or the only one.
    Usb {
        /// Serial number of the board.
        serial_number: Option<String>,
    },
    /// At a TCP address: an emulated board, or a serial server.
    Tcp(String),
    /// On a serial line.
    Serial {
        /// Device file or port name.
        path: String,
        /// Bits per second.
        baud: u32,
    },
    /// Inside this process.
    Simulated,
}

/// A board's name that is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" names no board; use usb, usb:SERIAL, tcp:HOST:PORT, serial:PATH, serial:PATH@BAUD or sim")]
pub struct AddressError(String);

impl Address {
    /// The only board on USB: what is meant where no board is named.
    pub const ANY_USB: Self = Self::Usb { serial_number: None };

    /// The serial line at `path`, at the firmware's baud rate.
    pub fn serial(path: String) -> Self {
        Self::Serial { path, baud: DEFAULT_BAUD }
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let refuse = || AddressError(text.to_string());
        if let Some(address) = text.strip_prefix("tcp:") {
            let (host, port) = address.rsplit_once(':').ok_or_else(refuse)?;
            let port_is_number = port.parse::<u16>().is_ok_and(|port| port != 0);
            return if host.is_empty() || !port_is_number { Err(refuse()) } else { Ok(Self::Tcp(address.into())) };
        }
        if let Some(line) = text.strip_prefix("serial:") {
            let (path, baud) = match line.rsplit_once('@') {
                Some((path, baud)) => (path, baud.parse().map_err(|_| refuse())?),
                None => (line, DEFAULT_BAUD),
            };
            return if path.is_empty() || baud == 0 {
                Err(refuse())
            } else {
                Ok(Self::Serial { path: path.into(), baud })
            };
        }
        if let Some(serial_number) = text.strip_prefix("usb:") {
            let serial_number = Some(serial_number.to_string());
            return if serial_number.as_deref() == Some("") { Err(refuse()) } else { Ok(Self::Usb { serial_number }) };
        }
        match text {
            "usb" => Ok(Self::ANY_USB),
            "sim" => Ok(Self::Simulated),
            _ => Err(refuse()),
        }
    }
}

/// Opens the link to the board at `address`. A simulated board's hidden robot is drawn from `seed` around `robot`.
pub fn open(address: &Address, robot: &Robot, seed: u64) -> Result<Box<dyn Link>, LinkError> {
    match address {
        Address::Usb { serial_number } => {
            let board = usb::choose(&usb::ports(), serial_number.as_deref())?;
            Ok(Box::new(SerialLink::open_usb(&board)?))
        }
        Address::Tcp(address) => Ok(Box::new(TcpLink::connect(address)?)),
        Address::Serial { path, baud } => Ok(Box::new(SerialLink::open(path, *baud)?)),
        Address::Simulated => Ok(Box::new(SimulatedBoard::hidden(robot, seed))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read() {
        assert_eq!("sim".parse(), Ok(Address::Simulated));
        assert_eq!("usb".parse(), Ok(Address::ANY_USB));
        assert_eq!("usb:12AB".parse(), Ok(Address::Usb { serial_number: Some("12AB".into()) }));
        assert_eq!("tcp:localhost:2000".parse(), Ok(Address::Tcp("localhost:2000".into())));
        assert_eq!("tcp:[::1]:2000".parse(), Ok(Address::Tcp("[::1]:2000".into())));
        let line = |path: &str, baud| Ok(Address::Serial { path: path.into(), baud });
        assert_eq!("serial:/dev/ttyACM0".parse(), line("/dev/ttyACM0", DEFAULT_BAUD));
        assert_eq!("serial:COM3@115200".parse(), line("COM3", 115_200));
    }

    #[test]
    fn other_names_are_refused() {
        for text in ["", "simulated", "usb:", "tcp:", "tcp:host", "tcp::1", "tcp:host:0", "serial:", "serial:x@fast"] {
            assert_eq!(text.parse::<Address>(), Err(AddressError(text.into())));
        }
    }
}

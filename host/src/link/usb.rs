//! Which of the computer's serial ports is a board.

use std::fmt;
use std::path::Path;

use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
use shared::protocol::usb::{PRODUCT, PRODUCT_ID, VENDOR_ID};

use super::LinkError;

/// USB vendor of the debug probes on ST's boards.
const ST_VENDOR_ID: u16 = 0x0483;
/// Products of that vendor that have a serial port: ST-LINK/V2-1 with and without a disk, and ST-LINK/V3.
const ST_LINK_PRODUCT_IDS: [u16; 5] = [0x374b, 0x3752, 0x374e, 0x374f, 0x3753];

/// A serial port that is, or leads to, a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbPort {
    /// Device file or port name.
    pub path: String,
    /// Serial number of the USB device, where it has one.
    pub serial_number: Option<String>,
}

impl fmt::Display for UsbPort {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.serial_number {
            Some(serial_number) => write!(formatter, "usb:{serial_number} ({})", self.path),
            None => write!(formatter, "serial:{} (has no serial number)", self.path),
        }
    }
}

/// The serial ports of this computer. None where the system cannot list any.
pub fn ports() -> Vec<SerialPortInfo> {
    // The library takes it for granted that Linux has this folder; a container need not.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_default()
}

/// The boards among `ports`, by path.
pub fn boards(ports: &[SerialPortInfo]) -> Vec<UsbPort> {
    // The numbers are shared with other devices under test, which call themselves otherwise; Windows tells the name of its
    // driver instead.
    let is_named_otherwise = |name: &String| !cfg!(windows) && name != PRODUCT;
    matching(ports, |usb| {
        (usb.vid, usb.pid) == (VENDOR_ID, PRODUCT_ID) && !usb.product.as_ref().is_some_and(is_named_otherwise)
    })
}

/// The virtual serial ports of ST-LINK probes among `ports`, by path. What is behind them is not known until it is
/// asked.
pub fn st_links(ports: &[SerialPortInfo]) -> Vec<UsbPort> {
    matching(ports, |usb| usb.vid == ST_VENDOR_ID && ST_LINK_PRODUCT_IDS.contains(&usb.pid))
}

/// The board among `ports`: the one with `serial_number` where one is named, else the only one.
pub fn choose(ports: &[SerialPortInfo], serial_number: Option<&str>) -> Result<UsbPort, LinkError> {
    let boards = boards(ports);
    let list = || Candidates(boards.clone());
    match (boards.as_slice(), serial_number) {
        (_, Some(wanted)) => {
            let mut named = boards.iter().filter(|board| board.serial_number.as_deref() == Some(wanted));
            let found = named.next().cloned();
            found.ok_or_else(|| LinkError::NoSuchBoard { serial_number: wanted.into(), found: list() })
        }
        ([board], None) => Ok(board.clone()),
        ([], None) => Err(LinkError::NoBoard { st_links: Candidates(st_links(ports)) }),
        (_, None) => Err(LinkError::SeveralBoards { found: list() }),
    }
}

fn matching(ports: &[SerialPortInfo], wanted: impl Fn(&UsbPortInfo) -> bool) -> Vec<UsbPort> {
    let mut found: Vec<UsbPort> = ports
        .iter()
        // macOS lists every port twice; opening the `tty` one waits for a carrier that no board gives.
        .filter(|port| !(cfg!(target_os = "macos") && port.port_name.starts_with("/dev/tty.")))
        .filter_map(|port| match &port.port_type {
            SerialPortType::UsbPort(usb) if wanted(usb) => Some(UsbPort {
                path: port.port_name.clone(),
                serial_number: usb.serial_number.clone().filter(|number| !number.is_empty()),
            }),
            _ => None,
        })
        .collect();
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

/// Ports to choose from, for messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Candidates(pub Vec<UsbPort>);

impl fmt::Display for Candidates {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, port) in self.0.iter().enumerate() {
            write!(formatter, "{}{port}", if index == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usb(path: &str, vid: u16, pid: u16, serial_number: Option<&str>) -> SerialPortInfo {
        let serial_number = serial_number.map(Into::into);
        let info = UsbPortInfo { vid, pid, serial_number, manufacturer: None, product: None, interface: None };
        SerialPortInfo { port_name: path.into(), port_type: SerialPortType::UsbPort(info) }
    }

    fn board(path: &str, serial_number: &str) -> SerialPortInfo {
        usb(path, VENDOR_ID, PRODUCT_ID, Some(serial_number))
    }

    fn named(mut port: SerialPortInfo, product: &str) -> SerialPortInfo {
        if let SerialPortType::UsbPort(usb) = &mut port.port_type {
            usb.product = Some(product.into());
        }
        port
    }

    fn others() -> Vec<SerialPortInfo> {
        vec![
            SerialPortInfo { port_name: "/dev/ttyS0".into(), port_type: SerialPortType::PciPort },
            usb("/dev/ttyUSB0", 0x0403, 0x6001, Some("A1")),
            usb("/dev/ttyACM9", VENDOR_ID, PRODUCT_ID + 1, Some("A1")),
            named(board("/dev/ttyACM8", "A1"), "another device under test"),
        ]
    }

    #[test]
    fn the_only_board_is_taken_whatever_else_is_connected() {
        let mut ports = others();
        ports.push(named(board("/dev/ttyACM1", "A1"), PRODUCT));
        let expected = UsbPort { path: "/dev/ttyACM1".into(), serial_number: Some("A1".into()) };
        assert_eq!(choose(&ports, None).unwrap(), expected);
        assert_eq!(choose(&ports, Some("A1")).unwrap(), expected);
    }

    #[test]
    fn of_several_boards_one_must_be_named() {
        let ports = [board("/dev/ttyACM3", "B2"), board("/dev/ttyACM1", "A1")];
        let told = choose(&ports, None).unwrap_err().to_string();
        for part in ["usb:A1 (/dev/ttyACM1), usb:B2 (/dev/ttyACM3)", "--board usb:SERIAL"] {
            assert!(told.contains(part), "{told}");
        }
        assert_eq!(choose(&ports, Some("B2")).unwrap().path, "/dev/ttyACM3");
        let told = choose(&ports, Some("C3")).unwrap_err().to_string();
        assert!(told.contains("C3") && told.contains("usb:A1"), "{told}");
    }

    #[test]
    fn without_a_board_the_port_of_a_probe_is_proposed() {
        let told = choose(&others(), None).unwrap_err().to_string();
        assert!(told.contains("no board was found") && !told.contains("ST-LINK"), "{told}");
        let mut ports = others();
        ports.push(usb("/dev/ttyACM0", ST_VENDOR_ID, 0x374b, Some("066F")));
        let told = choose(&ports, None).unwrap_err().to_string();
        assert!(told.contains("ST-LINK") && told.contains("serial:/dev/ttyACM0"), "{told}");
        let told = choose(&ports, Some("066F")).unwrap_err().to_string();
        assert!(told.contains("066F"), "{told}");
    }

    #[test]
    fn a_board_without_a_serial_number_is_named_by_its_port() {
        let ports = [usb("COM4", VENDOR_ID, PRODUCT_ID, None), usb("COM3", VENDOR_ID, PRODUCT_ID, Some(""))];
        let told = choose(&ports, None).unwrap_err().to_string();
        assert!(told.contains("serial:COM3 ") && told.contains("serial:COM4 "), "{told}");
    }

    #[test]
    fn the_udev_rules_name_the_same_devices() {
        let rules = include_str!("../../udev/60-armid.rules");
        for subsystem in ["tty", "usb"] {
            let attribute = if subsystem == "tty" { "ATTRS" } else { "ATTR" };
            let rule = format!(
                "SUBSYSTEM==\"{subsystem}\", {attribute}{{idVendor}}==\"{VENDOR_ID:04x}\", \
                 {attribute}{{idProduct}}==\"{PRODUCT_ID:04x}\""
            );
            assert!(rules.contains(&rule), "no rule for {rule}");
        }
        assert!(rules.contains(&format!("\"{ST_VENDOR_ID:04x}\"")));
    }
}

//! Debug probes that `armid flash` may use, told by what they call themselves on USB, as probe-rs tells them.

use super::devices::UsbDevice;

/// What a device is as a debug probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// It can be used through its USB device, and is called so.
    Usb(&'static str),
    /// It is used through its serial port, and is called so.
    Serial(&'static str),
    /// It speaks CMSIS-DAP of the first version alone, over HID, which this tool is built without.
    OverHid,
}

/// Probes on ST's boards: ST-LINK/V2 to V3.
const ST_LINKS: [u16; 10] = [0x3742, 0x3748, 0x374a, 0x374b, 0x374e, 0x374f, 0x3752, 0x3753, 0x3754, 0x3757];
/// J-Links of the old numbering.
const OLD_J_LINKS: [u16; 7] = [0x0101, 0x0102, 0x0103, 0x0104, 0x0105, 0x0107, 0x0108];
/// J-Links of the new numbering have the first bit, and one of the other two: the drivers that can be used.
const J_LINK: u16 = 0x1000;
const J_LINK_DRIVERS: u16 = 0x0030;

/// The class of human interface devices.
const HID: u8 = 3;
/// The class of interfaces that are their maker's own.
const OWN: u8 = 0xff;

/// What `device` is, if it is a probe.
pub(super) fn kind(device: &UsbDevice) -> Option<Kind> {
    cmsis_dap(device).or_else(|| by_number(device.vendor_id, device.product_id))
}

fn by_number(vendor_id: u16, product_id: u16) -> Option<Kind> {
    let is_j_link = OLD_J_LINKS.contains(&product_id) || (product_id & J_LINK != 0 && product_id & J_LINK_DRIVERS != 0);
    Some(match (vendor_id, product_id) {
        (0x0483, product_id) if ST_LINKS.contains(&product_id) => Kind::Usb("ST-LINK"),
        (0x1366, _) if is_j_link => Kind::Usb("J-Link"),
        // The same chips are in plain serial adapters.
        (0x0403, 0x6010 | 0x6011 | 0x6014) => Kind::Usb("FTDI chip, if it is wired as a probe"),
        (0x15ba, 0x0003 | 0x0004 | 0x002a | 0x002b) => Kind::Usb("Olimex ARM-USB"),
        (0x1a86, 0x55dd | 0x55de | 0x55e8) => Kind::Usb("CH347"),
        (0x20b7, 0x9db1) => Kind::Usb("Glasgow"),
        (0x1d50, 0x6018) => Kind::Serial("Black Magic Probe"),
        _ => return None,
    })
}

/// Probes of many makers tell it in the names of their interfaces.
fn cmsis_dap(device: &UsbDevice) -> Option<Kind> {
    let of_class = |class: u8| {
        device
            .interfaces
            .iter()
            .any(|(of, name)| *of == class && (name.contains("CMSIS-DAP") || name.contains("CMSIS_DAP")))
    };
    if of_class(OWN) {
        return Some(Kind::Usb("CMSIS-DAP"));
    }
    of_class(HID).then_some(Kind::OverHid)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(vendor_id: u16, product_id: u16, interfaces: &[(u8, &str)]) -> UsbDevice {
        let interfaces = interfaces.iter().map(|&(class, name)| (class, name.to_string())).collect();
        UsbDevice { vendor_id, product_id, interfaces, node: Default::default() }
    }

    #[test]
    fn j_links_are_told_from_their_other_modes() {
        let kind = |product_id| kind(&device(0x1366, product_id, &[]));
        let j_link = Some(Kind::Usb("J-Link"));
        // The legacy driver, WinUSB, and an old one.
        assert_eq!([kind(0x1059), kind(0x1061), kind(0x0105)], [j_link; 3]);
        // As a CMSIS-DAP probe, and as a serial port alone.
        assert_eq!([kind(0x1008), kind(0x0106)], [None; 2]);
    }

    #[test]
    fn what_speaks_both_versions_of_cmsis_dap_can_be_used() {
        let kind = |interfaces: &[(u8, &str)]| kind(&device(0x2e8a, 0x000c, interfaces));
        let first = (HID, "CMSIS-DAP v1 Interface");
        assert_eq!(kind(&[first, (OWN, "CMSIS-DAP v2 Interface")]), Some(Kind::Usb("CMSIS-DAP")));
        assert_eq!(kind(&[first]), Some(Kind::OverHid));
        assert_eq!(kind(&[(2, "Debug Probe UART"), (HID, "keyboard")]), None);
    }
}

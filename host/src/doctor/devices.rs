//! What is connected and what runs, as Linux shows it in its file system.

use std::fs;
use std::path::{Path, PathBuf};

/// A device on USB.
pub(super) struct UsbDevice {
    pub vendor_id: u16,
    pub product_id: u16,
    /// Class and name of each interface that has a name.
    pub interfaces: Vec<(u8, String)>,
    /// Its device file.
    pub node: PathBuf,
}

/// A serial port on USB.
pub(super) struct SerialPort {
    pub vendor_id: u16,
    pub product_id: u16,
    /// What the device calls itself.
    pub product: Option<String>,
    pub serial_number: Option<String>,
    /// Its device file.
    pub node: PathBuf,
}

impl SerialPort {
    /// The port in words.
    pub fn name(&self) -> String {
        match &self.serial_number {
            Some(serial_number) => format!("usb:{serial_number}"),
            None => "without a serial number".into(),
        }
    }
}

fn text(folder: &Path, file: &str) -> Option<String> {
    fs::read_to_string(folder.join(file)).ok().map(|text| text.trim().to_string()).filter(|text| !text.is_empty())
}

fn hexadecimal(folder: &Path, file: &str) -> Option<u16> {
    u16::from_str_radix(&text(folder, file)?, 16).ok()
}

/// The interfaces of a device are folders in its own: `1-3:1.0` in `1-3`.
fn interfaces(device: &Path) -> Vec<(u8, String)> {
    let of = |folder: PathBuf| {
        Some((u8::try_from(hexadecimal(&folder, "bInterfaceClass")?).ok()?, text(&folder, "interface")?))
    };
    entries(device).into_iter().filter_map(of).collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// Every device on USB.
pub(super) fn usb_devices(root: &Path) -> Vec<UsbDevice> {
    let device = |folder: PathBuf| {
        let number = |file: &str| text(&folder, file)?.parse::<u16>().ok();
        let node = format!("dev/bus/usb/{:03}/{:03}", number("busnum")?, number("devnum")?);
        Some(UsbDevice {
            vendor_id: hexadecimal(&folder, "idVendor")?,
            product_id: hexadecimal(&folder, "idProduct")?,
            interfaces: interfaces(&folder),
            node: root.join(node),
        })
    };
    entries(&root.join("sys/bus/usb/devices")).into_iter().filter_map(device).collect()
}

/// Every serial port on USB.
pub(super) fn serial_ports(root: &Path) -> Vec<SerialPort> {
    let port = |folder: PathBuf| {
        let name = folder.file_name()?.to_owned();
        // From the interface up to the device it is of.
        let interface = folder.join("device").canonicalize().ok()?;
        let device = interface.ancestors().take(4).find(|folder| folder.join("idVendor").is_file())?;
        Some(SerialPort {
            vendor_id: hexadecimal(device, "idVendor")?,
            product_id: hexadecimal(device, "idProduct")?,
            product: text(device, "product"),
            serial_number: text(device, "serial"),
            node: root.join("dev").join(name),
        })
    };
    entries(&root.join("sys/class/tty")).into_iter().filter_map(port).collect()
}

/// Whether a program of this name runs.
pub(super) fn runs(root: &Path, program: &str) -> bool {
    entries(&root.join("proc")).iter().any(|process| text(process, "comm").as_deref() == Some(program))
}

/// Whether the user may read and write, as the system judges.
#[cfg(unix)]
pub(super) fn may_read_and_write(path: &Path) -> bool {
    use rustix::fs::{Access, access};
    access(path, Access::READ_OK | Access::WRITE_OK).is_ok()
}

/// Whether the user may read and write, as far as it shows without trying.
#[cfg(not(unix))]
pub(super) fn may_read_and_write(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.permissions().readonly())
}

/// The name of the group that a device file belongs to.
#[cfg(unix)]
pub(super) fn group(root: &Path, node: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt as _;
    let number = fs::metadata(node).ok()?.gid().to_string();
    let groups = fs::read_to_string(root.join("etc/group")).ok()?;
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == number).then(|| name.to_string())
    })
}

/// The name of the group that a device file belongs to: only Unix has them.
#[cfg(not(unix))]
pub(super) fn group(_root: &Path, _node: &Path) -> Option<String> {
    None
}

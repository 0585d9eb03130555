//! What on this computer is in the way of using a board, and what to do about it.
//!
//! Everything is read below one folder, the root of the file system, so that a test can bring each fault about.

mod devices;
mod probes;

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use shared::protocol::usb::{PRODUCT, PRODUCT_ID, VENDOR_ID};

use devices::{SerialPort, UsbDevice};
use probes::Kind;

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// As it should be.
    Ok,
    /// Something will not work, but nothing that is needed for everything.
    Warn,
    /// The board, or the tool, cannot be used like this.
    Fail,
}

impl fmt::Display for State {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Fail => "fail",
        })
    }
}

/// What one check found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub check: &'static str,
    /// Whether it is as it should be.
    pub state: State,
    /// What was found.
    pub found: String,
    /// What to do about it, where something is to be done.
    pub remedy: Option<String>,
}

impl Finding {
    /// Something as it should be.
    pub fn ok(check: &'static str, found: impl Into<String>) -> Self {
        Self { check, state: State::Ok, found: found.into(), remedy: None }
    }

    /// Something that should be otherwise.
    pub fn not_ok(state: State, check: &'static str, found: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { check, state, found: found.into(), remedy: Some(remedy.into()) }
    }
}

/// The rule that lets whoever sits at the computer use the board.
const RULE: &str = include_str!("../udev/60-armid.rules");

/// Its name.
const RULE_NAME: &str = "60-armid.rules";

/// How to install it.
const INSTALL_RULE: &str = "sudo cp host/udev/60-armid.rules /etc/udev/rules.d/ && sudo udevadm control --reload && \
                            sudo udevadm trigger";

/// Where systems keep such rules, the first found counting.
const RULE_FOLDERS: [&str; 4] = ["etc/udev/rules.d", "run/udev/rules.d", "usr/lib/udev/rules.d", "lib/udev/rules.d"];

/// The computer that is looked at.
pub struct Computer {
    root: PathBuf,
    may_use: Box<dyn Fn(&Path) -> bool>,
}

impl Computer {
    /// This computer.
    pub fn this() -> Self {
        Self::at("/".into())
    }

    /// The computer whose file system begins at `root`.
    pub fn at(root: PathBuf) -> Self {
        Self { root, may_use: Box::new(devices::may_read_and_write) }
    }

    /// The same, with another judgement of which files the user may read and write.
    pub fn with_permissions(self, may_use: impl Fn(&Path) -> bool + 'static) -> Self {
        Self { may_use: Box::new(may_use), ..self }
    }

    /// Every check of the computer itself. `cache` is the folder that `explain` keeps things in, if any.
    pub fn check(&self, cache: Option<&Path>) -> Vec<Finding> {
        let mut findings = vec![self.udev_rule()];
        findings.extend(self.boards());
        findings.extend(self.probes());
        findings.push(self.modem_manager());
        findings.push(self.cache(cache));
        findings
    }

    /// Serial ports of boards on USB that the user may open.
    pub fn usable_boards(&self) -> usize {
        self.board_ports().iter().filter(|port| (self.may_use)(&port.node)).count()
    }

    fn board_ports(&self) -> Vec<SerialPort> {
        let is_board = |port: &SerialPort| {
            (port.vendor_id, port.product_id) == (VENDOR_ID, PRODUCT_ID)
                && port.product.as_ref().is_none_or(|product| product == PRODUCT)
        };
        devices::serial_ports(&self.root).into_iter().filter(is_board).collect()
    }

    fn installed_rule(&self) -> Option<(PathBuf, String)> {
        RULE_FOLDERS.iter().find_map(|folder| {
            let path = self.root.join(folder).join(RULE_NAME);
            std::fs::read_to_string(&path).ok().map(|text| (Path::new("/").join(folder).join(RULE_NAME), text))
        })
    }

    fn udev_rule(&self) -> Finding {
        const CHECK: &str = "udev rule";
        match self.installed_rule() {
            Some((path, text)) if statements(&text) == statements(RULE) => {
                Finding::ok(CHECK, format!("{} is installed", path.display()))
            }
            Some((path, _)) => Finding::not_ok(
                State::Warn,
                CHECK,
                format!("{} is not the one of this version", path.display()),
                INSTALL_RULE,
            ),
            None => Finding::not_ok(State::Warn, CHECK, format!("{RULE_NAME} is not installed"), INSTALL_RULE),
        }
    }

    fn boards(&self) -> Vec<Finding> {
        const CHECK: &str = "board";
        if !self.root.join("sys").is_dir() {
            let remedy = "on Linux, outside of containers, it is found in /sys; elsewhere `armid info` finds the board";
            return vec![Finding::not_ok(State::Warn, CHECK, "USB cannot be looked at here", remedy)];
        }
        let ports = self.board_ports();
        if ports.is_empty() {
            let remedy = "connect its USB port with a cable that carries data, or use --board sim";
            return vec![Finding::not_ok(State::Warn, CHECK, "none on USB", remedy)];
        }
        ports.iter().map(|port| self.access(CHECK, &port.node, &port.name())).collect()
    }

    fn probes(&self) -> Vec<Finding> {
        const CHECK: &str = "debug probe";
        let probe = |device: UsbDevice| -> Vec<Finding> {
            let named = |name: &str| format!("{name} {:04x}:{:04x}", device.vendor_id, device.product_id);
            match probes::kind(&device) {
                None => Vec::new(),
                Some(Kind::Usb(name)) => vec![self.access(CHECK, &device.node, &named(name))],
                Some(Kind::Serial(name)) => {
                    let numbers = (device.vendor_id, device.product_id);
                    let ports = devices::serial_ports(&self.root).into_iter();
                    let ports = ports.filter(|port| (port.vendor_id, port.product_id) == numbers);
                    ports.map(|port| self.access(CHECK, &port.node, &named(name))).collect()
                }
                Some(Kind::OverHid) => {
                    let found = format!("{} speaks CMSIS-DAP over HID alone", named("a probe"));
                    let remedy = "`armid flash` needs version 2 of CMSIS-DAP: give the probe its maker's newer firmware, or \
                                  use the board's ST-LINK";
                    vec![Finding::not_ok(State::Warn, CHECK, found, remedy)]
                }
            }
        };
        let findings: Vec<Finding> = devices::usb_devices(&self.root).into_iter().flat_map(probe).collect();
        if findings.is_empty() {
            let remedy = "only `armid flash` needs one: connect the ST-LINK's USB port, or another probe to the board's SWD pins";
            return vec![Finding::not_ok(State::Warn, CHECK, "none on USB", remedy)];
        }
        findings
    }

    /// Whether the user may use the device at `node`, called `name`.
    fn access(&self, check: &'static str, node: &Path, name: &str) -> Finding {
        let shown = Path::new("/").join(node.strip_prefix(&self.root).unwrap_or(node));
        let shown = shown.display();
        if !node.exists() {
            let remedy = "unplug it and plug it in again; in a container, pass the device through";
            return Finding::not_ok(State::Fail, check, format!("{name}: {shown} is missing"), remedy);
        }
        if (self.may_use)(node) {
            return Finding::ok(check, format!("{name} at {shown}"));
        }
        let remedy = match (self.installed_rule(), devices::group(&self.root, node)) {
            (None, _) => format!("{INSTALL_RULE}, then plug it in again"),
            (Some(_), Some(group)) => format!(
                "plug it in again; where nobody sits at the computer (over ssh), sudo usermod -aG {group} $USER and log in \
                 again"
            ),
            (Some(_), None) => "plug it in again".into(),
        };
        Finding::not_ok(State::Fail, check, format!("{name}: {shown} may not be read and written"), remedy)
    }

    fn modem_manager(&self) -> Finding {
        const CHECK: &str = "ModemManager";
        if !devices::runs(&self.root, "ModemManager") {
            return Finding::ok(CHECK, "does not run");
        }
        let ignored = self.installed_rule().is_some_and(|(_, text)| text.contains("ID_MM_DEVICE_IGNORE"));
        if ignored {
            return Finding::ok(CHECK, "runs, and is told to leave the board alone");
        }
        let state = if self.board_ports().is_empty() { State::Warn } else { State::Fail };
        Finding::not_ok(state, CHECK, "runs, and writes to every new serial port, the board's too", INSTALL_RULE)
    }

    fn cache(&self, cache: Option<&Path>) -> Finding {
        const CHECK: &str = "cache";
        let Some(cache) = cache else {
            return Finding::ok(CHECK, "none is kept");
        };
        // What does not exist yet is made in the nearest folder that does.
        let nearest = cache.ancestors().find(|folder| folder.exists());
        if nearest.is_some_and(|folder| folder.is_dir() && (self.may_use)(folder)) {
            return Finding::ok(CHECK, format!("{} can be written", cache.display()));
        }
        let remedy = "name another folder in ARMID_CACHE, or leave it empty for none; without one, explain is slower";
        Finding::not_ok(State::Warn, CHECK, format!("{} cannot be written", cache.display()), remedy)
    }
}

/// The rules of a file without its remarks.
fn statements(text: &str) -> Vec<&str> {
    text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')).collect()
}

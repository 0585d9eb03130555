//! `armid flash`.

mod probe;

use std::path::PathBuf;
use std::time::Duration;

use armid::client::{Client, SessionError};
use armid::firmware_image::{self, FirmwareImage};
use armid::link::{self, Address, usb};
use armid::robot::Robot;
use clap::Args;
use serde_json::json;
use shared::protocol::Info;

use super::CommandError;
use super::common::{advise, print, print_json};
pub use probe::ProbeError;
use probe::{Found, Selector};

/// How long the board may take to come back after its reset, USB enumeration included.
const RETURN_TIMEOUT: Duration = Duration::from_secs(6);
/// How long to wait between two looks for it.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

const WHAT_IS_KEPT: &str = "The stored parameters in the last 256 KiB of flash are kept. The board is reset before anything is erased, so that its \
    outputs are off meanwhile; that needs the pull-down at the amplifier enable.

Without ELF the image that `tests/run firmware` built here is taken (below CARGO_TARGET_DIR, or the folder target).
Exit code 2 with several probes and no --probe, 3 with an unusable ELF file, 4 without a probe or a chip, 5 while a \
    movement runs.

Examples:
  armid flash                                       the image that tests/run firmware built here
  armid flash --list";

/// Arguments of `flash`.
#[derive(Debug, Args)]
#[command(after_help = WHAT_IS_KEPT)]
pub struct Flash {
    /// Image to flash; without it, the one built here
    #[arg(value_name = "ELF")]
    elf: Option<PathBuf>,
    /// Debug probe: VID:PID or VID:PID:SERIAL, as --list prints it; a Black Magic Probe on a network is 1d50:6018:IP:PORT
    #[arg(long, value_name = "VID:PID:SERIAL", env = "ARMID_PROBE")]
    probe: Option<Selector>,
    /// List the connected debug probes and end
    #[arg(long, conflicts_with_all = ["elf", "erase_parameters"])]
    list: bool,
    /// Erase the stored parameters too: robot constants, limits and model
    #[arg(long)]
    erase_parameters: bool,
    /// Link over which to ask the new firmware for its version; without it, the board's USB or the probe's serial port
    #[arg(long, value_name = "BOARD", env = super::BOARD_VARIABLE)]
    board: Option<Address>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Flash {
    pub fn run(&self) -> Result<(), CommandError> {
        if self.list {
            return self.print_list(&probe::list(self.probe.as_ref()));
        }
        let path = match &self.elf {
            Some(path) => path.clone(),
            None => self.find_built()?,
        };
        let image = FirmwareImage::read(&path)?;
        advise(format!("{}: {} bytes", path.display(), image.size()));
        let found = probe::list(self.probe.as_ref());
        let chosen = probe::choose(&found, self.probe.as_ref())?;
        self.refuse_while_moving(chosen)?;
        probe::flash(chosen, &image, self.erase_parameters)?;
        let answer = self.wait_for_board(chosen);
        self.report(&image, chosen, answer.as_ref())
    }

    fn find_built(&self) -> Result<PathBuf, CommandError> {
        let folder = std::env::current_dir().unwrap_or_default();
        let target = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
        Ok(firmware_image::find_built(&folder, target.as_deref())?)
    }

    fn print_list(&self, found: &[Found]) -> Result<(), CommandError> {
        if self.json {
            let probes: Vec<_> = found
                .iter()
                .map(|probe| json!({"probe": probe.selector.to_string(), "name": probe.name, "accessible": probe.accessible}))
                .collect();
            return print_json(&json!({ "probes": probes }));
        }
        if found.is_empty() {
            advise(ProbeError::None.to_string());
            return Ok(());
        }
        let lines: Vec<String> = found.iter().map(Found::to_string).collect();
        print(lines.join("\n"))
    }

    /// Where the board can be asked: the link that was named, else its own USB, else the serial port of `probe`.
    fn link(&self, probe: &Found) -> Option<Address> {
        if self.board.is_some() {
            return self.board.clone();
        }
        let ports = usb::ports();
        if usb::choose(&ports, None).is_ok() {
            return Some(Address::ANY_USB);
        }
        let serial_number = probe.selector.serial_number.as_deref();
        let port = usb::st_links(&ports).into_iter().find(|port| port.serial_number.as_deref() == serial_number)?;
        Some(Address::serial(port.path))
    }

    fn connect(&self, probe: &Found) -> Option<Client> {
        let address = self.link(probe)?;
        Client::connect(link::open(&address, &Robot::paper(), 0).ok()?).ok()
    }

    /// The reset would let go of an arm in the middle of its way. A board that does not answer is not asked.
    fn refuse_while_moving(&self, probe: &Found) -> Result<(), CommandError> {
        let Some(mut client) = self.connect(probe) else { return Ok(()) };
        match client.status() {
            Ok(status) if status.mode.is_powered() => Err(SessionError::Busy { mode: status.mode.name() }.into()),
            _ => Ok(()),
        }
    }

    /// The new firmware, by its own account.
    fn wait_for_board(&self, probe: &Found) -> Option<(String, Info)> {
        let until = std::time::Instant::now() + RETURN_TIMEOUT;
        while std::time::Instant::now() < until {
            std::thread::sleep(LOOK_AGAIN);
            if let Some(client) = self.connect(probe) {
                return Some((client.address(), client.info().clone()));
            }
        }
        None
    }

    fn report(
        &self,
        image: &FirmwareImage,
        probe: &Found,
        answer: Option<&(String, Info)>,
    ) -> Result<(), CommandError> {
        if answer.is_none() {
            advise(
                "the board could not be asked for its version: no link to it was found within 6 s; connect its USB or the \
                 probe's serial port, and see `armid info`",
            );
        }
        let identity = answer.map(|(_, info)| &info.identity);
        let path = image.path.display();
        if self.json {
            return print_json(&json!({
                "elf": image.path, "bytes": image.size(), "probe": probe.selector.to_string(), "verified": true,
                "parameters_erased": self.erase_parameters,
                "address": answer.map(|(address, _)| address),
                "firmware_version": identity.map(|identity| identity.firmware_version.as_str()),
                "git_revision": identity.map(|identity| identity.git_revision.as_str()),
            }));
        }
        let parameters = if self.erase_parameters { "erased" } else { "kept" };
        let mut text = format!("{path}: {} bytes flashed and verified; stored parameters {parameters}", image.size());
        if let Some((address, info)) = answer {
            let identity = &info.identity;
            text += &format!("\nnow running at {address}: {}, {}", identity.firmware_version, identity.git_revision);
        }
        print(text)
    }
}

//! The debug probe: finding it, choosing one, and writing an image through it.

use std::cell::RefCell;
use std::fmt;
use std::net::SocketAddr;
use std::str::FromStr;
use std::time::Duration;

use armid::firmware_image::{FirmwareImage, PARAMETER_FLASH};
use indicatif::ProgressBar;
use probe_rs::flashing::{self, DownloadOptions, FlashProgress, ProgressEvent, ProgressOperation};
use probe_rs::probe::{DebugProbeError, DebugProbeSelector, WireProtocol, list::Accessibility, list::Lister};
use probe_rs::{Permissions, Session};

use super::super::progress;

/// The board's chip, by its name in the library's list.
const CHIP: &str = "STM32F429ZITx";
/// How long the chip may take to stop behind its reset.
const HALT_TIMEOUT: Duration = Duration::from_millis(500);

/// Why nothing was flashed, or not all of it.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// There is no probe.
    #[error(
        "no debug probe was found; connect the board's ST-LINK socket (CN1 on a Nucleo) to this computer with a USB \
         cable that carries data, and see that a virtual machine or container passes it on"
    )]
    None,
    /// There is a choice.
    #[error("several debug probes are connected:\n{found}\nchoose one with --probe VID:PID:SERIAL")]
    Several {
        /// All of them, a line each.
        found: String,
    },
    /// The probe named is not there.
    #[error("no debug probe {wanted} was found; {}", if found.is_empty() { "nor is there any other".into() } else { format!("there are:\n{found}") })]
    NotThere {
        /// The one named.
        wanted: Selector,
        /// Those that are there, a line each.
        found: String,
    },
    /// The system does not let us.
    #[error(
        "the debug probe {0} may not be used by this user; install armid's udev rules (host/udev/60-armid.rules, see the \
         README) and plug it in again"
    )]
    Denied(Selector),
    /// The probe does not answer.
    #[error("the debug probe {probe} does not open: {reason}; close other programs that use it, and plug it in again")]
    Open {
        /// The probe.
        probe: Selector,
        /// What the library says.
        reason: String,
    },
    /// Nor does one on the network.
    #[error("no debug probe answers at {0}; check its address and port, and that no other program uses it")]
    OnNetwork(Selector),
    /// The chip does not answer.
    #[error(
        "no {CHIP} answers to the debug probe {probe}: {reason}; check the board's power, and both jumpers CN4 between \
         ST-LINK and board"
    )]
    Attach {
        /// The probe.
        probe: Selector,
        /// What the library says.
        reason: String,
    },
    /// Flashing ended in the middle.
    #[error("flashing failed: {reason}; the board has no whole program now: flash it again")]
    Flash {
        /// What the library says.
        reason: String,
    },
}

/// A probe's name on the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selector {
    pub vendor_id: u16,
    pub product_id: u16,
    pub serial_number: Option<String>,
}

impl Selector {
    /// A Black Magic Probe behind a network address.
    fn is_on_network(&self) -> bool {
        self.serial_number.as_ref().is_some_and(|address| address.parse::<SocketAddr>().is_ok())
    }
}

impl From<&Selector> for DebugProbeSelector {
    fn from(selector: &Selector) -> Self {
        let Selector { vendor_id, product_id, serial_number } = selector.clone();
        Self { vendor_id, product_id, interface: None, serial_number }
    }
}

impl FromStr for Selector {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = || format!("\"{text}\" names no probe, such as 0483:374b or 0483:374b:066FFF3031");
        let mut parts = text.splitn(3, ':');
        let mut number = || u16::from_str_radix(parts.next()?, 16).ok();
        let (vendor_id, product_id) = (number().ok_or_else(refuse)?, number().ok_or_else(refuse)?);
        Ok(Self { vendor_id, product_id, serial_number: parts.next().filter(|text| !text.is_empty()).map(Into::into) })
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:04x}:{:04x}", self.vendor_id, self.product_id)?;
        self.serial_number.iter().try_for_each(|serial_number| write!(formatter, ":{serial_number}"))
    }
}

/// A probe that is connected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    pub selector: Selector,
    /// What it calls itself.
    pub name: String,
    /// Whether the system lets us use it.
    pub accessible: bool,
}

impl fmt::Display for Found {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let denied = if self.accessible { "" } else { " (no permission: install armid's udev rules)" };
        write!(formatter, "{}  {}{denied}", self.selector, self.name)
    }
}

/// Every probe connected; and the one meant, where that is one on the network, which nobody can look for.
pub fn list(wanted: Option<&Selector>) -> Vec<Found> {
    let found = Lister::new().list_with_access(wanted.filter(|wanted| wanted.is_on_network()).map(Into::into).as_ref());
    let found = found.into_iter().map(|item| Found {
        selector: Selector {
            vendor_id: item.info.vendor_id,
            product_id: item.info.product_id,
            serial_number: item.info.serial_number,
        },
        name: item.info.identifier,
        accessible: item.accessibility == Accessibility::Accessible,
    });
    found.collect()
}

/// The probe that is meant: the one named, else the only one.
pub fn choose<'a>(found: &'a [Found], wanted: Option<&Selector>) -> Result<&'a Found, ProbeError> {
    let is_meant = |probe: &&Found| {
        wanted.is_none_or(|wanted| {
            let Selector { vendor_id, product_id, serial_number } = &probe.selector;
            (*vendor_id, *product_id) == (wanted.vendor_id, wanted.product_id)
                && (wanted.serial_number.is_none() || *serial_number == wanted.serial_number)
        })
    };
    let lines = |found: &mut dyn Iterator<Item = &Found>| {
        found.map(|probe| format!("  {probe}")).collect::<Vec<String>>().join("\n")
    };
    let meant: Vec<&Found> = found.iter().filter(is_meant).collect();
    match (meant.as_slice(), wanted) {
        ([probe], _) if probe.accessible => Ok(probe),
        ([probe], _) => Err(ProbeError::Denied(probe.selector.clone())),
        ([], Some(wanted)) => Err(ProbeError::NotThere { wanted: wanted.clone(), found: lines(&mut found.iter()) }),
        ([], None) => Err(ProbeError::None),
        (several, _) => Err(ProbeError::Several { found: lines(&mut several.iter().copied()) }),
    }
}

/// Erases, writes and verifies `image` through `probe`, and starts it.
pub fn flash(probe: &Found, image: &FirmwareImage, erase_parameters: bool) -> Result<(), ProbeError> {
    let mut session = attach(&probe.selector)?;
    let failed = |error: &dyn std::error::Error| ProbeError::Flash { reason: with_causes(error) };
    // Stopped anywhere else, the board would go on putting out its last commands while its program is replaced.
    session
        .core(0)
        .and_then(|mut core| core.reset_and_halt(HALT_TIMEOUT).map(drop))
        .map_err(|error| ProbeError::Attach { probe: probe.selector.clone(), reason: with_causes(&error) })?;

    let mut loader = session.target().flash_loader();
    for segment in &image.segments {
        loader.add_data(u64::from(segment.address), &segment.bytes).map_err(|error| failed(&error))?;
    }
    let mut options = DownloadOptions::new();
    options.verify = true;
    options.progress = shown_progress();
    loader.commit(&mut session, options).map_err(|error| failed(&error))?;
    if erase_parameters {
        let [start, end] = [PARAMETER_FLASH.start, PARAMETER_FLASH.end].map(u64::from);
        flashing::erase(&mut session, &mut FlashProgress::empty(), start, end, false)
            .map_err(|error| failed(&error))?;
    }
    session.core(0).and_then(|mut core| core.reset()).map_err(|error| failed(&error))
}

fn attach(selector: &Selector) -> Result<Session, ProbeError> {
    let failed = |error: DebugProbeError| match selector.clone() {
        probe if probe.is_on_network() => ProbeError::OnNetwork(probe),
        probe => ProbeError::Open { probe, reason: with_causes(&error) },
    };
    let mut probe = Lister::new().open(DebugProbeSelector::from(selector)).map_err(failed)?;
    // The board brings out these two wires alone; some probes choose none by themselves.
    probe.select_protocol(WireProtocol::Swd).map_err(failed)?;
    probe
        .attach(CHIP, Permissions::default())
        .map_err(|error| ProbeError::Attach { probe: selector.clone(), reason: with_causes(&error) })
}

/// An error and what is behind it, in one line.
fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string().trim_end_matches('.').to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text += &format!(": {}", error.to_string().trim_end_matches('.'));
        cause = error.source();
    }
    text
}

/// One bar after the other: erasing, programming, verifying.
fn shown_progress() -> FlashProgress<'static> {
    let mut totals = Vec::new();
    let shown: RefCell<Option<ProgressBar>> = RefCell::new(None);
    let name = |operation: &ProgressOperation| match operation {
        ProgressOperation::Fill => "reading what stays",
        ProgressOperation::Erase => "erasing",
        ProgressOperation::Program => "programming",
        ProgressOperation::Verify => "verifying",
    };
    FlashProgress::new(move |event| match event {
        ProgressEvent::AddProgressBar { operation, total } => totals.push((name(&operation), total.unwrap_or(0))),
        ProgressEvent::Started(operation) => {
            let name = name(&operation);
            let total = totals.iter().find(|(of, _)| *of == name).map_or(0, |(_, total)| *total);
            *shown.borrow_mut() = Some(progress::bar(name, total));
        }
        ProgressEvent::Progress { size, .. } => {
            if let Some(bar) = &*shown.borrow() {
                bar.inc(size);
            }
        }
        ProgressEvent::Failed(_) | ProgressEvent::Finished(_) => {
            if let Some(bar) = shown.take() {
                bar.finish();
            }
        }
        ProgressEvent::FlashLayoutReady { .. } | ProgressEvent::DiagnosticMessage { .. } => {}
    })
}

#[cfg(test)]
mod tests {
    use armid::firmware_image::PROGRAM_FLASH;
    use probe_rs::config::Registry;

    use super::*;

    fn found(serial_number: &str, accessible: bool) -> Found {
        let selector = format!("0483:374b:{serial_number}").parse().unwrap();
        Found { selector, name: "STLink V2-1".into(), accessible }
    }

    #[test]
    fn probes_are_named_as_they_are_listed() {
        for text in ["0483:374b", "0483:374b:066F", "303a:1001:DC:DA:0C"] {
            assert_eq!(text.parse::<Selector>().unwrap().to_string(), text);
        }
        for text in ["", "0483", "0483:", "stlink:374b", "0483:1374b"] {
            assert!(text.parse::<Selector>().unwrap_err().contains("names no probe"), "{text}");
        }
    }

    #[test]
    fn a_probe_on_the_network_is_taken_at_its_word_when_it_is_named() {
        let wanted: Selector = "1d50:6018:127.0.0.1:2022".parse().unwrap();
        let found = list(Some(&wanted));
        assert_eq!(choose(&found, Some(&wanted)).unwrap().selector, wanted);
        // Only of this kind there are such.
        let other: Selector = "0483:374b:127.0.0.1:2022".parse().unwrap();
        assert!(choose(&list(Some(&other)), Some(&other)).unwrap_err().to_string().contains("was found"));
    }

    #[test]
    fn the_probe_meant_is_taken_or_the_others_are_listed() {
        let probes = [found("A1", true), found("B2", false)];
        assert_eq!(choose(&probes[..1], None).unwrap(), &probes[0]);
        assert_eq!(choose(&probes, Some(&probes[0].selector)).unwrap(), &probes[0]);
        let told = |found: &[Found], wanted: Option<&str>| {
            let wanted = wanted.map(|text| text.parse().unwrap());
            choose(found, wanted.as_ref()).unwrap_err().to_string()
        };
        assert!(told(&[], None).contains("no debug probe was found; connect"));
        let several = told(&probes, None);
        assert!(several.contains("0483:374b:A1") && several.contains("0483:374b:B2"), "{several}");
        assert_eq!(told(&probes, Some("0483:374b")), several);
        assert!(told(&probes, Some("0483:374b:B2")).contains("udev"));
        let other = told(&probes, Some("0483:374b:C3"));
        assert!(other.contains("C3 was not found") || other.contains("0483:374b:C3"), "{other}");
        assert!(other.contains("A1") && other.contains("B2"), "{other}");
    }

    /// Erasing and programming itself is tested on the emulated chip (`tests/tests/emulated_flash.rs`).
    #[test]
    fn the_chip_takes_program_and_parameters_where_they_are_put() {
        let target = Registry::from_builtin_families().get_target_by_name(CHIP).expect("a known chip");
        let mut loader = target.flash_loader();
        for address in [PROGRAM_FLASH.start, PROGRAM_FLASH.end - 4, PARAMETER_FLASH.end - 4] {
            loader.add_data(u64::from(address), &[0; 4]).expect("flash");
        }
        loader.add_data(u64::from(PARAMETER_FLASH.end), &[0; 4]).expect_err("no flash");
        let sectors: Vec<(u64, u64)> = target
            .flash_algorithms
            .iter()
            .filter(|algorithm| {
                algorithm.default
                    && algorithm.flash_properties.address_range.contains(&u64::from(PARAMETER_FLASH.start))
            })
            .flat_map(|algorithm| algorithm.flash_properties.sectors.iter())
            .map(|sector| (sector.address, sector.size))
            .collect();
        println!("{sectors:x?}");
        // Erasing the program ends at a boundary between sectors, so that the parameters survive.
        let offset = u64::from(PARAMETER_FLASH.start - PROGRAM_FLASH.start);
        let last = sectors.iter().rfind(|(address, _)| *address <= offset).expect("sectors");
        assert_eq!((offset - last.0) % last.1, 0);
    }
}

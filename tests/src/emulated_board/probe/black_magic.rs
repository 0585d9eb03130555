//! What a Black Magic Probe says over its remote protocol, version 4: requests from `!` to `#`, answers from `&` to `#`,
//! numbers in hexadecimal digits.
//!
//! Left out: JTAG, 64-bit and multi-drop debug ports. The two wires are imitated bit by bit for the debug port's own registers,
//! which is how programs find it; everything after that the protocol asks for as registers and memory.

use super::debug_port::DebugPort;
use super::debugger::{DebuggerError, from_digits};
use super::wires::Wires;

/// Version of the protocol.
const VERSION: u32 = 4;
/// Requests for registers and memory of a debug port of version 5 are understood.
const ACCELERATORS: u32 = 1;
/// What is said of the clock's rate, in kHz.
const CLOCK_KHZ: u32 = 4000;

/// What is sent back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Done: a number or bytes, as digits.
    Done(String),
    /// The chip refused.
    Refused,
    /// The request is not understood.
    Unknown,
}

impl Answer {
    fn number(number: impl std::fmt::LowerHex) -> Self {
        Self::Done(format!("{number:x}"))
    }

    /// A register's four bytes, the lowest first.
    fn register(value: u32) -> Self {
        Self::Done(format!("{:08x}", value.swap_bytes()))
    }

    /// As it goes over the line.
    pub fn to_line(&self) -> String {
        match self {
            Self::Done(digits) => format!("&K{digits}#"),
            Self::Refused => "&E1#".into(),
            Self::Unknown => "&N0#".into(),
        }
    }
}

/// The probe, wired to a chip.
pub struct BlackMagic {
    port: DebugPort,
    wires: Wires,
    holds_reset: bool,
}

impl BlackMagic {
    /// A probe that has just been plugged in.
    pub fn new(port: DebugPort) -> Self {
        Self { port, wires: Wires::default(), holds_reset: false }
    }

    /// The probe is taken away.
    pub fn disconnect(self) -> Result<(), DebuggerError> {
        self.port.disconnect()
    }

    /// Carries out a request, as it stands between `!` and `#`.
    pub fn answer(&mut self, request: &str) -> Result<Answer, DebuggerError> {
        let (kind, digits) = request.split_at_checked(2).unwrap_or((request, ""));
        let mut fields = Fields(digits);
        Ok(match kind {
            "GA" => Answer::Done("emulated Black Magic Probe".into()),
            "HC" => Answer::number(VERSION),
            "HA" => Answer::number(ACCELERATORS),
            "Gf" => Answer::number(CLOCK_KHZ),
            "GF" | "GP" | "GE" | "SS" => Answer::number(0),
            "GZ" => {
                let holds = digits == "1";
                if std::mem::replace(&mut self.holds_reset, holds) && !holds {
                    self.port.reset()?;
                }
                Answer::number(0)
            }
            "So" => {
                let bits = fields.next(2);
                let (Some(bits), Some(value)) = (bits, fields.rest()) else { return Ok(Answer::Unknown) };
                self.wires.put(&mut self.port, bits, value);
                Answer::number(0)
            }
            "Si" => match fields.next(2) {
                Some(bits) => Answer::number(self.wires.take(bits)),
                None => Answer::Unknown,
            },
            "Ad" | "AR" | "Aa" | "AA" | "Am" | "AM" => self.access(kind, fields)?.unwrap_or(Answer::Unknown),
            _ => Answer::Unknown,
        })
    }

    /// Registers and memory. None where digits are missing.
    fn access(&mut self, kind: &str, mut fields: Fields<'_>) -> Result<Option<Answer>, DebuggerError> {
        // The number of the device on a chain, of which there is none.
        let Some(_) = fields.next(2) else { return Ok(None) };
        let Some(selected) = fields.next(2) else { return Ok(None) };
        if matches!(kind, "Am" | "AM") {
            return self.access_memory(kind == "AM", fields);
        }
        let Some(register) = fields.next(4) else { return Ok(None) };
        let value = fields.next(8);
        let (port, register) = (selected as u8, register as u16);
        // Registers of access ports are told from those of the debug port by a bit that stands above them.
        Ok(match (kind, value) {
            ("Ad", _) => Some(Answer::register(self.port.read(register))),
            ("AR", Some(value)) => {
                self.port.write(register, value);
                Some(Answer::number(0))
            }
            ("Aa", _) => Some(Answer::register(self.port.read_access_port(port, register as u8)?)),
            ("AA", Some(value)) => {
                self.port.write_access_port(port, register as u8, value.swap_bytes())?;
                Some(Answer::number(0))
            }
            _ => None,
        })
    }

    fn access_memory(&mut self, writes: bool, mut fields: Fields<'_>) -> Result<Option<Answer>, DebuggerError> {
        let Some(_control) = fields.next(8) else { return Ok(None) };
        if writes && fields.next(2).is_none() {
            return Ok(None);
        }
        // Of 64 bits, the upper half of which this chip has not.
        let (Some(0), Some(address), Some(length)) = (fields.next(8), fields.next(8), fields.next(8)) else {
            return Ok(None);
        };
        if writes {
            let Some(bytes) = from_digits(fields.0).filter(|bytes| bytes.len() == length as usize) else {
                return Ok(None);
            };
            let taken = self.port.write_memory(address, &bytes)?;
            return Ok(Some(if taken { Answer::number(0) } else { Answer::Refused }));
        }
        let mut bytes = vec![0; length as usize];
        if !self.port.read_memory(address, &mut bytes)? {
            return Ok(Some(Answer::Refused));
        }
        Ok(Some(Answer::Done(bytes.iter().map(|byte| format!("{byte:02x}")).collect())))
    }
}

/// Numbers that follow each other without anything between them.
struct Fields<'a>(&'a str);

impl Fields<'_> {
    fn next(&mut self, digits: usize) -> Option<u32> {
        let (number, rest) = self.0.split_at_checked(digits)?;
        self.0 = rest;
        u32::from_str_radix(number, 16).ok()
    }

    fn rest(&mut self) -> Option<u32> {
        self.next(self.0.len())
    }
}

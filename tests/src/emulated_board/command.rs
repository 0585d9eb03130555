//! What host and bench say to each other.

use std::fmt;

use rigless::emulator::Host;
use rigless::session::Session;
use rigless::time::VirtualNanos;

use shared::arm::PARAMETERS;
use shared::protocol::Link;

use super::nucleo::Nucleo;
use super::usb::UsbAction;
use crate::line::Trouble;

/// What ends a run early.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Until {
    /// Nothing.
    #[default]
    TimeIsUp,
    /// The board has sent a frame over this link, or the link is gone.
    Frame(Link),
    /// The USB port is open.
    UsbIsOpen,
}

/// When power fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PowerCut {
    /// At once.
    Now,
    /// In the middle of an operation of the flash memory, after so many others.
    AfterFlashOperations(u64),
}

/// What the host asks for: bytes to the board, what happens around it, then time.
#[derive(Debug, Default)]
pub struct Command {
    /// Bytes to put on the serial line.
    pub to_board: Vec<u8>,
    /// Bytes for the USB port.
    pub to_usb: Vec<u8>,
    /// What is to happen on USB, and when, in ns.
    pub usb_actions: Vec<(u64, UsbAction)>,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: bool,
    /// When to cut the power, if at all.
    pub power_cut: Option<PowerCut>,
    /// A motor to turn by hand.
    pub turn: Option<Turn>,
    /// What the arm carries from now on: what it adds to f1..f9.
    pub added_f: Option<[f64; PARAMETERS]>,
    /// What is wrong with the line from now on, and until when in ns.
    pub trouble: Option<(Trouble, u64)>,
    /// Something to do to the chip itself.
    pub intervention: Option<Intervention>,
    /// Until when to run at most, in ns.
    pub run_until_ns: u64,
    /// When to come back earlier.
    pub until: Until,
}

/// What the host gets back.
#[derive(Debug)]
pub struct Answer {
    /// What time it is, in ns.
    pub at_ns: u64,
    /// What the board has sent over the serial line.
    pub from_board: Vec<u8>,
    /// What the board has sent over USB.
    pub from_usb: Vec<u8>,
    /// Whether the USB port is open.
    pub usb_is_open: bool,
}

/// Turning a motor by hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// Index of the joint.
    pub joint: usize,
    /// By how many encoder counts.
    pub counts: i32,
    /// Time from edge to edge, in ns.
    pub interval_ns: u64,
}

type Deed = dyn FnOnce(&mut Session<Nucleo>, &mut dyn Host, VirtualNanos) + Send;

/// Something done to the chip between two instructions.
pub struct Intervention(pub Box<Deed>);

impl fmt::Debug for Intervention {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Intervention")
    }
}

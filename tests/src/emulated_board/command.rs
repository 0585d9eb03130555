//! What host and bench say to each other.

use std::fmt;

use rigless::emulator::Host;
use rigless::session::Session;
use rigless::time::VirtualNanos;

use super::nucleo::Nucleo;
use crate::line::Trouble;

/// What the host asks for: bytes to the board, what happens around it, then time.
#[derive(Debug, Default)]
pub struct Command {
    /// Bytes to put on the line.
    pub to_board: Vec<u8>,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: bool,
    /// A motor to turn by hand.
    pub turn: Option<Turn>,
    /// What is wrong with the line from now on, and until when in ns.
    pub trouble: Option<(Trouble, u64)>,
    /// Something to do to the chip itself.
    pub intervention: Option<Intervention>,
    /// Until when to run at most, in ns.
    pub run_until_ns: u64,
    /// Whether to come back when the board has sent a frame.
    pub until_frame: bool,
}

/// What the host gets back.
#[derive(Debug)]
pub struct Answer {
    /// What time it is, in ns.
    pub at_ns: u64,
    /// What the board has sent.
    pub from_board: Vec<u8>,
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

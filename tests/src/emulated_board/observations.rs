//! What is watched from outside while the image runs.

use rigless::device::ResetCause;
use rigless::session::Session;

use super::flash::{FlashOperation, PARAMETERS, WHOLE};
use super::nucleo::{CORE_CLOCK_HZ, INSTRUCTIONS_PER_SECOND, Nucleo, Outputs};
use super::usb::Enumerated;
use crate::line::Losses;

/// Core cycles in one step of TIM1, as the firmware sets its prescaler.
const CYCLES_PER_TIMER_STEP: u64 = 2;

/// One run of the control interrupt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    /// When its first instruction that touches a register ran, in ns.
    pub start_ns: u64,
    /// Steps that TIM1 had counted since its overflow then.
    pub timer_steps: u64,
    /// Instructions from there to its last look at the timer.
    pub instructions: u64,
}

impl Tick {
    /// When the timer overflowed, in ns: exact to the resolution of the timer, 12 ns.
    pub fn overflow_ns(&self) -> f64 {
        self.start_ns as f64 - (self.timer_steps * CYCLES_PER_TIMER_STEP) as f64 * 1e9 / CORE_CLOCK_HZ as f64
    }

    /// Its duration on the emulated core, in µs.
    pub fn duration_us(&self) -> f64 {
        self.instructions as f64 * 1e6 / INSTRUCTIONS_PER_SECOND as f64
    }
}

/// What the board put out from an instant on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputChange {
    /// Since when, in ns.
    pub at_ns: u64,
    /// What.
    pub outputs: Outputs,
}

/// A restart of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Restart {
    /// When, in ns.
    pub at_ns: u64,
    /// Why.
    pub cause: ResetCause,
}

/// What happened on USB.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UsbTraffic {
    /// What the host found out when it recognised the board last.
    pub found: Enumerated,
    /// How often it recognised the board.
    pub enumerations: u32,
    /// How often a control transfer failed.
    pub failures: u32,
    /// Packets of bytes that the board took.
    pub packets_to_board: u64,
    /// Packets of bytes that the board sent.
    pub packets_from_board: u64,
    /// How many of these were empty: they end a transfer whose other packets are full.
    pub empty_packets: u64,
}

/// Something done to the flash memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashUse {
    /// When it began, in ns.
    pub at_ns: u64,
    /// What.
    pub operation: FlashOperation,
    /// Whether the amplifiers were on: they never may be.
    pub amplifiers_enabled: bool,
}

/// Everything that was watched.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observations {
    /// Every run of the control interrupt.
    pub ticks: Vec<Tick>,
    /// Every change of the outputs.
    pub outputs: Vec<OutputChange>,
    /// Every word programmed and every sector erased.
    pub flash_uses: Vec<FlashUse>,
    /// What was done to the flash memory that must not be.
    pub flash_faults: Vec<String>,
    /// Whether a debug probe ever had hold of the core: its code may write to all of the flash memory.
    pub was_probed: bool,
    /// Encoder edges put out for each joint.
    pub edges: [u64; 2],
    /// Joint angles in rad at the end.
    pub position_rad: [f64; 2],
    /// What became of the bytes on the line to the board, and from it.
    pub line_losses: [Losses; 2],
    /// Every restart after the first start.
    pub restarts: Vec<Restart>,
    /// Registers that the firmware touched and no model answers for, and addresses where there is nothing.
    pub unmodelled: Vec<String>,
    /// What happened on USB.
    pub usb: UsbTraffic,
    /// Instructions executed.
    pub instructions: u64,
    /// When the run ended, in ns.
    pub end_ns: u64,
}

impl Observations {
    /// Adds what the emulator itself kept.
    pub(super) fn complete(&mut self, session: &Session<Nucleo>) {
        self.restarts =
            session.resets().iter().map(|reset| Restart { at_ns: reset.at.0, cause: reset.cause }).collect();
        let registers = session.unimplemented().values().map(|gap| format!("{} {}", gap.instance, gap.register));
        // Stores into these sectors are answered by the bench's own model, of which the emulator does not know.
        let written = if self.was_probed { WHOLE } else { PARAMETERS };
        let answered = |address: u64| written.contains(&address);
        let unmapped = session.unmapped().into_iter().filter(|gap| !answered(gap.address));
        let nowhere = unmapped.map(|gap| format!("{:#010x}", gap.address));
        let refusals = session.refused().iter().filter(|(address, _)| !answered(**address));
        let refused = refusals.map(|(address, fault)| format!("{address:#010x} {fault:?}"));
        let gaps = session.board().usb().gaps().map(String::from);
        self.unmodelled = registers.chain(nowhere).chain(refused).chain(gaps).collect();
        self.unmodelled.sort();
        self.unmodelled.dedup();
        let host = session.board().usb().host();
        let ((enumerations, failures), (packets_to_board, packets_from_board)) = (host.enumerations(), host.packets());
        let found = host.found().clone();
        let empty_packets = host.empty_packets();
        self.usb = UsbTraffic { found, enumerations, failures, packets_to_board, packets_from_board, empty_packets };
    }
}

//! USB: the core of the part, a cable, and a host at its other end.
//!
//! The emulator keeps the core's registers in four blocks and has nothing where the FIFOs are. So these four places on
//! its bus are exchanged for windows, all answered by one model. Everything else on the bus stays as it is, which a test
//! makes sure of.

mod core;
mod host;
mod registers;
mod transfer;

use std::num::NonZeroU64;

use rigless::device::{DeviceContext, ErasedDevice, RegisterFile, RequestChange};
use rigless::soc::stm32f427::{CPU, MEMORY};
use rigless::soc::{Bus, Error, Gate, Peripheral, RegisterSpec, Width, Window};
use rigless::time::{EventId, VirtualNanos};

use self::core::Core;
use self::host::Host;
pub use self::host::{Enumerated, LINE_CODING};

/// The blocks into which the emulator divides the core, in the order of their addresses.
const BLOCKS: [&str; 4] = ["OTG_FS_GLOBAL", "OTG_FS_HOST", "OTG_FS_DEVICE", "OTG_FS_PWRCLK"];

/// Where the first of them begins.
const BASE: u64 = 0x5000_0000;

/// OTG_FS in the vector table (RM0090, table 62).
const INTERRUPT: [u16; 1] = [67];

/// The clock of the core.
const CLOCK: Gate = Gate::by("RCC", "AHB2ENR", "OTGFSEN");

/// Four places on the bus of the part, and what is not in them at the moment: the windows, or the emulator's own.
#[derive(Debug)]
pub struct Places {
    other: Bus,
    /// Where they are on the bus of the part and on the other.
    slots: [(usize, usize); 4],
}

impl Places {
    /// For a part with this bus.
    pub fn new(bus: &Bus) -> Result<Self, Error> {
        // The same bus without the four. Gates go by position, and the clock controller is before them on both.
        let others: Vec<Peripheral> =
            bus.peripherals().filter(|peripheral| !BLOCKS.contains(&peripheral.name)).copied().collect();
        let mut other = Bus::builder(CPU, &MEMORY, others).build()?;
        let mut slots = [(0, 0); 4];
        for (slots, name) in slots.iter_mut().zip(BLOCKS) {
            let slot = bus.slot(name)?;
            let &Peripheral { base, size, .. } = bus.slots()[slot].peripheral();
            let size = NonZeroU64::new(size).expect("a block with registers");
            let window = Window::new(name, base, size).gated(CLOCK).raising(&INTERRUPT);
            *slots = (slot, other.add_window(window)?);
        }
        Ok(Self { other, slots })
    }

    /// Exchanges what is in them. The emulator knows its own part only as it made it, so at a reset this is done twice.
    pub fn exchange(&mut self, bus: &mut Bus) {
        for (slot, other) in self.slots {
            std::mem::swap(bus.slot_mut(slot), self.other.slot_mut(other));
        }
    }

    /// The slot that raises the interrupt.
    pub fn first_slot(&self) -> usize {
        self.slots[0].0
    }

    /// How far behind the beginning of the core the place in `slot` begins, if it is one of the four.
    pub fn offset(&self, bus: &Bus, slot: usize) -> Option<u64> {
        let is_one = self.slots.iter().any(|&(place, _)| place == slot);
        is_one.then(|| bus.slots()[slot].peripheral().base - BASE)
    }
}

/// What can happen on USB from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UsbAction {
    /// The cable is plugged in, or pulled.
    Plug(bool),
    /// A program opens the port as soon as there is one, or closes it.
    Open(bool),
    /// The program stops reading, or goes on.
    Stall(bool),
    /// The host puts the bus to sleep, or wakes it.
    Suspend(bool),
}

/// Core, cable and host.
#[derive(Debug)]
pub struct Usb {
    core: Core,
    host: Host,
    /// Whether the pins are the core's.
    wired: bool,
    plugged: bool,
    raised: bool,
    /// Where the block begins that is accessed next.
    block_offset: u64,
    expected: Option<EventId>,
    layout: &'static [RegisterSpec],
}

impl Usb {
    /// Plugged in, as most boards are when they are switched on. `bus` is the part's, windows in place.
    pub fn new(bus: &Bus, places: &Places) -> Self {
        Self {
            core: Core::new(),
            host: Host::new(),
            wired: false,
            plugged: true,
            raised: false,
            block_offset: 0,
            expected: None,
            layout: bus.slots()[places.first_slot()].peripheral().registers,
        }
    }

    /// The next access is to the block that begins there.
    pub fn select(&mut self, block_offset: u64) {
        self.block_offset = block_offset;
    }

    /// The host, to look at.
    pub fn host(&self) -> &Host {
        &self.host
    }

    /// What the firmware did that the model has no answer for.
    pub fn gaps(&self) -> impl Iterator<Item = &str> {
        self.core.gaps()
    }

    /// Whether `wired` is news.
    pub fn would_change(&self, wired: bool) -> bool {
        self.wired != wired
    }

    /// Whether the pins are the core's.
    pub fn wire(&mut self, wired: bool, context: &mut DeviceContext<'_>) {
        self.wired = wired;
        self.follow(context);
    }

    /// Something happens.
    pub fn act(&mut self, action: UsbAction, context: &mut DeviceContext<'_>) {
        let now_ns = context.now().0;
        match action {
            UsbAction::Plug(plugged) => self.plugged = plugged,
            UsbAction::Open(open) => self.host.open_port(now_ns, open),
            UsbAction::Stall(stalled) => self.host.stall(now_ns, stalled),
            UsbAction::Suspend(suspended) => self.host.suspend(now_ns, suspended),
        }
        self.follow(context);
    }

    /// Lets the host do something.
    pub fn drive<T>(&mut self, context: &mut DeviceContext<'_>, act: impl FnOnce(&mut Host, u64) -> T) -> T {
        let result = act(&mut self.host, context.now().0);
        self.follow(context);
        result
    }

    /// What everything that has happened leads to: a device that comes or goes, an interrupt, the host's next turn.
    fn follow(&mut self, context: &mut DeviceContext<'_>) {
        self.host.attach(context.now().0, self.plugged && self.wired && self.core.is_attached());
        if self.core.interrupt() != self.raised {
            self.raised = !self.raised;
            if self.raised { context.raise(0) } else { context.lower(0) }
        }
        if self.host.next_ns() != u64::MAX {
            self.expected = Some(context.schedule(VirtualNanos(self.host.next_ns())));
        }
    }
}

/// All but windows and events belongs to models of registers.
impl ErasedDevice for Usb {
    fn layout(&self) -> &'static [RegisterSpec] {
        self.layout
    }

    fn read(&mut self, _: usize, _: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        None
    }

    fn write(&mut self, _: usize, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.expected == Some(event) {
            self.host.act(context.now().0, &mut self.core);
            self.follow(context);
        }
    }

    fn on_request(&mut self, _: RequestChange, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_clock(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn poll(&mut self, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    /// Of the part. Cable and host stay.
    fn reset(&mut self) {
        self.core.reset();
        self.raised = false;
        self.wired = false;
        self.expected = None;
    }

    /// Of the core alone, by the clock controller.
    fn reset_line(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.core.reset();
        self.raised = false;
        self.follow(context);
    }

    fn on_access(&mut self, _: u64, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn read_window(&mut self, offset: u64, _: Width, context: &mut DeviceContext<'_>) -> u64 {
        let value = self.core.read(self.block_offset + offset);
        self.follow(context);
        value.into()
    }

    fn write_window(&mut self, offset: u64, _: Width, value: u64, context: &mut DeviceContext<'_>) {
        self.core.write(self.block_offset + offset, value as u32);
        self.follow(context);
    }
}

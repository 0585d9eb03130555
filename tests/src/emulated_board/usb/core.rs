//! The USB OTG full-speed core of the part in device mode (RM0090, chapter 34), which the emulator leaves as bare
//! registers: interrupts, FIFOs and endpoints as the driver of the firmware uses them, with a bus side for the host.
//!
//! Modelled as on silicon where that is known to matter: flags cleared by ones, flushes that clear themselves, a transfer
//! that a bus reset does not end, an OUT endpoint that takes the next packet as soon as its NAK is cleared, data toggles,
//! and the erratum that garbles a transmit FIFO when another register is touched while it is filled (ES0206, 2.14.1),
//! which is reported rather than imitated. Left out: the PHY and its timing, VBUS, isochronous transfers, several
//! packets in one transfer, host mode.

use std::collections::{BTreeSet, VecDeque};

use super::registers::*;

/// Endpoints of each direction.
const ENDPOINTS: usize = 4;

/// Words of FIFO memory.
const FIFO_WORDS: u32 = 320;

/// What an endpoint answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Taken.
    Acknowledged,
    /// Data, with its toggle.
    Data(bool, Vec<u8>),
    /// Not now.
    Busy,
    /// Not ever.
    Stalled,
    /// Nobody is there.
    Silence,
}

#[derive(Debug, Default)]
struct Endpoint {
    control: u32,
    interrupts: u32,
    size: u32,
}

impl Endpoint {
    fn write_control(&mut self, value: u32) {
        self.control = self.control & !ENDPOINT_STORED | value & ENDPOINT_STORED;
        let mut set = |bit: u32, on: bool| self.control = if on { self.control | bit } else { self.control & !bit };
        if value & CNAK != 0 {
            set(NAKSTS, false);
        }
        if value & SNAK != 0 {
            set(NAKSTS, true);
        }
        if value & (SD0PID | SD1PID) != 0 {
            set(DPID, value & SD1PID != 0);
        }
        if value & EPDIS != 0 && self.control & EPENA != 0 {
            self.control &= !EPENA;
            self.interrupts |= EPDISD | INEPNE;
        } else if value & EPENA != 0 {
            self.control |= EPENA;
        }
    }

    fn is(&self, bits: u32) -> bool {
        self.control & bits == bits
    }

    fn packets(&self) -> u32 {
        (self.size & PKTCNT_MASK) >> PKTCNT_SHIFT
    }

    fn bytes(&self) -> usize {
        (self.size & XFRSIZ_MASK) as usize
    }
}

#[derive(Debug)]
struct Received {
    status: u32,
    words: VecDeque<u32>,
}

/// The core.
#[derive(Debug)]
pub struct Core {
    ahb_configuration: u32,
    usb_configuration: u32,
    interrupts: u32,
    interrupt_mask: u32,
    transceiver: u32,
    device_configuration: u32,
    /// A new address counts from the end of the transfer that set it.
    address: u8,
    device_control: u32,
    device_status: u32,
    in_mask: u32,
    out_mask: u32,
    endpoint_mask: u32,
    empty_mask: u32,
    receive_size: u32,
    transmit_size: [u32; ENDPOINTS],
    flushed_fifo: u32,
    inputs: [Endpoint; ENDPOINTS],
    outputs: [Endpoint; ENDPOINTS],
    receive: VecDeque<Received>,
    /// What is left of the entry popped last.
    popped: VecDeque<u32>,
    transmit: [VecDeque<u32>; ENDPOINTS],
    /// The IN endpoint whose packet is being written, and how many words are still to come.
    filling: Option<(usize, usize)>,
    /// What the firmware did that this model has no answer for, or that silicon does not stand.
    gaps: BTreeSet<String>,
}

impl Core {
    /// Out of reset.
    pub fn new() -> Self {
        Self {
            ahb_configuration: 0,
            usb_configuration: 0x0000_1440,
            interrupts: GINTSTS_AFTER_RESET,
            interrupt_mask: 0,
            transceiver: 0,
            device_configuration: 0x0220_0000,
            address: 0,
            device_control: 0,
            device_status: 0x10,
            in_mask: 0,
            out_mask: 0,
            endpoint_mask: 0,
            empty_mask: 0,
            receive_size: 0x200,
            transmit_size: [0x0200_0200; ENDPOINTS],
            flushed_fifo: 0,
            inputs: Default::default(),
            outputs: Default::default(),
            receive: VecDeque::new(),
            popped: VecDeque::new(),
            transmit: Default::default(),
            filling: None,
            gaps: BTreeSet::new(),
        }
    }

    /// A reset of the core; what was found missing stays known.
    pub fn reset(&mut self) {
        *self = Self { gaps: std::mem::take(&mut self.gaps), ..Self::new() };
    }

    /// What the firmware did that has no answer here, in words.
    pub fn gaps(&self) -> impl Iterator<Item = &str> {
        self.gaps.iter().map(String::as_str)
    }

    /// Whether the interrupt line is raised.
    pub fn interrupt(&self) -> bool {
        self.ahb_configuration & GINT != 0 && self.all_interrupts() & self.interrupt_mask != 0
    }

    /// Whether the core pulls its data line up, which is how a host sees a device.
    pub fn is_attached(&self) -> bool {
        self.transceiver & (PWRDWN | NOVBUSSENS) == PWRDWN | NOVBUSSENS
            && self.usb_configuration & FDMOD != 0
            && self.device_control & SDIS == 0
    }

    fn all_interrupts(&self) -> u32 {
        let when = |condition: bool, bit: u32| if condition { bit } else { 0 };
        let endpoints = self.endpoint_interrupts() & self.endpoint_mask;
        self.interrupts
            | when(!self.receive.is_empty(), RXFLVL)
            | when(endpoints & 0xFFFF != 0, IEPINT)
            | when(endpoints >> 16 != 0, OEPINT)
    }

    /// One bit for each endpoint: IN from 0, OUT from 16.
    fn endpoint_interrupts(&self) -> u32 {
        (0..ENDPOINTS).fold(0, |all, number| {
            let input = self.inputs[number].interrupts & self.in_mask != 0
                || self.is_transmit_empty(number) && self.empty_mask >> number & 1 != 0;
            let output = self.outputs[number].interrupts & self.out_mask != 0;
            all | u32::from(input) << number | u32::from(output) << (16 + number)
        })
    }

    fn is_transmit_empty(&self, number: usize) -> bool {
        self.transmit[number].is_empty()
    }

    fn space_words(&self, number: usize) -> u32 {
        (self.transmit_size[number] >> 16).saturating_sub(self.transmit[number].len() as u32)
    }

    /// The firmware reads.
    pub fn read(&mut self, offset: u64) -> u32 {
        self.check_order(offset);
        match offset {
            GOTGCTL | GOTGINT | HWCFG4 => 0,
            GAHBCFG => self.ahb_configuration,
            GUSBCFG => self.usb_configuration,
            GRSTCTL => AHBIDL | self.flushed_fifo << 6,
            GINTSTS => self.all_interrupts(),
            GINTMSK => self.interrupt_mask,
            GRXSTSR => self.receive.front().map_or(0, |entry| entry.status),
            GRXSTSP => self.pop(),
            GRXFSIZ => self.receive_size,
            DIEPTXF0 => self.transmit_size[0],
            DIEPTXF1..=DIEPTXF3 => self.transmit_size[(offset - DIEPTXF1) as usize / 4 + 1],
            GCCFG => self.transceiver,
            CID => CORE_ID,
            DCFG => self.device_configuration,
            DCTL => self.device_control,
            DSTS => self.device_status,
            DIEPMSK => self.in_mask,
            DOEPMSK => self.out_mask,
            DAINT => self.endpoint_interrupts(),
            DAINTMSK => self.endpoint_mask,
            DIEPEMPMSK => self.empty_mask,
            FIFOS.. => self.popped.pop_front().unwrap_or_else(|| self.gap("read of an empty receive FIFO".into())),
            _ => match endpoint_register(offset) {
                Some((true, number, 0x00)) => self.inputs[number].control | if number == 0 { USBAEP } else { 0 },
                Some((true, number, 0x08)) => {
                    self.inputs[number].interrupts | if self.is_transmit_empty(number) { TXFE } else { 0 }
                }
                Some((true, number, 0x10)) => self.inputs[number].size,
                Some((true, number, 0x18)) => self.space_words(number),
                Some((false, number, 0x00)) => self.outputs[number].control | if number == 0 { USBAEP } else { 0 },
                Some((false, number, 0x08)) => self.outputs[number].interrupts,
                Some((false, number, 0x10)) => self.outputs[number].size,
                _ => self.gap(format!("read of {offset:#05x}")),
            },
        }
    }

    /// The firmware writes.
    pub fn write(&mut self, offset: u64, value: u32) {
        self.check_order(offset);
        match offset {
            GAHBCFG => self.ahb_configuration = value,
            GUSBCFG => self.usb_configuration = value,
            GRSTCTL => self.reset_or_flush(value),
            // The flags that follow FIFOs and endpoints cannot be cleared here, but they are not kept here either.
            GINTSTS => self.interrupts &= !value | GINTSTS_AFTER_RESET,
            GINTMSK => self.interrupt_mask = value,
            GRXFSIZ => self.receive_size = value,
            DIEPTXF0 => self.place(0, value),
            DIEPTXF1..=DIEPTXF3 => self.place((offset - DIEPTXF1) as usize / 4 + 1, value),
            GCCFG => self.transceiver = value,
            DCFG => self.device_configuration = value,
            DCTL => self.device_control = value,
            DIEPMSK => self.in_mask = value,
            DOEPMSK => self.out_mask = value,
            DAINTMSK => self.endpoint_mask = value,
            DIEPEMPMSK => self.empty_mask = value,
            FIFOS.. => self.push((offset / FIFOS) as usize - 1, value),
            _ => match endpoint_register(offset) {
                Some((true, number, 0x00)) => {
                    let endpoint = &mut self.inputs[number];
                    let was_enabled = endpoint.is(EPENA);
                    endpoint.write_control(value);
                    if endpoint.is(EPENA) && !was_enabled && endpoint.bytes() > 0 {
                        self.filling = Some((number, endpoint.bytes().div_ceil(4)));
                    }
                }
                Some((true, number, 0x08)) => self.inputs[number].interrupts &= !value,
                Some((true, number, 0x10)) => self.inputs[number].size = value,
                Some((false, number, 0x00)) => self.outputs[number].write_control(value),
                Some((false, number, 0x08)) => self.outputs[number].interrupts &= !value,
                Some((false, number, 0x10)) => self.outputs[number].size = value,
                _ => {
                    self.gap(format!("write of {offset:#05x}"));
                }
            },
        }
    }

    fn gap(&mut self, what: String) -> u32 {
        self.gaps.insert(format!("OTG_FS {what}"));
        0
    }

    /// While a packet is written into a FIFO, nothing else may be touched.
    fn check_order(&mut self, offset: u64) {
        if let Some((number, _)) = self.filling
            && offset / FIFOS != number as u64 + 1
        {
            self.gap(format!("access to {offset:#05x} while transmit FIFO {number} is filled"));
        }
    }

    /// Gives an endpoint its part of the FIFO memory.
    fn place(&mut self, number: usize, value: u32) {
        self.transmit_size[number] = value;
        let (start, words) = (value & 0xFFFF, value >> 16);
        if start < self.receive_size || start + words > FIFO_WORDS {
            self.gap(format!("transmit FIFO {number} outside its memory"));
        }
    }

    fn reset_or_flush(&mut self, value: u32) {
        self.flushed_fifo = value >> 6 & 0x1F;
        if value & CSRST != 0 {
            self.interrupts = GINTSTS_AFTER_RESET;
        }
        if value & (CSRST | RXFFLSH) != 0 {
            self.receive.clear();
            self.popped.clear();
        }
        if value & (CSRST | TXFFLSH) != 0 {
            for (number, fifo) in self.transmit.iter_mut().enumerate() {
                if self.flushed_fifo == ALL_FIFOS || self.flushed_fifo == number as u32 {
                    fifo.clear();
                }
            }
        }
        if value & RESET_AND_FLUSH & !(CSRST | RXFFLSH | TXFFLSH) != 0 {
            self.gap(format!("reset {value:#x}"));
        }
    }

    fn pop(&mut self) -> u32 {
        if !self.popped.is_empty() {
            self.gap("receive FIFO not read to the end".into());
        }
        let Some(Received { status, words }) = self.receive.pop_front() else {
            return self.gap("pop of an empty receive FIFO".into());
        };
        self.popped = words;
        let endpoint = &mut self.outputs[(status & 0xF) as usize];
        match status >> 17 {
            SETUP_DONE => endpoint.interrupts |= STUP,
            OUT_DONE => endpoint.interrupts |= XFRC,
            _ => {}
        }
        status
    }

    fn push(&mut self, number: usize, word: u32) {
        if number >= ENDPOINTS || self.space_words(number) == 0 {
            self.gap(format!("transmit FIFO {number} overflowed"));
            return;
        }
        self.transmit[number].push_back(word);
        self.filling = self.filling.and_then(|(number, words)| (words > 1).then_some((number, words - 1)));
    }

    fn receive(&mut self, number: usize, kind: u32, bytes: &[u8]) {
        let word = |bytes: &[u8]| {
            let mut whole = [0; 4];
            whole[..bytes.len()].copy_from_slice(bytes);
            u32::from_le_bytes(whole)
        };
        let words = bytes.chunks(4).map(word).collect();
        self.receive.push_back(Received { status: number as u32 | (bytes.len() as u32) << 4 | kind << 17, words });
    }

    fn hears(&self, address: u8) -> bool {
        self.is_attached() && self.address == address
    }

    /// The host begins to hold both lines down.
    pub fn bus_reset_begins(&mut self) {
        self.interrupts |= USBRST;
        self.address = 0;
        self.device_status &= !SUSPSTS;
    }

    /// It lets go.
    pub fn bus_reset_ends(&mut self) {
        self.interrupts |= ENUMDNE;
        self.device_status |= FULL_SPEED;
        for endpoint in self.inputs.iter_mut().chain(&mut self.outputs) {
            endpoint.control &= !STALL;
        }
    }

    /// Nothing has happened on the bus for 3 ms.
    pub fn bus_sleeps(&mut self) {
        self.interrupts |= ESUSP | USBSUSP;
        self.device_status |= SUSPSTS;
    }

    /// Something happens again.
    pub fn bus_wakes(&mut self) {
        self.interrupts |= WKUPINT;
        self.device_status &= !SUSPSTS;
    }

    /// A frame begins.
    pub fn start_of_frame(&mut self) {
        self.interrupts |= SOF;
        let number = (self.device_status >> FNSOF_SHIFT).wrapping_add(1) & FNSOF_MASK;
        self.device_status = self.device_status & !(FNSOF_MASK << FNSOF_SHIFT) | number << FNSOF_SHIFT;
    }

    /// The host begins a control transfer. A device may not refuse that.
    pub fn setup(&mut self, address: u8, request: [u8; 8]) -> Answer {
        if !self.hears(address) {
            return Answer::Silence;
        }
        for endpoint in [&mut self.inputs[0], &mut self.outputs[0]] {
            endpoint.control = endpoint.control & !STALL | NAKSTS;
        }
        self.receive(0, SETUP_DATA, &request);
        self.receive(0, SETUP_DONE, &[]);
        Answer::Acknowledged
    }

    /// The host sends a packet.
    pub fn output(&mut self, address: u8, number: usize, toggle: bool, bytes: &[u8]) -> Answer {
        if !self.hears(address) || number > 0 && !self.outputs[number].is(USBAEP) {
            return Answer::Silence;
        }
        let endpoint = &mut self.outputs[number];
        if endpoint.is(STALL) {
            return Answer::Stalled;
        }
        // Of endpoint 0 the driver clears no more than the NAK; of the others it writes the size too, but enables them
        // only once.
        if endpoint.is(NAKSTS) || number > 0 && (!endpoint.is(EPENA) || endpoint.packets() == 0) {
            return Answer::Busy;
        }
        if number > 0 && endpoint.is(DPID) != toggle {
            // It has been here before: acknowledged and thrown away.
            return Answer::Acknowledged;
        }
        endpoint.control ^= DPID;
        endpoint.control |= NAKSTS;
        endpoint.size = endpoint.size & !PKTCNT_MASK | endpoint.packets().saturating_sub(1) << PKTCNT_SHIFT;
        self.receive(number, OUT_DATA, bytes);
        self.receive(number, OUT_DONE, &[]);
        Answer::Acknowledged
    }

    /// The host asks for a packet.
    pub fn input(&mut self, address: u8, number: usize) -> Answer {
        if !self.hears(address) || number > 0 && !self.inputs[number].is(USBAEP) {
            return Answer::Silence;
        }
        let endpoint = &self.inputs[number];
        if endpoint.is(STALL) {
            return Answer::Stalled;
        }
        let (bytes, words) = (endpoint.bytes(), endpoint.bytes().div_ceil(4));
        if !endpoint.is(EPENA) || endpoint.is(NAKSTS) || self.transmit[number].len() < words {
            return Answer::Busy;
        }
        let mut data: Vec<u8> = self.transmit[number].iter().take(words).flat_map(|word| word.to_le_bytes()).collect();
        data.truncate(bytes);
        Answer::Data(endpoint.is(DPID), data)
    }

    /// The host has the packet.
    pub fn input_taken(&mut self, number: usize) {
        let words = self.inputs[number].bytes().div_ceil(4);
        self.transmit[number].drain(..words);
        if number == 0 && words == 0 {
            self.address = (self.device_configuration >> 4 & 0x7F) as u8;
        }
        let endpoint = &mut self.inputs[number];
        endpoint.control = (endpoint.control ^ DPID) & !EPENA;
        endpoint.size = 0;
        endpoint.interrupts |= XFRC;
    }
}

/// Whether it is of an IN endpoint, the endpoint's number, and the register's offset among the endpoint's.
fn endpoint_register(offset: u64) -> Option<(bool, usize, u64)> {
    let (is_input, within) = match offset {
        IN_ENDPOINTS..OUT_ENDPOINTS => (true, offset - IN_ENDPOINTS),
        OUT_ENDPOINTS..0xD00 => (false, offset - OUT_ENDPOINTS),
        _ => return None,
    };
    let number = (within / 0x20) as usize;
    (number < ENDPOINTS).then_some((is_input, number, within % 0x20))
}

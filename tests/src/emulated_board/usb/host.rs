//! A USB host with one port: recognises the device, asks for everything a system asks for, and then carries bytes for
//! the program that has the serial port open.
//!
//! Its frames last 1 ms, and a packet takes the time its bits take on a full-speed bus, so that 19 full ones fit a frame.
//! A device that is busy is asked again after an eighth of a frame. Times between plugging in, resets and requests are
//! those the standard prescribes (USB 2.0, 7.1.7), which real systems keep or exceed.

use std::collections::VecDeque;

use super::core::{Answer, Core};
use super::transfer::{Progress, Transfer};

const MILLISECOND: u64 = 1_000_000;
/// Contacts bounce for so long.
const DEBOUNCE_NS: u64 = 100 * MILLISECOND;
const RESET_NS: u64 = 10 * MILLISECOND;
const RECOVERY_NS: u64 = 10 * MILLISECOND;
/// After so long without anything on the bus, a device is to sleep.
const SLEEP_AFTER_NS: u64 = 3 * MILLISECOND;
/// How long a bus is woken.
const RESUME_NS: u64 = 20 * MILLISECOND;
const FRAME_NS: u64 = MILLISECOND;
const BUSY_NS: u64 = FRAME_NS / 8;
/// One byte at 12 Mbit/s.
const BYTE_NS: u64 = 667;
/// Bytes that go with the data of a transaction: tokens, check sums, gaps.
const TRANSACTION_BYTES: u64 = 13;
/// How long a system has patience with a control transfer.
const PATIENCE_NS: u64 = 500 * MILLISECOND;

const BULK_BYTES: usize = 64;
/// How much a system asks for at once. It sees nothing of it before that much or a packet of less than full length has
/// come: so Linux reads a serial port.
const READ_BYTES: usize = 2 * BULK_BYTES;
const ADDRESS: u8 = 5;
/// Endpoints of the data interface, as in the configuration descriptor.
const DATA_INPUT: usize = 2;
const DATA_OUTPUT: usize = 1;

/// 1 Mbaud, one stop bit, no parity, 8 bits. It means nothing on USB, but systems send it.
pub const LINE_CODING: [u8; 7] = [0x40, 0x42, 0x0F, 0x00, 0, 0, 8];

/// What the host found out about the device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Enumerated {
    /// Device descriptor.
    pub device: Vec<u8>,
    /// Configuration descriptor with all that is in it.
    pub configuration: Vec<u8>,
    /// Manufacturer, product, serial number.
    pub strings: Vec<String>,
    /// Line coding read back.
    pub line_coding: Vec<u8>,
}

/// What the host is to ask next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    FirstDescriptor,
    SetAddress,
    Device,
    ConfigurationHeader,
    Configuration,
    Languages,
    /// Which of the three.
    Text(u8),
    SetConfiguration,
    SetLineCoding,
    LineCoding,
    OpenPort,
    ClosePort,
}

/// What the bus is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bus {
    /// No device; a device that still has power falls asleep.
    Nothing {
        sleeps_ns: Option<u64>,
    },
    /// A device is there, but may still bounce.
    Debouncing,
    Resetting {
        then: Step,
    },
    Recovering {
        then: Step,
    },
    Running,
    /// Put to sleep by the host.
    Asleep {
        sleeps_ns: Option<u64>,
    },
    Waking,
}

/// The host.
#[derive(Debug)]
pub struct Host {
    bus: Bus,
    /// When it does something next.
    next_ns: u64,
    frame_ns: u64,
    steps: VecDeque<Step>,
    transfer: Option<(Step, Transfer, u64)>,
    address: u8,
    configured: bool,
    open: bool,
    wants_open: bool,
    stalled: bool,
    input_toggle: bool,
    output_toggle: bool,
    input_busy_ns: u64,
    output_busy_ns: u64,
    output_turn: bool,
    to_board: VecDeque<u8>,
    /// What has come of the present request.
    reading: Vec<u8>,
    from_board: Vec<u8>,
    found: Enumerated,
    enumerations: u32,
    failures: u32,
    sent_packets: u64,
    received_packets: u64,
    empty_packets: u64,
}

impl Host {
    /// With nothing plugged in.
    pub fn new() -> Self {
        Self {
            bus: Bus::Nothing { sleeps_ns: None },
            next_ns: u64::MAX,
            frame_ns: 0,
            steps: VecDeque::new(),
            transfer: None,
            address: 0,
            configured: false,
            open: false,
            wants_open: false,
            stalled: false,
            input_toggle: false,
            output_toggle: false,
            input_busy_ns: 0,
            output_busy_ns: 0,
            output_turn: false,
            to_board: VecDeque::new(),
            reading: Vec::new(),
            from_board: Vec::new(),
            found: Enumerated::default(),
            enumerations: 0,
            failures: 0,
            sent_packets: 0,
            received_packets: 0,
            empty_packets: 0,
        }
    }

    /// When it wants its next turn.
    pub fn next_ns(&self) -> u64 {
        self.next_ns
    }

    /// A device comes or goes.
    pub fn attach(&mut self, now_ns: u64, attached: bool) {
        let is_there = !matches!(self.bus, Bus::Nothing { .. });
        if attached == is_there {
            return;
        }
        self.transfer = None;
        self.steps.clear();
        (self.configured, self.open) = (false, false);
        self.to_board.clear();
        (self.bus, self.next_ns) = if attached {
            (Bus::Debouncing, now_ns + DEBOUNCE_NS)
        } else {
            (Bus::Nothing { sleeps_ns: Some(now_ns + SLEEP_AFTER_NS) }, now_ns + SLEEP_AFTER_NS)
        };
    }

    /// A program opens the serial port, or closes it. Asked for early, it opens as soon as there is one.
    pub fn open_port(&mut self, now_ns: u64, open: bool) {
        self.wants_open = open;
        if self.configured && self.open != open {
            self.steps.extend(if open { &OPENING[..] } else { &[Step::ClosePort] });
            self.open = false;
            self.from_board.clear();
            self.next_ns = self.next_ns.min(now_ns);
        }
    }

    /// Whether bytes go to and fro.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// The program stops reading, or goes on.
    pub fn stall(&mut self, now_ns: u64, stalled: bool) {
        self.stalled = stalled;
        self.next_ns = self.next_ns.min(now_ns);
    }

    /// Puts the bus to sleep, or wakes it.
    pub fn suspend(&mut self, now_ns: u64, suspended: bool) {
        match (self.bus, suspended) {
            (Bus::Running, true) => {
                (self.bus, self.next_ns) =
                    (Bus::Asleep { sleeps_ns: Some(now_ns + SLEEP_AFTER_NS) }, now_ns + SLEEP_AFTER_NS);
            }
            (Bus::Asleep { .. }, false) => (self.bus, self.next_ns) = (Bus::Waking, now_ns + RESUME_NS),
            _ => {}
        }
    }

    /// Bytes for the board; lost where the port is not open.
    pub fn send(&mut self, now_ns: u64, bytes: &[u8]) {
        if self.open {
            self.to_board.extend(bytes);
            self.next_ns = self.next_ns.min(now_ns);
        }
    }

    /// What the board has sent and nobody has taken yet.
    pub fn received(&self) -> &[u8] {
        &self.from_board
    }

    /// Takes it.
    pub fn take_received(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.from_board)
    }

    /// What it found out about the device.
    pub fn found(&self) -> &Enumerated {
        &self.found
    }

    /// How often a device was recognised, and how often a control transfer failed.
    pub fn enumerations(&self) -> (u32, u32) {
        (self.enumerations, self.failures)
    }

    /// Bulk packets that went to the board and came from it.
    pub fn packets(&self) -> (u64, u64) {
        (self.sent_packets, self.received_packets)
    }

    /// Packets without a byte, which end a transfer whose other packets are full.
    pub fn empty_packets(&self) -> u64 {
        self.empty_packets
    }

    /// Its turn.
    pub fn act(&mut self, now_ns: u64, core: &mut Core) {
        if now_ns < self.next_ns {
            return;
        }
        self.next_ns = match self.bus {
            Bus::Nothing { sleeps_ns } | Bus::Asleep { sleeps_ns } => {
                if sleeps_ns.is_some_and(|at_ns| now_ns >= at_ns) {
                    core.bus_sleeps();
                    self.bus = match self.bus {
                        Bus::Nothing { .. } => Bus::Nothing { sleeps_ns: None },
                        _ => Bus::Asleep { sleeps_ns: None },
                    };
                    u64::MAX
                } else {
                    sleeps_ns.unwrap_or(u64::MAX)
                }
            }
            Bus::Debouncing => self.reset(now_ns, core, Step::FirstDescriptor),
            Bus::Resetting { then } => {
                core.bus_reset_ends();
                self.bus = Bus::Recovering { then };
                now_ns + RECOVERY_NS
            }
            Bus::Recovering { then } => {
                self.bus = Bus::Running;
                self.frame_ns = now_ns;
                self.steps.push_back(then);
                now_ns
            }
            Bus::Waking => {
                core.bus_wakes();
                self.bus = Bus::Running;
                self.frame_ns = now_ns;
                now_ns
            }
            Bus::Running => self.transact(now_ns, core),
        };
    }

    fn reset(&mut self, now_ns: u64, core: &mut Core, then: Step) -> u64 {
        core.bus_reset_begins();
        self.address = 0;
        self.bus = Bus::Resetting { then };
        now_ns + RESET_NS
    }

    /// One transaction; returns when the bus is free again.
    fn transact(&mut self, now_ns: u64, core: &mut Core) -> u64 {
        if now_ns >= self.frame_ns {
            self.frame_ns = now_ns + FRAME_NS;
            core.start_of_frame();
            return now_ns + TRANSACTION_BYTES * BYTE_NS;
        }
        // What does not fit the frame waits for the next.
        if now_ns + duration_ns(BULK_BYTES) > self.frame_ns {
            return self.frame_ns;
        }
        if self.transfer.is_none()
            && let Some(step) = self.steps.pop_front()
        {
            self.transfer = Some((step, self.ask(step), now_ns + PATIENCE_NS));
        }
        if self.transfer.is_some() {
            return self.control(now_ns, core);
        }
        let output = self.open && !self.to_board.is_empty() && now_ns >= self.output_busy_ns;
        let input = self.open && !self.stalled && now_ns >= self.input_busy_ns;
        self.output_turn = output && (!input || !self.output_turn);
        match (self.output_turn, input) {
            (true, _) => self.bulk_output(now_ns, core),
            (false, true) => self.bulk_input(now_ns, core),
            (false, false) => {
                let waits = |active: bool, at_ns: u64| if active { at_ns } else { u64::MAX };
                let output_ns = waits(self.open && !self.to_board.is_empty(), self.output_busy_ns);
                let input_ns = waits(self.open && !self.stalled, self.input_busy_ns);
                output_ns.min(input_ns).min(self.frame_ns)
            }
        }
    }

    fn bulk_output(&mut self, now_ns: u64, core: &mut Core) -> u64 {
        let count = self.to_board.len().min(BULK_BYTES);
        let packet: Vec<u8> = self.to_board.iter().copied().take(count).collect();
        match core.output(self.address, DATA_OUTPUT, self.output_toggle, &packet) {
            Answer::Acknowledged => {
                self.to_board.drain(..count);
                self.output_toggle = !self.output_toggle;
                self.sent_packets += 1;
            }
            _ => self.output_busy_ns = now_ns + BUSY_NS,
        }
        now_ns + duration_ns(count)
    }

    fn bulk_input(&mut self, now_ns: u64, core: &mut Core) -> u64 {
        match core.input(self.address, DATA_INPUT) {
            Answer::Data(toggle, data) => {
                core.input_taken(DATA_INPUT);
                // One with the wrong toggle is taken for a repetition.
                if toggle == self.input_toggle {
                    self.input_toggle = !self.input_toggle;
                    self.received_packets += 1;
                    self.empty_packets += u64::from(data.is_empty());
                    self.reading.extend(&data);
                    if data.len() < BULK_BYTES || self.reading.len() >= READ_BYTES {
                        self.from_board.append(&mut self.reading);
                    }
                }
                now_ns + duration_ns(data.len())
            }
            _ => {
                self.input_busy_ns = now_ns + BUSY_NS;
                now_ns + duration_ns(0)
            }
        }
    }

    fn control(&mut self, now_ns: u64, core: &mut Core) -> u64 {
        let Some((step, mut transfer, until_ns)) = self.transfer.take() else { return now_ns };
        match transfer.advance(core, self.address) {
            Progress::Bytes(bytes) => {
                self.transfer = Some((step, transfer, until_ns));
                now_ns + duration_ns(bytes)
            }
            Progress::Busy if now_ns < until_ns => {
                self.transfer = Some((step, transfer, until_ns));
                now_ns + BUSY_NS
            }
            Progress::Busy | Progress::Failed => {
                // A system gives up and begins anew.
                self.failures += 1;
                self.steps.clear();
                self.configured = false;
                self.open = false;
                self.reset(now_ns, core, Step::FirstDescriptor)
            }
            Progress::Done(data) => self.finish(now_ns, core, step, data),
        }
    }

    fn ask(&self, step: Step) -> Transfer {
        const DEVICE: u8 = 1;
        const CONFIGURATION: u8 = 2;
        const STRING: u8 = 3;
        const ENGLISH: u16 = 0x0409;
        match step {
            Step::FirstDescriptor => Transfer::descriptor(DEVICE, 0, 0, 64),
            Step::SetAddress => Transfer::set_address(ADDRESS),
            Step::Device => Transfer::descriptor(DEVICE, 0, 0, 18),
            Step::ConfigurationHeader => Transfer::descriptor(CONFIGURATION, 0, 0, 9),
            Step::Configuration => {
                let length = [2, 3].map(|index| self.found.configuration.get(index).copied().unwrap_or(0));
                Transfer::descriptor(CONFIGURATION, 0, 0, u16::from_le_bytes(length))
            }
            Step::Languages => Transfer::descriptor(STRING, 0, 0, 255),
            Step::Text(which) => {
                let index = self.found.device.get(14 + usize::from(which)).copied().unwrap_or(0);
                Transfer::descriptor(STRING, index, ENGLISH, 255)
            }
            Step::SetConfiguration => {
                Transfer::set_configuration(self.found.configuration.get(5).copied().unwrap_or(0))
            }
            Step::SetLineCoding => Transfer::set_line_coding(LINE_CODING),
            Step::LineCoding => Transfer::line_coding(),
            Step::OpenPort => Transfer::set_lines(true),
            Step::ClosePort => Transfer::set_lines(false),
        }
    }

    fn finish(&mut self, now_ns: u64, core: &mut Core, step: Step, data: Vec<u8>) -> u64 {
        match step {
            // Systems reset a second time before they give an address.
            Step::FirstDescriptor => return self.reset(now_ns, core, Step::SetAddress),
            Step::SetAddress => {
                self.address = ADDRESS;
                self.found = Enumerated::default();
                self.steps.extend([Step::Device, Step::ConfigurationHeader, Step::Configuration, Step::Languages]);
                self.steps.extend([Step::Text(0), Step::Text(1), Step::Text(2), Step::SetConfiguration]);
                // The device has 2 ms to get used to it.
                return now_ns + 2 * MILLISECOND;
            }
            Step::Device => self.found.device = data,
            Step::ConfigurationHeader | Step::Configuration => self.found.configuration = data,
            Step::Languages => {}
            Step::Text(_) => {
                let units: Vec<u16> = data
                    .get(2..)
                    .unwrap_or(&[])
                    .chunks_exact(2)
                    .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
                    .collect();
                self.found.strings.push(String::from_utf16_lossy(&units));
            }
            Step::SetConfiguration => {
                self.configured = true;
                self.enumerations += 1;
                (self.input_toggle, self.output_toggle) = (false, false);
                if self.wants_open {
                    self.steps.extend(OPENING);
                }
            }
            Step::SetLineCoding => {}
            Step::LineCoding => self.found.line_coding = data,
            Step::OpenPort => {
                self.open = true;
                self.from_board.clear();
                self.reading.clear();
            }
            Step::ClosePort => self.open = false,
        }
        now_ns + duration_ns(0)
    }
}

const OPENING: [Step; 3] = [Step::SetLineCoding, Step::LineCoding, Step::OpenPort];

/// How long a transaction with so many bytes of data occupies the bus.
fn duration_ns(bytes: usize) -> u64 {
    (TRANSACTION_BYTES + bytes as u64) * BYTE_NS
}

//! The two wires between probe and chip, bit by bit (ARM IHI 0031, chapter B4): how the debug port's own registers are read
//! and written. Access ports are left out; no probe that knows registers and memory by name asks for them here.

use super::debug_port::DebugPort;

/// A request, the first bit being the lowest: start, access port, read, two bits of the address, parity, stop, park.
const REQUEST_BITS: u32 = 8;
const FRAME_MASK: u32 = 0b1100_0001;
const FRAME: u32 = 0b1000_0001;
const ACCESS_PORT: u32 = 1 << 1;
const READ: u32 = 1 << 2;
const ADDRESS_SHIFT: u32 = 3;
const UNDER_PARITY: u32 = 0b11_1110;
/// As many ones as never stand in a request or an idle line: the line is being reset.
const RESET: u32 = 0xFF;

/// A register and its parity.
const DATA_BITS: u32 = 33;
/// The acknowledgement, from its lowest bit.
const ACKNOWLEDGED: u64 = 0b001;
const ACKNOWLEDGEMENT_BITS: u32 = 3;
/// Lines that nobody drives are high.
const NOBODY_ANSWERS: u64 = u64::MAX;

/// What the next bit from the probe belongs to.
#[derive(Clone, Copy, Debug, Default)]
enum State {
    #[default]
    Idle,
    /// Ones, until the first zero.
    Reset,
    Request {
        bits: u32,
        count: u32,
    },
    Data {
        register: u16,
        bits: u64,
        count: u32,
    },
}

/// The chip's end of the wires.
#[derive(Debug)]
pub struct Wires {
    state: State,
    /// What the chip puts on the wire next, from the lowest bit.
    answer: u64,
}

impl Default for Wires {
    fn default() -> Self {
        Self { state: State::default(), answer: NOBODY_ANSWERS }
    }
}

impl Wires {
    /// The probe puts out the lowest `count` bits, from the lowest.
    pub fn put(&mut self, port: &mut DebugPort, count: u32, bits: u32) {
        for index in 0..count.min(u32::BITS) {
            self.state = self.next(port, bits >> index & 1);
        }
    }

    /// The probe reads so many bits, at most 63; the first becomes the lowest.
    pub fn take(&mut self, count: u32) -> u64 {
        let count = count.min(63);
        let taken = self.answer & ((1 << count) - 1);
        self.answer >>= count;
        taken
    }

    fn next(&mut self, port: &mut DebugPort, bit: u32) -> State {
        match self.state {
            State::Idle | State::Reset if bit == 0 => State::Idle,
            State::Reset => State::Reset,
            State::Idle => State::Request { bits: 1, count: 1 },
            State::Request { bits, count } => {
                let (bits, count) = (bits | bit << count, count + 1);
                if count < REQUEST_BITS { State::Request { bits, count } } else { self.request(port, bits) }
            }
            State::Data { register, bits, count } => {
                let (bits, count) = (bits | u64::from(bit) << count, count + 1);
                if count < DATA_BITS {
                    return State::Data { register, bits, count };
                }
                // Of whole data the ones are even in number.
                if bits.count_ones().is_multiple_of(2) {
                    port.write(register, bits as u32);
                }
                State::Idle
            }
        }
    }

    fn request(&mut self, port: &DebugPort, bits: u32) -> State {
        self.answer = NOBODY_ANSWERS;
        if bits == RESET {
            return State::Reset;
        }
        let is_request = bits & FRAME_MASK == FRAME && (bits & UNDER_PARITY).count_ones().is_multiple_of(2);
        if !is_request || bits & ACCESS_PORT != 0 {
            return State::Idle;
        }
        let register = (bits >> ADDRESS_SHIFT & 3) as u16 * 4;
        self.answer = ACKNOWLEDGED;
        if bits & READ == 0 {
            return State::Data { register, bits: 0, count: 0 };
        }
        let data = port.read(register);
        let data = u64::from(data) | u64::from(data.count_ones() % 2) << 32;
        self.answer |= data << ACKNOWLEDGEMENT_BITS;
        State::Idle
    }
}

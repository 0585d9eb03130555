//! Control transfers: what the host asks endpoint 0, and how a transfer goes from stage to stage.

use super::core::{Answer, Core};

/// Bytes of a packet of endpoint 0.
const PACKET_BYTES: usize = 64;

const DEVICE_TO_HOST: u8 = 0x80;
const CLASS_INTERFACE: u8 = 0x21;

/// One control transfer.
#[derive(Debug)]
pub struct Transfer {
    setup: [u8; 8],
    output: Vec<u8>,
    input: Vec<u8>,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Setup,
    Input,
    /// From so many bytes on.
    Output(usize),
    StatusIn,
    StatusOut,
}

/// What one transaction brought.
#[derive(Debug)]
pub enum Progress {
    /// Bytes that went over the bus; there is more to do.
    Bytes(usize),
    /// The device is busy.
    Busy,
    /// Done, with what the device answered.
    Done(Vec<u8>),
    /// The device refuses, or does not answer.
    Failed,
}

impl Transfer {
    fn new(kind: u8, request: u8, value: u16, index: u16, length: u16, output: Vec<u8>) -> Self {
        let [value, index, length] = [value, index, length].map(u16::to_le_bytes);
        let setup = [kind, request, value[0], value[1], index[0], index[1], length[0], length[1]];
        Self { setup, output, input: Vec::new(), stage: Stage::Setup }
    }

    /// GET_DESCRIPTOR.
    pub fn descriptor(kind: u8, index: u8, language: u16, length: u16) -> Self {
        Self::new(DEVICE_TO_HOST, 6, u16::from(kind) << 8 | u16::from(index), language, length, Vec::new())
    }

    /// SET_ADDRESS.
    pub fn set_address(address: u8) -> Self {
        Self::new(0, 5, address.into(), 0, 0, Vec::new())
    }

    /// SET_CONFIGURATION.
    pub fn set_configuration(configuration: u8) -> Self {
        Self::new(0, 9, configuration.into(), 0, 0, Vec::new())
    }

    /// SET_LINE_CODING of interface 0.
    pub fn set_line_coding(coding: [u8; 7]) -> Self {
        Self::new(CLASS_INTERFACE, 0x20, 0, 0, 7, coding.to_vec())
    }

    /// GET_LINE_CODING of interface 0.
    pub fn line_coding() -> Self {
        Self::new(CLASS_INTERFACE | DEVICE_TO_HOST, 0x21, 0, 0, 7, Vec::new())
    }

    /// SET_CONTROL_LINE_STATE of interface 0: DTR and RTS together.
    pub fn set_lines(on: bool) -> Self {
        Self::new(CLASS_INTERFACE, 0x22, if on { 0b11 } else { 0 }, 0, 0, Vec::new())
    }

    fn is_input(&self) -> bool {
        self.setup[0] & DEVICE_TO_HOST != 0
    }

    fn length(&self) -> usize {
        u16::from_le_bytes([self.setup[6], self.setup[7]]).into()
    }

    /// The next transaction.
    pub fn advance(&mut self, core: &mut Core, address: u8) -> Progress {
        let answer = match self.stage {
            Stage::Setup => core.setup(address, self.setup),
            Stage::Input | Stage::StatusIn => core.input(address, 0),
            Stage::Output(from) => {
                let to = self.output.len().min(from + PACKET_BYTES);
                core.output(address, 0, true, &self.output[from..to])
            }
            Stage::StatusOut => core.output(address, 0, true, &[]),
        };
        match (answer, self.stage) {
            (Answer::Busy, _) => Progress::Busy,
            (Answer::Stalled | Answer::Silence, _) => Progress::Failed,
            (Answer::Data(_, data), Stage::StatusIn) => {
                core.input_taken(0);
                if data.is_empty() { Progress::Done(Vec::new()) } else { Progress::Failed }
            }
            (Answer::Data(_, data), _) => {
                core.input_taken(0);
                self.input.extend(&data);
                if data.len() < PACKET_BYTES || self.input.len() >= self.length() {
                    self.stage = Stage::StatusOut;
                }
                Progress::Bytes(data.len())
            }
            (Answer::Acknowledged, Stage::StatusOut) => Progress::Done(std::mem::take(&mut self.input)),
            (Answer::Acknowledged, Stage::Output(from)) => {
                let to = self.output.len().min(from + PACKET_BYTES);
                self.stage = if to == self.output.len() { Stage::StatusIn } else { Stage::Output(to) };
                Progress::Bytes(to - from)
            }
            (Answer::Acknowledged, _) => {
                self.stage = match (self.is_input(), self.output.is_empty()) {
                    (true, _) => Stage::Input,
                    (false, false) => Stage::Output(0),
                    (false, true) => Stage::StatusIn,
                };
                Progress::Bytes(self.setup.len())
            }
        }
    }
}

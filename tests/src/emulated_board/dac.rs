//! The digital-analogue converter, which the emulator leaves as bare registers.
//!
//! Modelled: both channels switched on and off, and every holding register of the untriggered mode (RM0090, 14.3).
//! Left out: triggers, wave generators, DMA, and the buffer's settling time of some microseconds.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32f427::generated::dac::{Register, cr};

/// What the two channels put out.
#[derive(Debug, Default)]
pub struct Dac {
    code: [u16; 2],
    enabled: [bool; 2],
}

impl Dac {
    /// The codes at the outputs; `None` for a channel that is switched off and drives nothing.
    pub fn outputs(&self) -> [Option<u16>; 2] {
        [0, 1].map(|channel| self.enabled[channel].then_some(self.code[channel]))
    }
}

impl Device for Dac {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, _: &mut DeviceContext<'_>) {
        let twelve_bits = |shift: u32| Some((value >> shift & 0xFFF) as u16);
        let eight_bits = |shift: u32| Some(((value >> shift & 0xFF) << 4) as u16);
        let codes = match register {
            Register::Cr => {
                self.enabled = [cr::EN1.is_set(value), cr::EN2.is_set(value)];
                return;
            }
            Register::Dhr12r1 => [twelve_bits(0), None],
            Register::Dhr12l1 => [twelve_bits(4), None],
            Register::Dhr8r1 => [eight_bits(0), None],
            Register::Dhr12r2 => [None, twelve_bits(0)],
            Register::Dhr12l2 => [None, twelve_bits(4)],
            Register::Dhr8r2 => [None, eight_bits(0)],
            Register::Dhr12rd => [twelve_bits(0), twelve_bits(16)],
            Register::Dhr12ld => [twelve_bits(4), twelve_bits(20)],
            Register::Dhr8rd => [eight_bits(0), eight_bits(8)],
            Register::Swtrigr | Register::Dor1 | Register::Dor2 | Register::Sr => return,
        };
        for (channel, output) in [Register::Dor1, Register::Dor2].into_iter().enumerate() {
            if let Some(code) = codes[channel] {
                self.code[channel] = code;
                registers.set(output, code.into());
            }
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use rigless::mcu::{Operate as _, Single};
    use rigless::soc::Width;
    use rigless::soc::stm32f427::{builder, generated::DAC};
    use rigless::time::VirtualNanos;

    use super::*;

    const CONTROL: u64 = 0x00;
    const RIGHT_ALIGNED_SECOND: u64 = 0x14;
    const RIGHT_ALIGNED_BOTH: u64 = 0x20;
    const LEFT_ALIGNED_BOTH: u64 = 0x24;

    #[test]
    fn a_channel_puts_out_what_was_written_last_once_it_is_switched_on() {
        let mut converter = Single::new(builder(), "DAC", Dac::default()).unwrap();
        let write = |converter: &mut Single<Dac>, offset: u64, value: u64| {
            converter.write(VirtualNanos(0), DAC.base + offset, Width::W32, value).unwrap();
        };
        write(&mut converter, RIGHT_ALIGNED_BOTH, 0x0123_0456);
        assert_eq!(converter.model.outputs(), [None, None]);
        write(&mut converter, CONTROL, 0x0001_0001);
        assert_eq!(converter.model.outputs(), [Some(0x456), Some(0x123)]);
        write(&mut converter, RIGHT_ALIGNED_SECOND, 0x800);
        assert_eq!(converter.model.outputs(), [Some(0x456), Some(0x800)]);
        write(&mut converter, LEFT_ALIGNED_BOTH, 0x1230_4560);
        assert_eq!(converter.model.outputs(), [Some(0x456), Some(0x123)]);
    }
}

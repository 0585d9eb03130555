//! The microcontroller: the emulator's STM32F427, the same peripherals as the board's STM32F429, with our converter
//! in the place where it has none.

use rigless::device::{ErasedDevice, ResetCause};
use rigless::mcu::Mcu;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use super::dac::Dac;

/// The part with its digital-analogue converter.
#[derive(Debug)]
pub struct Part {
    /// Everything the emulator models itself.
    pub stm32: Stm32f427,
    /// The converter.
    pub dac: Dac,
    dac_slot: usize,
}

impl Part {
    /// A part fresh out of reset.
    pub fn new() -> Result<Self, Error> {
        let stm32 = Stm32f427::new()?;
        let dac_slot = stm32.bus().slot("DAC")?;
        Ok(Self { stm32, dac: Dac::default(), dac_slot })
    }
}

impl Mcu for Part {
    fn bus(&self) -> &Bus {
        self.stm32.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.stm32.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.stm32.reset(at, cause);
        self.dac = Dac::default();
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.stm32.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        if slot == self.dac_slot { (self.stm32.bus_mut(), Some(&mut self.dac)) } else { self.stm32.split(slot) }
    }
}

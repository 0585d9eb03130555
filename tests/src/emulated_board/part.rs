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
    /// What the board does to a part it has just switched on: clock, supply, wires.
    fit: fn(&mut Stm32f427),
    /// Everything the emulator models itself.
    pub stm32: Stm32f427,
    /// The converter.
    pub dac: Dac,
    dac_slot: usize,
}

impl Part {
    /// A part that has just been switched on, on a board that does `fit` to it.
    pub fn new(fit: fn(&mut Stm32f427)) -> Result<Self, Error> {
        let mut stm32 = Stm32f427::new()?;
        fit(&mut stm32);
        let dac_slot = stm32.bus().slot("DAC")?;
        Ok(Self { fit, stm32, dac: Dac::default(), dac_slot })
    }

    /// Cuts the supply, or gives it back. It takes effect before the next instruction that touches a register.
    pub fn set_power(&mut self, at: VirtualNanos, on: bool) {
        let (_, mut context) = self.stm32.bus_mut().drive(at, self.dac_slot);
        context.request_power(on);
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
        if cause == ResetCause::PowerOn {
            // The emulator's part takes any reset but this: it leaves nothing of what was.
            *self = Self::new(self.fit).expect("a part that was assembled once");
        } else {
            self.stm32.reset(at, cause);
            self.dac = Dac::default();
        }
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.stm32.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        if slot == self.dac_slot { (self.stm32.bus_mut(), Some(&mut self.dac)) } else { self.stm32.split(slot) }
    }
}

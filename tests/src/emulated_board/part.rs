//! The microcontroller: the emulator's STM32F427, the same peripherals as the board's STM32F429, with our converter and
//! USB core in the places where it has none.

use rigless::device::{DeviceContext, ErasedDevice, ResetCause};
use rigless::mcu::Mcu;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use super::dac::Dac;
use super::usb::{Places, Usb};

/// The part with its digital-analogue converter and its USB core.
#[derive(Debug)]
pub struct Part {
    /// What the board does to a part it has just switched on: clock, supply, wires.
    fit: fn(&mut Stm32f427),
    /// Everything the emulator models itself.
    pub stm32: Stm32f427,
    /// The converter.
    pub dac: Dac,
    /// The USB core, and the host at the other end of its cable.
    pub usb: Usb,
    dac_slot: usize,
    usb_places: Places,
}

impl Part {
    /// A part that has just been switched on, on a board that does `fit` to it.
    pub fn new(fit: fn(&mut Stm32f427)) -> Result<Self, Error> {
        let mut stm32 = Stm32f427::new()?;
        fit(&mut stm32);
        let dac_slot = stm32.bus().slot("DAC")?;
        let mut usb_places = Places::new(stm32.bus())?;
        usb_places.exchange(stm32.bus_mut());
        let usb = Usb::new(stm32.bus(), &usb_places);
        Ok(Self { fit, stm32, dac: Dac::default(), usb, dac_slot, usb_places })
    }

    /// Something happens to the USB core from outside.
    pub fn drive_usb<T>(&mut self, at: VirtualNanos, act: impl FnOnce(&mut Usb, &mut DeviceContext<'_>) -> T) -> T {
        let (_, mut context) = self.stm32.bus_mut().drive(at, self.usb_places.first_slot());
        act(&mut self.usb, &mut context)
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
            // The emulator's part takes any reset but this: it leaves nothing of what was, but for the cable's other end.
            let usb = std::mem::replace(self, Self::new(self.fit).expect("a part that was assembled once")).usb;
            self.usb = usb;
        } else {
            self.usb_places.exchange(self.stm32.bus_mut());
            self.stm32.reset(at, cause);
            self.usb_places.exchange(self.stm32.bus_mut());
            self.dac = Dac::default();
        }
        self.usb.reset();
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.stm32.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        if slot == self.dac_slot {
            return (self.stm32.bus_mut(), Some(&mut self.dac));
        }
        match self.usb_places.offset(self.stm32.bus(), slot) {
            Some(offset) => {
                self.usb.select(offset);
                (self.stm32.bus_mut(), Some(&mut self.usb))
            }
            None => self.stm32.split(slot),
        }
    }
}

#[cfg(test)]
mod tests {
    use rigless::mcu::Operate as _;
    use rigless::soc::{Fault, Width};

    use super::*;

    const CLOCK_ENABLE: u64 = 0x4002_3834;
    const CORE_ID: u64 = 0x5000_003C;
    const FIFO: u64 = 0x5000_1000;

    #[test]
    fn the_part_is_the_stock_one_but_for_the_usb_core_also_after_a_reset() {
        let mut part = Part::new(|_| ()).unwrap();
        let stock = Stm32f427::new().unwrap();
        for _ in 0..2 {
            let mut compared = 0;
            for (ours, theirs) in part.bus().slots().iter().zip(stock.bus().slots()) {
                let [ours_is, theirs_is] = [ours, theirs].map(|slot| *slot.peripheral());
                assert_eq!(
                    (ours_is.name, ours_is.base, ours_is.size),
                    (theirs_is.name, theirs_is.base, theirs_is.size)
                );
                if !ours_is.name.starts_with("OTG_FS") {
                    assert_eq!(format!("{ours:?}"), format!("{theirs:?}"));
                    compared += theirs_is.registers.len();
                }
            }
            assert!(compared > 1400, "{compared} registers compared");
            let at = VirtualNanos(0);
            assert!(matches!(part.read(at, CORE_ID, Width::W32), Err(Fault::Gated { .. })));
            part.write(at, CLOCK_ENABLE, Width::W32, 1 << 7).unwrap();
            assert_eq!(part.read(at, CORE_ID, Width::W32), Ok(0x1200));
            assert_eq!(part.write(at, FIFO, Width::W32, 0), Ok(()));
            part.reset(at, ResetCause::PowerOn);
        }
    }
}

//! The amplifiers: measured armature currents in (ADC), current commands out (DAC), enable.

use embassy_stm32::{
    Peri,
    adc::{Adc, AdcChannel, AnyAdcChannel, SampleTime},
    gpio::{Flex, Level, Output, Speed},
    pac, peripherals, rcc,
};

use shared::board::MID_SCALE;

use crate::safe_output::EnablePin;

/// The two inputs for the armature currents, converted one right after the other on request.
pub struct MeasuredCurrents {
    _adc: Adc<'static, peripherals::ADC1>,
    _inputs: [AnyAdcChannel<'static, peripherals::ADC1>; 2],
}

impl MeasuredCurrents {
    /// Long enough for a source of up to 6 kΩ; with 12 cycles of conversion at 21 MHz each input takes 1.9 µs.
    const SAMPLE_TIME: SampleTime = SampleTime::CYCLES28;

    /// Prepares the inputs for joint 2 and joint 3 as an injected sequence started by software.
    pub fn new(
        adc: Peri<'static, peripherals::ADC1>,
        joint_2: impl AdcChannel<peripherals::ADC1> + 'static,
        joint_3: impl AdcChannel<peripherals::ADC1> + 'static,
    ) -> Self {
        let adc = Adc::new(adc);
        let inputs = [joint_2.degrade_adc(), joint_3.degrade_adc()];
        let registers = pac::ADC1;
        for channel in inputs.each_ref().map(AnyAdcChannel::get_hw_channel) {
            match channel {
                0..=9 => registers.smpr2().modify(|register| register.set_smp(channel.into(), Self::SAMPLE_TIME)),
                _ => {
                    registers.smpr1().modify(|register| register.set_smp(usize::from(channel) - 10, Self::SAMPLE_TIME))
                }
            }
        }
        registers.jsqr().modify(|register| {
            // A sequence of two uses the last two of the four places (RM0090, 13.13.12).
            register.set_jl(1);
            register.set_jsq(2, inputs[0].get_hw_channel());
            register.set_jsq(3, inputs[1].get_hw_channel());
        });
        registers.cr1().modify(|register| register.set_scan(true));
        Self { _adc: adc, _inputs: inputs }
    }

    /// Starts converting both inputs and returns at once. The first is sampled within the next 1.4 µs.
    pub fn start(&mut self) {
        pac::ADC1.sr().modify(|register| register.set_jeoc(false));
        pac::ADC1.cr2().modify(|register| register.set_jswstart(true));
    }

    /// The codes (0 to 4095) of the conversions begun by [`Self::start`]; `None` if they do not finish in time,
    /// which only a converter that has lost its clock or was switched off can cause.
    pub fn finish(&mut self) -> Option<[u16; 2]> {
        // Each look takes several cycles; 2000 of them are far beyond the 640 cycles both conversions need.
        for _ in 0..2000 {
            if pac::ADC1.sr().read().jeoc() {
                return Some([0, 1].map(|place| pac::ADC1.jdr(place).read().jdata()));
            }
        }
        None
    }
}

/// The two current commands and the enable signal common to both amplifiers.
pub struct Amplifiers {
    enable: Output<'static>,
    _commands: [Flex<'static>; 2],
}

impl Amplifiers {
    /// Brings the outputs up in the only safe order: enable low, commands at mid-scale, then the DAC switched on.
    ///
    /// The DAC driver of embassy is not used: it switches the channels on at code 0, which the conditioning for
    /// ±10 V turns into the full negative current.
    pub fn new(
        enable: Peri<'static, EnablePin>,
        _dac: Peri<'static, peripherals::DAC1>,
        joint_2: Peri<'static, peripherals::PA4>,
        joint_3: Peri<'static, peripherals::PA5>,
    ) -> Self {
        let enable = Output::new(enable, Level::Low, Speed::Low);
        rcc::enable_and_reset::<peripherals::DAC1>();
        let mut amplifiers = Self { enable, _commands: [analog(joint_2), analog(joint_3)] };
        amplifiers.set_commands([MID_SCALE; 2]);
        pac::DAC1.cr().modify(|register| {
            register.set_en(0, true);
            register.set_en(1, true);
        });
        amplifiers.set_commands([MID_SCALE; 2]);
        amplifiers
    }

    /// Sends both commands (0 to 4095, mid-scale is no current) at the same instant.
    pub fn set_commands(&mut self, codes: [u16; 2]) {
        pac::DAC1.dhr12rd().write(|register| {
            register.set_dhr(0, codes[0]);
            register.set_dhr(1, codes[1]);
        });
    }

    /// Whether the amplifiers may drive the motors.
    pub fn are_enabled(&self) -> bool {
        self.enable.is_set_high()
    }

    /// Lets the amplifiers drive the motors, or not.
    pub fn set_enabled(&mut self, enabled: bool) {
        self.enable.set_level(if enabled { Level::High } else { Level::Low });
    }
}

fn analog<P: embassy_stm32::gpio::Pin>(pin: Peri<'static, P>) -> Flex<'static> {
    let mut pin = Flex::new(pin);
    pin.set_as_analog();
    pin
}

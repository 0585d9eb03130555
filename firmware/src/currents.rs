//! The amplifiers: measured armature currents in (ADC), current commands out (DAC), enable.

use embassy_stm32::{
    Peri,
    adc::{Adc, AdcChannel, AnyAdcChannel, SampleTime},
    gpio::{Flex, Level, Output, Speed},
    pac, peripherals, rcc,
};

use shared::board::MID_SCALE;

use crate::safe_output::EnablePin;

/// The two inputs for the armature currents, each with a converter of its own, so that both are sampled at once and
/// take no longer than one.
pub struct MeasuredCurrents {
    // Kept for the pins and the clock gates they hold.
    _joint_2: (Adc<'static, peripherals::ADC1>, AnyAdcChannel<'static, peripherals::ADC1>),
    _joint_3: (Adc<'static, peripherals::ADC2>, AnyAdcChannel<'static, peripherals::ADC2>),
}

/// The converters of joint 2 and joint 3.
const CONVERTERS: [pac::adc::Adc; 2] = [pac::ADC1, pac::ADC2];

/// Long enough for a source of up to 6 kΩ; with 12 cycles of conversion at 21 MHz an input takes 1.9 µs.
const SAMPLE_TIME: SampleTime = SampleTime::CYCLES28;

impl MeasuredCurrents {
    /// Prepares the inputs for joint 2 and joint 3 as injected conversions started by software.
    pub fn new(
        joint_2: (Peri<'static, peripherals::ADC1>, impl AdcChannel<peripherals::ADC1> + 'static),
        joint_3: (Peri<'static, peripherals::ADC2>, impl AdcChannel<peripherals::ADC2> + 'static),
    ) -> Self {
        let joint_2 = (Adc::new(joint_2.0), joint_2.1.degrade_adc());
        let joint_3 = (Adc::new(joint_3.0), joint_3.1.degrade_adc());
        for (registers, channel) in CONVERTERS.into_iter().zip([joint_2.1.get_hw_channel(), joint_3.1.get_hw_channel()])
        {
            match channel {
                0..=9 => registers.smpr2().modify(|register| register.set_smp(channel.into(), SAMPLE_TIME)),
                _ => registers.smpr1().modify(|register| register.set_smp(usize::from(channel) - 10, SAMPLE_TIME)),
            }
            registers.jsqr().modify(|register| {
                // A sequence of one uses the last of the four places (RM0090, 13.13.12).
                register.set_jl(0);
                register.set_jsq(3, channel);
            });
        }
        Self { _joint_2: joint_2, _joint_3: joint_3 }
    }

    /// Starts converting both inputs and returns at once. They are sampled within the next 1.4 µs, a few cycles apart.
    pub fn start(&mut self) {
        for registers in CONVERTERS {
            registers.sr().modify(|register| register.set_jeoc(false));
        }
        for registers in CONVERTERS {
            registers.cr2().modify(|register| register.set_jswstart(true));
        }
    }

    /// The codes (0 to 4095) of the conversions begun by [`Self::start`]; `None` if they do not finish in time,
    /// which only a converter that has lost its clock or was switched off can cause.
    pub fn finish(&mut self) -> Option<[u16; 2]> {
        // Each look takes several cycles; 1000 of them are far beyond the 320 cycles a conversion needs.
        for _ in 0..1000 {
            if CONVERTERS.iter().all(|registers| registers.sr().read().jeoc()) {
                return Some(CONVERTERS.map(|registers| registers.jdr(0).read().jdata()));
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

//! The board around the part: clock, supply, and which pin carries what, as in the firmware's `main.rs`.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::chip::uart::Rate;
use rigless::cpu::armv7m::windows;
use rigless::device::{DeviceContext, Level};
use rigless::machine::{Board, Crystal, Target, armv7m};
use rigless::mcu::{Bare, Mcu, Operate as _};
use rigless::snapshot::Store;
use rigless::soc::Error;
use rigless::soc::st::tim;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::{FLASH, flash::Register, gpioa};
use rigless::soc::stm32f427::peripherals::{
    adc,
    gpio::{Gpio, Pin},
};
use rigless::time::VirtualNanos;

use super::{flash, part::Part, usb::Usb, wire::Wire};

/// Clock of the core and of TIM1.
pub const CORE_CLOCK_HZ: u64 = 168_000_000;

/// How fast the emulated core is. The emulator knows neither wait states nor instructions of several cycles, so this
/// is set well below one instruction a cycle: time in the control interrupt is rather over- than underestimated.
pub const INSTRUCTIONS_PER_SECOND: u64 = 120_000_000;

/// The clock that the ST-LINK puts out.
const HIGH_SPEED_CLOCK: Crystal = Crystal(8_000_000);

/// Supply in mV.
const SUPPLY_MV: u32 = 3300;

/// Reference of the analogue-digital converter in mV. The emulator takes its inputs in whole millivolts; with this
/// reference one of them is exactly one code, so that nothing is rounded twice.
const CONVERTER_REFERENCE_MV: u32 = 4095;

/// What an input of the converters shows while its pin is not analogue, and so cut off: the largest current, so that
/// it does not go unnoticed.
const CUT_OFF_CODE: u16 = 4095;

/// A pin that has to be analogue to reach a converter, or be reached by one.
#[derive(Clone, Copy)]
struct AnaloguePin {
    port: usize,
    pin: u8,
}

/// Inputs for the currents of joint 2 and 3: the channel of the converter, ADC1 and ADC2, and its pin.
const CURRENT_INPUTS: [(u8, AnaloguePin); 2] =
    [(3, AnaloguePin { port: PORT_A, pin: 3 }), (10, AnaloguePin { port: PORT_C, pin: 0 })];

/// Outputs for the current commands of joint 2 and 3.
const COMMAND_OUTPUTS: [AnaloguePin; 2] = [AnaloguePin { port: PORT_A, pin: 4 }, AnaloguePin { port: PORT_A, pin: 5 }];

/// Mode of a pin in the port's mode register (RM0090, 8.4.1).
const MODE_ANALOGUE: u64 = 3;

const PORT_A: usize = 0;
const PORT_B: usize = 1;
const PORT_C: usize = 2;
const PORT_D: usize = 3;
const PORT_F: usize = 5;

/// Makes the noise of the serial line, when there is any.
const LINE_SEED: u64 = 1;

/// USART3 among the emulator's serial ports.
const SERIAL_PORT: usize = 2;

/// A pin and the alternate function it has to carry.
#[derive(Clone, Copy)]
struct FunctionPin {
    port: usize,
    pin: u8,
    function: u8,
}

/// An encoder input: which of the emulator's timers, and the pins of its two channels.
#[derive(Clone, Copy)]
struct EncoderInput {
    timer: usize,
    pins: [FunctionPin; 2],
}

const ENCODERS: [EncoderInput; 2] = [
    // TIM2.
    EncoderInput {
        timer: 0,
        pins: [FunctionPin { port: PORT_A, pin: 15, function: 1 }, FunctionPin { port: PORT_B, pin: 3, function: 1 }],
    },
    // TIM5.
    EncoderInput {
        timer: 3,
        pins: [FunctionPin { port: PORT_A, pin: 0, function: 2 }, FunctionPin { port: PORT_A, pin: 1, function: 2 }],
    },
];

const SERIAL_PINS: [FunctionPin; 2] =
    [FunctionPin { port: PORT_D, pin: 8, function: 7 }, FunctionPin { port: PORT_D, pin: 9, function: 7 }];

/// Data minus and data plus.
const USB_PINS: [FunctionPin; 2] =
    [FunctionPin { port: PORT_A, pin: 11, function: 10 }, FunctionPin { port: PORT_A, pin: 12, function: 10 }];

const ENABLE_PIN: u8 = 12;
const EMERGENCY_STOP_PIN: u8 = 13;

/// What the board does to the amplifiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// Codes of the current commands; `None` for an output that is switched off.
    pub command_code: [Option<u16>; 2],
    /// Whether the amplifiers are enabled. The pull-down outside keeps them off as long as nothing drives the pin.
    pub amplifiers_enabled: bool,
}

/// The board.
#[derive(Debug)]
pub struct Nucleo {
    part: Part,
    memory_map: Bare,
}

impl Nucleo {
    /// A board that has just been switched on.
    pub fn new() -> Result<Self, Error> {
        let part = Part::new(|stm32| {
            stm32.rcc.attach_crystals(HIGH_SPEED_CLOCK.0, Crystal::NONE.0);
            stm32.set_supply(SUPPLY_MV);
            for converter in &mut stm32.adc[..2] {
                converter.set_reference(CONVERTER_REFERENCE_MV);
            }
            stm32.usart[SERIAL_PORT].attach(Wire::new(LINE_SEED));
        })?;
        Ok(Self { part, memory_map: flash::memory_map()? })
    }

    /// Cuts the supply, or gives it back.
    pub fn set_power(&mut self, at: VirtualNanos, on: bool) {
        self.part.set_power(at, on);
    }

    /// A register of the flash controller.
    pub fn flash_register(&self, register: Register) -> u64 {
        self.part.bus().registers(FLASH.name).map_or(0, |registers| registers.get(register))
    }

    /// Sets a register of the flash controller, as the memory behind it does.
    pub fn set_flash_register(&mut self, register: Register, value: u64) {
        let bus = self.part.bus_mut();
        if let Some(slot) = bus.slot_of(FLASH.name) {
            bus.slot_mut(slot).registers_mut().set(register, value);
        }
    }

    /// Both measured currents, as the codes they are to be converted to. They reach the converters through the pins as
    /// these are set at this instant.
    pub fn set_current_codes(&mut self, codes: [u16; 2]) {
        for (joint, (channel, input)) in CURRENT_INPUTS.into_iter().enumerate() {
            let channel = adc::Channel::new(channel).expect("an input of the converter");
            let code = if self.is_analogue(input) { codes[joint] } else { CUT_OFF_CODE };
            self.part.stm32.adc[joint].set_input(channel, code.into());
        }
    }

    /// Opens or closes the contact of the emergency stop.
    pub fn set_emergency_stop(&mut self, at: VirtualNanos, pressed: bool) {
        // Closed, the contact pulls the pin to ground; open, the board's own pull-up has it.
        let level = (!pressed).then_some(Level::Low);
        self.part.stm32.drive_port(at, PORT_F, |port, registers, context| {
            port.drive(pin(EMERGENCY_STOP_PIN), level, registers, context);
        });
    }

    /// The levels of an encoder's two channels. Pins that the firmware gave to something else do not reach the counter.
    pub fn set_encoder(&mut self, at: VirtualNanos, joint: usize, levels: [bool; 2]) {
        let EncoderInput { timer, pins } = ENCODERS[joint];
        for (index, high) in levels.into_iter().enumerate() {
            if !self.carries(pins[index]) {
                continue;
            }
            let channel = tim::Channel::new(index as u8 + 1).expect("a channel of the timer");
            let level = if high { Level::High } else { Level::Low };
            self.part.stm32.drive_timer(at, timer, |timer, registers, context| {
                timer.drive_input(channel, level, registers, context);
            });
        }
    }

    /// The microcontroller, but for what is ours in it.
    pub fn chip_mut(&mut self) -> &mut Stm32f427 {
        &mut self.part.stm32
    }

    /// The host's end of the serial line; nothing as long as its pins are not the USART's.
    pub fn wire(&mut self) -> Option<&mut Wire> {
        let connected = SERIAL_PINS.into_iter().all(|pin| self.carries(pin));
        if connected { self.part.stm32.usart[SERIAL_PORT].chip_mut() } else { None }
    }

    /// Core, cable and host of USB, to look at.
    pub fn usb(&self) -> &Usb {
        &self.part.usb
    }

    /// Something happens to them from outside.
    pub fn drive_usb<T>(&mut self, at: VirtualNanos, act: impl FnOnce(&mut Usb, &mut DeviceContext<'_>) -> T) -> T {
        self.part.drive_usb(at, act)
    }

    /// The cable leads to the core only while both pins are the core's.
    pub fn look_at_usb_pins(&mut self, at: VirtualNanos) {
        let wired = USB_PINS.into_iter().all(|pin| self.carries(pin));
        if self.part.usb.would_change(wired) {
            self.part.drive_usb(at, |usb, context| usb.wire(wired, context));
        }
    }

    /// How many words in a million the board's serial port receives with noise on them, and as many with a framing
    /// error; both have bits flipped.
    pub fn set_serial_errors(&mut self, per_million: u32) {
        let errors = self.part.stm32.usart[SERIAL_PORT].errors_mut();
        errors.seed = LINE_SEED;
        errors.noise = Rate { name: "noise", per_million };
        errors.framing = Rate { name: "framing", per_million };
    }

    /// What is put out at this instant.
    pub fn outputs(&mut self) -> Outputs {
        let codes = self.part.dac.outputs();
        let command_code = [0, 1].map(|joint| codes[joint].filter(|_| self.is_analogue(COMMAND_OUTPUTS[joint])));
        let (port, registers) = self.part.stm32.port(PORT_F);
        Outputs { command_code, amplifiers_enabled: port.level(pin(ENABLE_PIN), registers) == Level::High }
    }

    fn is_analogue(&mut self, wanted: AnaloguePin) -> bool {
        let (_, registers) = self.part.stm32.port(wanted.port);
        registers.get(gpioa::Register::Moder) >> (2 * wanted.pin) & 3 == MODE_ANALOGUE
    }

    fn carries(&mut self, wanted: FunctionPin) -> bool {
        let (_, registers) = self.part.stm32.port(wanted.port);
        Gpio::function(pin(wanted.pin), registers) == Some(wanted.function)
    }
}

fn pin(number: u8) -> Pin {
    Pin::new(number).expect("a port has sixteen pins")
}

/// Runs begin at reset, so nothing is ever put back.
impl Store for Nucleo {}

impl Board for Nucleo {
    fn name(&self) -> &'static str {
        "nucleo-f429zi"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f429"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.part)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let nonzero = |value: u64| NonZeroU64::new(value).expect("not zero");
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: nonzero(CORE_CLOCK_HZ),
            interrupt_lines: NonZeroU32::new(self.part.cpu().interrupt_lines.into()).expect("a part with interrupts"),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).expect("not zero"),
            instructions_per_second: nonzero(INSTRUCTIONS_PER_SECOND),
            boot: "flash",
        }
        .spec_with_parts(&windows(self.part.bus()), armv7m::Fpu::FpV4Sp, armv7m::MpuRegions::Eight);
        // The emulator takes its memory from here and everything else from `mcu`.
        vec![Target::new("stm32f429", &mut self.memory_map, core)]
    }
}

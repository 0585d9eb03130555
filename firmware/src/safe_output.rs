//! The last word when the program fails: no current, amplifiers off, and stay there until the watchdog restarts the
//! board.
//!
//! Peripherals keep their outputs when the core stops. So a panic, a hard fault and an interrupt nobody handles
//! all write safe values themselves, straight to the registers, since the owner of the outputs may be what failed. What
//! happened is kept for the next start to report.

use core::{
    arch::naked_asm,
    panic::PanicInfo,
    sync::atomic::{AtomicBool, Ordering},
};

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use embassy_stm32::{pac, peripherals};
use shared::{
    board::MID_SCALE,
    protocol::{Fault, SourcePlace},
};

use crate::last_fault;

/// Enables both amplifiers when high. A pull-down outside keeps it low while the board is reset or unpowered.
pub type EnablePin = peripherals::PF12;
const ENABLE_PORT: pac::gpio::Gpio = pac::GPIOF;
const ENABLE_PIN_NUMBER: usize = 12;

/// Switches the amplifiers off, commands no current, and lets no interrupt, not even the control interrupt, write
/// anything else afterwards.
fn force_and_mask() {
    cortex_m::interrupt::disable();
    ENABLE_PORT.bsrr().write(|register| register.set_br(ENABLE_PIN_NUMBER, true));
    pac::DAC1.dhr12rd().write(|register| {
        register.set_dhr(0, MID_SCALE);
        register.set_dhr(1, MID_SCALE);
    });
}

/// Nothing more happens until the watchdog restarts the board.
fn halt() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(information: &PanicInfo) -> ! {
    force_and_mask();
    let place =
        information.location().map_or(SourcePlace::UNKNOWN, |place| SourcePlace::new(place.file(), place.line()));
    last_fault::keep(&Fault::Panic { place });
    // The log itself panics when it was interrupted half way through a message: then say nothing the second time.
    static PANICKED: AtomicBool = AtomicBool::new(false);
    if !PANICKED.swap(true, Ordering::Relaxed) {
        match information.location() {
            Some(location) => defmt::error!("panic at {}:{}", location.file(), location.line()),
            None => defmt::error!("panic"),
        }
    }
    halt()
}

/// What `defmt::panic!` and its kin end in; their message is already in the log.
#[defmt::panic_handler]
fn defmt_panic() -> ! {
    force_and_mask();
    last_fault::keep(&Fault::Panic { place: SourcePlace::UNKNOWN });
    halt()
}

/// The hard fault handler. It gets a fresh stack before anything else: after a stack overflow the first push would
/// be a fault in the fault handler, which locks the core up with the outputs as they were. Before that it takes the
/// address of the failed instruction from the old stack, the seventh word the processor pushed, unless that overflowed.
// SAFETY: the body sets up the stack it then uses and ends in a function that never returns, so the convention of its
// caller, the exception entry, does not matter; the name is the one that the vector table of cortex-m-rt looks up.
// What it reads lies in the stack's memory: the stack pointer is not below its end, and the frame was pushed below its
// start.
#[unsafe(naked)]
#[unsafe(no_mangle)]
extern "C" fn HardFault() -> ! {
    naked_asm!(
        "mov r0, #0",
        "mov r1, sp",
        "movw r2, #:lower16:_stack_end",
        "movt r2, #:upper16:_stack_end",
        "cmp r1, r2",
        "it hs",
        "ldrhs r0, [r1, #24]",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "mov sp, r1",
        "b {}",
        sym hard_fault,
    )
}

extern "C" fn hard_fault(program_counter: u32) -> ! {
    force_and_mask();
    // SAFETY: reads two registers of the core that say what happened.
    let (status, address) = unsafe { ((*SCB::PTR).cfsr.read(), (*SCB::PTR).bfar.read()) };
    last_fault::keep(&Fault::of_processor(program_counter, status, address));
    halt()
}

// SAFETY: the handler touches no variable but the place of the last fault, which it may, and registers that hold the
// outputs, and never returns. Reached by an interrupt or exception that has no handler, the NMI of a failed clock among
// them.
#[exception]
unsafe fn DefaultHandler(interrupt_number: i16) -> ! {
    force_and_mask();
    last_fault::keep(&Fault::UnexpectedInterrupt { number: interrupt_number });
    halt()
}

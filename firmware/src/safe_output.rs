//! The last word when the program fails: no current, amplifiers off, and stay there until the watchdog restarts the
//! board.
//!
//! Peripherals keep their outputs when the core stops. So a panic, a hard fault and an interrupt nobody handles
//! all write safe values themselves, straight to the registers, since the owner of the outputs may be what failed.

use core::{
    arch::naked_asm,
    panic::PanicInfo,
    sync::atomic::{AtomicBool, Ordering},
};

use cortex_m_rt::exception;
use embassy_stm32::{pac, peripherals};
use shared::board::MID_SCALE;

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
    halt()
}

/// The hard fault handler. It gets a fresh stack before anything else: after a stack overflow the first push would
/// be a fault in the fault handler, which locks the core up with the outputs as they were.
// SAFETY: the body sets up the stack it then uses and ends in a function that never returns, so the convention of its
// caller, the exception entry, does not matter; the name is the one that the vector table of cortex-m-rt looks up.
#[unsafe(naked)]
#[unsafe(no_mangle)]
extern "C" fn HardFault() -> ! {
    naked_asm!(
        "movw r0, #:lower16:_stack_start",
        "movt r0, #:upper16:_stack_start",
        "mov sp, r0",
        "b {}",
        sym hard_fault,
    )
}

extern "C" fn hard_fault() -> ! {
    force_and_mask();
    halt()
}

// SAFETY: the handler touches no variable, only registers that hold the outputs, and never returns. Reached by an
// interrupt or exception that has no handler, the NMI of a failed clock among them.
#[exception]
unsafe fn DefaultHandler(_interrupt_number: i16) -> ! {
    force_and_mask();
    halt()
}

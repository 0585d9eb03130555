//! Who may interrupt whom: the control interrupt interrupts everything, everything else waits for it.

use cortex_m::peripheral::NVIC;
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};

/// Of the control interrupt (`TIM1_UP_TIM10`), which has this priority alone.
pub const CONTROL_PRIORITY: Priority = Priority::P0;

/// The highest priority any other interrupt may have; critical sections mask this and all below it.
pub const HIGHEST_SHARED_PRIORITY: Priority = Priority::P4;

/// Of the time driver, the links (USB and the serial line) and their DMA streams.
pub const TASK_PRIORITY: Priority = Priority::P6;

/// One more than the highest interrupt number of the STM32F429 (`DMA2D`, 90).
const INTERRUPT_COUNT: usize = 91;

/// Lowers every interrupt, then raises the control interrupt. Out of reset all have the highest priority, and the
/// drivers of embassy leave it so; call this before the first of them starts.
pub fn set_all(nvic: NVIC) {
    for register in &nvic.ipr[..INTERRUPT_COUNT] {
        // SAFETY: a lower priority breaks no critical section; none is entered and no interrupt enabled yet.
        unsafe { register.write(TASK_PRIORITY as u8) };
    }
    Interrupt::TIM1_UP_TIM10.set_priority(CONTROL_PRIORITY);
}

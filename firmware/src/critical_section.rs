//! Critical sections that hold off every interrupt but the control interrupt.
//!
//! The usual implementation masks all interrupts (PRIMASK), and embassy enters a critical section at every wake-up
//! of a task: the control interrupt would then start late by as long as the section lasts. This one raises
//! BASEPRI to [`HIGHEST_SHARED_PRIORITY`] instead, so the control interrupt, alone above it, always starts at once.
//!
//! The price: **the control interrupt must not enter a critical section**, nor call anything that does: nothing of
//! embassy but plain register access, and no log statement. It talks to the tasks through lock-free queues only.

use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::register::{basepri, basepri_max};
use critical_section::RawRestoreState;

use crate::interrupt_priorities::HIGHEST_SHARED_PRIORITY;

struct BelowControlInterrupt;
critical_section::set_impl!(BelowControlInterrupt);

// SAFETY: between `acquire` and the matching `release` no other code that enters a critical section runs: all
// interrupts but one are of HIGHEST_SHARED_PRIORITY or lower and so masked by BASEPRI, and that one, the control
// interrupt, enters none (see above). The part has one core. The fences keep the compiler from moving accesses out
// of the section. Nesting works because `basepri_max` never lowers the mask and each level restores what it found.
unsafe impl critical_section::Impl for BelowControlInterrupt {
    unsafe fn acquire() -> RawRestoreState {
        let previous = basepri::read();
        basepri_max::write(HIGHEST_SHARED_PRIORITY as u8);
        compiler_fence(Ordering::SeqCst);
        previous
    }

    unsafe fn release(previous: RawRestoreState) {
        compiler_fence(Ordering::SeqCst);
        // SAFETY: `previous` is what `acquire` read, so the mask returns to what it was before the section.
        unsafe { basepri::write(previous) };
    }
}

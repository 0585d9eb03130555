//! The last fault, over a reset: in a part of RAM that nobody clears at the start.

use core::{
    cell::UnsafeCell,
    mem::MaybeUninit,
    ptr,
    sync::atomic::{Ordering, compiler_fence},
};

use shared::{
    board::KeptFault,
    protocol::{Fault, ResetCause},
};

struct Place(UnsafeCell<MaybeUninit<KeptFault>>);

// SAFETY: written and read only by the two functions below, whose callers never run at the same time: `at_start` runs
// before any interrupt is enabled, and `keep` is called by the control interrupt, which nothing interrupts but the
// handlers of panics and hardware faults, and these never return to what they interrupted.
unsafe impl Sync for Place {}

// The startup code of cortex-m-rt leaves this section as it finds it, and so does every reset but the loss of power.
#[unsafe(link_section = ".uninit.LAST_FAULT")]
static LAST_FAULT: Place = Place(UnsafeCell::new(MaybeUninit::uninit()));

/// What happened before this start, if it was a fault. Call it once, at the start.
pub fn at_start(cause: ResetCause) -> Option<Fault> {
    let place = LAST_FAULT.0.get().cast::<KeptFault>();
    // SAFETY: see above; of the integers of a `KeptFault` every pattern of bits is valid, and it checks itself. Volatile,
    // because the memory was written before the program began.
    let mut kept = unsafe { ptr::read_volatile(place) };
    let fault = kept.at_start(cause);
    // SAFETY: as above.
    unsafe { ptr::write_volatile(place, kept) };
    fault
}

/// Keeps a fault for the next start. Only for the control interrupt and for handlers that never return.
pub fn keep(fault: &Fault) {
    // SAFETY: as above. Volatile, because the next reader is another run of the program.
    unsafe { ptr::write_volatile(LAST_FAULT.0.get().cast(), KeptFault::new(fault)) };
    compiler_fence(Ordering::SeqCst);
}

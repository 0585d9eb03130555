//! A value handed over to one interrupt, which from then on owns it.

use core::{cell::UnsafeCell, mem::MaybeUninit};

/// A static place for the value. Everything about its soundness is in the contracts of its two functions.
pub struct InterruptOwned<T>(UnsafeCell<MaybeUninit<T>>);

// SAFETY: the contracts below leave exactly one context with access at any time: the one that calls `hand_over`
// before the interrupt is enabled, and the interrupt afterwards. `T: Send` because the value changes context once.
unsafe impl<T: Send> Sync for InterruptOwned<T> {}

impl<T> InterruptOwned<T> {
    /// An empty place.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Puts the value in place.
    ///
    /// # Safety
    /// At most once, and before the interrupt that calls [`Self::get`] is enabled.
    pub unsafe fn hand_over(&self, value: T) {
        // SAFETY: the caller guarantees that nobody has a reference to the inside yet.
        unsafe { (*self.0.get()).write(value) };
    }

    /// The value, in the interrupt that owns it.
    ///
    /// # Safety
    /// Only once in each run of that one interrupt, and only after [`Self::hand_over`]. An interrupt does not
    /// interrupt itself, so the references of two runs never live at the same time.
    #[expect(clippy::mut_from_ref, reason = "exclusive by the contract above")]
    pub unsafe fn get(&self) -> &mut T {
        // SAFETY: initialised and not aliased, as the caller guarantees.
        unsafe { (*self.0.get()).assume_init_mut() }
    }
}

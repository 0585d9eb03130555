//! The wish of whoever sits at the computer to end a movement.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Counts how often the end was asked for. Clones share one count, so a signal handler can hold one and the client
/// another.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicU32>);

impl Interrupt {
    /// Asks once more for the end, and says how often it was asked for by now. The first time the arm slows down along
    /// its path, the second time the amplifiers go off and the brakes on.
    pub fn ask(&self) -> u32 {
        self.0.fetch_add(1, Ordering::SeqCst) + 1
    }

    /// How often the end was asked for.
    pub fn asked(&self) -> u32 {
        self.0.load(Ordering::SeqCst)
    }
}

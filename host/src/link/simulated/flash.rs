//! The simulated board's flash memory, which outlives it.

use std::future::{Future, ready};
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use shared::protocol::StoreFailure;
use shared::storage::{ERASED, Flash, PREPARED, SLOT_WORDS, Sector};

/// Time to program a word, in ns: typical of an STM32F429 (DS9405, table 48).
const PROGRAM_NS: u64 = 16_000;
/// Time to erase a sector of 128 KiB, in ns: typical of an STM32F429 with words of 32 bits.
const ERASE_NS: u64 = 1_000_000_000;

#[derive(Debug)]
struct Content {
    words: [Vec<u32>; 2],
    busy_ns: u64,
}

/// The two sectors for the parameters. A clone is the same memory, for the board that is switched on next.
#[derive(Clone, Debug)]
pub struct MemoryFlash(Arc<Mutex<Content>>);

impl Default for MemoryFlash {
    /// Without parameters. One sector is prepared already, so that the first store takes no longer than most.
    fn default() -> Self {
        let mut words = [0, 1].map(|_| vec![ERASED; Self::SLOTS * SLOT_WORDS]);
        words[Sector::First.index()][..PREPARED.len()].copy_from_slice(&PREPARED);
        Self(Arc::new(Mutex::new(Content { words, busy_ns: 0 })))
    }
}

impl MemoryFlash {
    /// Both sectors as bytes in the order of their addresses, as they would stand in a chip.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.content().words.iter().flatten().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// How long the memory would have been busy since it is there, in ns.
    pub(super) fn busy_ns(&self) -> u64 {
        self.content().busy_ns
    }

    fn content(&self) -> MutexGuard<'_, Content> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Flash for MemoryFlash {
    const SLOTS: usize = 128;

    fn word(&self, sector: Sector, index: usize) -> u32 {
        self.content().words[sector.index()].get(index).copied().unwrap_or(ERASED)
    }

    fn program(
        &mut self,
        sector: Sector,
        index: usize,
        value: u32,
    ) -> impl Future<Output = Result<(), StoreFailure>> + Send {
        let mut content = self.content();
        content.busy_ns += PROGRAM_NS;
        if let Some(word) = content.words[sector.index()].get_mut(index) {
            *word &= value;
        }
        ready(Ok(()))
    }

    fn erase(&mut self, sector: Sector) -> impl Future<Output = Result<(), StoreFailure>> + Send {
        let mut content = self.content();
        content.busy_ns += ERASE_NS;
        content.words[sector.index()].fill(ERASED);
        ready(Ok(()))
    }
}

/// The output of a future that never waits, as everything over a [`MemoryFlash`]; nothing for one that does.
pub fn complete<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

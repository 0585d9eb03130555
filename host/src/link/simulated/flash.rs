//! The simulated board's flash memory, which outlives it.
//!
//! It behaves as a real one does: bits only go from 1 to 0 until a sector is erased, and what was being programmed or
//! erased when power failed is uncertain afterwards: done, not done, or different at every reading.

use std::future::{Future, ready};
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use shared::protocol::StoreFailure;
use shared::storage::{ERASED, Flash, PREPARED, SLOT_WORDS, Sector};

use crate::random::Random;

/// Time to program a word, in ns: typical of an STM32F429 (DS9405, table 48).
const PROGRAM_NS: u64 = 16_000;
/// Time to erase a sector of 128 KiB, in ns: typical of an STM32F429 with words of 32 bits.
const ERASE_NS: u64 = 1_000_000_000;

/// What an operation ends with in the middle of which power fails. A real board never hears it.
pub const POWER_CUT: StoreFailure = StoreFailure::Timeout { waited_ms: 0 };

/// 32 cells.
#[derive(Clone, Copy, Debug)]
struct Cells {
    value: u32,
    /// Those left half way: they read as they like until they are programmed or erased to the end.
    uncertain: u32,
}

const BLANK: Cells = Cells { value: ERASED, uncertain: 0 };

/// What was done to a memory since it is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FlashHistory {
    /// Words programmed in each of the sectors.
    pub programmed: [usize; 2],
    /// How often each of the sectors was erased.
    pub erased: [usize; 2],
    /// Words that were asked to take a 1 where there was a 0, and operations begun without power.
    pub misuses: usize,
}

impl FlashHistory {
    /// Words programmed and sectors erased.
    pub fn operations(&self) -> usize {
        self.programmed.iter().chain(&self.erased).sum()
    }
}

#[derive(Clone, Debug)]
struct Content {
    sectors: [Vec<Cells>; 2],
    busy_ns: u64,
    history: FlashHistory,
    /// Operations that are still carried out whole before power fails.
    operations_left: Option<usize>,
    has_power: bool,
    random: Random,
}

impl Content {
    fn bits(&mut self) -> u32 {
        (self.random.unit() * (u64::from(u32::MAX) + 1) as f64) as u32
    }

    /// Whether power fails in the operation that begins now; nothing where there is none.
    fn begin(&mut self) -> Option<bool> {
        if !self.has_power {
            self.history.misuses += 1;
            return None;
        }
        let cut = self.operations_left == Some(0);
        self.operations_left = self.operations_left.and_then(|left| left.checked_sub(1));
        self.has_power = !cut;
        Some(cut)
    }
}

/// The two sectors for the parameters, `SLOTS` slots each. A clone is the same memory, for the board that is switched on
/// next.
#[derive(Clone, Debug)]
pub struct MemoryFlash<const SLOTS: usize = 128>(Arc<Mutex<Content>>);

impl Default for MemoryFlash {
    /// Without parameters. One sector is prepared already, so that the first store takes no longer than most.
    fn default() -> Self {
        let flash = Self::blank(0);
        for (cells, word) in flash.content().sectors[Sector::First.index()].iter_mut().zip(PREPARED) {
            cells.value = word;
        }
        flash
    }
}

impl<const SLOTS: usize> MemoryFlash<SLOTS> {
    /// A memory that nothing was ever written to; `seed` decides what power cuts leave.
    pub fn blank(seed: u64) -> Self {
        Self(Arc::new(Mutex::new(Content {
            sectors: [0, 1].map(|_| vec![BLANK; SLOTS * SLOT_WORDS]),
            busy_ns: 0,
            history: FlashHistory::default(),
            operations_left: None,
            has_power: true,
            random: Random::new(seed, 3),
        })))
    }

    /// Another memory that holds the same.
    pub fn duplicate(&self) -> Self {
        Self(Arc::new(Mutex::new(self.content().clone())))
    }

    /// Both sectors as bytes in the order of their addresses, as they would stand in a chip.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.content().sectors.iter().flatten().flat_map(|cells| cells.value.to_le_bytes()).collect()
    }

    /// What was done to it.
    pub fn history(&self) -> FlashHistory {
        self.content().history
    }

    /// Lets power fail in the middle of an operation, after so many others.
    pub fn cut_power_after(&self, operations: usize) {
        self.content().operations_left = Some(operations);
    }

    /// Whether power has not failed.
    pub fn has_power(&self) -> bool {
        self.content().has_power
    }

    /// Gives it power again, if it has none, and forgets a power cut that has not happened yet.
    pub fn switch_on(&self) {
        let mut content = self.content();
        content.has_power = true;
        content.operations_left = None;
    }

    /// Flips a bit of a word of a sector, as age or radiation might. Nothing happens to words that are not there.
    pub fn flip(&self, sector: Sector, index: usize, bit: u32) {
        if let Some(cells) = self.content().sectors[sector.index()].get_mut(index) {
            cells.value ^= 1 << (bit % 32);
        }
    }

    /// How long the memory would have been busy since it is there, in ns.
    pub(super) fn busy_ns(&self) -> u64 {
        self.content().busy_ns
    }

    fn content(&self) -> MutexGuard<'_, Content> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn program_now(&self, sector: Sector, index: usize, value: u32) -> Result<(), StoreFailure> {
        let content = &mut *self.content();
        let cut = content.begin().ok_or(POWER_CUT)?;
        content.busy_ns += if cut { 0 } else { PROGRAM_NS };
        content.history.programmed[sector.index()] += 1;
        let (some, others) = (content.bits(), content.bits());
        let Some(cells) = content.sectors[sector.index()].get_mut(index) else { return Ok(()) };
        let certainly_0 = !cells.value & !cells.uncertain;
        content.history.misuses += usize::from(value & certainly_0 != 0);
        let programmed = !value;
        if cut {
            cells.value &= !(programmed & some);
            cells.uncertain |= programmed & others;
            return Err(POWER_CUT);
        }
        cells.value &= value;
        cells.uncertain &= value;
        Ok(())
    }

    fn erase_now(&self, sector: Sector) -> Result<(), StoreFailure> {
        let content = &mut *self.content();
        let cut = content.begin().ok_or(POWER_CUT)?;
        content.busy_ns += if cut { 0 } else { ERASE_NS };
        content.history.erased[sector.index()] += 1;
        if !cut {
            content.sectors[sector.index()].fill(BLANK);
            return Ok(());
        }
        // How far it got: some cells are done, some are not, some are in between.
        let far = content.bits();
        for index in 0..SLOTS * SLOT_WORDS {
            let done = match far % 4 {
                0 => 0,
                1 => u32::MAX,
                2 => content.bits(),
                _ => content.bits() & content.bits(),
            };
            let uncertain = content.bits() & content.bits();
            let cells = &mut content.sectors[sector.index()][index];
            cells.value |= done;
            cells.uncertain |= uncertain;
        }
        Err(POWER_CUT)
    }
}

impl<const SLOTS: usize> Flash for MemoryFlash<SLOTS> {
    const SLOTS: usize = SLOTS;

    fn word(&self, sector: Sector, index: usize) -> u32 {
        let mut content = self.content();
        match content.sectors[sector.index()].get(index).copied() {
            None => ERASED,
            Some(Cells { value, uncertain: 0 }) => value,
            Some(Cells { value, uncertain }) => value ^ (uncertain & content.bits()),
        }
    }

    fn program(
        &mut self,
        sector: Sector,
        index: usize,
        value: u32,
    ) -> impl Future<Output = Result<(), StoreFailure>> + Send {
        ready(self.program_now(sector, index, value))
    }

    fn erase(&mut self, sector: Sector) -> impl Future<Output = Result<(), StoreFailure>> + Send {
        ready(self.erase_now(sector))
    }
}

/// The output of a future that never waits, as everything over a [`MemoryFlash`]; nothing for one that does.
pub fn complete<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

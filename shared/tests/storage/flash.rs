//! A flash memory that fails as real ones do: bits only go from 1 to 0, and where power was cut nothing is certain.

use std::cell::Cell;
use std::future::{Future, ready};
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};
use shared::protocol::StoreFailure;
use shared::storage::{ERASED, Flash, SLOT_WORDS, Sector};

/// Three records in a sector: stores soon change sectors.
pub const SLOTS: usize = 4;

/// 32 cells. Those left half way read as they like, until they are programmed or erased to the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cells {
    value: u32,
    uncertain: u32,
}

const BLANK: Cells = Cells { value: ERASED, uncertain: 0 };

/// The memory.
#[derive(Clone, Debug)]
pub struct FailingFlash {
    words: [Vec<Cells>; 2],
    /// Programmed words and erasures so far.
    pub operations: usize,
    pub erasures: usize,
    /// The operation during which power is cut.
    pub cut_at: Option<usize>,
    off: bool,
    random: Cell<u64>,
}

impl FailingFlash {
    pub fn new(seed: u64) -> Self {
        let words = [0, 1].map(|_| vec![BLANK; SLOTS * SLOT_WORDS]);
        Self { words, operations: 0, erasures: 0, cut_at: None, off: false, random: Cell::new(seed) }
    }

    /// Full of whatever a memory may hold that something else used before.
    pub fn with_rubbish(seed: u64) -> Self {
        let mut flash = Self::new(seed);
        for word in flash.words.as_flattened_mut_vecs() {
            word.value = Pcg32::seed_from_u64(u64::from(word.value) ^ seed).next_u32();
        }
        flash
    }

    fn bits(&self) -> u32 {
        // Another generator for every number; this is a test of the log and not of the numbers.
        let mut random = Pcg32::seed_from_u64(self.random.get());
        self.random.set(random.next_u64());
        random.next_u32()
    }

    /// Power is back.
    pub fn switch_on(&mut self) {
        self.off = false;
        self.cut_at = None;
    }

    /// Cuts power after so many more operations.
    pub fn cut_after(&mut self, operations: usize) {
        self.cut_at = Some(self.operations + operations);
    }

    /// Flips a bit, as age or radiation might.
    pub fn flip(&mut self, sector: Sector, index: usize, bit: u32) {
        self.words[sector.index()][index].value ^= 1 << bit;
    }

    fn begin(&mut self) -> bool {
        assert!(!self.off, "the log went on without power");
        let cut = self.cut_at == Some(self.operations);
        self.operations += 1;
        self.off = cut;
        cut
    }
}

trait Flattened {
    fn as_flattened_mut_vecs(&mut self) -> impl Iterator<Item = &mut Cells>;
}

impl Flattened for [Vec<Cells>; 2] {
    fn as_flattened_mut_vecs(&mut self) -> impl Iterator<Item = &mut Cells> {
        self.iter_mut().flatten()
    }
}

/// What the log is told when power fails. It never hears of it in truth.
pub const POWER_CUT: StoreFailure = StoreFailure::Timeout { waited_ms: 0 };

impl Flash for FailingFlash {
    const SLOTS: usize = SLOTS;

    fn word(&self, sector: Sector, index: usize) -> u32 {
        let Some(cells) = self.words[sector.index()].get(index) else { return ERASED };
        if cells.uncertain == 0 { cells.value } else { cells.value ^ (cells.uncertain & self.bits()) }
    }

    fn program(
        &mut self,
        sector: Sector,
        index: usize,
        value: u32,
    ) -> impl Future<Output = Result<(), StoreFailure>> + Send {
        let cut = self.begin();
        let (some, others) = (self.bits(), self.bits());
        let cells = &mut self.words[sector.index()][index];
        let certainly_0 = !cells.value & !cells.uncertain;
        assert_eq!(value & certainly_0, 0, "a 1 cannot be programmed where there is a 0");
        let programmed = !value;
        if cut {
            cells.value &= !(programmed & some);
            cells.uncertain |= programmed & others;
        } else {
            cells.value &= value;
            cells.uncertain &= !programmed;
        }
        ready(if cut { Err(POWER_CUT) } else { Ok(()) })
    }

    fn erase(&mut self, sector: Sector) -> impl Future<Output = Result<(), StoreFailure>> + Send {
        let cut = self.begin();
        self.erasures += 1;
        // How far it got: some cells are done, some are not, some are in between.
        let far = self.bits();
        for index in 0..SLOTS * SLOT_WORDS {
            let done = match far % 4 {
                0 => 0,
                1 => u32::MAX,
                2 => self.bits(),
                _ => self.bits() & self.bits(),
            };
            let uncertain = self.bits() & self.bits();
            let cells = &mut self.words[sector.index()][index];
            if cut {
                cells.value |= done;
                cells.uncertain |= uncertain;
            } else {
                *cells = BLANK;
            }
        }
        ready(if cut { Err(POWER_CUT) } else { Ok(()) })
    }
}

/// Runs what never has to wait.
pub fn complete<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("this memory lets nobody wait"),
    }
}

//! Robot constants and model kept over a restart: a log of records in two sectors of flash.
//!
//! The caller brings the flash ([`Flash`]): registers in the firmware, an array in the simulated board and in tests.
//! Nothing here decides when to store; that is the board's ([`crate::board::Board::begin_store`]).
//!
//! # Layout
//! A sector is a row of slots of [`SLOT_WORDS`] words. Slot 0 says that the sector was erased to the end
//! ([`PREPARED`]); each other slot has room for one record:
//!
//! | word | content |
//! |---|---|
//! | 0 | [`RECORD`] |
//! | 1 | format version in the upper half, bytes of payload in the lower |
//! | 2 | sequence number: the highest is the newest record |
//! | 3 | CRC-32 of words 0 to 2 |
//! | 4… | payload: postcard of `Option<`[`Parameters`]`>`, `None` for "forgotten" |
//! | next | CRC-32 of everything before |
//! | last | 0 once all of it was read back: the seal |
//!
//! The first four words and the CRC are the same in every format version, so that a record of a newer firmware is
//! recognised as one and not taken for damage.
//!
//! # Power cuts
//! Records are only ever added. A record counts when both its CRCs agree, so a cut leaves the old one or the new one.
//! Words and sectors that were being programmed or erased when power failed may read differently each time, or look
//! erased and not be. Therefore:
//! - a record without its seal is programmed a second time with the same words and sealed before anything is built on it;
//! - a sector is erased only when the newest record, sealed, is in the other one;
//! - it is marked as not prepared before, and as prepared after the erasure has ended, and only then written to;
//! - the first record after a start leaves one slot free, because the slot before may have been touched unnoticed.
//!
//! A record in a sector of 128 KiB costs one of 127 slots, so the 10 000 erasures that the memory endures are enough
//! for a million stores.
//!
//! # Why not a crate
//! Key-value stores for flash such as `sequential-storage` and `ekv` repair what they find while they read, which here
//! means an erasure of seconds before the first control tick; and they take whatever reads back intact as sound, while
//! the seal and the mark above are what keeps a cell that was programmed half way from failing later. One record of a
//! known size needs none of their indices and caches.

mod log;
mod record;

use crate::protocol::{Configuration, Model, StoreFailure};
use core::future::Future;
use serde::{Deserialize, Serialize};

pub use log::{Found, Log};
pub use record::{FORMAT_VERSION, MAX_PAYLOAD_BYTES, RECORD};

/// Words of a slot: 1 KiB.
pub const SLOT_WORDS: usize = 256;

/// What an erased word reads.
pub const ERASED: u32 = u32::MAX;

/// First words of a sector that was erased to the end.
pub const PREPARED: [u32; 2] = [0x6d72_6170, 0x3173_6772];

/// What is kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Robot constants and limits.
    pub configuration: Configuration,
    /// The model that computed torque runs with, if there is one.
    pub model: Option<Model>,
}

/// One of the two sectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sector {
    /// The one with the lower address.
    First,
    /// The other.
    Second,
}

impl Sector {
    /// Both, by address.
    pub const BOTH: [Self; 2] = [Self::First, Self::Second];

    /// The one that is not this.
    pub fn other(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }

    /// 0 or 1, by address.
    pub fn index(self) -> usize {
        self as usize
    }
}

/// Two sectors of flash memory, each [`Self::SLOTS`] times [`SLOT_WORDS`] words long.
///
/// After an error nothing is known about what was being changed; the log copes with that like with a power cut.
pub trait Flash {
    /// Slots in a sector, at least 3.
    const SLOTS: usize;

    /// Reads a word by its place in the sector. Places beyond the sector read [`ERASED`].
    fn word(&self, sector: Sector, index: usize) -> u32;

    /// Programs a word. Bits go from 1 to 0 only: what was 0 stays 0.
    fn program(
        &mut self,
        sector: Sector,
        index: usize,
        value: u32,
    ) -> impl Future<Output = Result<(), StoreFailure>> + Send;

    /// Sets every bit of a sector to 1.
    fn erase(&mut self, sector: Sector) -> impl Future<Output = Result<(), StoreFailure>> + Send;
}

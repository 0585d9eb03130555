//! What the board keeps over a restart, and whether it is what it runs with.

use serde::{Deserialize, Serialize};

/// Why parameters could not be stored, or not be restored at the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum StoreFailure {
    /// They were stored by a firmware with another format, and are left alone until others are stored.
    #[error(
        "the stored parameters have format {theirs}, this firmware knows {ours}; flash the firmware they belong to, or \
         upload them again"
    )]
    OtherVersion {
        /// Format of the stored parameters.
        theirs: u16,
        /// Format of this firmware.
        ours: u16,
    },
    /// There are records, but none is whole.
    #[error("no stored record is whole; upload the parameters again")]
    Damaged,
    /// A record is whole, but does not mean anything to this firmware.
    #[error("the stored record is whole, but means nothing to this firmware; upload the parameters again")]
    Unreadable,
    /// What was stored is not acceptable any more.
    #[error("the stored parameters are refused by this firmware; upload acceptable ones to learn why")]
    Refused,
    /// The parameters do not fit a record.
    #[error("the parameters do not fit a record of the flash memory; report this")]
    TooLong,
    /// The flash controller reported an error.
    #[error(
        "the flash memory reported an error (status {status:#06x}); if it comes again, the chip is worn or protected"
    )]
    Controller {
        /// Its status register (FLASH_SR of an STM32).
        status: u32,
    },
    /// The flash controller did not finish.
    #[error(
        "the flash memory was not ready after {waited_ms} ms; restart the board, and replace it if this comes again"
    )]
    Timeout {
        /// Time waited in ms.
        waited_ms: u16,
    },
    /// A word does not read as it was programmed.
    #[error("word {word} of the record did not keep what was written; the flash memory is worn, replace the board")]
    NotKept {
        /// Its place in the record.
        word: u16,
    },
    /// A word is not blank after an erasure.
    #[error("word {word} of the sector is not blank after an erasure; the flash memory is worn, replace the board")]
    NotErased {
        /// Its place in the sector.
        word: u16,
    },
}

/// Whether what the board runs with is kept over a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StoreState {
    /// Nothing is stored, and nothing is going to be: the board has no parameters, or was told to forget.
    Nothing,
    /// The active parameters are stored.
    Stored,
    /// Storing is under way, or waits until the board is idle.
    Pending,
    /// Storing, or restoring at the start, failed. The next change of the parameters is stored all the same.
    Failed(StoreFailure),
}

/// What is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoredParameters {
    /// Whether it is what the board runs with.
    pub state: StoreState,
    /// CRC-32 of the stored configuration ([`super::Configuration::crc`]); `None` where there is none.
    pub configuration_crc: Option<u32>,
    /// CRC-32 of the stored model ([`super::Model::crc`]); `None` where there is none.
    pub model_crc: Option<u32>,
    /// Damaged records newer than the one restored at the start, at most 255: above 0 the last store before the restart
    /// was cut, and the parameters before it were restored.
    pub damaged_records: u8,
}

impl StoredParameters {
    /// Nothing stored, and nothing found.
    pub const NONE: Self =
        Self { state: StoreState::Nothing, configuration_crc: None, model_crc: None, damaged_records: 0 };
}

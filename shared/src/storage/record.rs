//! One record: its words, as they stand in a slot.

use super::{ERASED, Flash, Parameters, SLOT_WORDS, Sector};
use crate::protocol::{Checksum, StoreFailure};

/// Raised with every change of what [`Parameters`] looks like in postcard.
pub const FORMAT_VERSION: u16 = 2;

/// First word of a record.
pub const RECORD: u32 = 0x6472_6f63;

/// Words before the payload.
const HEADER_WORDS: usize = 4;
/// Place of the seal in its slot.
const SEAL: usize = SLOT_WORDS - 1;
/// What the seal reads when it is there.
const SEALED: u32 = 0;
/// Longest payload in bytes.
pub const MAX_PAYLOAD_BYTES: usize = (SEAL - 1 - HEADER_WORDS) * size_of::<u32>();

/// Where a record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub sector: Sector,
    pub slot: usize,
}

impl Place {
    fn first_word(self) -> usize {
        self.slot * SLOT_WORDS
    }

    pub fn word(self, flash: &impl Flash, index: usize) -> u32 {
        flash.word(self.sector, self.first_word() + index)
    }

    /// Whether nothing was ever written here, as far as one word tells.
    pub fn looks_blank(self, flash: &impl Flash) -> bool {
        self.word(flash, 0) == ERASED
    }

    /// Whether nothing was ever written here.
    pub fn is_blank(self, flash: &impl Flash) -> bool {
        (0..SLOT_WORDS).all(|index| self.word(flash, index) == ERASED)
    }

    pub fn is_sealed(self, flash: &impl Flash) -> bool {
        self.word(flash, SEAL) == SEALED
    }
}

/// The part of a record that says what the rest is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub version: u16,
    pub payload_bytes: u16,
    pub sequence: u32,
}

impl Header {
    fn words(self) -> [u32; HEADER_WORDS] {
        let length = u32::from(self.version) << 16 | u32::from(self.payload_bytes);
        let words = [RECORD, length, self.sequence];
        let [first, second, third] = words;
        [first, second, third, crc(words)]
    }

    /// The header of what stands at a place, if that is one.
    #[inline]
    pub fn read(flash: &impl Flash, place: Place) -> Option<Self> {
        Self::parse([0, 1, 2, 3].map(|index| place.word(flash, index)))
    }

    fn parse(words: [u32; HEADER_WORDS]) -> Option<Self> {
        let [_, length, sequence, _] = words;
        let header = Self { version: (length >> 16) as u16, payload_bytes: length as u16, sequence };
        let fits = usize::from(header.payload_bytes) <= MAX_PAYLOAD_BYTES;
        (fits && header.words() == words).then_some(header)
    }

    /// Place of the CRC of everything before.
    fn crc_index(self) -> usize {
        HEADER_WORDS + usize::from(self.payload_bytes).div_ceil(size_of::<u32>())
    }
}

/// A whole record.
pub(super) struct Record {
    pub header: Header,
    words: [u32; SLOT_WORDS],
}

impl Record {
    #[inline]
    pub fn new(parameters: Option<&Parameters>, sequence: u32) -> Result<Self, StoreFailure> {
        let mut payload = [0xFF; MAX_PAYLOAD_BYTES];
        // The one error there is: not enough room.
        let payload_bytes = postcard::to_slice(&parameters, &mut payload).map_err(|_| StoreFailure::TooLong)?.len();
        let header = Header { version: FORMAT_VERSION, payload_bytes: payload_bytes as u16, sequence };
        let mut words = [ERASED; SLOT_WORDS];
        let bytes = payload.chunks_exact(size_of::<u32>()).map(word);
        for (place, word) in words.iter_mut().zip(header.words().into_iter().chain(bytes)) {
            *place = word;
        }
        let mut record = Self { header, words };
        let crc = record.crc();
        if let Some(place) = record.words.get_mut(header.crc_index()) {
            *place = crc;
        }
        Ok(record)
    }

    /// Reads what stands at a place; nothing where that is no whole record. Every word is read once only, so what is
    /// returned is what was checked, whatever the next read would bring.
    #[inline]
    pub fn read(flash: &impl Flash, place: Place) -> Option<Self> {
        let mut words = [ERASED; SLOT_WORDS];
        for (index, word) in words.iter_mut().enumerate() {
            *word = place.word(flash, index);
        }
        let header = Header::parse(*words.first_chunk()?)?;
        let record = Self { header, words };
        (record.words.get(header.crc_index()) == Some(&record.crc())).then_some(record)
    }

    /// What it says: parameters, or that there are none any more.
    #[inline]
    pub fn parameters(&self) -> Result<Option<Parameters>, StoreFailure> {
        if self.header.version != FORMAT_VERSION {
            return Err(StoreFailure::OtherVersion { theirs: self.header.version, ours: FORMAT_VERSION });
        }
        let mut payload = [0; MAX_PAYLOAD_BYTES];
        for (bytes, word) in payload.chunks_exact_mut(size_of::<u32>()).zip(self.words.iter().skip(HEADER_WORDS)) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        let payload = payload.get(..usize::from(self.header.payload_bytes)).unwrap_or_default();
        postcard::from_bytes(payload).map_err(|_| StoreFailure::Unreadable)
    }

    /// Programs it, CRC last, reads it back, and seals it where all is as it should be; else tells the first word that is
    /// not. Programming the same words again is harmless, and makes firm what power was cut from.
    pub async fn write(&self, flash: &mut impl Flash, place: Place) -> Result<Option<usize>, StoreFailure> {
        // One loop and one call, because every `await` is a piece of code of its own.
        for (index, &word) in self.words.iter().enumerate() {
            let word = match index {
                SEAL => match self.differs(flash, place) {
                    Some(index) => return Ok(Some(index)),
                    None => SEALED,
                },
                _ if index > self.header.crc_index() => continue,
                _ => word,
            };
            flash.program(place.sector, place.first_word() + index, word).await?;
        }
        Ok(None)
    }

    /// The place in its slot of the first word that does not read as it should, if there is one.
    fn differs(&self, flash: &impl Flash, place: Place) -> Option<usize> {
        let mut words = self.words.iter().enumerate().take(SEAL);
        words.find_map(|(index, &word)| (place.word(flash, index) != word).then_some(index))
    }

    fn crc(&self) -> u32 {
        crc(self.words.iter().take(self.header.crc_index()).copied())
    }
}

fn crc(words: impl IntoIterator<Item = u32>) -> u32 {
    let mut checksum = Checksum::new();
    words.into_iter().for_each(|word| checksum.add(&word.to_le_bytes()));
    checksum.finish()
}

fn word(bytes: &[u8]) -> u32 {
    bytes.first_chunk().copied().map_or(ERASED, u32::from_le_bytes)
}

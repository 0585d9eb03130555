//! The log: finds the newest record, adds another, and changes sectors when one is full.

use super::record::{Header, Place, Record};
use super::{ERASED, Flash, PREPARED, Parameters, SLOT_WORDS, Sector};
use crate::protocol::StoreFailure;

/// Slots tried for a record before giving up.
const ATTEMPTS: usize = 4;

/// Readings tried of a record whose words read differently each time.
const READINGS: usize = 4;

/// What was found at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The newest whole record: parameters, or that there are none; or why it cannot be used.
    pub parameters: Result<Option<Parameters>, StoreFailure>,
    /// Whether that record is complete. One that power was cut from at the very end is not, and may read damaged another
    /// time: it has to be stored again.
    pub sealed: bool,
    /// Damaged records newer than the one found, at most 255: what a power cut leaves of a record, or worse.
    pub damaged_records: u8,
}

/// Where things stand in the two sectors.
#[derive(Clone, Debug)]
pub struct Log {
    newest: Option<Place>,
    /// Highest sequence number seen, whole or not.
    highest_sequence: Option<u32>,
    /// The slot written last since the start.
    written: Option<Place>,
}

impl Log {
    /// Looks through both sectors and changes nothing. Reads a word of each of the slots and all of one record, or of
    /// more where records are damaged.
    pub fn open<F: Flash>(flash: &F) -> (Self, Found) {
        let headers = || places::<F>().filter_map(|place| Some((place, Header::read(flash, place)?)));
        let highest_sequence = headers().map(|(_, header)| header.sequence).max();
        let mut log = Self { newest: None, highest_sequence, written: None };
        let mut damaged: u8 = 0;
        let mut below = None;
        while let Some((place, sequence)) = newest_before(flash, below) {
            below = Some(sequence);
            if let Some(record) = Record::read(flash, place) {
                log.newest = Some(place);
                let later = |slot: &Place| slot.sector == place.sector && slot.slot > place.slot;
                let torn = places::<F>().filter(later).filter(|slot| is_torn(flash, *slot)).count();
                let found = Found {
                    parameters: record.parameters(),
                    sealed: place.is_sealed(flash),
                    damaged_records: damaged.saturating_add(u8::try_from(torn).unwrap_or(u8::MAX)),
                };
                return (log, found);
            }
            damaged = damaged.saturating_add(1);
        }
        let torn = places::<F>().filter(|slot| is_torn(flash, *slot)).count();
        let damaged_records = damaged.saturating_add(u8::try_from(torn).unwrap_or(u8::MAX));
        let parameters = if damaged_records == 0 { Ok(None) } else { Err(StoreFailure::Damaged) };
        (log, Found { parameters, sealed: true, damaged_records })
    }

    /// Adds a record: these parameters, or that there are none any more. It counts from the last word of its CRC on; when
    /// this returns, it has been read back and lasts.
    pub async fn store<F: Flash>(
        &mut self,
        flash: &mut F,
        parameters: Option<&Parameters>,
    ) -> Result<(), StoreFailure> {
        let sequence = self.highest_sequence.map_or(0, |highest| highest.wrapping_add(1));
        let mut attempts = 0;
        loop {
            // The newest record has to last before anything is built on it: it may soon be the only one.
            let unsealed = self.newest.filter(|place| !place.is_sealed(flash));
            let (record, place) = match unsealed {
                Some(place) => match (0..READINGS).find_map(|_| Record::read(flash, place)) {
                    Some(record) => (record, place),
                    None => {
                        self.fall_back(flash, place);
                        continue;
                    }
                },
                None => (Record::new(parameters, sequence)?, self.free_place(flash).await?),
            };
            if unsealed.is_none() {
                self.written = Some(place);
                self.highest_sequence = Some(sequence);
            }
            match (record.write(flash, place).await?, unsealed) {
                (None, None) => {
                    self.newest = Some(place);
                    return Ok(());
                }
                (None, Some(_)) => {}
                (Some(_), Some(place)) => self.fall_back(flash, place),
                (Some(word), None) => {
                    attempts += 1;
                    if attempts == ATTEMPTS {
                        return Err(StoreFailure::NotKept { word: word as u16 });
                    }
                }
            }
        }
    }

    /// The newest record turned out to be lost; the one before it counts again.
    fn fall_back<F: Flash>(&mut self, flash: &F, lost: Place) {
        let mut below = Header::read(flash, lost).map(|header| header.sequence).or(self.highest_sequence);
        self.newest = None;
        while let Some((place, sequence)) = newest_before(flash, below) {
            if place != lost && Record::read(flash, place).is_some() {
                self.newest = Some(place);
                break;
            }
            below = Some(sequence);
        }
    }

    /// A blank slot of a prepared sector: behind the newest record if there is room.
    async fn free_place<F: Flash>(&self, flash: &mut F) -> Result<Place, StoreFailure> {
        let home = self.newest.map_or(Sector::First, |newest| newest.sector);
        if let Some(place) = self.room_in(flash, home) {
            return Ok(place);
        }
        // The newest record stays where it is; without one there is nothing to lose in either sector.
        let away = home.other();
        if let Some(place) = self.room_in(flash, away) {
            return Ok(place);
        }
        prepare(flash, away).await?;
        Ok(Place { sector: away, slot: 1 })
    }

    fn room_in<F: Flash>(&self, flash: &F, sector: Sector) -> Option<Place> {
        if !is_prepared(flash, sector) {
            return None;
        }
        let from = match self.written {
            Some(written) if written.sector == sector => written.slot + 1,
            _ => {
                let used = (1..F::SLOTS).rfind(|&slot| !Place { sector, slot }.looks_blank(flash)).unwrap_or(0);
                // One slot is left free: power may have been cut at the first word of it, and left no trace.
                used + 2
            }
        };
        (from..F::SLOTS).map(|slot| Place { sector, slot }).find(|place| place.is_blank(flash))
    }
}

fn places<F: Flash>() -> impl Iterator<Item = Place> {
    Sector::BOTH.into_iter().flat_map(|sector| (1..F::SLOTS).map(move |slot| Place { sector, slot }))
}

/// The record with the highest sequence number, or with the highest below one, whole or not.
#[inline(never)]
fn newest_before<F: Flash>(flash: &F, below: Option<u32>) -> Option<(Place, u32)> {
    places::<F>()
        .filter_map(|place| Some((place, Header::read(flash, place)?.sequence)))
        .filter(|&(_, sequence)| below.is_none_or(|below| sequence < below))
        .max_by_key(|&(_, sequence)| sequence)
}

/// Whether something stands at a place that is not even the beginning of a record.
fn is_torn(flash: &impl Flash, place: Place) -> bool {
    !place.looks_blank(flash) && Header::read(flash, place).is_none()
}

fn is_prepared(flash: &impl Flash, sector: Sector) -> bool {
    (0..).zip(PREPARED).all(|(index, word)| flash.word(sector, index) == word)
}

/// Erases a sector and marks it, so that a cut on the way is noticed.
async fn prepare<F: Flash>(flash: &mut F, sector: Sector) -> Result<(), StoreFailure> {
    // Twice over the words of the mark: to take it away before, to write it after.
    for index in 0..2 * PREPARED.len() {
        let value = if index < PREPARED.len() { 0 } else { PREPARED[index - PREPARED.len()] };
        if index == PREPARED.len() {
            flash.erase(sector).await?;
            if let Some(word) = (0..F::SLOTS * SLOT_WORDS).find(|&index| flash.word(sector, index) != ERASED) {
                return Err(StoreFailure::NotErased { word: word as u16 });
            }
        }
        flash.program(sector, index % PREPARED.len(), value).await?;
    }
    Ok(())
}

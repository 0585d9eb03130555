//! Parameters in flash: the old or the new, whenever power fails.

#[path = "../../shared/tests/protocol/samples.rs"]
#[expect(dead_code, reason = "only the configuration and the model of it are used")]
mod samples;

use armid::link::{MemoryFlash, POWER_CUT, complete};
use proptest::prelude::*;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::SeedableRng as _;
use shared::protocol::StoreFailure;
use shared::storage::{
    FORMAT_VERSION, Flash as _, Found, Log, MAX_PAYLOAD_BYTES, Parameters, RECORD, SLOT_WORDS, Sector,
};

/// Three records in a sector: stores soon change sectors.
const SLOTS: usize = 4;

type SmallFlash = MemoryFlash<SLOTS>;

/// Different parameters for every number; every fifth is "none any more".
fn parameters(number: usize) -> Option<Parameters> {
    if number % 5 == 4 {
        return None;
    }
    let mut configuration = samples::configuration();
    configuration.joints[0].torque_constant_nm_per_a = 0.25 + number as f64;
    let mut model = samples::model();
    model.f[3] = number as f64;
    Some(Parameters { configuration, model: (!number.is_multiple_of(3)).then_some(model) })
}

fn store(flash: &mut SmallFlash, log: &mut Log, number: usize) -> Result<(), StoreFailure> {
    let stored = complete(log.store(flash, parameters(number).as_ref())).expect("no waiting");
    assert_eq!(flash.history().misuses, 0, "asked for a 1 where there is a 0, or went on without power");
    stored
}

fn erasures(flash: &SmallFlash) -> usize {
    flash.history().erased.iter().sum()
}

/// What reads back must be one of `allowed`, as numbers of [`parameters`]; `None` stands for an empty memory.
fn check(found: &Found, allowed: &[Option<usize>], context: &str) {
    let expected: Vec<_> =
        allowed.iter().map(|number| number.map_or(Ok(None), |number| Ok(parameters(number)))).collect();
    // Before the first record is whole, damage is all there is.
    let nothing_yet = allowed.contains(&None) && found.parameters == Err(StoreFailure::Damaged);
    assert!(expected.contains(&found.parameters) || nothing_yet, "{context}: {found:?}, allowed {allowed:?}");
}

#[test]
fn what_was_stored_comes_back_and_the_newest_counts() {
    let mut flash = SmallFlash::blank(1);
    let (mut log, found) = Log::open(&flash);
    assert_eq!(found, Found { parameters: Ok(None), sealed: true, damaged_records: 0 });
    for number in 0..40 {
        store(&mut flash, &mut log, number).unwrap();
        let (again, found) = Log::open(&flash);
        assert_eq!(found, Found { parameters: Ok(parameters(number)), sealed: true, damaged_records: 0 });
        // Now and then a restart in between.
        if number.is_multiple_of(7) {
            log = again;
        }
    }
}

#[test]
fn a_sector_is_erased_once_in_as_many_stores_as_it_has_room_for() {
    let mut flash = SmallFlash::blank(1);
    let (mut log, _) = Log::open(&flash);
    for number in 0..300 {
        store(&mut flash, &mut log, number).unwrap();
    }
    assert_eq!(erasures(&flash), 300 / (SLOTS - 1));
}

#[test]
fn rubbish_left_by_something_else_is_no_record_and_is_erased() {
    let mut flash = SmallFlash::blank(3);
    let mut random = Pcg32::seed_from_u64(3);
    for sector in Sector::BOTH {
        for index in 0..SLOTS * SLOT_WORDS {
            complete(flash.program(sector, index, random.next_u32())).expect("no waiting").unwrap();
        }
    }
    let (mut log, found) = Log::open(&flash);
    assert_eq!(found.parameters, Err(StoreFailure::Damaged));
    store(&mut flash, &mut log, 1).unwrap();
    let (_, found) = Log::open(&flash);
    assert_eq!((found.parameters, found.sealed), (Ok(parameters(1)), true));
}

/// Power is cut at every single operation of ten stores, over several sector changes. After each the old or the new is
/// found, whatever the uncertain cells read, and storing goes on.
#[test]
fn a_cut_at_any_operation_leaves_the_old_or_the_new() {
    const STORES: usize = 10;
    let mut whole = SmallFlash::blank(0);
    let (mut log, _) = Log::open(&whole);
    (0..STORES).for_each(|number| store(&mut whole, &mut log, number).unwrap());
    let operations = whole.history().operations();
    assert!(operations > 1000 && erasures(&whole) >= 3, "{operations} operations, {} erasures", erasures(&whole));
    let mut seen = [0, 0];
    for cut_at in 0..operations {
        let mut flash = SmallFlash::blank(cut_at as u64 + 1);
        flash.cut_power_after(cut_at);
        let (mut log, _) = Log::open(&flash);
        let mut number = 0;
        let failure = loop {
            match store(&mut flash, &mut log, number) {
                Ok(()) => number += 1,
                Err(failure) => break failure,
            }
        };
        assert_eq!(failure, POWER_CUT);
        flash.switch_on();
        let allowed = [number.checked_sub(1), Some(number)];
        let context = format!("cut at operation {cut_at}, while storing {number}");
        for _ in 0..3 {
            let (_, found) = Log::open(&flash);
            check(&found, &allowed, &context);
            seen[usize::from(found.parameters == Ok(parameters(number)))] += 1;
        }
        // Two more: the second would lose the first to a mistake in the sector change.
        let (mut log, _) = Log::open(&flash);
        for more in [number + 1, number + 2] {
            store(&mut flash, &mut log, more).unwrap();
            let (_, found) = Log::open(&flash);
            check(&found, &[Some(more)], &context);
        }
    }
    assert!(seen[0] > 1000 && seen[1] > 20, "old {} and new {} times: both must occur", seen[0], seen[1]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Cut after cut: what once was stored is never lost, and nothing older comes back.
    #[test]
    fn any_number_of_cuts_leaves_the_old_or_a_newer(
        seed in any::<u64>(),
        cuts in proptest::collection::vec(0_usize..400, 1..25),
        calm in 0_usize..4,
    ) {
        let mut flash = SmallFlash::blank(seed);
        let mut allowed = vec![None];
        let mut number = 0;
        for cut in cuts {
            flash.switch_on();
            let (mut log, found) = Log::open(&flash);
            check(&found, &allowed, "after a cut");
            flash.cut_power_after(cut + calm * 200);
            loop {
                let result = store(&mut flash, &mut log, number);
                if result.is_ok() {
                    allowed.clear();
                }
                allowed.push(Some(number));
                number += 1;
                if result.is_err() {
                    break;
                }
            }
        }
        flash.switch_on();
        let (mut log, found) = Log::open(&flash);
        check(&found, &allowed, "at the end");
        store(&mut flash, &mut log, number).unwrap();
        let (_, found) = Log::open(&flash);
        prop_assert_eq!(found.parameters, Ok(parameters(number)));
    }

    /// A bit that flips in the newest record: the one before comes back, and that is told.
    #[test]
    fn a_flipped_bit_brings_back_the_record_before(word in 0_usize..150, bit in 0_u32..32) {
        let mut flash = SmallFlash::blank(7);
        let (mut log, _) = Log::open(&flash);
        store(&mut flash, &mut log, 1).unwrap();
        store(&mut flash, &mut log, 2).unwrap();
        // In the second sector, because the first store of a new memory prepares that; the second record is in slot 2.
        flash.flip(Sector::Second, 2 * SLOT_WORDS + word, bit);
        let (mut log, found) = Log::open(&flash);
        prop_assert_eq!(found, Found { parameters: Ok(parameters(1)), sealed: true, damaged_records: 1 });
        store(&mut flash, &mut log, 3).unwrap();
        let (_, found) = Log::open(&flash);
        prop_assert_eq!(found, Found { parameters: Ok(parameters(3)), sealed: true, damaged_records: 0 });
    }
}

/// A record as a firmware with another format would write it.
fn foreign_record(version: u16, sequence: u32, payload: &[u8]) -> Vec<u32> {
    let crc = |words: &[u32]| {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes)
    };
    let mut words = vec![RECORD, u32::from(version) << 16 | payload.len() as u32, sequence];
    words.push(crc(&words));
    for bytes in payload.chunks(4) {
        let mut word = [0xFF; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        words.push(u32::from_le_bytes(word));
    }
    words.push(crc(&words));
    words
}

fn place(flash: &mut SmallFlash, slot: usize, words: &[u32]) {
    for (index, &word) in words.iter().enumerate() {
        complete(flash.program(Sector::Second, slot * SLOT_WORDS + index, word)).expect("no waiting").unwrap();
    }
}

#[test]
fn a_record_of_another_format_is_named_and_left_alone_until_something_is_stored() {
    let mut flash = SmallFlash::blank(7);
    let (mut log, _) = Log::open(&flash);
    store(&mut flash, &mut log, 1).unwrap();
    place(&mut flash, 2, &foreign_record(FORMAT_VERSION + 1, 1, b"what the future brings"));
    let before = flash.history().operations();
    let (mut log, found) = Log::open(&flash);
    let other = StoreFailure::OtherVersion { theirs: FORMAT_VERSION + 1, ours: FORMAT_VERSION };
    assert_eq!((found.parameters, found.damaged_records), (Err(other), 0), "not the older one either");
    assert_eq!(flash.history().operations(), before, "looking changes nothing");
    store(&mut flash, &mut log, 2).unwrap();
    let (_, found) = Log::open(&flash);
    assert_eq!(found.parameters, Ok(parameters(2)));
    let foreign = foreign_record(FORMAT_VERSION + 1, 1, b"what the future brings");
    assert!((0..).zip(foreign).all(|(index, word)| flash.word(Sector::Second, 2 * SLOT_WORDS + index) == word));
}

#[test]
fn a_whole_record_that_makes_no_sense_is_refused() {
    let mut flash = SmallFlash::blank(7);
    let (mut log, _) = Log::open(&flash);
    store(&mut flash, &mut log, 1).unwrap();
    place(&mut flash, 2, &foreign_record(FORMAT_VERSION, 1, &[9; 40]));
    assert_eq!(Log::open(&flash).1.parameters, Err(StoreFailure::Unreadable));
}

#[test]
fn a_record_has_room_for_the_parameters_and_its_layout_has_a_version() {
    let mut flash = SmallFlash::blank(7);
    let (mut log, _) = Log::open(&flash);
    let stored = Parameters { configuration: samples::configuration(), model: Some(samples::model()) };
    complete(log.store(&mut flash, Some(&stored))).expect("no waiting").unwrap();
    let payload_bytes = flash.word(Sector::Second, SLOT_WORDS + 1) & 0xFFFF;
    assert!((payload_bytes as usize) < MAX_PAYLOAD_BYTES * 4 / 5, "{payload_bytes} bytes");
    // When this fails, records of boards in the field can no longer be read: raise FORMAT_VERSION, then renew the numbers.
    let checksum = (4..4 + payload_bytes.div_ceil(4) as usize)
        .fold(0_u32, |sum, index| sum.rotate_left(1) ^ flash.word(Sector::Second, SLOT_WORDS + index));
    assert_eq!((FORMAT_VERSION, payload_bytes, checksum), (2, 771, 430_414_719));
}

/// The three precautions against cells that only look sound. Failures they prevent are too rare to be met by chance, so
/// each is looked for itself.
#[test]
fn what_a_cut_may_have_left_half_done_is_never_built_on() {
    const SEAL: usize = SLOT_WORDS - 1;
    let mut flash = SmallFlash::blank(7);
    let (mut log, _) = Log::open(&flash);
    store(&mut flash, &mut log, 1).unwrap();
    // Header, payload, CRC and seal.
    let payload_bytes = flash.word(Sector::Second, SLOT_WORDS + 1) & 0xFFFF;
    let operations_of_a_store = 4 + payload_bytes.div_ceil(4) as usize + 2;
    flash.cut_power_after(operations_of_a_store - 1);
    assert_eq!(store(&mut flash, &mut log, 2), Err(POWER_CUT), "cut at the seal");
    flash.switch_on();
    let (mut log, _) = Log::open(&flash);
    store(&mut flash, &mut log, 5).unwrap();
    assert_eq!(flash.word(Sector::Second, 2 * SLOT_WORDS + SEAL), 0, "sealed before the next is added");
    assert_eq!(flash.word(Sector::Second, 3 * SLOT_WORDS), u32::MAX, "a slot that may have been touched is left free");
    assert_eq!(flash.word(Sector::First, SLOT_WORDS), RECORD);

    let before = erasures(&flash);
    while erasures(&flash) == before {
        flash.switch_on();
        let mut trial = flash.duplicate();
        trial.cut_power_after(2);
        let mut trial_log = log.clone();
        if store(&mut trial, &mut trial_log, 6).is_err() && erasures(&trial) > before {
            let mark = [0, 1].map(|index| trial.word(Sector::Second, index));
            assert_ne!(mark, shared::storage::PREPARED, "a sector half erased must not look prepared");
            return;
        }
        store(&mut flash, &mut log, 6).unwrap();
    }
    panic!("no sector was erased by a store that begins with two words of the mark");
}

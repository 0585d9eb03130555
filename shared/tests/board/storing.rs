//! When parameters are stored: by themselves, and never while anything could move.

use crate::rig::{Rig, configuration, exact_model, identity};
use shared::board::Board;
use shared::protocol::*;
use shared::storage::{Found, Parameters};

fn stored(rig: &mut Rig) -> StoredParameters {
    rig.status().stored
}

/// Does what the firmware does: asks after every request and tick.
fn begin(rig: &mut Rig) -> Option<Option<Parameters>> {
    rig.board.begin_store()
}

fn found(parameters: Option<Parameters>) -> Found {
    Found { parameters: Ok(parameters), sealed: true, damaged_records: 0 }
}

#[test]
fn a_new_configuration_and_a_new_model_are_stored_without_being_asked() {
    let mut rig = Rig::bare(configuration());
    assert_eq!((begin(&mut rig), stored(&mut rig)), (None, StoredParameters::NONE));
    rig.configure();
    let configuration_crc = Some(configuration().crc());
    assert_eq!(stored(&mut rig).state, StoreState::Pending);
    assert_eq!(begin(&mut rig), Some(Some(Parameters { configuration: configuration(), model: None })));
    assert_eq!((begin(&mut rig), stored(&mut rig).state), (None, StoreState::Pending), "one at a time");
    rig.board.end_store(Ok(()));
    let expected = StoredParameters { state: StoreState::Stored, configuration_crc, ..StoredParameters::NONE };
    assert_eq!((begin(&mut rig), stored(&mut rig)), (None, expected));

    rig.upload(exact_model());
    assert_eq!(begin(&mut rig), Some(Some(Parameters { configuration: configuration(), model: Some(exact_model()) })));
    rig.board.end_store(Ok(()));
    let expected = StoredParameters { model_crc: Some(exact_model().crc()), ..expected };
    assert_eq!(stored(&mut rig), expected);

    // The same again costs no erasure.
    rig.configure();
    rig.upload(exact_model());
    assert_eq!((begin(&mut rig), stored(&mut rig)), (None, expected));
}

#[test]
fn what_changes_during_a_store_is_stored_after_it() {
    let mut rig = Rig::bare(configuration());
    rig.configure();
    begin(&mut rig).expect("a new configuration");
    rig.upload(exact_model());
    assert_eq!(begin(&mut rig), None);
    rig.board.end_store(Ok(()));
    assert_eq!(stored(&mut rig).state, StoreState::Pending);
    assert_eq!(begin(&mut rig), Some(Some(Parameters { configuration: configuration(), model: Some(exact_model()) })));
}

#[test]
fn nothing_is_armed_during_a_store_and_nothing_stored_while_armed() {
    let mut rig = Rig::loaded(configuration());
    begin(&mut rig).expect("a new configuration");
    assert_eq!(rig.refused(Request::Arm), Refusal::Storing);
    rig.tick();
    assert_eq!((rig.refused(Request::Arm), rig.board.mode()), (Refusal::Storing, Mode::Idle));
    rig.board.end_store(Ok(()));
    rig.ok(Request::Arm);
    // A model may be activated while the position loop holds the arm. It has to wait.
    rig.upload(exact_model());
    for _ in 0..100 {
        assert_eq!((begin(&mut rig), stored(&mut rig).state), (None, StoreState::Pending));
        rig.tick();
    }
    rig.tamper = Some(|inputs| inputs.emergency_stop = true);
    rig.tick();
    assert!(matches!(rig.board.mode(), Mode::Fault(_)));
    assert_eq!(begin(&mut rig), None, "not in a fault either");
    rig.tick();
    rig.ok(Request::ClearFault);
    assert!(begin(&mut rig).is_some());
}

#[test]
fn a_failed_store_is_told_allows_arming_and_is_tried_again_with_the_next_upload() {
    let mut rig = Rig::loaded(configuration());
    begin(&mut rig).expect("a new configuration");
    let failure = StoreFailure::NotKept { word: 3 };
    rig.board.end_store(Err(failure));
    let expected = StoredParameters { state: StoreState::Failed(failure), ..StoredParameters::NONE };
    assert_eq!((stored(&mut rig), begin(&mut rig)), (expected, None), "not again by itself: the memory wears");
    rig.configure();
    begin(&mut rig).expect("a second try");
    rig.board.end_store(Ok(()));
    assert_eq!(stored(&mut rig).state, StoreState::Stored);
    rig.ok(Request::Arm);
}

#[test]
fn forgetting_leaves_what_is_active_alone_and_lasts_until_the_next_upload() {
    let mut rig = Rig::loaded(configuration());
    begin(&mut rig).expect("a new configuration");
    rig.board.end_store(Ok(()));
    rig.ok(Request::Arm);
    assert!(matches!(rig.refused(Request::ForgetParameters), Refusal::WrongMode { .. }));
    rig.ok(Request::Disarm);
    rig.ok(Request::ForgetParameters);
    assert_eq!(begin(&mut rig), Some(None));
    rig.board.end_store(Ok(()));
    assert_eq!((stored(&mut rig), begin(&mut rig)), (StoredParameters::NONE, None));
    assert_eq!(rig.board.configuration(), Some(&configuration()));
    rig.configure();
    assert!(matches!(begin(&mut rig), Some(Some(_))));
}

#[test]
fn what_was_found_at_the_start_is_taken_up_or_its_failure_told() {
    let start = |found: &Found| {
        let mut rig = Rig::bare(configuration());
        rig.board = Board::new(identity(), vec![PackedSample::EMPTY; 10]);
        rig.board.restore_stored(found);
        rig.ok(Request::Hello { protocol_version: PROTOCOL_VERSION });
        rig
    };
    let kept = Parameters { configuration: configuration(), model: Some(exact_model()) };
    let mut rig = start(&found(Some(kept)));
    assert_eq!((rig.board.configuration(), rig.board.active_model()), (Some(&configuration()), Some(&exact_model())));
    assert_eq!((stored(&mut rig).state, begin(&mut rig)), (StoreState::Stored, None), "nothing new to store");

    // Cut at the very end: it counts, but is written once more.
    let mut rig = start(&Found { sealed: false, ..found(Some(kept)) });
    assert_eq!(stored(&mut rig).state, StoreState::Pending);
    assert_eq!(begin(&mut rig), Some(Some(kept)));

    let mut rig = start(&Found { damaged_records: 2, ..found(None) });
    assert_eq!((stored(&mut rig).damaged_records, begin(&mut rig)), (2, None));

    // Whole and yet unacceptable: the limits of another firmware may have been wider.
    let mut rotten = kept;
    rotten.configuration.joints[0].gear_ratio = f64::NAN;
    let mut rig = start(&found(Some(rotten)));
    assert_eq!(rig.board.configuration(), None);
    assert_eq!((stored(&mut rig).state, begin(&mut rig)), (StoreState::Failed(StoreFailure::Refused), None));

    let failure = StoreFailure::OtherVersion { theirs: 9, ours: 1 };
    let mut rig = start(&Found { parameters: Err(failure), sealed: false, damaged_records: 0 });
    assert_eq!((stored(&mut rig).state, begin(&mut rig)), (StoreState::Failed(failure), None), "left alone");
    rig.configure();
    assert!(begin(&mut rig).is_some(), "until the user stores something else");
}

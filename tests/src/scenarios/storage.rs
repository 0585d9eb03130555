//! Parameters in the board's flash memory: kept over restarts, old or new whenever power fails, and never written while
//! the amplifiers are on.

use std::time::Duration;

use armid::board_setup::configuration;
use armid::client::{Client, ClientError};
use armid::link::{MemoryFlash, complete};
use rigless::device::ResetCause as Cause;
use shared::protocol::{Model, Refusal, Reply, Request, ResetCause, StoreFailure, StoreState, StoredParameters};
use shared::storage::{FORMAT_VERSION, Flash as _, Log, Parameters, RECORD, SLOT_WORDS, Sector};

use super::{BoardUnderTest, Setup, check_whole, greeted, loaded, ready, robot, run_undisturbed, true_model};
use crate::emulated_board::PowerCut;
use crate::emulated_board::flash::{FlashOperation, PARAMETERS};
use crate::emulated_board::observations::Observations;

/// Longer than a store without an erasure takes, from the request to the seal, and than a restart.
const STORE: Duration = Duration::from_millis(40);
/// With one.
const ERASE_AND_STORE: Duration = Duration::from_millis(1_100);

/// Records that a sector has room for, without the one left free at a start.
const RECORDS: usize = 126;

/// A host that comes anew, as it has to after every restart.
fn connected(board: &impl BoardUnderTest) -> Client {
    Client::connect_from(board.link(), 1).expect("a board that answers")
}

/// Different models for every number.
fn model(number: usize) -> Model {
    let mut model = true_model();
    model.viscous_friction_nm_s_per_rad[0] += 1.0e-6 * number as f64;
    model
}

fn parameters(number: usize) -> Parameters {
    Parameters { configuration: configuration(&robot()).expect("a safe robot"), model: Some(model(number)) }
}

/// A memory that holds the parameters of every number below this.
fn filled(numbers: usize) -> MemoryFlash {
    let mut flash = MemoryFlash::default();
    let (mut log, _) = Log::open(&flash);
    for number in 0..numbers {
        complete(log.store(&mut flash, Some(&parameters(number)))).expect("no waiting").expect("a sound memory");
    }
    flash
}

fn with(flash: MemoryFlash) -> Setup {
    Setup { flash, ..Setup::default() }
}

/// Sends a model and waits for nothing but the answers.
fn activate(client: &mut Client, model: &Model) {
    begin_to_activate(client, model).expect("an accepted model");
}

/// The same on a board whose power may fail before it has answered.
fn begin_to_activate(client: &mut Client, model: &Model) -> Result<Reply, ClientError> {
    let crc = model.crc();
    client.request(Request::StageModel { model: *model, crc }).expect("an accepted model");
    client.request(Request::CommitModel { crc })
}

/// Asks once to arm; says why not.
fn refusal_to_arm(client: &mut Client) -> Option<Refusal> {
    match client.command(Request::Arm) {
        Err(ClientError::Refused { refusal, .. }) => Some(refusal),
        other => {
            other.expect("an answer");
            None
        }
    }
}

fn stored(number: usize) -> StoredParameters {
    StoredParameters {
        state: StoreState::Stored,
        configuration_crc: Some(parameters(number).configuration.crc()),
        model_crc: Some(model(number).crc()),
        damaged_records: 0,
    }
}

fn erasures(observations: &Observations) -> usize {
    observations.flash_uses.iter().filter(|used| matches!(used.operation, FlashOperation::Erase { .. })).count()
}

/// A model survives a power cut, and what is forgotten stays forgotten; a memory that is not prepared is.
pub fn parameters_survive_a_power_cycle_and_a_blank_memory_is_prepared_for_them<B: BoardUnderTest>(
    switch_on: impl Fn(Setup) -> B,
) {
    let mut blank = MemoryFlash::default();
    for sector in Sector::BOTH {
        complete(blank.erase(sector)).expect("no waiting").expect("a sound memory");
    }
    let board = switch_on(with(blank));
    let mut client = ready(&board);
    assert_eq!(refusal_to_arm(&mut client), Some(Refusal::Storing));
    client.wait_until_stored().expect("an answer");
    let from = board.now();
    activate(&mut client, &model(1));
    assert_eq!(client.wait_until_stored().expect("an answer"), stored(1));
    println!("a model was stored within {:.1} ms", (board.now() - from).as_secs_f64() * 1e3);

    board.cut_power(PowerCut::Now);
    board.run(STORE);
    let mut client = connected(&board);
    assert_eq!(client.info().identity.reset_cause, ResetCause::PowerOn);
    let status = client.status().expect("a status");
    assert_eq!((status.stored, status.active_model_crc), (stored(1), Some(model(1).crc())));
    assert_eq!(status.configuration_crc, stored(1).configuration_crc);
    assert_eq!(client.active_model().expect("an answer"), Some(model(1)), "to the bit");
    assert!(!status.pose_known, "where the arm is, nobody can store");

    // What is forgotten stays forgotten.
    client.command(Request::ForgetParameters).expect("an idle board");
    assert_eq!(client.wait_until_stored().expect("an answer"), StoredParameters::NONE);
    board.cut_power(PowerCut::Now);
    board.run(STORE);
    let status = connected(&board).status().expect("a status");
    assert_eq!((status.stored, status.configuration_crc), (StoredParameters::NONE, None));

    let observations = board.finish();
    assert_eq!(erasures(&observations), 1);
    assert_eq!(observations.restarts.iter().map(|restart| restart.cause).collect::<Vec<_>>(), [Cause::PowerOn; 2]);
}

/// Power fails in the middle of an operation of a store that needs no erasure. A few points only: every start of the
/// emulator costs more than a second, and the log is tried at every point in its own tests.
pub fn power_cut_during_a_store_leaves_the_old_or_the_new_model<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(with(filled(1)));
    drop(greeted(&board));
    // Words of a record: header, payload, CRC and seal.
    let operations = (filled(2).history().operations() - filled(1).history().operations()) as u64;
    let points = [0, 3, 80, operations - 3, operations - 2, operations - 1];
    let mut old = 0;
    let mut kept_new = 0;
    for (new, point) in (1..).zip(points) {
        let mut client = connected(&board);
        assert_eq!(client.wait_until_stored().expect("an answer"), stored(old), "before the cut at {point}");
        board.cut_power(PowerCut::AfterFlashOperations(point));
        let _ = begin_to_activate(&mut client, &model(new));
        board.run(STORE);
        let mut client = connected(&board);
        let status = client.status().expect("a status");
        assert_eq!(status.configuration_crc, stored(old).configuration_crc, "cut at {point}");
        let active = client.active_model().expect("an answer");
        assert!([Some(model(old)), Some(model(new))].contains(&active), "cut at {point}: {active:?}");
        let is_new = active == Some(model(new));
        assert_eq!(is_new, point >= operations - 1, "the CRC decides, cut at {point}");
        if is_new {
            old = new;
            kept_new += 1;
        } else {
            assert_eq!(status.stored.damaged_records, 1, "cut at {point}");
            // Another store, so that the next cut does not find this one's traces.
            old = new + 1000;
            activate(&mut client, &model(old));
        }
    }
    let observations = board.finish();
    println!("{} power cuts, {kept_new} with the new model", observations.restarts.len());
    assert_eq!((observations.restarts.len(), kept_new), (points.len(), 1), "{:?}", observations.restarts);
    assert!(observations.restarts.iter().all(|restart| restart.cause == Cause::PowerOn));
}

/// One sector is full, so the other is erased first: around and in the middle of that.
pub fn power_cut_during_a_sector_change_leaves_the_old_or_the_new_model<B: BoardUnderTest>(
    switch_on: impl Fn(Setup) -> B,
) {
    // Two words of the mark away, the erasure, two words of the mark back, then the record.
    for point in [2, 4] {
        let board = switch_on(with(filled(RECORDS)));
        let mut client = greeted(&board);
        assert_eq!(client.status().expect("a status").stored, stored(RECORDS - 1));
        board.cut_power(PowerCut::AfterFlashOperations(point));
        let _ = begin_to_activate(&mut client, &model(RECORDS));
        board.run(if point > 2 { ERASE_AND_STORE } else { STORE });
        let mut client = connected(&board);
        assert_eq!(client.active_model().expect("an answer"), Some(model(RECORDS - 1)), "cut at {point}");
        // And on it goes.
        activate(&mut client, &model(RECORDS));
        assert_eq!(client.wait_until_stored().expect("an answer"), stored(RECORDS), "after the cut at {point}");
        board.cut_power(PowerCut::Now);
        board.run(STORE);
        assert_eq!(connected(&board).status().expect("a status").stored, stored(RECORDS), "cut at {point}");
        let observations = board.finish();
        assert_eq!(observations.restarts.len(), 2);
        let second = PARAMETERS.start + (PARAMETERS.end - PARAMETERS.start) / 2;
        for used in &observations.flash_uses {
            let (FlashOperation::Program { address } | FlashOperation::Erase { address }) = used.operation;
            assert!(address >= second, "the sector with the newest record was touched: {used:?}");
        }
    }
}

/// Nothing is armed during a store; while armed nothing is stored; the control interrupt goes on during an erasure.
pub fn storing_and_moving_exclude_each_other<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(with(filled(RECORDS)));
    let mut client = loaded(&board);
    let erase_from = board.now();
    activate(&mut client, &model(RECORDS));
    let mut refused = 0;
    while client.status().expect("a status").stored.state == StoreState::Pending {
        refused += u32::from(refusal_to_arm(&mut client) == Some(Refusal::Storing));
        client.command(Request::Disarm).expect("always possible");
        board.run(Duration::from_millis(50));
    }
    let erase_to = board.now();
    assert!(refused > 10, "asked to arm {refused} times during an erasure of a second");

    // Armed, a model may be activated, but it is stored only afterwards.
    client.command(Request::Arm).expect("nothing is being stored any more");
    activate(&mut client, &model(RECORDS + 1));
    board.run(Duration::from_millis(100));
    assert_eq!(client.status().expect("a status").stored.state, StoreState::Pending);
    client.command(Request::Disarm).expect("always possible");
    assert_eq!(client.wait_until_stored().expect("an answer"), stored(RECORDS + 1));
    check_whole(&run_undisturbed(&mut client));

    let observations = board.finish();
    assert!(observations.outputs.iter().any(|change| change.outputs.amplifiers_enabled));
    assert_eq!(erasures(&observations), 1);
    assert!(observations.restarts.is_empty(), "the watchdog was fed: {:?}", observations.restarts);
    let during = |at_ns: u64| (erase_from.as_nanos()..erase_to.as_nanos()).contains(&u128::from(at_ns));
    let ticks: Vec<u64> =
        observations.ticks.iter().map(|tick| tick.start_ns).filter(|&start_ns| during(start_ns)).collect();
    let longest_ns = ticks.windows(2).map(|pair| pair[1] - pair[0]).max().expect("control ticks");
    println!("{} control ticks during the erasure, at most {longest_ns} ns apart", ticks.len());
    assert!(longest_ns < 710_000);
}

/// A memory that another firmware wrote to, or nobody who knows about records.
pub fn stored_parameters_that_cannot_be_used_are_named_and_left_alone<B: BoardUnderTest>(
    switch_on: impl Fn(Setup) -> B,
) {
    let mut flash = filled(1);
    add_foreign_record(&mut flash);
    let board = switch_on(with(flash));
    let status = greeted(&board).status().expect("a status");
    let StoreState::Failed(StoreFailure::OtherVersion { theirs, ours }) = status.stored.state else {
        panic!("{status:?}")
    };
    assert_eq!((theirs, status.configuration_crc), (ours + 1, None));
    let observations = board.finish();
    assert_eq!(observations.flash_uses, []);
}

/// The newest record, as a firmware with the next format would write it. The CRC is reckoned bit by bit, apart from the
/// product's own.
fn add_foreign_record(flash: &mut MemoryFlash) {
    let crc = |words: &[u32]| {
        let mut crc = u32::MAX;
        for byte in words.iter().flat_map(|word| word.to_le_bytes()) {
            crc ^= u32::from(byte);
            for _ in 0..8 {
                crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
            }
        }
        !crc
    };
    let mut words = vec![RECORD, u32::from(FORMAT_VERSION + 1) << 16 | 8, 77];
    words.push(crc(&words));
    words.extend([1, 2]);
    words.push(crc(&words));
    for (index, word) in words.into_iter().enumerate() {
        complete(flash.program(Sector::First, 10 * SLOT_WORDS + index, word)).expect("no waiting").expect("a word");
    }
}

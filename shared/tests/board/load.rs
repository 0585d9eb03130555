//! Loads: what the board orders, what it passes on, and how a change enters computed torque.

use crate::rig::{Rig, configuration, exact_model};
use shared::board::LoadOrder;
use shared::load::{LoadEstimate, LoadNews, LoadRow, LoadSettings, Waiting};
use shared::protocol::*;

const MAXIMUM_KG: f32 = 2.5;

fn settings() -> LoadSettings {
    LoadSettings::known_grasp(MAXIMUM_KG, 0.4318, [-0.02, -0.53])
}

fn estimate(mass_kg: f32) -> LoadEstimate {
    LoadEstimate { mass_kg, standard_error_kg: 0.01, centre_m: [-0.02, -0.53], ..LoadEstimate::NONE }
}

fn report(rig: &mut Rig, request: Request) -> LoadReport {
    match rig.ok(request) {
        Reply::Load(report) => report,
        other => panic!("{other:?}"),
    }
}

/// Armed, with model, trajectory and loads to be identified.
fn identifying(settings: LoadSettings) -> Rig {
    let mut rig = Rig::loaded(configuration());
    rig.upload(exact_model());
    let report = report(&mut rig, Request::IdentifyLoad(settings));
    assert_eq!((report.settings_active, report.assumed_kg, report.found), (true, 0.5 * MAXIMUM_KG, None));
    rig.ok(Request::Arm);
    rig.tick();
    rig
}

#[test]
fn loads_are_identified_only_where_that_can_be() {
    let mut rig = Rig::bare(configuration());
    assert_eq!(rig.refused(Request::IdentifyLoad(settings())), Refusal::NotConfigured);
    assert_eq!(report(&mut rig, Request::ReadLoad), LoadReport::NONE);

    let mut rig = Rig::loaded(configuration());
    let bad = LoadSettings { maximum_kg: -1.0, ..settings() };
    assert!(matches!(rig.refused(Request::IdentifyLoad(bad)), Refusal::Load(error) if error.value == -1.0));
    assert_eq!(rig.refused(Request::UseLoad(estimate(1.0))), Refusal::BadLoad);

    let mut rig = Rig::running(configuration());
    assert!(matches!(rig.refused(Request::IdentifyLoad(settings())), Refusal::WrongMode { .. }));
    assert!(matches!(rig.refused(Request::ForgetLoad), Refusal::WrongMode { .. }));

    let mut fast = configuration();
    fast.common.loop_period_ns = 350_000;
    let mut rig = Rig::loaded(fast);
    let refusal = Refusal::LoadNeedsEveryTick { loop_ns: 350_000, record_ns: 700_000 };
    assert_eq!(rig.refused(Request::IdentifyLoad(settings())), refusal);
}

#[test]
fn a_movement_under_computed_torque_orders_the_identification_and_gives_it_every_row() {
    let mut rig = identifying(settings());
    rig.run(ControlLaw::Position);
    assert!(rig.board.take_load_order().is_none());
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    assert_eq!(rig.tick().load_row, None);
    rig.until(|mode| matches!(mode, Mode::Holding(_)));

    rig.run(ControlLaw::ComputedTorque);
    let Some(LoadOrder::Begin(setup)) = rig.board.take_load_order() else { panic!() };
    assert!(rig.board.take_load_order().is_none());
    assert_eq!((setup.settings, setup.assumed), (settings(), settings().assumed()));
    assert_eq!(setup.f, exact_model().f.map(|f| f as f32));
    assert!((setup.period_s - 0.0007).abs() < 1e-9 && (setup.command_delay_s - 30e-6).abs() < 1e-9);
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    let rows: Vec<LoadRow> = (0..300).filter_map(|_| rig.tick().load_row).collect();
    let recorded = &rig.recording()[..300];
    assert_eq!(rows.len(), 300);
    for (row, sample) in rows.iter().zip(recorded) {
        let counts = [0, 1].map(|joint: usize| sample.reference_counts[joint] - i32::from(sample.error_counts[joint]));
        assert_eq!((row.index, row.counts, row.command_code), (sample.index, counts, sample.command_code));
    }
}

#[test]
fn a_host_that_identifies_gets_no_order_and_no_rows_are_passed_on() {
    let mut rig = identifying(LoadSettings { by_host: true, ..settings() });
    rig.run(ControlLaw::ComputedTorque);
    assert!(rig.board.take_load_order().is_none());
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    assert_eq!(rig.tick().load_row, None);
    assert_eq!(rig.refused(Request::UseLoad(estimate(MAXIMUM_KG + 0.1))), Refusal::BadLoad);
    assert_eq!(rig.refused(Request::UseLoad(estimate(f32::NAN))), Refusal::BadLoad);
    let far = LoadEstimate { centre_m: [0.9, 0.9], ..estimate(1.0) };
    assert_eq!(rig.refused(Request::UseLoad(far)), Refusal::BadLoad);
    let used = report(&mut rig, Request::UseLoad(estimate(1.0)));
    assert_eq!((used.found, used.identifications), (Some(estimate(1.0)), 1));
}

/// Friction holds the arm at its end, so what changes there is the command alone: half a load that is assumed and not there
/// goes, some 20 codes of joint 2, in 30 ms.
#[test]
fn what_is_found_enters_by_degrees_and_is_told() {
    let mut rig = identifying(settings());
    rig.run(ControlLaw::ComputedTorque);
    rig.until(|mode| matches!(mode, Mode::Holding(_)));
    rig.seconds(0.5);
    let mut codes = vec![rig.tick().command_code];
    let found = LoadNews::Found(estimate(0.0));
    rig.board.hear_of_load(&found);
    let mut events = Vec::new();
    for _ in 0..100 {
        let outputs = rig.tick();
        codes.push(outputs.command_code);
        events.extend(outputs.event);
    }
    assert!(matches!(events[..], [Event::Load { news, .. }] if news == found), "{events:?}");
    let changed = |from: [u16; 2], to: [u16; 2]| [0, 1].map(|joint: usize| to[joint].abs_diff(from[joint]));
    let [second, _] = changed(codes[0], codes[100]);
    assert!(second >= 15, "{second} codes in all");
    assert_eq!(codes[60], codes[100]);
    let largest = codes.windows(2).flat_map(|pair| changed(pair[0], pair[1])).max();
    assert!(largest <= Some(2), "{largest:?} codes in a tick");
}

#[test]
fn what_is_assumed_follows_the_news() {
    let mut rig = identifying(settings());
    rig.run(ControlLaw::ComputedTorque);
    rig.until(|mode| matches!(mode, Mode::Running(_)));
    let mut after = |news: LoadNews| {
        rig.board.hear_of_load(&news);
        rig.tick();
        report(&mut rig, Request::ReadLoad)
    };
    assert_eq!(after(LoadNews::Waiting(Waiting::Slow { joint: 0 })).assumed_kg, 1.25);
    let collecting = after(LoadNews::Collecting).collecting_tick;
    assert_eq!(after(LoadNews::Searching).searching_tick, collecting + 1);
    let found = after(LoadNews::Found(estimate(1.7)));
    assert_eq!((found.assumed_kg, found.found_tick), (1.7, collecting + 2));
    let changed = after(LoadNews::Changed { by_kg: -5.0, assumed_kg: -3.3 });
    assert_eq!((changed.assumed_kg, changed.found, changed.changes), (0.0, None, 1));
    // What is assumed at the end of a movement is assumed in the next.
    rig.until(|mode| matches!(mode, Mode::Holding(_)));
    rig.board.take_load_order();
    rig.run(ControlLaw::ComputedTorque);
    let Some(LoadOrder::Begin(setup)) = rig.board.take_load_order() else { panic!() };
    assert_eq!(setup.assumed, settings().held(0.0));
}

#[test]
fn another_configuration_forgets_the_load() {
    let mut rig = identifying(settings());
    rig.ok(Request::Disarm);
    rig.configuration.joints[0].position_gain_a_per_count *= 0.5;
    rig.configure();
    assert!(matches!(rig.board.take_load_order(), Some(LoadOrder::End)));
    assert_eq!(report(&mut rig, Request::ReadLoad), LoadReport::NONE);
    // News that were on their way mean nothing any more.
    rig.board.hear_of_load(&LoadNews::Found(estimate(1.0)));
    assert_eq!(report(&mut rig, Request::ReadLoad), LoadReport::NONE);
    rig.ok(Request::IdentifyLoad(settings()));
    assert_eq!(report(&mut rig, Request::ForgetLoad), LoadReport::NONE);
}

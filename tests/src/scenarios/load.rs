//! Loads taken up and dropped while the arm moves, identified on the board.

use armid::client::MovementProgress;
use armid::load::{self, Listener, Told};
use shared::load::{LoadEstimate, LoadNews};
use shared::protocol::ControlLaw;

use super::{
    BoardUnderTest, Setup, check_whole, hidden, largest_errors_counts, paper_movement, plan, ready, robot, true_model,
};
use crate::emulated_board::control_time::{COMPUTED_TORQUE_LIMIT_US, ControlTime};

/// Mass that is taken up, kg.
const PICKED_KG: f64 = 1.6;

/// Rows at which it is taken up and dropped: in the middle of motion of both joints.
const PICKED_AT: u32 = 1300;
const DROPPED_AT: u32 = 3000;

/// What the paper needed 3 to 4 s of a host computer for, s.
const IDENTIFIED_WITHIN_S: f64 = 1.0;

/// Noticed within, s.
const NOTICED_WITHIN_S: f64 = 0.15;

/// An empty gripper, a load taken up and the load dropped are each found by the board, within what it states; no control
/// tick is late or long, and the drop is corrected gently.
pub fn a_load_is_identified_on_the_board_when_it_is_picked_and_dropped<B: BoardUnderTest>(
    switch_on: impl Fn(Setup) -> B,
) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    client.upload(&true_model()).expect("an accepted model");
    let model = hidden().to_model(toml::Table::new());
    let settings = load::settings(&robot(), &model, load::MAXIMUM_KG, load::GRASP_M);
    client.identify_load(&settings).expect("settings within their limits");
    client.load_trajectory(&paper_movement(3.65)).expect("an accepted movement");
    let mut show = |told: &Told| println!("{:.3} s: {:?}", told.at_s, told.news);
    let mut listener = Listener::new(&robot(), &mut show);
    let mut carried = 0;
    let movement = client
        .run_watched(
            &plan(ControlLaw::ComputedTorque),
            &mut |progress| {
                let MovementProgress::Running { rows, .. } = progress else { return };
                if rows >= PICKED_AT && carried == 0 {
                    carried = 1;
                    board.carry(&load::held(PICKED_KG));
                } else if rows >= DROPPED_AT && carried == 1 {
                    carried = 2;
                    board.carry(&load::held(0.0));
                }
            },
            &mut listener,
        )
        .expect("a movement");
    let told = listener.told;
    check_whole(&movement);
    let timing = client.hello().expect("an answer").timing;
    let report = client.load_report().expect("a report");
    let observations = board.finish();

    let found: Vec<LoadEstimate> = told
        .iter()
        .filter_map(|told| match told.news {
            LoadNews::Found(found) => Some(found),
            _ => None,
        })
        .collect();
    assert_eq!((report.identifications, report.changes, found.len()), (3, 2, 3), "{report:?}");
    assert_eq!(report.found, found.last().copied());
    for (found, truth_kg) in found.iter().zip([0.0, PICKED_KG, 0.0]) {
        let error_kg = f64::from(found.mass_kg) - truth_kg;
        assert!(error_kg.abs() < 3.0 * f64::from(found.standard_error_kg), "{truth_kg} kg: {found:?}");
        assert!(found.standard_error_kg < 0.06, "{found:?}");
    }
    let at_s = |news: fn(&LoadNews) -> bool| -> Vec<f64> {
        told.iter().filter(|told| news(&told.news)).map(|told| told.at_s).collect()
    };
    let searching_s = at_s(|news| matches!(news, LoadNews::Searching));
    let found_s = at_s(|news| matches!(news, LoadNews::Found(_)));
    for (searching_s, found_s) in searching_s.iter().zip(&found_s) {
        println!("identified {:.3} s after the last row", found_s - searching_s);
        assert!(found_s - searching_s <= IDENTIFIED_WITHIN_S);
    }
    // Told at the first row.
    let start_s = told[0].at_s;
    for (changed_s, row) in at_s(|news| matches!(news, LoadNews::Changed { .. })).iter().zip([PICKED_AT, DROPPED_AT]) {
        let after_s = changed_s - start_s - f64::from(row) * robot().record_period_s;
        println!("noticed {after_s:.3} s after row {row}");
        assert!((0.0..NOTICED_WITHIN_S).contains(&after_s));
    }
    let largest = largest_errors_counts(&movement);
    println!("largest errors {largest:?} counts");
    assert!(largest.into_iter().all(|error| error <= 10));
    assert_eq!(timing.missed_deadlines, 0);
    if let Some(time) = ControlTime::while_powered(&observations) {
        println!("{time}");
        assert!(time.longest().duration_us() <= COMPUTED_TORQUE_LIMIT_US, "{time}");
    }
}

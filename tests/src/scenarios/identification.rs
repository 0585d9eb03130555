//! The whole chain over the wire: record, identify, upload, track.

use std::path::PathBuf;

use armid::capture::{self, Circumstances};
use armid::client::{Client, Movement};
use armid::compensation::board_model;
use armid::identified_model;
use armid::identify::{Options, identify};
use armid::recording::{Mode, Recording};
use shared::protocol::ControlLaw;

use super::{
    BoardUnderTest, Setup, check_whole, hidden, largest_errors_counts, paper_movement, plan, ready, robot,
    run_undisturbed, within_one_count_percent,
};

/// Periods of the movements to identify from, in s: one alone leaves a combination of f7, f8 and f9 nearly free.
const TRAINING_PERIODS_S: [f64; 2] = [3.65, 5.0];

/// Runs the paper's movement of a period under the position loop.
pub fn record(client: &mut Client, period_s: f64) -> Movement {
    client.load_trajectory(&paper_movement(period_s)).expect("an accepted movement");
    let movement = run_undisturbed(client);
    check_whole(&movement);
    movement
}

fn recording(client: &Client, movement: &Movement) -> Recording {
    let robot = robot();
    let circumstances = Circumstances {
        robot: &robot,
        mode: Mode::P,
        trajectory: "paper".into(),
        board: client.info().clone(),
        seed: None,
    };
    capture::recording(movement, &circumstances, PathBuf::from("wire.csv"))
}

/// Two movements under the position loop, what is identified from them, and a movement under computed torque with that:
/// every sample within one count.
pub fn identified_over_the_wire_the_arm_is_tracked_to_the_count<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    let training: Vec<Movement> = TRAINING_PERIODS_S.iter().map(|&period_s| record(&mut client, period_s)).collect();
    let recordings: Vec<Recording> = training.iter().map(|movement| recording(&client, movement)).collect();
    let options = Options { seed: 1, ..Options::default() };
    let found = identify(&robot(), &recordings, &[], &options, &|_| {}).expect("an identification");
    println!("closed-loop rms {:.3?} counts", found.rms_counts);
    let model = identified_model::from_identification(&robot(), &found, toml::Table::new());
    for (index, (found, truth)) in model.f.iter().zip(hidden().f).enumerate() {
        println!("f{}: found {found:.5}, true {truth:.5}", index + 1);
    }
    client.upload(&board_model(&robot(), &model).expect("a model for the board")).expect("an accepted model");
    client.load_trajectory(&paper_movement(TRAINING_PERIODS_S[0])).expect("an accepted movement");
    let tracked = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
    check_whole(&tracked);
    let within_percent = within_one_count_percent(&tracked);
    println!(
        "position loop: largest {:?} counts; computed torque: largest {:?} counts, {within_percent:.3} % within one",
        largest_errors_counts(&training[0]),
        largest_errors_counts(&tracked),
    );
    assert_eq!(within_percent, 100.0);
    board.finish();
}

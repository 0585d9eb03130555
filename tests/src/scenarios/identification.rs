//! The whole chain over the wire: record, identify, upload, track.

use std::path::PathBuf;

use armid::capture::{self, Circumstances};
use armid::client::{Client, Movement};
use armid::compensation::board_model;
use armid::excite;
use armid::identified_model;
use armid::identify::{Options, identify};
use armid::model::Model;
use armid::random::Random;
use armid::recording::{Mode, Recording};
use shared::protocol::ControlLaw;
use shared::trajectory::Trajectory;

use super::{
    BoardUnderTest, Setup, check_whole, hidden, largest_errors_counts, paper_movement, plan, ready, robot,
    run_undisturbed, within_one_count_percent,
};

/// Periods of the movements to identify from, in s: one alone leaves a combination of f7, f8 and f9 nearly free.
const TRAINING_PERIODS_S: [f64; 2] = [3.65, 5.0];

/// Arms that are tracked along movements never used for identification, by seed: drawn within ±10 % of the reference robot.
const ARMS: [u64; 3] = [1, 2, 3];

/// How many such movements, how long the first lasts and how much longer each next one, in s.
const DESIGNED: u64 = 10;
const SHORTEST_S: f64 = 3.0;
const LONGER_S: f64 = 0.2;

/// How far every f of the wrong models is off, at most.
const WRONG_F_SHARE: f64 = 0.05;

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

/// Two movements under the position loop, and what is identified from them.
fn identified(client: &mut Client) -> (Vec<Movement>, Model) {
    let training: Vec<Movement> = TRAINING_PERIODS_S.iter().map(|&period_s| record(client, period_s)).collect();
    let recordings: Vec<Recording> = training.iter().map(|movement| recording(client, movement)).collect();
    let options = Options { seed: 1, ..Options::default() };
    let found = identify(&robot(), &recordings, &[], &options, &|_| {}).expect("an identification");
    println!("closed-loop rms {:.3?} counts", found.rms_counts);
    (training, identified_model::from_identification(&robot(), &found, toml::Table::new()))
}

/// Two movements under the position loop, what is identified from them, and a movement under computed torque with that:
/// every sample within one count.
pub fn identified_over_the_wire_the_arm_is_tracked_to_the_count<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    let board = switch_on(Setup::default());
    let mut client = ready(&board);
    let (training, model) = identified(&mut client);
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

/// Arms across ±10 % of the reference robot, each identified from two movements: the paper's movement is tracked within one
/// count throughout, ten designed movements for 99 % of their samples, and with every f off by up to 5 % for 95 %.
pub fn movements_never_used_for_identification_are_tracked_to_the_count_on_every_arm<B: BoardUnderTest>(
    switch_on: impl Fn(Setup) -> B,
) {
    let designed: Vec<Trajectory> = (0..DESIGNED)
        .map(|index| {
            let duration_s = SHORTEST_S + LONGER_S * index as f64;
            let settings =
                excite::Settings { generations: 1, seed: index, ..excite::Settings::of_duration(duration_s) };
            excite::design(&robot(), None, &settings, &|_, _| ()).expect("a movement").trajectory
        })
        .collect();
    for arm in ARMS {
        let board = switch_on(Setup { arm: Some(arm), ..Setup::default() });
        let mut client = ready(&board);
        let (_, model) = identified(&mut client);
        let mut random = Random::new(arm, 20);
        let wrong = model.f.map(|f| f * (1.0 + random.between(-WRONG_F_SHARE, WRONG_F_SHARE)));
        let wrong = Model { f: wrong, ..model.clone() };
        let mut tracked = |model: &Model, movements: &[Trajectory]| -> Vec<f64> {
            client.upload(&board_model(&robot(), model).expect("a model for the board")).expect("an accepted model");
            let mut run = |movement: &Trajectory| {
                client.load_trajectory(movement).expect("an accepted movement");
                let movement = client.run(&plan(ControlLaw::ComputedTorque), &mut |_| {}).expect("a movement");
                check_whole(&movement);
                within_one_count_percent(&movement)
            };
            movements.iter().map(&mut run).collect()
        };
        let paper = tracked(&model, &[paper_movement(TRAINING_PERIODS_S[0])]);
        let others = tracked(&model, &designed);
        // Three are enough to see it; on an emulated chip movements take their time.
        let wrong = tracked(&wrong, &designed[..3]);
        println!("arm {arm}: {paper:.2?} % of the paper's, {others:.2?} % of the designed, {wrong:.2?} % with f off");
        assert_eq!(paper, [100.0]);
        assert!(others.iter().all(|&percent| percent >= 99.0));
        assert!(wrong.iter().all(|&percent| percent >= 95.0));
        board.finish();
    }
}

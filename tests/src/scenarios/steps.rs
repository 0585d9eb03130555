//! What most scenarios begin with, and what most of them check.

use std::time::Duration;

use armid::board_setup::configuration;
use armid::client::{Client, Movement, MovementPlan, Pose};
use armid::compensation::board_model;
use armid::robot::Robot;
use shared::protocol::{ControlLaw, Model};
use shared::trajectory::{Points, Trajectory};

use super::{BoardUnderTest, hidden, robot};

const SETTLE_NS: u64 = 200_000_000;

/// A board has started by then.
const STARTED_AFTER: Duration = Duration::from_millis(50);

/// A client that has greeted the board, once it has started. Always the same sequence numbers, or the same run would
/// not send the same bytes.
pub fn greeted(board: &impl BoardUnderTest) -> Client {
    // What is sent before the board has opened its serial port is lost.
    board.run(STARTED_AFTER.saturating_sub(board.now()));
    Client::connect_from(board.link(), 1).expect("a board that answers")
}

/// A client of a board that has its robot constants and knows its pose.
pub fn ready(board: &impl BoardUnderTest) -> Client {
    let mut client = greeted(board);
    prepared(&mut client, &robot());
    client
}

/// Gives a board its robot constants and its pose.
pub fn prepared(client: &mut Client, robot: &Robot) {
    client
        .prepare(&configuration(robot).expect("a safe robot"), Pose::DefaultsTo([0.0; 2]), false)
        .expect("a board that accepts its robot");
}

/// The same with a small, quick movement loaded.
pub fn loaded(board: &impl BoardUnderTest) -> Client {
    let mut client = ready(board);
    client.load_trajectory(&nod()).expect("an accepted movement");
    client
}

/// How movements are run.
pub fn plan(law: ControlLaw) -> MovementPlan {
    MovementPlan { law, settle_ns: SETTLE_NS }
}

/// Runs what is loaded under the position loop, with nothing on the way.
pub fn run_undisturbed(client: &mut Client) -> Movement {
    client.run(&plan(ControlLaw::Position), &mut |_| {}).expect("a movement")
}

/// The paper's movement of period `period_s`.
pub fn paper_movement(period_s: f64) -> Trajectory {
    armid::trajectory_file::paper(period_s).expect("the paper's movement")
}

/// A small, quick movement.
pub fn nod() -> Trajectory {
    let points = [[0.0, 0.0], [-0.1, 0.15], [-0.15, 0.1], [0.0, 0.0]];
    Trajectory::Points(Points::new(300_000_000, &points).expect("a movement through points"))
}

/// The hidden robot as a model for the board.
pub fn true_model() -> Model {
    true_model_for(&robot())
}

/// The same for a board with the constants of `robot`.
pub fn true_model_for(robot: &Robot) -> Model {
    board_model(robot, &hidden().to_model(toml::Table::new())).expect("a model for the board")
}

/// Largest absolute errors of both joints, in counts.
pub fn largest_errors_counts(movement: &Movement) -> [i16; 2] {
    [0, 1].map(|joint: usize| movement.samples.iter().map(|sample| sample.error_counts[joint].abs()).max().unwrap_or(0))
}

/// Rms of the errors of both joints, in counts.
pub fn rms_errors_counts(movement: &Movement) -> [f64; 2] {
    [0, 1].map(|joint: usize| {
        let squares = movement.samples.iter().map(|sample| f64::from(sample.error_counts[joint]).powi(2));
        (squares.sum::<f64>() / movement.samples.len() as f64).sqrt()
    })
}

/// Share of rows with both errors within one count, in percent.
pub fn within_one_count_percent(movement: &Movement) -> f64 {
    let within =
        movement.samples.iter().filter(|sample| sample.error_counts.iter().all(|error| error.abs() <= 1)).count();
    100.0 * within as f64 / movement.samples.len() as f64
}

/// Every row is there, and as it stands in the board's memory.
pub fn check_complete(movement: &Movement) {
    assert_eq!(movement.partial, None);
    assert_eq!(movement.samples.len() as u32, movement.planned_rows);
    assert!((0..).zip(&movement.samples).all(|(index, sample)| sample.index == index));
    assert_eq!(movement.streamed_rows + movement.reread_rows, movement.planned_rows);
    assert_eq!(movement.differing_rows, 0);
}

/// And every row came with the stream.
pub fn check_whole(movement: &Movement) {
    check_complete(movement);
    assert_eq!(movement.streamed_rows, movement.planned_rows, "every row came with the stream");
}

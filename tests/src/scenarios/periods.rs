//! Every loop period the board can be asked for.

use std::time::Duration;

use armid::client::MovementPlan;
use armid::robot::Robot;
use shared::protocol::{ControlLaw, LOOP_PERIODS_NS};

use super::{BoardUnderTest, Setup, check_whole, greeted, largest_errors_counts, nod, prepared, robot, true_model_for};
use crate::emulated_board::control_time::{COMPUTED_TORQUE_LIMIT_US, ControlTime, POSITION_LIMIT_US};

/// Rows of the short movement: 0.9 s, one every 0.7 ms.
const NOD_ROWS: u32 = 1285;

/// The paper's robot with another loop period.
pub fn robot_with_period(loop_period_ns: u32) -> Robot {
    Robot { loop_period_s: f64::from(loop_period_ns) * 1e-9, ..robot() }
}

/// Runs a movement under `law` at every loop period. Each is recorded whole with a row every 0.7 ms, control ticks come a
/// period apart, exactly, and none is longer than `limit_us`.
fn run_at_every_period<B: BoardUnderTest>(switch_on: &impl Fn(Setup) -> B, law: ControlLaw, limit_us: f64) {
    for loop_period_ns in LOOP_PERIODS_NS {
        let robot = robot_with_period(loop_period_ns);
        let board = switch_on(Setup { robot: robot.clone(), ..Setup::default() });
        let mut client = greeted(&board);
        prepared(&mut client, &robot);
        client.upload(&true_model_for(&robot)).expect("an accepted model");
        client.load_trajectory(&nod()).expect("an accepted movement");
        board.run(Duration::from_millis(20));
        let from_ns = board.now().as_nanos() as u64;
        let movement = client.run(&MovementPlan { law, settle_ns: 50_000_000 }, &mut |_| {}).expect("a movement");
        let to_ns = board.now().as_nanos() as u64;
        let timing = client.hello().expect("an answer").timing;
        let observations = board.finish();

        let time = ControlTime::while_powered(&observations).expect("switched on and off again");
        let largest = largest_errors_counts(&movement);
        println!("{:3} µs {law:?}: {time}; largest errors {largest:?} counts", loop_period_ns / 1000);
        check_whole(&movement);
        assert_eq!(movement.planned_rows, NOD_ROWS);
        assert_eq!(timing.missed_deadlines, 0);
        assert!(time.longest().duration_us() <= limit_us, "{time}");
        let ticks: Vec<_> =
            observations.ticks.iter().filter(|tick| (from_ns..to_ns).contains(&tick.start_ns)).collect();
        let expected = (to_ns - from_ns) / u64::from(loop_period_ns);
        assert!((ticks.len() as u64).abs_diff(expected) <= 1, "{} ticks, not {expected}", ticks.len());
        for pair in ticks.windows(2) {
            let apart_ns = pair[1].overflow_ns() - pair[0].overflow_ns();
            let off_ns = apart_ns - f64::from(loop_period_ns);
            assert!(off_ns.abs() < 30.0, "{apart_ns} ns apart at {} ns", pair[0].start_ns);
        }
    }
}

/// See `run_at_every_period`.
pub fn the_position_loop_runs_in_time_at_every_period<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    run_at_every_period(&switch_on, ControlLaw::Position, POSITION_LIMIT_US);
}

/// See `run_at_every_period`.
pub fn computed_torque_runs_in_time_at_every_period<B: BoardUnderTest>(switch_on: impl Fn(Setup) -> B) {
    run_at_every_period(&switch_on, ControlLaw::ComputedTorque, COMPUTED_TORQUE_LIMIT_US);
}

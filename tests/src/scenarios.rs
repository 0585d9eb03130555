//! What happens to a board, and what has to come of it, whichever board it is.
//!
//! Every scenario is a function of a way to switch a board on. [`test_every_scenario`](crate::test_every_scenario)
//! makes a test of each, so that what is added here runs on the simulated board of the host tool and on the real image
//! alike.

mod emulated;
mod encoders;
mod frames;
mod line;
mod movements;
mod native;
mod start;
mod steps;

use std::time::Duration;

use armid::link::Link;
use shared::protocol::Link as BoardLink;

use crate::emulated_board::Turn;
use crate::emulated_board::observations::Observations;
use crate::line::Trouble;

pub use emulated::{hidden, robot, switched_on};
pub use encoders::*;
pub use frames::*;
pub use line::*;
pub use movements::*;
pub use native::NativeBoard;
pub use start::*;
pub use steps::*;

/// A board with a hidden robot at its terminals, resting at zero angles, and everything that can happen to it from
/// outside. All time is virtual and passes only while somebody waits for the board.
pub trait BoardUnderTest {
    /// The link the host has to it.
    const LINK: BoardLink;

    /// A new connection to it.
    fn link(&self) -> Box<dyn Link>;

    /// Its time.
    fn now(&self) -> Duration;

    /// Lets it run with nobody at the line.
    fn run(&self, duration: Duration);

    /// Presses or releases the emergency stop.
    fn set_emergency_stop(&self, pressed: bool);

    /// Puts the line in trouble for so long from now on, in both directions.
    fn disturb_line(&self, trouble: Trouble, duration: Duration);

    /// Turns a motor by hand as time goes on, with the arm uncoupled.
    fn turn_by_hand(&self, turn: Turn);

    /// Sets both hardware counters. Only before anything has moved.
    fn set_counters(&self, counts: [u32; 2]);

    /// Switches it off, checks what must hold for every run, and says what was watched.
    fn finish(self) -> Observations;
}

/// Makes a test of every scenario, all with the boards that `$switch_on` gives. It is called once for each test and
/// returns a function that switches a board on, or nothing where there is none to be had.
#[macro_export]
macro_rules! test_every_scenario {
    ($switch_on:path) => {
        $crate::test_scenarios! { $switch_on:
            the_board_starts_with_everything_off
            nothing_moves_before_the_board_is_armed
            a_movement_is_recorded_whole
            two_runs_are_the_same_to_the_bit
            computed_torque_with_the_true_model_stays_within_one_count
            the_emergency_stop_switches_off_in_the_next_tick
            a_cut_line_loses_no_row_and_leaves_control_alone
            a_noisy_line_loses_no_row_and_leaves_control_alone
            a_line_that_stays_cut_ends_the_movement
            damaged_frames_change_nothing_and_are_counted
            old_frames_are_not_carried_out_again
            frames_of_another_version_are_answered_and_do_nothing
            counters_may_wrap_during_a_movement
            every_edge_counts_up_to_ten_times_the_fastest_movement
            a_motor_that_trembles_about_an_edge_loses_no_count
        }
    };
}

/// Makes a test of each scenario named.
#[macro_export]
macro_rules! test_scenarios {
    ($switch_on:path: $($scenario:ident)*) => {
        $(
            #[test]
            fn $scenario() {
                if let Some(switch_on) = $switch_on() {
                    $crate::scenarios::$scenario(switch_on);
                }
            }
        )*
    };
}

//! What happens to a board, and what has to come of it, whichever board it is.
//!
//! Every scenario is a function of a way to switch a board on. [`test_every_scenario`](crate::test_every_scenario)
//! makes a test of each, so that what is added here runs on the simulated board of the host tool and on the real image
//! alike.

mod emulated;
mod encoders;
mod faults;
mod frames;
mod identification;
mod line;
mod load;
mod movements;
mod native;
mod periods;
mod soak;
mod start;
mod steps;
mod storage;

use std::time::Duration;

use armid::hidden_robot::HiddenRobot;
use armid::link::{Link, MemoryFlash};
use armid::model::Effect;
use armid::robot::Robot;
use shared::arm::Load;
use shared::protocol::Link as BoardLink;

use crate::emulated_board::observations::Observations;
use crate::emulated_board::{PowerCut, Turn};
use crate::line::Trouble;

pub use emulated::{hidden, robot, switched_on};
pub use encoders::*;
pub use faults::*;
pub use frames::*;
pub use identification::*;
pub use line::*;
pub use load::*;
pub use movements::*;
pub use native::NativeBoard;
pub use periods::*;
pub use soak::*;
pub use start::*;
pub use steps::*;
pub use storage::*;

/// What a board is switched on with.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The drives, and the loop period the arm is simulated for.
    pub robot: Robot,
    /// Seed of the arm behind the drives, drawn within ±10 % of the one to expect; without it, it is [`hidden`].
    pub arm: Option<u64>,
    /// What that robot has beyond its parameters.
    pub effects: Vec<Effect>,
    /// What its memory for parameters holds. Not to be used for a second board: the first may have written to it.
    pub flash: MemoryFlash,
}

impl Default for Setup {
    /// The paper's robot and no parameters.
    fn default() -> Self {
        Self { robot: robot(), arm: None, effects: Vec::new(), flash: MemoryFlash::default() }
    }
}

impl Setup {
    /// The robot behind the drives.
    pub fn hidden(&self) -> HiddenRobot {
        let arm = self.arm.map_or_else(hidden, |seed| HiddenRobot::draw(&self.robot, seed));
        arm.with_effects(&self.effects, &self.robot).expect("effects that can be")
    }
}

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

    /// The program at the other end of the line stops reading for so long from now on, while the board goes on sending.
    fn stall_reader(&self, duration: Duration);

    /// Makes a control tick come too late, soon.
    fn delay_a_tick(&self);

    /// Cuts the power for a millisecond, now or in the middle of a store.
    fn cut_power(&self, when: PowerCut);

    /// Turns a motor by hand as time goes on, with the arm uncoupled.
    fn turn_by_hand(&self, turn: Turn);

    /// The arm carries `load` from now on, whatever it carried before.
    fn carry(&self, load: &Load<f64>);

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
            a_model_committed_in_a_movement_takes_over_smoothly
            effects_that_the_model_knows_are_compensated
            the_emergency_stop_switches_off_in_the_next_tick
            a_cut_line_loses_no_row_and_leaves_control_alone
            a_noisy_line_loses_no_row_and_leaves_control_alone
            a_line_that_stays_cut_ends_the_movement
            a_very_noisy_line_only_slows_down_the_reading
            a_reader_that_stalls_loses_no_row_and_leaves_control_alone
            a_late_tick_is_a_fault_of_that_name
            parameters_survive_a_power_cycle_and_a_blank_memory_is_prepared_for_them
            power_cut_during_a_store_leaves_the_old_or_the_new_model
            power_cut_during_a_sector_change_leaves_the_old_or_the_new_model
            storing_and_moving_exclude_each_other
            stored_parameters_that_cannot_be_used_are_named_and_left_alone
            the_position_loop_runs_in_time_at_every_period
            computed_torque_runs_in_time_at_every_period
            identified_over_the_wire_the_arm_is_tracked_to_the_count
            movements_never_used_for_identification_are_tracked_to_the_count_on_every_arm
            damaged_frames_change_nothing_and_are_counted
            old_frames_are_not_carried_out_again
            frames_of_another_version_are_answered_and_do_nothing
            a_load_is_identified_on_the_board_when_it_is_picked_and_dropped
            a_load_and_its_centre_are_found_by_the_difference_from_the_empty_arm
            movements_follow_each_other_whatever_the_line_does
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

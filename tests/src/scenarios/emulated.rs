//! The real image as a board under test.

use std::time::Duration;

use armid::hidden_robot::HiddenRobot;
use armid::link::Link;
use armid::robot::Robot;
use rigless::mcu::Operate as _;
use rigless::soc::Width;
use shared::arm::Load;
use shared::protocol::Link as BoardLink;

use super::{BoardUnderTest, Setup};
use crate::emulated_board::observations::Observations;
use crate::emulated_board::{EmulatedBoard, FIRMWARE_VARIABLE, PowerCut, Turn, firmware_from_environment};
use crate::line::Trouble;

/// Seed of the robot at every board under test.
const SEED: u64 = 5;

/// Count registers of TIM2 and TIM5, joint 2 and joint 3.
const COUNTERS: [u64; 2] = [0x4000_0024, 0x4000_0C24];

/// Auto-reload register of TIM1: steps of the control interrupt's period, less one.
const TIM1_RELOAD: u64 = 0x4001_002C;

/// Its value for a loop period of 0.7 ms.
const USUAL_STEPS: u64 = 58_800 - 1;

/// A loop period that no run of the control interrupt fits in: 5 µs.
const TOO_SHORT_STEPS: u64 = 420;

/// The robot the boards under test are told of.
pub fn robot() -> Robot {
    Robot::paper()
}

/// The robot they really have.
pub fn hidden() -> HiddenRobot {
    HiddenRobot::draw(&robot(), SEED)
}

/// Switches on boards with the image that the environment names; nothing, and a word about it, where it names none.
pub fn switched_on() -> Option<impl Fn(Setup) -> EmulatedBoard> {
    let firmware = firmware_from_environment();
    if firmware.is_none() {
        println!("SKIPPED: {FIRMWARE_VARIABLE} names no image; run `tests/run emulated`, which builds one");
    }
    let firmware = firmware?;
    Some(move |setup: Setup| {
        EmulatedBoard::start_with(&firmware, &setup.robot, &setup.hidden(), &setup.flash).expect("an image that runs")
    })
}

impl BoardUnderTest for EmulatedBoard {
    const LINK: BoardLink = BoardLink::Serial;

    fn link(&self) -> Box<dyn Link> {
        Box::new(EmulatedBoard::link(self))
    }

    fn now(&self) -> Duration {
        EmulatedBoard::now(self)
    }

    fn run(&self, duration: Duration) {
        EmulatedBoard::run(self, duration);
    }

    fn set_emergency_stop(&self, pressed: bool) {
        EmulatedBoard::set_emergency_stop(self, pressed);
    }

    fn disturb_line(&self, trouble: Trouble, duration: Duration) {
        EmulatedBoard::disturb_line(self, trouble, duration);
    }

    fn stall_reader(&self, duration: Duration) {
        EmulatedBoard::stall_serial_for(self, duration);
    }

    /// The control timer runs so fast for a while that a run of its interrupt lasts longer than a period.
    fn delay_a_tick(&self) {
        let reload = |steps: u64| {
            self.intervene(move |session, _, at| {
                let chip = session.board_mut().chip_mut();
                chip.write(at, TIM1_RELOAD, Width::W32, steps).expect("a register");
            });
        };
        reload(TOO_SHORT_STEPS);
        // It counts from the next overflow on.
        EmulatedBoard::run(self, Duration::from_micros(750));
        reload(USUAL_STEPS);
    }

    fn cut_power(&self, when: PowerCut) {
        EmulatedBoard::cut_power(self, when);
    }

    fn turn_by_hand(&self, turn: Turn) {
        EmulatedBoard::turn_by_hand(self, turn);
    }

    fn carry(&self, load: &Load<f64>) {
        EmulatedBoard::carry(self, load.delta_f(robot().upper_arm_m));
    }

    fn set_counters(&self, counts: [u32; 2]) {
        self.intervene(move |session, _, at| {
            for (register, count) in COUNTERS.into_iter().zip(counts) {
                let chip = session.board_mut().chip_mut();
                chip.write(at, register, Width::W32, count.into()).expect("a counter that can be written");
            }
        });
    }

    fn finish(self) -> Observations {
        let observations = EmulatedBoard::finish(self).expect("a run without error");
        observations.check_always();
        observations
    }
}

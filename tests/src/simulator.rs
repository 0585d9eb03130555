//! The two-link PUMA arm under a sampled position loop: the sealed judge of the identification.
//!
//! | module | its one job |
//! |---|---|
//! | [`base_parameters`] | the equations of motion in `f1..f9` |
//! | [`newton_euler`] | the same motion from masses, centres and inertias, by a recursion over the links |
//! | [`dynamics`] | either of the two behind one face |
//! | [`friction`] | which joints stick and which slide |
//! | [`plant`] | motion through time: Runge–Kutta between located reversals |
//! | [`robot`] | the whole machine, and random ones |
//! | [`reference`](mod@reference), [`fourier`] | where the arm is told to go |
//! | [`noise`] | seeded disturbances of current and torque |
//! | [`sampled_loop`] | encoder, control law, command delay, recording |
//! | [`recording`], [`files`] | results in memory and on disk |
//!
//! The methods differ from those of `shared` on purpose. There: implicit midpoint and friction by clipping. Here:
//! fourth-order Runge–Kutta with fixed short steps, friction by trying the modes "sticks", "slides up", "slides
//! down" for consistency, and the instant of every reversal located inside its step.
//!
//! ```
//! use armid_tests::simulator::{Reference, Robot, RunSettings, record};
//!
//! let robot = Robot::draw(7);
//! let recording = record(&robot, &Reference::Paper { period_s: 3.65 }, &RunSettings::default());
//! assert_eq!(recording.tick.len(), 5214);
//! ```

pub mod base_parameters;
pub mod dynamics;
pub mod files;
pub mod fourier;
pub mod friction;
pub mod newton_euler;
pub mod noise;
pub mod plant;
pub mod recording;
pub mod reference;
pub mod robot;
pub mod sampled_loop;

#[cfg(test)]
mod checks;

pub use base_parameters::BaseParameters;
pub use dynamics::{Arm, EquationsOfMotion};
pub use files::{Truth, read_truth, robot_toml, write_robot_toml, write_truth};
pub use fourier::FourierSeries;
pub use newton_euler::LinkMasses;
pub use noise::TorqueNoise;
pub use plant::{Plant, State};
pub use recording::Recording;
pub use reference::Reference;
pub use robot::{Drive, Robot};
pub use sampled_loop::{RunSettings, record};

//! What judges the rest of the project from outside.
//!
//! ```text
//! simulator ── hidden_effects         a second arm, and machines with something wrong: recordings for the host library
//! emulated_board ─┬─ line             the firmware's image in an emulated chip, with links that can be cut and disturbed
//!                 └─ board_server     the same at its real pace, on a TCP port
//! scenarios                           what happens to a board, that one or the host's simulated one
//! ```
//!
//! [`simulator`] is a second robot arm, written from the mechanics alone. It uses nothing of the crate `shared`: if both
//! had the same mistake, an identification could look perfect and still be wrong.
//!
//! [`hidden_effects`] builds on it: machines with something wrong in them, for judging `explain`.
//!
//! [`emulated_board`] runs the real firmware image on an emulated microcontroller.
//!
//! [`scenarios`] are what happens to a board, whichever board: that one, or the simulated board of the host tool.

#![forbid(unsafe_code)]

pub mod board_server;
pub mod emulated_board;
pub mod hidden_effects;
pub mod line;
pub mod scenarios;
pub mod simulator;

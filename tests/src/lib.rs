//! What judges the rest of the project from outside.
//!
//! [`simulator`] is a second robot arm, written from the mechanics alone. It shares no code with the crate `shared`:
//! if both had the same mistake, an identification could look perfect and still be wrong.

#![forbid(unsafe_code)]

pub mod simulator;

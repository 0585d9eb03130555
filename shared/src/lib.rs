//! What is true of the arm, whoever computes it: the same code runs on the board, in the simulated board and in the
//! host's identification.
//!
//! ```text
//! scalar ── arm ── drive ── plant ── replay       the arm, and a model arm repeating a recording
//!    │                  effects ──┘              what a real arm has beyond the plain one
//!    └──── trajectory ── control ── board         references, control laws, the whole board as a state machine
//!                protocol ──┘                     what travels between board and host
//!                storage  ──┘                     what the board keeps over a restart
//! genetic ── load                                 the genetic algorithm, and what it finds while the arm moves
//! ```
//!
//! Nothing here allocates, panics on data, or touches hardware.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

// Its tests share samples with those in `tests`, which know it by its name.
#[cfg(test)]
extern crate self as shared;

pub mod arm;
pub mod board;
pub mod control;
pub mod drive;
pub mod dual;
pub mod effects;
pub mod genetic;
pub mod load;
pub mod machine;
pub mod plant;
pub mod protocol;
pub mod replay;
pub mod scalar;
pub mod storage;
pub mod trajectory;

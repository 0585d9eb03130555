//! Recordings with something hidden in them, for judging `explain`.
//!
//! A second simulator beside [`simulator`](crate::simulator), on the same mechanics but with everything that may be
//! wrong with a machine. It uses nothing of the crate `shared`: steps of 20 µs by Runge–Kutta, motors apart from their
//! links where a joint is elastic, friction with located reversals.
//!
//! | module | its one job |
//! |---|---|
//! | [`machine`] | the machine and its faults |
//! | [`motion`] | the machine through time |
//! | [`run`] | encoder, loop, converter, recording |
//! | [`library`] | the library's effects: what "clear" means, what is drawn |
//! | [`outside`] | faults that the library does not contain |
//! | [`plan`] | which cases a benchmark has |
//! | [`case`](mod@case) | one case: drawn, recorded, written |
//! | [`draw`] | random draws |

pub mod case;
pub mod draw;
pub mod library;
pub mod machine;
pub mod motion;
pub mod outside;
pub mod plan;
pub mod run;

#[cfg(test)]
mod checks;

//! Scores `explain` on recordings with hidden effects.
//!
//! A benchmark is a folder of cases, each a folder with `robot.toml`, in most cases `model.toml`, `fit-*.csv`,
//! `check-*.csv` and the sealed `truth.toml`, which is read after the verdict only. The cases come from a generator
//! that is no part of this tool, so that both cannot share a mistake.
//!
//! ```text
//! cases ── answers (explain, or a rival) ── score ── report
//! ```
//!
//! Rivals in the same table: [`screen`], the best single regression, and [`sindy`], sparse regression of the
//! discrepancy; both on the torque that the model leaves over ([`residual`]), both small and done as documented.

pub mod answer;
pub mod case;
pub mod interval;
pub mod report;
pub mod residual;
pub mod score;
pub mod screen;
pub mod sindy;

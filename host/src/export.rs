//! Recordings and models in other programs' formats.
//!
//! ```text
//! series     a recording in SI units, as named columns ── table   CSV for pandas and spreadsheets
//!                                                      ── mcap    MCAP for Foxglove and PlotJuggler
//! bodies     masses, centres and inertias that give f  ── urdf    URDF for simulators
//! json       a model with its units
//! ```

pub mod bodies;
mod json;
mod mcap;
mod series;
mod table;
mod urdf;

pub use json::model_json;
pub use mcap::{McapError, recording_mcap};
pub use series::{Channel, Column, Series};
pub use table::recording_csv;
pub use urdf::model_urdf;

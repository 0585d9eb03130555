//! Report pages: one HTML file each, with its pictures inside. It opens from disk, fetches nothing, runs no script, and
//! follows the reader's light or dark theme.
//!
//! ```text
//! recordings ─┐                                             ┌─→ page.rs ─→ HTML
//! parameters ─┤                                             │
//! residuals  ─┼─→ sections of text, tables and pictures ────┤
//! search     ─┤      table.rs, picture.rs (drawn by draw.rs)│
//! load       ─┤                                             └─→ text.rs ─→ terminal, without pictures
//! provenance ─┘
//! ```
//!
//! Everything that is not a constant of this program (names of joints, paths, command lines) is text: `maud` and the SVG
//! backend of `plotters` escape it.

mod draw;
mod load;
mod page;
mod parameters;
mod picture;
mod provenance;
mod recordings;
mod residuals;
mod search;
mod table;
mod text;

pub use draw::{PictureError, inline, sheet};
pub use load::{Assumed, assumed_load};
pub use page::{Block, Page, Section};
pub use parameters::{PAPER_F, PAPER_SCATTER_PERCENT, Row, is_paper_robot, of_model, parameters};
pub use picture::{Band, Content, Ink, Interval, Intervals, Line, Map, Picture, staircase, thinned};
pub use provenance::{FileRole, Provenance};
pub use recordings::{currents, made_again, measured, quality, repeated, tracking_pictures};
pub use residuals::residual_maps;
pub use search::{certainty, convergence};
pub use table::{Cell, Table};

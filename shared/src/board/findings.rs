//! What is found out about a request before it reaches the board.

use super::constants::TorqueModel;
use crate::protocol::{Model, ModelError, Request};

/// What follows from a request alone, whatever the board is doing.
///
/// A model is checked in `f64`, which a Cortex-M4 emulates: some ten thousand cycles, more than a control tick may
/// take. So whoever receives a request examines it first ([`Self::of`]), outside the control interrupt, and hands the
/// findings over with it ([`super::Board::handle_examined`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Findings {
    model: Option<ModelFindings>,
}

/// What is found out about a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ModelFindings {
    /// CRC-32 of its numbers.
    pub(super) crc: u32,
    /// Whether it can be an arm at all.
    pub(super) dynamics: Result<(), ModelError>,
    /// It in the board's precision.
    pub(super) torque_model: TorqueModel,
}

impl Findings {
    /// Examines a request.
    pub fn of(request: &Request) -> Self {
        Self {
            model: match request {
                Request::StageModel { model, .. } => Some(ModelFindings::of(model)),
                _ => None,
            },
        }
    }

    /// The findings about a model. `None` where they are those of another request.
    pub(super) fn model(&self) -> Option<&ModelFindings> {
        self.model.as_ref()
    }
}

impl ModelFindings {
    pub(super) fn of(model: &Model) -> Self {
        Self { crc: model.crc(), dynamics: model.check_dynamics(), torque_model: TorqueModel::new(model) }
    }
}

//! What is found out about a request before it reaches the board.

use super::constants::TorqueModel;
use super::trajectory_check::MovementFindings;
use crate::protocol::{Model, ModelError, Request, TrajectoryPart};

/// What follows from a request alone, whatever the board is doing.
///
/// A model is checked in `f64`, which a Cortex-M4 emulates: some ten thousand cycles, more than a control tick may
/// take. So whoever receives a request examines it first ([`Self::of`]), outside the control interrupt, and hands the
/// findings over with it ([`super::Board::answer`]). The same with a movement, whose numbers are looked at one by one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Findings(Found);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Found {
    Nothing,
    Model(ModelFindings),
    Movement(MovementFindings),
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
    /// What is found out about most requests: nothing.
    pub const NONE: Self = Self(Found::Nothing);

    /// Examines a request.
    #[inline]
    pub fn of(request: &Request) -> Self {
        Self(match request {
            Request::StageModel { model, .. } => Found::Model(ModelFindings::of(model)),
            Request::LoadTrajectory(TrajectoryPart::Paper(paper)) => Found::Movement(MovementFindings::of_paper(paper)),
            Request::LoadTrajectory(TrajectoryPart::Fourier(fourier)) => {
                Found::Movement(MovementFindings::of_fourier(fourier))
            }
            _ => Found::Nothing,
        })
    }

    /// The findings about a model. `None` where they are those of another request.
    pub(super) fn model(&self) -> Option<&ModelFindings> {
        match &self.0 {
            Found::Model(findings) => Some(findings),
            _ => None,
        }
    }

    /// The findings about a movement. `None` where they are those of another request.
    pub(super) fn movement(&self) -> Option<&MovementFindings> {
        match &self.0 {
            Found::Movement(findings) => Some(findings),
            _ => None,
        }
    }
}

impl ModelFindings {
    pub(super) fn of(model: &Model) -> Self {
        Self { crc: model.crc(), dynamics: model.check_dynamics(), torque_model: TorqueModel::new(model) }
    }
}

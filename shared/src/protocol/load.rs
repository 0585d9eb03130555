//! What the board tells about the load it carries.

use serde::{Deserialize, Serialize};

use crate::load::LoadEstimate;

/// Answer to [`Request::ReadLoad`](super::Request::ReadLoad). Ticks are loop ticks since the board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LoadReport {
    /// Whether loads are identified.
    pub settings_active: bool,
    /// Mass that computed torque assumes now, kg.
    pub assumed_kg: f32,
    /// The load found and in use; `None` before the first, and again since one that changed.
    pub found: Option<LoadEstimate>,
    /// When the last collection began.
    pub collecting_tick: u64,
    /// When it was complete.
    pub searching_tick: u64,
    /// When what came of it began to enter computed torque.
    pub found_tick: u64,
    /// Loads found.
    pub identifications: u32,
    /// Results that did not pass the gate.
    pub rejections: u32,
    /// Changes noticed.
    pub changes: u32,
}

impl LoadReport {
    /// Of a board that identifies no loads.
    pub const NONE: Self = Self {
        settings_active: false,
        assumed_kg: 0.0,
        found: None,
        collecting_tick: 0,
        searching_tick: 0,
        found_tick: 0,
        identifications: 0,
        rejections: 0,
        changes: 0,
    };
}

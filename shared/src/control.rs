//! Control laws: the position loop the arm is identified under, and computed-torque control.

mod computed_torque;
mod law;
mod position_loop;

pub use computed_torque::{
    ComputedTorque, ComputedTorqueInput, ComputedTorqueOutput, ComputedTorqueSettings, JointReference,
};
pub use law::{Cascade, Law, LawState, PositionLaw, SampledTiming};
pub use position_loop::{GainError, PositionLoop, SampledLoop, StabilityLimit};

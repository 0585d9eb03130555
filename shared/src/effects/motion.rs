//! Everything that changes while an extended plant moves.

use crate::plant::State;

/// State of an extended plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<S> {
    /// Positions and velocities of the motors, as joint angles: what the encoders follow.
    pub motor: State<S>,
    /// What the motors are ahead of the links by, rad of joint angle: the shafts' twist and the gears' play.
    pub twist_rad: [S; 2],
    /// Its rate in rad/s.
    pub twist_rate_rad_s: [S; 2],
    /// Torque that each gear transmits to its link, N m at the joint.
    pub gear_torque_nm: [S; 2],
    /// Friction's torque at each joint, N m: where the search for the next one begins.
    pub friction_torque_nm: [S; 2],
    /// Current that flows, A: what a sensor measures at this instant.
    pub current_a: [S; 2],
    /// Time since the start of the recording, s.
    pub time_s: S,
}

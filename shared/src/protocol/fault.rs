//! Why the board switched the amplifiers off.

use super::Joint;
use serde::{Deserialize, Serialize};

/// A reason to switch off. Every fault puts both commands at mid-scale and takes the amplifier-enable away in the tick
/// that sees it; on a PUMA the brakes then engage, because they are released by power.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum Fault {
    /// The emergency stop was pressed while the amplifiers were on.
    #[error("emergency-stop: the emergency stop is pressed; {}", self.remedy())]
    EmergencyStop,
    /// A joint strayed too far from its reference.
    #[error("following-error: {joint} is {error_counts} counts from its reference, limit {limit_counts}; {}", self.remedy())]
    FollowingError {
        /// Which joint.
        joint: Joint,
        /// Its error in counts.
        error_counts: i32,
        /// `following_error_limit_counts` of the configuration.
        limit_counts: i32,
    },
    /// A measured current was too large.
    #[error("over-current: {joint} draws {current_a:.2} A, limit {limit_a:.2} A; {}", self.remedy())]
    OverCurrent {
        /// Which joint.
        joint: Joint,
        /// The measured current in A.
        current_a: f32,
        /// `over_current_limit_a` of the configuration.
        limit_a: f32,
    },
    /// A command stayed at the amplifier's limit for too long.
    #[error("current-limit: the command of {joint} was at its limit of {limit_a:.2} A for {held_ns} ns; {}", self.remedy())]
    CurrentLimit {
        /// Which joint.
        joint: Joint,
        /// `current_limit_a` of the configuration.
        limit_a: f32,
        /// How long it stayed there, in ns.
        held_ns: u64,
    },
    /// A motor turned too fast.
    #[error("over-speed: {joint} turns at {speed_rad_s:.2} rad/s, limit {limit_rad_s:.2} rad/s; {}", self.remedy())]
    OverSpeed {
        /// Which joint.
        joint: Joint,
        /// Joint speed over the last record period in rad/s.
        speed_rad_s: f32,
        /// `speed_limit_rad_s` of the configuration.
        limit_rad_s: f32,
    },
    /// The host that started the movement fell silent.
    #[error("link-lost: no valid request for {silent_ns} ns during a movement, limit {limit_ns} ns; {}", self.remedy())]
    LinkLost {
        /// Time since the last valid request over the link that started the movement, in ns.
        silent_ns: u64,
        /// `link_timeout_ns` of the configuration.
        limit_ns: u64,
    },
    /// A control tick came too late or was left out.
    #[error("deadline-missed: a control tick was late or left out; {}", self.remedy())]
    DeadlineMissed,
    /// An encoder counted more than a motor can turn in one tick; the pose is unknown from then on.
    #[error("encoder-jump: {joint} jumped by {jump_counts} counts in one tick, plausible are {limit_counts}; {}", self.remedy())]
    EncoderJump {
        /// Which joint.
        joint: Joint,
        /// Change of the counter in one loop tick.
        jump_counts: i32,
        /// Four times what the speed limit allows, plus a margin.
        limit_counts: i32,
    },
    /// Computed torque gave a command that is not a number.
    #[error("bad-model: the model gave no finite command for {joint}; {}", self.remedy())]
    BadModel {
        /// Which joint.
        joint: Joint,
    },
}

impl Fault {
    /// The fault's name: what `info`, logs and reports show.
    pub fn name(&self) -> &'static str {
        match self {
            Self::EmergencyStop => "emergency-stop",
            Self::FollowingError { .. } => "following-error",
            Self::OverCurrent { .. } => "over-current",
            Self::CurrentLimit { .. } => "current-limit",
            Self::OverSpeed { .. } => "over-speed",
            Self::LinkLost { .. } => "link-lost",
            Self::DeadlineMissed => "deadline-missed",
            Self::EncoderJump { .. } => "encoder-jump",
            Self::BadModel { .. } => "bad-model",
        }
    }

    /// What to do about it.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::EmergencyStop => "release it, then clear the fault",
            Self::FollowingError { .. } => {
                "look for an obstacle, a wrong encoder direction or a gain too low; or raise following_error_limit_counts"
            }
            Self::OverCurrent { .. } => "check the motor's wiring and the current scale",
            Self::CurrentLimit { .. } => "look for a blocked joint, or choose a slower trajectory",
            Self::OverSpeed { .. } => "choose a slower trajectory, or check the encoder",
            Self::LinkLost { .. } => "check the cable; while a movement runs, send keep-alives or read the stream",
            Self::DeadlineMissed => "choose a longer loop period, and report the timing shown by info",
            Self::EncoderJump { .. } => "check the encoder's wiring and shielding, then declare the pose again",
            Self::BadModel { .. } => "identify the arm again and upload the new model",
        }
    }
}

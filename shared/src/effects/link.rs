//! Torques on a link that are neither its gear's nor the arm's own.

use super::JointEffects;
use super::wave::Wave;
use crate::scalar::Scalar;

/// What acts on one link from outside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link<S> {
    spring: Wave<S>,
    slack: SlackSpring<S>,
    contact: S,
    contact_start: S,
    contact_end: S,
}

/// A spring that pulls only beyond its slack.
#[derive(Clone, Copy, Debug)]
struct SlackSpring<S> {
    stiffness: S,
    centre: S,
    half_slack: S,
}

impl<S: Scalar> Link<S> {
    pub fn new(effects: &JointEffects<S>) -> Self {
        Self {
            spring: balance_spring(effects),
            slack: SlackSpring {
                stiffness: effects.slack_spring_nm_per_rad,
                centre: effects.slack_centre_rad,
                half_slack: effects.half_slack_rad,
            },
            contact: effects.contact_nm,
            contact_start: effects.contact_start_s,
            contact_end: effects.contact_start_s + effects.contact_duration_s,
        }
    }

    /// The springs' torque at an angle of the joint, N m.
    #[inline(always)]
    pub fn spring_nm(&self, position_rad: S) -> S {
        self.spring.at(position_rad) - self.slack.against_nm(position_rad)
    }

    /// The contact's mean torque over a step, N m.
    #[inline(always)]
    pub fn contact_nm(&self, time_s: S, period_s: S) -> S {
        let shared = (time_s + period_s).minimum(self.contact_end) - time_s.maximum(self.contact_start);
        self.contact / period_s * shared.maximum(shared.constant(0.0))
    }
}

/// The torque in N m of a joint's balance spring over the joint's angle.
pub(super) fn balance_spring<S: Scalar>(effects: &JointEffects<S>) -> Wave<S> {
    Wave { size: effects.spring_nm, order: effects.spring_nm.constant(1.0), phase: -effects.spring_angle_rad }
}

impl<S: Scalar> SlackSpring<S> {
    #[inline(always)]
    fn against_nm(&self, position_rad: S) -> S {
        let off = position_rad - self.centre;
        self.stiffness * (off - off.clamp_abs(self.half_slack))
    }
}

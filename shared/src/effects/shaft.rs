//! The shaft between motor and link: a spring with damping, behind a gap between gear teeth.
//!
//! Both are solved implicitly, so that a rigid shaft is nothing but a compliance of zero. Twist δ = motor − link and
//! shaft torque τ obey, over a step h, `c τ = δ̂ + t δ̇̂` less the gap where the teeth touch, δ̂ and δ̇̂ weighted means of
//! the step's start and end. The end weighs w = ½(1 + κ²/(c² + κ²)), κ = h²/inertia: one half, the midpoint rule that
//! neither damps nor drives, where the mode is slow beside the step (60 Hz at 0.175 ms: w − ½ = 1e-5); and one, which
//! lets no oscillation stand, where the shaft is so stiff that the step cannot see its mode.

use super::JointEffects;
use super::boxed::bounded;
use crate::arm::Inertia;
use crate::scalar::{Mask, Scalar};

/// One joint's shaft, everything at the joint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shaft<S> {
    compliance: S,
    damping_s: S,
    half_gap: S,
}

/// Its constants for one length of step.
#[derive(Clone, Copy, Debug)]
struct ShaftStep<S> {
    /// w.
    weight: S,
    /// 1/w.
    inverse_weight: S,
    /// 1/(w (w h + t)): what a twist weighs beside a difference of velocities.
    per_twist: S,
    /// Give of the spring beside that of the masses, 1/(kg m²).
    give: S,
    /// Half the gap as a difference of velocities.
    half_gap: S,
}

impl<S: Scalar> Shaft<S> {
    pub fn new(effects: &JointEffects<S>) -> Self {
        Self {
            compliance: effects.compliance_rad_per_nm,
            damping_s: effects.shaft_damping_s,
            half_gap: effects.gap_rad * effects.gap_rad.constant(0.5),
        }
    }

    /// The twist at rest under a torque.
    #[inline(always)]
    pub fn twist_rad(&self, torque_nm: S) -> S {
        self.compliance.mul_add(torque_nm, torque_nm.signed(self.half_gap))
    }

    #[inline(always)]
    fn step(&self, inverse_inertia: S, period_s: S) -> ShaftStep<S> {
        let (half, one) = (period_s.constant(0.5), period_s.constant(1.0));
        let stiff = period_s * period_s * inverse_inertia;
        let stiff = stiff * stiff;
        let weight = half.mul_add(stiff / self.compliance.mul_add(self.compliance, stiff), half);
        let travel = weight.mul_add(period_s, self.damping_s);
        let per_twist = one / (weight * travel);
        ShaftStep {
            weight,
            inverse_weight: one / weight,
            per_twist,
            give: self.compliance * per_twist / period_s,
            half_gap: self.half_gap * per_twist,
        }
    }
}

/// What moves on both sides of the shafts, and what acts there during a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct TwoMass<S> {
    /// Inverse inertias of the motors.
    pub inverse_motor: [S; 2],
    /// Inverse inertia matrix of the links.
    pub inverse_link: Inertia<S>,
    pub motor_velocity: [S; 2],
    pub twist: [S; 2],
    pub twist_rate: [S; 2],
    /// Impulses on the motors, dry friction apart.
    pub motor_impulse: [S; 2],
    /// Impulses on the links, the shafts' apart.
    pub link_impulse: [S; 2],
    /// Ends of dry friction's impulses.
    pub friction_low: [S; 2],
    pub friction_high: [S; 2],
    /// Friction's impulses to decide by which teeth touch.
    pub friction_guess: [S; 2],
}

/// What a step leaves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passed<S> {
    pub motor_velocity: [S; 2],
    pub twist: [S; 2],
    pub twist_rate: [S; 2],
    pub shaft_impulse: [S; 2],
    pub friction_impulse: [S; 2],
}

impl<S: Scalar> TwoMass<S> {
    /// One step. Which teeth touch is decided with the friction guessed; all else is exact.
    #[inline(always)]
    pub fn pass(&self, shafts: &[Shaft<S>; 2], period_s: S) -> Passed<S> {
        let steps = [
            shafts[0].step(self.inverse_motor[0], period_s),
            shafts[1].step(self.inverse_motor[1], period_s),
        ];
        let [motor2, motor3] = self.inverse_motor;
        let links = self.inverse_link.times(self.link_impulse);
        // By how much motor and link would part in the step, over the weight of its end.
        let parting = [
            self.parting(0, &steps[0], links[0]),
            self.parting(1, &steps[1], links[1]),
        ];
        let give = Inertia {
            d11: steps[0].give + motor2 + self.inverse_link.d11,
            d12: self.inverse_link.d12,
            d22: steps[1].give + motor3 + self.inverse_link.d22,
        };

        // The teeth take up what part of it the gap does not.
        let stiffness = give.inverse();
        let guessed = [
            motor2.mul_add(self.friction_guess[0], parting[0]),
            motor3.mul_add(self.friction_guess[1], parting[1]),
        ];
        let gap = [steps[0].half_gap, steps[1].half_gap];
        let play = bounded(&stiffness, stiffness.times(guessed), [-gap[0], -gap[1]], gap);
        let taken = [parting[0] + play.impulse[0], parting[1] + play.impulse[1]];
        let stiffness = touching(&give, play.inside);

        // Dry friction meets the motors with what hangs on them.
        let shaft = stiffness.times(taken);
        let free = [
            motor2.mul_add(self.motor_impulse[0] - shaft[0], self.motor_velocity[0]),
            motor3.mul_add(self.motor_impulse[1] - shaft[1], self.motor_velocity[1]),
        ];
        let mobility = Inertia {
            d11: (-motor2).mul_add(motor2 * stiffness.d11, motor2),
            d12: -(motor2 * stiffness.d12 * motor3),
            d22: (-motor3).mul_add(motor3 * stiffness.d22, motor3),
        };
        let friction = bounded(&mobility, free, self.friction_low, self.friction_high);
        let shaft_impulse = stiffness.times([
            motor2.mul_add(friction.impulse[0], taken[0]),
            motor3.mul_add(friction.impulse[1], taken[1]),
        ]);

        let moved = self.inverse_link.times([
            self.link_impulse[0] + shaft_impulse[0],
            self.link_impulse[1] + shaft_impulse[1],
        ]);
        let rate = [
            friction.velocity[0] - (self.motor_velocity[0] - self.twist_rate[0] + moved[0]),
            friction.velocity[1] - (self.motor_velocity[1] - self.twist_rate[1] + moved[1]),
        ];
        Passed {
            motor_velocity: friction.velocity,
            twist: [self.twisted(0, &steps[0], rate[0], period_s), self.twisted(1, &steps[1], rate[1], period_s)],
            twist_rate: rate,
            shaft_impulse,
            friction_impulse: friction.impulse,
        }
    }

    #[inline(always)]
    fn parting(&self, joint: usize, step: &ShaftStep<S>, link_velocity: S) -> S {
        let driven = self.inverse_motor[joint].mul_add(self.motor_impulse[joint], -link_velocity);
        step.per_twist.mul_add(self.twist[joint], step.inverse_weight.mul_add(self.twist_rate[joint], driven))
    }

    #[inline(always)]
    fn twisted(&self, joint: usize, step: &ShaftStep<S>, rate: S, period_s: S) -> S {
        let old = self.twist_rate[joint];
        period_s.mul_add(step.weight.mul_add(rate - old, old), self.twist[joint])
    }
}

/// The inverse of `give` for the shafts that transmit, and nothing for those inside their gap.
#[inline(always)]
fn touching<S: Scalar>(give: &Inertia<S>, in_gap: [S::Mask; 2]) -> Inertia<S> {
    let zero = give.d11.constant(0.0);
    let d12 = S::select(in_gap[0].or(in_gap[1]), zero, give.d12);
    let reciprocal = zero.constant(1.0) / give.d11.mul_add(give.d22, -(d12 * d12));
    Inertia {
        d11: S::select(in_gap[0], zero, give.d22 * reciprocal),
        d12: -(d12 * reciprocal),
        d22: S::select(in_gap[1], zero, give.d11 * reciprocal),
    }
}

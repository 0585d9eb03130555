//! The plant: arm and drives together, advanced by one step at a time. The same code on every number type.
//!
//! Two integrators share one velocity update. [`PreparedPlant::step`] is the implicit midpoint rule (two fixed-point passes)
//! for a torque held over the step: exact to the rounding of the encoder at 0.7 ms. [`PreparedPlant::step_symplectic`] is
//! symplectic Euler, for the fast-loop emulation where the feedback itself changes within the step: it adds no
//! damping of its own to the loop's nearly undamped modes.
//!
//! Coulomb friction is exact: the friction impulses of both joints solve a two-variable box-constrained problem, and
//! a joint that sticks gets a velocity of exactly zero.
//!
//! A single-axis machine is the first joint of an arm whose second joint is decoupled and never driven
//! ([`Plant::single_axis`]).

use crate::arm::{Arm, Inertia, Pose};
use crate::drive::Drive;
use crate::scalar::Scalar;

/// Position and velocity of both joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<S> {
    /// Joint angles in rad (metres for a linear axis).
    pub position_rad: [S; 2],
    /// Joint velocities in rad/s (m/s for a linear axis).
    pub velocity_rad_s: [S; 2],
}

impl<S: Scalar> State<S> {
    /// At rest at `position_rad`.
    pub fn at_rest(position_rad: [S; 2]) -> Self {
        Self { position_rad, velocity_rad_s: [S::zero(); 2] }
    }
}

/// An arm with its two drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant<S> {
    /// The rigid arm.
    pub arm: Arm<S>,
    /// The drives of the two joints.
    pub drives: [Drive<S>; 2],
}

/// A plant with its products of constants taken out of the step.
#[derive(Clone, Copy, Debug)]
pub struct PreparedPlant<S> {
    arm: Arm<S>,
    gear_ratio: [S; 2],
    joint_viscous: [S; 2],
    joint_coulomb: [S; 2],
    inverse_d22: S,
}

impl<S: Scalar> Plant<S> {
    /// A single axis of inertia (or mass) `inertia`, without gravity: joint 0 of an arm whose joint 1 has unit
    /// inertia, no coupling, no drive and hence no motion.
    pub fn single_axis(inertia: S, drive: Drive<S>) -> Self {
        let mut f = [S::zero(); crate::arm::PARAMETERS];
        f[0] = S::one();
        f[6] = inertia;
        let idle = Drive {
            gear_ratio: S::one(),
            counts_per_rev: S::one(),
            torque_constant_nm_per_a: S::zero(),
            current_limit_a: S::zero(),
            viscous_friction_nm_s_per_rad: S::zero(),
            coulomb_friction_nm: S::zero(),
            torque_offset_nm: S::zero(),
        };
        Self { arm: Arm { f, gravity_m_s2: S::zero() }, drives: [drive, idle] }
    }

    /// Computes once what every step needs.
    pub fn prepare(&self) -> PreparedPlant<S> {
        let of = |value: fn(&Drive<S>) -> S| [value(&self.drives[0]), value(&self.drives[1])];
        PreparedPlant {
            arm: self.arm,
            gear_ratio: of(|d| d.gear_ratio),
            joint_viscous: of(|d| d.gear_ratio * d.gear_ratio * d.viscous_friction_nm_s_per_rad),
            joint_coulomb: of(|d| d.gear_ratio.abs() * d.coulomb_friction_nm),
            inverse_d22: S::one() / self.arm.f[0],
        }
    }
}

impl<S: Scalar> PreparedPlant<S> {
    /// One step of `period_s` under motor torques held constant, by the implicit midpoint rule.
    ///
    /// Two fixed-point passes: the first predicts the midpoint with the old velocity, the second with the mean of
    /// the old and the predicted one. Second order away from reversals; a reversal within the step is placed at its
    /// end.
    #[inline]
    pub fn step(&self, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let half = period_s * S::from_f64(0.5);
        let mean = |a: S, b: S| (a + b) * S::from_f64(0.5);
        let [q2, q3] = state.position_rad;
        let old = state.velocity_rad_s;
        let mut middle = old;
        let mut new = old;
        for _ in 0..2 {
            let pose = Pose::at([q2 + half * middle[0], q3 + half * middle[1]]);
            new = self.velocity_after(&pose, middle, old, motor_torque_nm, period_s);
            middle = [mean(old[0], new[0]), mean(old[1], new[1])];
        }
        State { position_rad: [q2 + period_s * middle[0], q3 + period_s * middle[1]], velocity_rad_s: new }
    }

    /// One step of `period_s` by symplectic Euler: velocity from the forces at the old position, position from the
    /// new velocity. First order; with position feedback evaluated at the old position it neither damps nor drives
    /// the loop's oscillation.
    #[inline]
    pub fn step_symplectic(&self, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let [q2, q3] = state.position_rad;
        let old = state.velocity_rad_s;
        let new = self.velocity_after(&Pose::at([q2, q3]), old, old, motor_torque_nm, period_s);
        State { position_rad: [q2 + period_s * new[0], q3 + period_s * new[1]], velocity_rad_s: new }
    }

    /// The first step of a run of [`Self::step_symplectic`]. Those read the velocity as that of half a step before
    /// the position; a state given at one instant needs half an impulse only, or the loop starts by swinging.
    #[inline]
    pub fn start_symplectic(&self, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let half = period_s * S::from_f64(0.5);
        let mut next = self.step_symplectic(state, motor_torque_nm, half);
        for joint in 0..2 {
            next.position_rad[joint] += half * next.velocity_rad_s[joint];
        }
        next
    }

    /// The velocity after `period_s`: smooth forces at `pose` and `force_velocity`, then Coulomb friction.
    #[inline]
    fn velocity_after(
        &self,
        pose: &Pose<S>,
        force_velocity: [S; 2],
        old_velocity: [S; 2],
        motor_torque_nm: [S; 2],
        period_s: S,
    ) -> [S; 2] {
        let inertia = self.arm.inertia(pose);
        let h = self.arm.velocity_torque_nm(pose, force_velocity);
        let g = self.arm.gravity_torque_nm(pose);
        let smooth = |joint: usize| {
            self.gear_ratio[joint] * motor_torque_nm[joint]
                - self.joint_viscous[joint] * force_velocity[joint]
                - h[joint]
                - g[joint]
        };
        // One division serves the inverse of D and the friction's 1/D11.
        let determinant = inertia.d11 * inertia.d22 - inertia.d12 * inertia.d12;
        let both = S::one() / (determinant * inertia.d11);
        let reciprocal = both * inertia.d11;
        let inverse =
            Inertia { d11: inertia.d22 * reciprocal, d12: -inertia.d12 * reciprocal, d22: inertia.d11 * reciprocal };
        let change = inverse.times([period_s * smooth(0), period_s * smooth(1)]);
        let free = [old_velocity[0] + change[0], old_velocity[1] + change[1]];
        let bound = [period_s * self.joint_coulomb[0], period_s * self.joint_coulomb[1]];

        // Coulomb friction finds impulses λ with |λ_i| ≤ bound_i such that v = free + D⁻¹λ has λ_i opposing v_i at its
        // bound where v_i ≠ 0, and v_i zero where λ_i is inside: the minimiser of the convex ½ λᵀD⁻¹λ + freeᵀλ over
        // the box. Minimising over one variable leaves a convex function of the other, so clamping in turn is exact
        // and needs no iteration: λ0 of the unconstrained minimum −D·free is clamped, λ1 follows and is clamped, then
        // λ0 follows from that λ1.
        let first = (-(inertia.d11 * free[0] + inertia.d12 * free[1])).clamp_abs(bound[0]);
        let per_velocity1 = determinant * determinant * both;
        let impulse1 = (-(free[1] + inverse.d12 * first) * per_velocity1).clamp_abs(bound[1]);
        let per_velocity0 = determinant * self.inverse_d22;
        let impulse0 = (-(free[0] + inverse.d12 * impulse1) * per_velocity0).clamp_abs(bound[0]);
        let moved = inverse.times([impulse0, impulse1]);
        // A joint whose bound is zero has |λ| = bound and so never sticks.
        let velocity = |joint: usize, impulse: S| {
            let sticks = impulse.abs().less(bound[joint]);
            S::select(sticks, S::zero(), free[joint] + moved[joint])
        };
        [velocity(0, impulse0), velocity(1, impulse1)]
    }
}

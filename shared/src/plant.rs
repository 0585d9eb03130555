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

use crate::arm::{Arm, Pose};
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
        Self { position_rad, velocity_rad_s: [position_rad[0].constant(0.0); 2] }
    }
}

/// A known motion that a state is counted from over one step: of constant velocity, with its pose at the middle of the
/// step. Where the arm stays near such a motion its state is small, and single precision is enough to carry it.
#[derive(Clone, Copy, Debug)]
pub struct Frame<S> {
    /// The pose half-way through the step.
    pub middle: Pose<S>,
    /// The velocity in rad/s.
    pub velocity_rad_s: [S; 2],
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
        let [zero, one] = [0.0, 1.0].map(|value| inertia.constant(value));
        let mut f = [zero; crate::arm::PARAMETERS];
        f[0] = one;
        f[6] = inertia;
        let idle = Drive {
            gear_ratio: one,
            counts_per_rev: one,
            torque_constant_nm_per_a: zero,
            current_limit_a: zero,
            viscous_friction_nm_s_per_rad: zero,
            coulomb_friction_nm: zero,
            torque_offset_nm: zero,
        };
        Self { arm: Arm { f, gravity_m_s2: zero }, drives: [drive, idle] }
    }

    /// A plant in this number type: `number` is asked for every constant of it in turn, with a function that gives this
    /// constant of a plain plant.
    #[inline(always)]
    pub fn from_constants(number: impl Fn(&dyn Fn(&Plant<f64>) -> f64) -> S) -> Self {
        let drive = |joint: usize| Drive {
            gear_ratio: number(&|plant| plant.drives[joint].gear_ratio),
            counts_per_rev: number(&|plant| plant.drives[joint].counts_per_rev),
            torque_constant_nm_per_a: number(&|plant| plant.drives[joint].torque_constant_nm_per_a),
            current_limit_a: number(&|plant| plant.drives[joint].current_limit_a),
            viscous_friction_nm_s_per_rad: number(&|plant| plant.drives[joint].viscous_friction_nm_s_per_rad),
            coulomb_friction_nm: number(&|plant| plant.drives[joint].coulomb_friction_nm),
            torque_offset_nm: number(&|plant| plant.drives[joint].torque_offset_nm),
        };
        Self {
            arm: Arm {
                f: core::array::from_fn(|index| number(&|plant| plant.arm.f[index])),
                gravity_m_s2: number(&|plant| plant.arm.gravity_m_s2),
            },
            drives: [drive(0), drive(1)],
        }
    }

    /// Computes once what every step needs.
    pub fn prepare(&self) -> PreparedPlant<S> {
        let of = |value: fn(&Drive<S>) -> S| [value(&self.drives[0]), value(&self.drives[1])];
        PreparedPlant {
            arm: self.arm,
            gear_ratio: of(|d| d.gear_ratio),
            joint_viscous: of(|d| d.gear_ratio * d.gear_ratio * d.viscous_friction_nm_s_per_rad),
            joint_coulomb: of(|d| d.gear_ratio.abs() * d.coulomb_friction_nm),
            inverse_d22: self.arm.f[0].constant(1.0) / self.arm.f[0],
        }
    }
}

impl<S: Scalar> PreparedPlant<S> {
    /// A prepared plant in this number type: `number` is asked for every constant of it in turn, with a function that
    /// gives this constant of one in double precision.
    #[inline(always)]
    pub fn from_constants(number: impl Fn(&dyn Fn(&PreparedPlant<f64>) -> f64) -> S) -> Self {
        let pair =
            |of: fn(&PreparedPlant<f64>) -> [f64; 2]| [number(&|plant| of(plant)[0]), number(&|plant| of(plant)[1])];
        Self {
            arm: Arm {
                f: core::array::from_fn(|index| number(&|plant| plant.arm.f[index])),
                gravity_m_s2: number(&|plant| plant.arm.gravity_m_s2),
            },
            gear_ratio: pair(|plant| plant.gear_ratio),
            joint_viscous: pair(|plant| plant.joint_viscous),
            joint_coulomb: pair(|plant| plant.joint_coulomb),
            inverse_d22: number(&|plant| plant.inverse_d22),
        }
    }

    /// One step of `period_s` under motor torques held constant, by the implicit midpoint rule.
    ///
    /// Two fixed-point passes: the first predicts the midpoint with the old velocity, the second with the mean of
    /// the old and the predicted one. Second order away from reversals; a reversal within the step is placed at its
    /// end.
    #[inline(always)]
    pub fn step(&self, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let half = period_s * period_s.constant(0.5);
        let [q2, q3] = state.position_rad;
        let [v2, v3] = state.velocity_rad_s;
        let pose = Pose::at([half.mul_add(v2, q2), half.mul_add(v3, q3)]);
        let still = period_s.constant(0.0);
        self.step_by_midpoint(pose, [still; 2], state, motor_torque_nm, period_s)
    }

    /// [`Self::step`] with `state` counted from a moving frame, before and after. The same to the rounding as long as
    /// the arm stays within π/4 of the frame; beyond, its pose is wrong.
    #[inline(always)]
    pub fn step_from(&self, frame: &Frame<S>, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let half = period_s * period_s.constant(0.5);
        let [q2, q3] = state.position_rad;
        let [v2, v3] = state.velocity_rad_s;
        let pose = frame.middle.turned_within_eighth([half.mul_add(v2, q2), half.mul_add(v3, q3)]);
        self.step_by_midpoint(pose, frame.velocity_rad_s, state, motor_torque_nm, period_s)
    }

    /// The two passes of the midpoint rule, from the middle that the old velocity leads to. `state` is counted from a
    /// frame that moves with `carried` rad/s.
    #[inline(always)]
    fn step_by_midpoint(
        &self,
        pose: Pose<S>,
        carried: [S; 2],
        state: &State<S>,
        motor_torque_nm: [S; 2],
        period_s: S,
    ) -> State<S> {
        let half = period_s * period_s.constant(0.5);
        let [q2, q3] = state.position_rad;
        let [w2, w3] = state.velocity_rad_s;
        let old = [carried[0] + w2, carried[1] + w3];
        let drive_torque_nm = self.drive_torque_nm(motor_torque_nm);
        let predicted = self.velocity_after(&pose, old, carried, [w2, w3], drive_torque_nm, period_s);
        // Half of what the velocity is predicted to change by.
        let one_half = period_s.constant(0.5);
        let shift = [(predicted[0] - w2) * one_half, (predicted[1] - w3) * one_half];
        let pose = pose.turned([half * shift[0], half * shift[1]]);
        let middle = [old[0] + shift[0], old[1] + shift[1]];
        let new = self.velocity_after(&pose, middle, carried, [w2, w3], drive_torque_nm, period_s);
        State { position_rad: [half.mul_add(w2 + new[0], q2), half.mul_add(w3 + new[1], q3)], velocity_rad_s: new }
    }

    /// [`Self::step`], but with every reversal at its own time: the step ends where a joint comes to rest, and goes on from
    /// there. Positions are counted from `origin`, within π/4 of it. At most seven steps; one where no joint reverses, or one
    /// comes to rest that would not have moved by `nothing_rad`.
    #[inline(never)]
    pub fn step_through_reversals(
        &self,
        origin: &Pose<S>,
        state: &State<S>,
        motor_torque_nm: [S; 2],
        period_s: S,
        nothing_rad: [S; 2],
    ) -> State<S>
    where
        S: PartialOrd,
    {
        let zero = period_s.constant(0.0);
        let mut state = *state;
        let mut left_s = period_s;
        // Each joint comes to rest once at most, because it then has no velocity.
        for _ in 0..2 {
            let whole = self.step_by_origin(origin, &state, motor_torque_nm, left_s);
            let old = state.velocity_rad_s;
            let turns = [0, 1].map(|joint: usize| {
                let new = whole.velocity_rad_s[joint];
                old[joint] * new < zero || (new == zero && (old[joint] * left_s).abs() > nothing_rad[joint])
            });
            if turns == [false; 2] {
                return whole;
            }
            // Where friction stayed as it was, velocities would go on through zero.
            let mut gliding = *self;
            let mut torque_nm = motor_torque_nm;
            for joint in 0..2 {
                if old[joint] != zero {
                    let friction = gliding.joint_coulomb[joint] / self.gear_ratio[joint];
                    gliding.joint_coulomb[joint] = zero;
                    torque_nm[joint] += if old[joint] > zero { -friction } else { friction };
                }
            }
            let through = gliding.step_by_origin(origin, &state, torque_nm, left_s).velocity_rad_s;
            let mut first = None;
            for joint in 0..2 {
                if turns[joint] && old[joint] * through[joint] < zero {
                    let share = old[joint] / (old[joint] - through[joint]);
                    if first.is_none_or(|(before, _)| share < before) {
                        first = Some((share, joint));
                    }
                }
            }
            let Some((share, joint)) = first else { return whole };
            let until_s = share * left_s;
            state = self.step_by_origin(origin, &state, motor_torque_nm, until_s);
            state.velocity_rad_s[joint] = zero;
            left_s -= until_s;
        }
        self.step_by_origin(origin, &state, motor_torque_nm, left_s)
    }

    /// [`Self::step`] with positions counted from `origin`. Not inlined: a step is a kilobyte of code.
    #[inline(never)]
    fn step_by_origin(&self, origin: &Pose<S>, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let frame = Frame { middle: *origin, velocity_rad_s: [period_s.constant(0.0); 2] };
        self.step_from(&frame, state, motor_torque_nm, period_s)
    }

    /// One step of `period_s` by symplectic Euler: velocity from the forces at the old position, position from the
    /// new velocity. First order; with position feedback evaluated at the old position it neither damps nor drives
    /// the loop's oscillation.
    #[inline(always)]
    pub fn step_symplectic(&self, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let [q2, q3] = state.position_rad;
        let old = state.velocity_rad_s;
        let drive_torque_nm = self.drive_torque_nm(motor_torque_nm);
        let still = [period_s.constant(0.0); 2];
        let new = self.velocity_after(&Pose::at([q2, q3]), old, still, old, drive_torque_nm, period_s);
        State { position_rad: [period_s.mul_add(new[0], q2), period_s.mul_add(new[1], q3)], velocity_rad_s: new }
    }

    /// The first step of a run of [`Self::step_symplectic`]. Those read the velocity as that of half a step before
    /// the position; a state given at one instant needs half an impulse only, or the loop starts by swinging.
    #[inline(always)]
    pub fn start_symplectic(&self, state: &State<S>, motor_torque_nm: [S; 2], period_s: S) -> State<S> {
        let half = period_s * period_s.constant(0.5);
        let mut next = self.step_symplectic(state, motor_torque_nm, half);
        for joint in 0..2 {
            next.position_rad[joint] += half * next.velocity_rad_s[joint];
        }
        next
    }

    /// What the motors exert at the joints, friction apart.
    #[inline(always)]
    fn drive_torque_nm(&self, motor_torque_nm: [S; 2]) -> [S; 2] {
        [self.gear_ratio[0] * motor_torque_nm[0], self.gear_ratio[1] * motor_torque_nm[1]]
    }

    /// The velocity after `period_s`: smooth forces at `pose` and `force_velocity`, then Coulomb friction. The old and
    /// the new velocity are counted from a frame that moves with `carried` rad/s.
    #[inline(always)]
    fn velocity_after(
        &self,
        pose: &Pose<S>,
        force_velocity: [S; 2],
        carried: [S; 2],
        old_velocity: [S; 2],
        drive_torque_nm: [S; 2],
        period_s: S,
    ) -> [S; 2] {
        let inertia = self.arm.inertia(pose);
        let unloaded = self.arm.less_gravity_torque_nm(drive_torque_nm, pose);
        let smooth = self.arm.less_velocity_torque_nm(unloaded, pose, force_velocity);
        let smooth2 = (-self.joint_viscous[0]).mul_add(force_velocity[0], smooth[0]);
        let smooth3 = (-self.joint_viscous[1]).mul_add(force_velocity[1], smooth[1]);
        let [old2, old3] = [carried[0] + old_velocity[0], carried[1] + old_velocity[1]];
        let [push2, push3] = [period_s * smooth2, period_s * smooth3];
        let bound = [period_s * self.joint_coulomb[0], period_s * self.joint_coulomb[1]];

        // Coulomb friction finds impulses λ with |λ_i| ≤ bound_i such that v = v_old + D⁻¹(push + λ) has λ_i opposing v_i
        // at its bound where v_i ≠ 0, and v_i zero where λ_i is inside: with m = D v_old + push the minimiser of the
        // convex ½ (m + λ)ᵀD⁻¹(m + λ) over the box. Minimising over one variable leaves a convex function of the other,
        // so clamping in turn is exact and needs no iteration: λ2 of the unconstrained minimum, −m2, is clamped, λ3
        // follows and is clamped, then λ2 follows from that λ3. Of the momenta D v_old only what does not cancel is
        // computed: a joint at rest beside one that moves fast would otherwise feel the rounding of the latter.
        let determinant = inertia.d11.mul_add(inertia.d22, -(inertia.d12 * inertia.d12));
        // One division serves the inverse of D and 1/D11.
        let both = period_s.constant(1.0) / (determinant * inertia.d11);
        let [inverse_d11, inverse_determinant] = [both * determinant, both * inertia.d11];
        let m2 = inertia.d11.mul_add(old2, inertia.d12.mul_add(old3, push2));
        let left2 = push2 - m2.clamp_abs(bound[0]);
        let alone3 = (inertia.d12 * inverse_d11).mul_add(left2, -push3);
        let impulse3 = (-(determinant * inverse_d11)).mul_add(old3, alone3).clamp_abs(bound[1]);
        let total3 = push3 + impulse3;
        let alone2 = (inertia.d12 * self.inverse_d22).mul_add(total3, -push2);
        let impulse2 = (-(determinant * self.inverse_d22)).mul_add(old2, alone2).clamp_abs(bound[0]);
        let total2 = push2 + impulse2;
        let free2 = inverse_determinant.mul_add(inertia.d22.mul_add(total2, -(inertia.d12 * total3)), old_velocity[0]);
        let free3 = inverse_determinant.mul_add(inertia.d11.mul_add(total3, -(inertia.d12 * total2)), old_velocity[1]);
        // A joint whose bound is zero has |λ| = bound and so never sticks.
        let zero = period_s.constant(0.0);
        [
            S::select(impulse2.abs().less(bound[0]), zero - carried[0], free2),
            S::select(impulse3.abs().less(bound[1]), zero - carried[1], free3),
        ]
    }
}

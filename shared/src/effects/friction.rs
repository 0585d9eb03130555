//! Friction at the motor beyond a constant Coulomb and a proportional viscous part.

use super::JointEffects;
use super::wave::Wave;
use crate::drive::Drive;
use crate::scalar::Scalar;

/// Friction of one joint with its products of constants taken out of the step; everything at the joint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Friction<S> {
    coulomb: S,
    coulomb_asymmetry: S,
    viscous: S,
    viscous_asymmetry: S,
    quadratic: S,
    stribeck: S,
    /// Joint speed over Stribeck velocity.
    stribeck_per_speed: S,
    stribeck_sharpness: S,
    load_coefficient: S,
    drift: S,
    position: Wave<S>,
}

/// What the slowly changing part of friction depends on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circumstances<S> {
    pub position_rad: S,
    pub time_s: S,
}

impl<S: Scalar> Friction<S> {
    pub fn new(drive: &Drive<S>, effects: &JointEffects<S>) -> Self {
        let ratio = drive.gear_ratio;
        let (square, size) = (ratio * ratio, ratio.abs());
        let half = ratio.constant(0.5);
        Self {
            coulomb: size * (drive.coulomb_friction_nm + effects.coulomb_change_nm),
            // Forward at the motor is backward at the joint where the gear turns the other way.
            coulomb_asymmetry: half * ratio * effects.coulomb_asymmetry_nm,
            viscous: square * (drive.viscous_friction_nm_s_per_rad + effects.viscous_change_nm_s_per_rad),
            viscous_asymmetry: half * ratio * size * effects.viscous_asymmetry_nm_s_per_rad,
            quadratic: square * size * effects.quadratic_nm_s2_per_rad2,
            stribeck: size * effects.stribeck_nm,
            stribeck_per_speed: size / effects.stribeck_velocity_rad_s,
            stribeck_sharpness: effects.stribeck_sharpness,
            load_coefficient: effects.load_friction_coefficient,
            drift: size * effects.friction_drift_nm_per_s,
            position: Wave {
                size: size * effects.position_friction_nm,
                order: effects.position_friction_order,
                phase: effects.position_friction_phase_rad,
            },
        }
    }

    /// The part of dry friction that changes slowly, N m.
    #[inline(always)]
    pub fn slow_level_nm(&self, circumstances: &Circumstances<S>) -> S {
        // Before the recording friction has not begun to drift.
        let time_s = circumstances.time_s.maximum(self.drift.constant(0.0));
        self.position.at(circumstances.position_rad) + self.drift.mul_add(time_s, self.coulomb)
    }

    /// The range of dry friction's torque in N m at a joint speed: its low end acts while the joint moves in positive
    /// direction, its high end against the negative one, and at rest anything between.
    #[inline(always)]
    pub fn range_nm(&self, slow_level_nm: S, velocity_rad_s: S, gear_torque_nm: S) -> (S, S) {
        let speed = velocity_rad_s.abs() * self.stribeck_per_speed;
        // x² where sharp, x where not.
        let exponent = speed * self.stribeck_sharpness.mul_add(speed - speed.constant(1.0), speed.constant(1.0));
        // As a wave that is off: nothing to compute.
        let slow_speed = if self.stribeck.is_zero() { self.stribeck } else { self.stribeck * decay(exponent) };
        let level = slow_speed + self.load_coefficient.mul_add(gear_torque_nm.abs(), slow_level_nm);
        let level = level.maximum(level.constant(0.0));
        (-level - self.coulomb_asymmetry, level - self.coulomb_asymmetry)
    }

    /// The torque of all friction that vanishes at rest, N m at the joint.
    #[inline(always)]
    pub fn wet_torque_nm(&self, velocity_rad_s: S) -> S {
        let speed = velocity_rad_s.abs();
        let odd = self.quadratic.mul_add(speed, self.viscous);
        -odd.mul_add(velocity_rad_s, self.viscous_asymmetry * speed)
    }
}

/// exp(−x) for x ≥ 0, within 2e-4: one division, and zero far out.
#[inline(always)]
fn decay<S: Scalar>(x: S) -> S {
    let y = x * x.constant(1.0 / 16.0);
    let series =
        y.mul_add(y.mul_add(y.mul_add(x.constant(1.0 / 6.0), x.constant(0.5)), x.constant(1.0)), x.constant(1.0));
    let square = series * series;
    let fourth = square * square;
    let eighth = fourth * fourth;
    x.constant(1.0) / (eighth * eighth)
}

//! One joint's drive: amplifier, motor, gear, friction and encoder.
//!
//! Friction acts at the motor: viscous plus Coulomb, so a joint feels gear_ratio² and |gear_ratio| times it. The
//! amplifier is an ideal current source up to its limit (the 12A8 of the paper closes its current loop at 2.5 kHz: a
//! lag of 64 µs that this model leaves out, as the paper does). Everything else a real drive has is in
//! [`crate::effects`].

use crate::scalar::Scalar;

/// Constants of one drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive<S> {
    /// Motor turns per joint turn; negative where the motor turns the other way. Never zero.
    pub gear_ratio: S,
    /// Encoder counts per motor turn, quadrature included.
    pub counts_per_rev: S,
    /// Motor torque per ampere in N m/A.
    pub torque_constant_nm_per_a: S,
    /// Largest current of the amplifier in A.
    pub current_limit_a: S,
    /// Viscous friction at the motor in N m s/rad.
    pub viscous_friction_nm_s_per_rad: S,
    /// Coulomb friction at the motor in N m.
    pub coulomb_friction_nm: S,
    /// Constant torque the motor has to overcome, in N m (amplifier bias, the pull of a cable): the offset of the
    /// inverse model.
    pub torque_offset_nm: S,
}

impl<S: Scalar> Drive<S> {
    /// Encoder counts per radian of the joint: +13725.5 and −8546.6 on the paper's robot.
    #[inline(always)]
    pub fn counts_per_rad(&self) -> S {
        self.gear_ratio * self.counts_per_rev * self.gear_ratio.constant(1.0 / core::f64::consts::TAU)
    }

    /// Motor torque in N m for a commanded current in A: limited by the amplifier, offset included.
    #[inline(always)]
    pub fn motor_torque_nm(&self, command_a: S) -> S {
        command_a.clamp_abs(self.current_limit_a) * self.torque_constant_nm_per_a - self.torque_offset_nm
    }

    /// The count an ideal encoder shows at `position_rad`, after `fix()`.
    #[inline(always)]
    pub fn encoder_counts(&self, position_rad: S) -> S {
        (position_rad * self.counts_per_rad()).fix()
    }
}

/// The motor position in counts that a truncated count stands for: the middle of its cell.
///
/// `fix()` puts every position of 1 ≤ x < 2 at 1, so the count is half a count too small in magnitude on average;
/// only the cell of 0, two counts wide, is centred on its count.
#[inline(always)]
pub fn centre_of_count<S: Scalar>(count: S) -> S {
    let half = count.constant(0.5);
    count + S::select(half.less(count.abs()), count.signed(half), count.constant(0.0))
}

/// What a truncating encoder shows on average near `position_counts`: a smooth stand-in for `fix()` in models that
/// must be differentiated, inverse to [`centre_of_count`] away from zero.
#[inline(always)]
pub fn mean_count<S: Scalar>(position_counts: S) -> S {
    position_counts - mean_count_shift(position_counts)
}

/// By how much a truncating encoder shows less on average than `position_counts`: half a count, toward zero.
#[inline(always)]
pub fn mean_count_shift<S: Scalar>(position_counts: S) -> S {
    position_counts.clamp_abs(position_counts.constant(0.5))
}

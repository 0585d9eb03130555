//! From the commanded current to the motor's torque.

use super::JointEffects;
use super::wave::Wave;
use crate::drive::Drive;
use crate::scalar::Scalar;

/// Amplifier and motor of one joint with its products of constants taken out of the step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Amplifier<S> {
    /// The motor it drives.
    pub motor: Motor<S>,
    limit: S,
    dead_zone: S,
    lag: S,
    slew: S,
    inverse_slew: S,
    drift: S,
    back_emf: S,
    /// Current of the full voltage at rest, A.
    stall: S,
    /// Current that a speed of the joint takes from it, A s/rad.
    stall_per_speed: S,
}

/// The motor of one joint: from current to torque.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motor<S> {
    gear_ratio: S,
    torque_constant: S,
    offset: S,
    ripple: Wave<S>,
    cogging: Wave<S>,
}

/// Torque per current and torque without one at a position of the motor.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorAt<S> {
    torque_constant: S,
    torque_nm: S,
}

impl<S: Scalar> Amplifier<S> {
    pub fn new(drive: &Drive<S>, effects: &JointEffects<S>) -> Self {
        let ratio = drive.gear_ratio;
        let motor = Motor::new(drive, effects);
        Self {
            motor,
            limit: drive.current_limit_a.minimum(effects.current_limit_a),
            dead_zone: effects.dead_zone_a,
            lag: effects.current_lag_s,
            slew: effects.current_slew_a_per_s,
            inverse_slew: ratio.constant(1.0) / effects.current_slew_a_per_s,
            drift: effects.torque_constant_drift_per_s,
            back_emf: ratio * effects.back_emf_a_s_per_rad,
            stall: effects.supply_v / effects.winding_ohm,
            // In SI units the back-EMF constant is the torque constant.
            stall_per_speed: ratio * motor.torque_constant / effects.winding_ohm,
        }
    }

    /// The current that a command stands for, A.
    #[inline(always)]
    pub fn input_a(&self, command_a: S) -> S {
        (command_a - command_a.clamp_abs(self.dead_zone)).clamp_abs(self.limit)
    }

    /// The current that the amplifier strives for at a joint speed, A.
    #[inline(always)]
    pub fn target_a(&self, input_a: S, velocity_rad_s: S) -> S {
        let lost = self.stall_per_speed * velocity_rad_s;
        let target = (-self.back_emf).mul_add(velocity_rad_s, input_a);
        target.maximum(-self.stall - lost).minimum(self.stall - lost)
    }

    /// Current at the end of a step toward `target_a`, and its mean over the step.
    ///
    /// The mean follows from the same decay, so that however coarse the step, the current's delay adds up to the time
    /// constant exactly.
    #[inline(always)]
    pub fn lagged_a(&self, current_a: S, target_a: S, period_s: S) -> (S, S) {
        let x = self.lag / period_s;
        let decay = decay_over(x);
        let behind = current_a - target_a;
        let mean = (x * (x.constant(1.0) - decay)).mul_add(behind, target_a);
        self.limited_a(current_a, decay.mul_add(behind, target_a), mean, period_s)
    }

    /// The same where the current's rate is limited: exact where it is that alone that holds the current back.
    #[inline(always)]
    fn limited_a(&self, current_a: S, end_a: S, mean_a: S, period_s: S) -> (S, S) {
        let wanted = end_a - current_a;
        let change = wanted.clamp_abs(self.slew * period_s);
        // The share of the step that the change takes.
        let taken = change.abs() * (self.inverse_slew / period_s);
        let kept = change * (-taken.constant(0.5)).mul_add(taken, taken.constant(1.0));
        // Nothing is taken away where the rate is not in the way, not even by rounding.
        (end_a - (wanted - change), mean_a - (wanted - kept))
    }

    /// What a current of the motor counts for at a time after the start of the recording.
    #[inline(always)]
    pub fn drifted_a(&self, current_a: S, time_s: S) -> S {
        current_a * self.drift.mul_add(time_s, time_s.constant(1.0))
    }
}

impl<S: Scalar> Motor<S> {
    pub fn new(drive: &Drive<S>, effects: &JointEffects<S>) -> Self {
        let ratio = drive.gear_ratio;
        let one = ratio.constant(1.0);
        Self {
            gear_ratio: ratio,
            torque_constant: drive.torque_constant_nm_per_a * (one + effects.torque_constant_change),
            offset: drive.torque_offset_nm + effects.torque_offset_nm,
            ripple: Wave {
                size: effects.ripple_share,
                order: ratio * effects.ripple_order,
                phase: effects.ripple_phase_rad,
            },
            cogging: Wave {
                size: effects.cogging_nm,
                order: ratio * effects.cogging_order,
                phase: effects.cogging_phase_rad,
            },
        }
    }

    /// The motor at a position of the joint.
    #[inline(always)]
    pub fn at(&self, position_rad: S) -> MotorAt<S> {
        let factor = self.ripple.at(position_rad) + position_rad.constant(1.0);
        MotorAt {
            torque_constant: self.torque_constant * factor,
            torque_nm: self.cogging.at(position_rad) - self.offset,
        }
    }

    /// The joint torque of a current and a torque beside it, both at the motor.
    #[inline(always)]
    pub fn joint_torque_nm(&self, at: &MotorAt<S>, current_a: S, added_torque_nm: S) -> S {
        self.gear_ratio * at.torque_constant.mul_add(current_a, at.torque_nm + added_torque_nm)
    }

    /// The current that gives a joint torque: the inverse of [`Self::joint_torque_nm`].
    #[inline(always)]
    pub fn current_a(&self, at: &MotorAt<S>, joint_torque_nm: S) -> S {
        (joint_torque_nm / self.gear_ratio - at.torque_nm) / at.torque_constant
    }

    /// Joint torque per ampere.
    #[inline(always)]
    pub fn joint_torque_per_a(&self, at: &MotorAt<S>) -> S {
        self.gear_ratio * at.torque_constant
    }
}

/// exp(−1/x) for x ≥ 0, exact at 0 and, for all that matters to a lag, beyond: within 2e-3.
#[inline(always)]
fn decay_over<S: Scalar>(x: S) -> S {
    // 1/(1 + y + y²/2 + … + y⁶/720) with y = 1/x, without the division that x = 0 does not survive:
    // x⁶ over x⁶ + x⁵ + x⁴/2 + x³/6 + x²/24 + x/120 + 1/720.
    let mut below = x + x.constant(1.0);
    let mut power = x;
    for inverse_factorial in [0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0] {
        below = below.mul_add(x, x.constant(inverse_factorial));
        power = power * x;
    }
    power / below
}

//! The other way round: from the torque that a joint of the arm needs to the current that gives it, through friction and
//! motor with their effects.
//!
//! What the plant computes with forwards is inverted here, from the same functions. Left out is what a controller cannot
//! invert at the reference motion: what happens between motor and link, in the amplifier, in the encoder and in time.

use super::JointEffects;
use super::amplifier::Motor;
use super::friction::{Circumstances, Friction};
use super::link::balance_spring;
use super::wave::Wave;
use crate::drive::Drive;
use crate::scalar::Scalar;

/// One joint's drive, to be asked for currents.
#[derive(Clone, Copy, Debug)]
pub struct DriveFeedforward<S> {
    friction: Friction<S>,
    motor: Motor<S>,
    spring: Wave<S>,
    motor_inertia: S,
    /// Direction of dry friction per joint speed, s/rad.
    direction_per_speed: S,
}

/// The motion of one joint that a current is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Instant<S> {
    /// Angle of the joint in rad.
    pub position_rad: S,
    /// Its velocity in rad/s.
    pub velocity_rad_s: S,
    /// Its acceleration in rad/s².
    pub acceleration_rad_s2: S,
    /// The arm's torque in this motion, N m: what the gear transmits, springs and the motor's own inertia apart.
    pub arm_torque_nm: S,
}

impl<S: Scalar> DriveFeedforward<S> {
    /// Dry friction changes direction over `switch_motor_rad_s` of the motor's speed.
    #[inline(never)]
    pub fn new(drive: &Drive<S>, effects: &JointEffects<S>, switch_motor_rad_s: S) -> Self {
        let ratio = drive.gear_ratio;
        Self {
            friction: Friction::new(drive, effects),
            motor: Motor::new(drive, effects),
            spring: balance_spring(effects),
            motor_inertia: ratio * ratio * effects.motor_inertia_kg_m2,
            direction_per_speed: ratio.abs() / switch_motor_rad_s,
        }
    }

    /// The current in A that leaves the arm a joint torque of `wanted_nm`, and the joint torque in N m that one ampere
    /// more would give.
    ///
    /// Not inlined: the board has room for one copy, not for one a joint.
    #[inline(never)]
    pub fn current_a(&self, instant: &Instant<S>, wanted_nm: S) -> (S, S) {
        let &Instant { position_rad, velocity_rad_s, acceleration_rad_s2, arm_torque_nm } = instant;
        let spring_nm = self.spring.at(position_rad);
        let gear_nm = (-self.motor_inertia).mul_add(acceleration_rad_s2, arm_torque_nm - spring_nm);
        // Drift counts from the start of a recording, and the controller knows of none.
        let circumstances = Circumstances { position_rad, time_s: position_rad.constant(0.0) };
        let slow_nm = self.friction.slow_level_nm(&circumstances);
        let (low_nm, high_nm) = self.friction.range_nm(slow_nm, velocity_rad_s, gear_nm);
        let one = position_rad.constant(1.0);
        let direction = (self.direction_per_speed * velocity_rad_s).clamp_abs(one);
        // The low end acts while the joint moves in positive direction.
        let half = position_rad.constant(0.5);
        let dry_nm = half * direction.mul_add(low_nm - high_nm, low_nm + high_nm);
        let friction_nm = dry_nm + self.friction.wet_torque_nm(velocity_rad_s);
        let at = self.motor.at(position_rad);
        (self.motor.current_a(&at, wanted_nm - spring_nm - friction_nm), self.motor.joint_torque_per_a(&at))
    }
}

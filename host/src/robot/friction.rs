//! The most friction that a drive can move against: more is a number in another unit, or a slip.

use crate::number_text::significant;

use super::{Kind, Robot};

/// Friction that the drive can never overcome.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{kind} friction of joint {joint} is {value:?} {unit} at the motor, but must be from 0 to below {limit}, {reason}",
    limit = significant(*limit, 4)
)]
pub struct FrictionError {
    /// Viscous or Coulomb.
    kind: &'static str,
    /// Name of the joint.
    joint: String,
    /// The friction.
    value: f64,
    /// Its unit.
    unit: &'static str,
    /// What it must be below.
    limit: f64,
    /// What sets the limit.
    reason: String,
}

impl FrictionError {
    /// What to do.
    pub const REMEDY: &'static str = "identify the arm again, or correct the number";
}

impl Robot {
    /// Accepts Coulomb friction of joint `index` at the motor that its drive overcomes.
    pub fn check_coulomb_friction(&self, index: usize, value_nm: f64) -> Result<(), FrictionError> {
        let limit = self.greatest_torque_nm(index);
        let reason = "the greatest torque of its drive (torque_constant_nm_per_a × current_limit_a)".into();
        self.check_friction(index, ("Coulomb", "N m"), value_nm, limit, reason)
    }

    /// Accepts viscous friction of joint `index` at the motor that its drive overcomes at the joint's speed limit.
    pub fn check_viscous_friction(&self, index: usize, value_nm_s_per_rad: f64) -> Result<(), FrictionError> {
        let joint = &self.joints[index];
        let (limit, reason) = match self.kind {
            Kind::TwoLink => {
                let speed_rad_s = joint.limits.speed_rad_s;
                let torque_nm = self.greatest_torque_nm(index);
                let reason = format!(
                    "where it takes all of its drive's {} N m at the speed limit of {speed_rad_s} rad/s",
                    significant(torque_nm, 4)
                );
                (torque_nm / (speed_rad_s * joint.gear_ratio.abs()), reason)
            }
            // The speeds that an axis may have are not asked of it.
            Kind::SingleAxis => (f64::INFINITY, "a finite number".into()),
        };
        self.check_friction(index, ("viscous", "N m s/rad"), value_nm_s_per_rad, limit, reason)
    }

    fn greatest_torque_nm(&self, index: usize) -> f64 {
        self.joints[index].torque_constant_nm_per_a * self.joints[index].current_limit_a
    }

    fn check_friction(
        &self,
        index: usize,
        (kind, unit): (&'static str, &'static str),
        value: f64,
        limit: f64,
        reason: String,
    ) -> Result<(), FrictionError> {
        if (0.0..limit).contains(&value) {
            return Ok(());
        }
        Err(FrictionError { kind, joint: self.joints[index].name.clone(), value, unit, limit, reason })
    }
}

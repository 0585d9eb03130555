//! The model of the arm that computed torque runs with.

use super::frame::Checksum;
use super::{Joint, JointCompensation};
use crate::arm::{Arm, ArmError, PARAMETERS, SEARCH_HIGH, SEARCH_LOW};
use serde::{Deserialize, Serialize};

/// f1..f9, the friction found with them and the effects found beyond them, tied to the robot they were identified on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// [`super::Configuration::robot_identity`] of the robot the model was identified on.
    pub robot_identity: u32,
    /// f1..f9: f1, f2, f3, f4, f7 in kg m²; f5, f6, f8, f9 in kg m.
    pub f: [f64; PARAMETERS],
    /// Viscous friction at the motors in N m s/rad.
    pub viscous_friction_nm_s_per_rad: [f64; 2],
    /// Coulomb friction at the motors in N m.
    pub coulomb_friction_nm: [f64; 2],
    /// Effects to compensate.
    pub compensation: [JointCompensation; 2],
}

impl Model {
    /// CRC-32 of the model: of the identity and then of every number, little endian, in the order of the fields.
    pub fn crc(&self) -> u32 {
        let mut checksum = Checksum::new();
        checksum.add(&self.robot_identity.to_le_bytes());
        for number in self.f.iter().chain(&self.viscous_friction_nm_s_per_rad).chain(&self.coulomb_friction_nm) {
            checksum.add(&number.to_le_bytes());
        }
        for joint in &self.compensation {
            checksum.add(&joint.to_bytes());
        }
        checksum.finish()
    }

    /// Accepts a model only for the robot it was made for, with every number finite, f1..f9 in `range`, friction not
    /// negative, effects in their ranges, and D(q) positive definite for every q3 ([`Arm::check_inertia`]). Constant time.
    pub fn check(&self, robot_identity: u32, range: &ModelRange) -> Result<(), ModelError> {
        self.check_ranges(robot_identity, range)?;
        self.check_dynamics()
    }

    /// The part of [`Self::check`] that depends on the robot, or only compares.
    pub(crate) fn check_ranges(&self, robot_identity: u32, range: &ModelRange) -> Result<(), ModelError> {
        if self.robot_identity != robot_identity {
            return Err(ModelError::OtherRobot { model: self.robot_identity, board: robot_identity });
        }
        for (number, ((&value, &low), &high)) in (1u8..).zip(self.f.iter().zip(&range.low).zip(&range.high)) {
            if !is_finite(value) {
                return Err(ModelError::NotFinite { number, value });
            }
            if is_below(value, low) || is_below(high, value) {
                return Err(ModelError::OutOfRange { number, value, low, high });
            }
        }
        for (joint, (&viscous, &coulomb)) in
            Joint::ALL.into_iter().zip(self.viscous_friction_nm_s_per_rad.iter().zip(&self.coulomb_friction_nm))
        {
            for value in [viscous, coulomb] {
                if is_below(value, 0.0) || !is_finite(value) {
                    return Err(ModelError::Friction { joint, value });
                }
            }
        }
        Ok(())
    }

    /// The part of [`Self::check`] that depends on the model alone and takes calculation.
    #[inline]
    pub(crate) fn check_dynamics(&self) -> Result<(), ModelError> {
        for (joint, compensation) in Joint::ALL.into_iter().zip(&self.compensation) {
            compensation.check(joint)?;
        }
        Arm { f: self.f, gravity_m_s2: 0.0 }.check_inertia().map_err(|error| match error {
            ArmError::NotFinite { number, value } => ModelError::NotFinite { number: number as u8, value },
            ArmError::JointInertia { value } => ModelError::JointInertia { value },
            ArmError::Indefinite { determinant, q3_rad } => ModelError::Indefinite { determinant, q3_rad },
        })
    }
}

/// Whether a number is finite, seen from its bits: a Cortex-M4 compares `f64` in software.
fn is_finite(value: f64) -> bool {
    value.abs().total_cmp(&f64::INFINITY).is_lt()
}

/// Whether a number is below another, likewise from their bits; neither may be NaN.
fn is_below(value: f64, other: f64) -> bool {
    let is_zero = |number: f64| number.to_bits() << 1 == 0;
    value.total_cmp(&other).is_lt() && !(is_zero(value) && is_zero(other))
}

/// What a plausible model's f1..f9 lie between; part of the configuration, because it depends on the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelRange {
    /// Least plausible f1..f9.
    pub low: [f64; PARAMETERS],
    /// Greatest plausible f1..f9.
    pub high: [f64; PARAMETERS],
}

impl ModelRange {
    /// A search range widened by its own width on both sides: an identified model may lie outside the range it was
    /// searched in (the paper's own does), and a load moves it further.
    pub fn around(low: [f64; PARAMETERS], high: [f64; PARAMETERS]) -> Self {
        let mut range = Self { low, high };
        for (low, high) in range.low.iter_mut().zip(&mut range.high) {
            let width = *high - *low;
            *low -= width;
            *high += width;
        }
        range
    }
}

impl Default for ModelRange {
    /// Around the paper's search range.
    fn default() -> Self {
        Self::around(SEARCH_LOW, SEARCH_HIGH)
    }
}

/// Why a model is refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum ModelError {
    /// The model was identified on a robot with other constants.
    #[error(
        "the model was made for robot {model:08x}, this is robot {board:08x}; identify this robot, or apply the robot \
         file the model belongs to"
    )]
    OtherRobot {
        /// Identity in the model.
        model: u32,
        /// Identity of the applied configuration.
        board: u32,
    },
    /// A parameter is NaN or infinite.
    #[error("f{number} is {value}, not a finite number; identify the arm again")]
    NotFinite {
        /// Number of the parameter, 1..=9.
        number: u8,
        /// Its value.
        value: f64,
    },
    /// A parameter is far from anything plausible.
    #[error("f{number} is {value}, outside the plausible {low} to {high}; identify the arm again, or widen the range")]
    OutOfRange {
        /// Number of the parameter, 1..=9.
        number: u8,
        /// Its value.
        value: f64,
        /// Least plausible value.
        low: f64,
        /// Greatest plausible value.
        high: f64,
    },
    /// A friction coefficient is negative or not finite.
    #[error(
        "a friction coefficient of {joint} is {value}, but must be finite and not negative; identify the arm again"
    )]
    Friction {
        /// Which joint.
        joint: Joint,
        /// The coefficient.
        value: f64,
    },
    /// A number of an effect is outside its range.
    #[error(
        "{} of {joint} is {value}, but must be from {low} to {high}; correct the effect in the model file, or leave it out",
        JointCompensation::NAMES.get(usize::from(*number)).unwrap_or(&"an effect")
    )]
    Compensation {
        /// Which joint.
        joint: Joint,
        /// Which of [`JointCompensation::NAMES`].
        number: u8,
        /// Its value.
        value: f32,
        /// Least value.
        low: f32,
        /// Greatest value.
        high: f32,
    },
    /// f1, the inertia of joint 3, is not positive.
    #[error("f1 is {value} kg m², but the inertia of joint 3 must be above 0; identify the arm again")]
    JointInertia {
        /// The value of f1.
        value: f64,
    },
    /// D(q) is not positive definite somewhere.
    #[error(
        "the inertia matrix is not positive definite: det D falls to {determinant:.4} kg² m⁴ at q3 = {q3_rad:.3} rad, \
         and must stay above 0; identify the arm again"
    )]
    Indefinite {
        /// The least determinant over all q3.
        determinant: f64,
        /// Where it occurs.
        q3_rad: f64,
    },
}

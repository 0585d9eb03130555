//! The arm's equations of motion, whichever of the two ways they are computed.

use super::base_parameters::BaseParameters;
use super::newton_euler::LinkMasses;

/// `mass · acceleration + bias = joint torque`, at one pose and speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EquationsOfMotion {
    /// Mass matrix in kg m², row by row. Motor inertias are included.
    pub mass_kg_m2: [[f64; 2]; 2],
    /// Centrifugal, Coriolis and gravity torques in N m.
    pub bias_nm: [f64; 2],
}

/// The moving parts of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arm {
    /// Given by `f1..f9`: any set can be simulated, even one that no real arm has.
    Base(BaseParameters),
    /// Given by real masses, computed by the Newton–Euler recursion. Takes about 1.4 times as long.
    Links(LinkMasses),
}

impl Arm {
    /// Mass matrix and bias torques at this pose and speed.
    #[must_use]
    pub fn equations(&self, angle_rad: [f64; 2], velocity_rad_s: [f64; 2], gravity_m_s2: f64) -> EquationsOfMotion {
        match self {
            Self::Base(base) => base.equations(angle_rad, velocity_rad_s, gravity_m_s2),
            Self::Links(links) => links.equations(angle_rad, velocity_rad_s, gravity_m_s2),
        }
    }

    /// The true `f1..f9` of this arm.
    #[must_use]
    pub fn base_parameters(&self) -> BaseParameters {
        match self {
            Self::Base(base) => *base,
            Self::Links(links) => links.base_parameters(),
        }
    }

    /// Kinetic and potential energy together, in joules.
    #[must_use]
    pub fn energy_j(&self, angle_rad: [f64; 2], velocity_rad_s: [f64; 2], gravity_m_s2: f64) -> f64 {
        let mass = self.equations(angle_rad, [0.0; 2], 0.0).mass_kg_m2;
        let [upper, fore] = velocity_rad_s;
        let kinetic = 0.5 * (mass[0][0] * upper * upper + mass[1][1] * fore * fore) + mass[0][1] * upper * fore;
        kinetic
            + match self {
                Self::Base(base) => base.potential_energy_j(angle_rad, gravity_m_s2),
                Self::Links(links) => links.potential_energy_j(angle_rad, gravity_m_s2),
            }
    }
}

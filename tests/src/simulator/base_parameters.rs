//! The arm as nine numbers `f1..f9`, the combinations of masses that motion can reveal.
//!
//! Source: the paper's equations with its misprints corrected, as listed in design.md §2. The checks compare them
//! with [`newton_euler`](super::newton_euler), which was not derived from them.

use super::dynamics::EquationsOfMotion;

/// Distance from the shoulder axis to the elbow axis of a PUMA 560, in metres (the paper's `a3`).
pub const UPPER_ARM_LENGTH_M: f64 = 0.4318;

/// The nine base parameters of the two-link arm, `f1` first.
///
/// `f1, f2, f3, f4, f7` are in kg m², `f5, f6, f8, f9` in kg m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseParameters(pub [f64; 9]);

impl BaseParameters {
    /// A PUMA 560 with its wrist locked and a tool of 2.5 kg: the reference robot of design.md §2.
    ///
    /// The table there gives three decimals; `f3` and `f4` are computed here from `f5` and `f6`, so that the set
    /// belongs to a real arm exactly.
    pub const REFERENCE: Self = Self::with_consistent_elbow(1.647, 1.070, -0.025, -2.219, 5.609, -0.104, 4.875);

    /// The set the paper identified on its own robot with a drill as tool. It belongs to no real arm:
    /// `f3` is not `a3 f5`, nor is `f4` `a3 f6`.
    pub const PAPER: Self = Self([1.68, 1.39, -0.29, -1.40, -0.08, -1.94, 6.67, 0.06, 10.2]);

    /// The nine numbers from the seven that are free on a real arm: `f3 = a3 f5` and `f4 = a3 f6`.
    ///
    /// Units as in [`BaseParameters`].
    #[must_use]
    pub const fn with_consistent_elbow(f1: f64, f2: f64, f5: f64, f6: f64, f7: f64, f8: f64, f9: f64) -> Self {
        Self([f1, f2, UPPER_ARM_LENGTH_M * f5, UPPER_ARM_LENGTH_M * f6, f5, f6, f7, f8, f9])
    }

    /// Mass matrix and bias torques at joint angles `angle_rad` and speeds `velocity_rad_s`.
    #[must_use]
    pub fn equations(&self, angle_rad: [f64; 2], velocity_rad_s: [f64; 2], gravity_m_s2: f64) -> EquationsOfMotion {
        let [f1, f2, f3, f4, f5, f6, f7, f8, f9] = self.0;
        let [upper_velocity, forearm_velocity] = velocity_rad_s;
        let (upper_sin, upper_cos) = angle_rad[0].sin_cos();
        let (elbow_sin, elbow_cos) = angle_rad[1].sin_cos();
        // The angle-sum formulas cost four multiplications where a third sin_cos would cost ten times as much.
        let forearm_sin = upper_sin * elbow_cos + upper_cos * elbow_sin;
        let forearm_cos = upper_cos * elbow_cos - upper_sin * elbow_sin;

        let coupling = f3 * elbow_cos - f4 * elbow_sin;
        let speed_coupling = f3 * elbow_sin + f4 * elbow_cos;
        let forearm_weight = gravity_m_s2 * (f6 * forearm_sin - f5 * forearm_cos);
        let upper_weight = gravity_m_s2 * (f8 * upper_sin - f9 * upper_cos);
        EquationsOfMotion {
            mass_kg_m2: [[f7 + 2.0 * coupling, f2 + coupling], [f2 + coupling, f1]],
            bias_nm: [
                -speed_coupling * forearm_velocity * (forearm_velocity + 2.0 * upper_velocity)
                    + forearm_weight
                    + upper_weight,
                speed_coupling * upper_velocity * upper_velocity + forearm_weight,
            ],
        }
    }

    /// Potential energy in joules, zero where both links' weights have no lever.
    #[must_use]
    pub fn potential_energy_j(&self, angle_rad: [f64; 2], gravity_m_s2: f64) -> f64 {
        let [_, _, _, _, f5, f6, _, f8, f9] = self.0;
        let (upper_sin, upper_cos) = angle_rad[0].sin_cos();
        let (forearm_sin, forearm_cos) = (angle_rad[0] + angle_rad[1]).sin_cos();
        -gravity_m_s2 * (f5 * forearm_sin + f6 * forearm_cos + f8 * upper_cos + f9 * upper_sin)
    }

    /// Whether an arm with these parameters can exist as far as its inertia goes: `f1 > f2 >= 0`, and the mass
    /// matrix positive definite at every elbow angle.
    #[must_use]
    pub fn is_physical(&self) -> bool {
        let [f1, f2, f3, f4, _, _, f7, _, _] = self.0;
        // The elbow angle enters only through the coupling, which lies in [-reach, reach]. The determinant is a
        // downward parabola in it, so its least value lies at one of the two ends.
        let reach = f3.hypot(f4);
        let definite = [-reach, reach].iter().all(|coupling| {
            let upper = f7 + 2.0 * coupling;
            upper > 0.0 && f1 * upper - (f2 + coupling).powi(2) > 0.0
        });
        f1 > f2 && f2 >= 0.0 && definite
    }

    /// The arm after it gripped a load of `mass_kg` at `(x_m, y_m)` in the forearm's frame, with `inertia_kg_m2`
    /// about the load's own centre. Source: design.md §6.
    #[must_use]
    pub fn with_load(&self, mass_kg: f64, x_m: f64, y_m: f64, inertia_kg_m2: f64) -> Self {
        let [f1, f2, f3, f4, f5, f6, f7, f8, f9] = self.0;
        let about_elbow = inertia_kg_m2 + mass_kg * (x_m * x_m + y_m * y_m);
        Self([
            f1 + about_elbow,
            f2 + about_elbow,
            f3 + mass_kg * x_m * UPPER_ARM_LENGTH_M,
            f4 + mass_kg * y_m * UPPER_ARM_LENGTH_M,
            f5 + mass_kg * x_m,
            f6 + mass_kg * y_m,
            f7 + mass_kg * UPPER_ARM_LENGTH_M.powi(2) + about_elbow,
            f8,
            f9 + mass_kg * UPPER_ARM_LENGTH_M,
        ])
    }
}

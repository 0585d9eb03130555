//! What is known of a load before its rows: mass, centre and inertia, and how the numbers that f is linear in follow them.

use super::LoadSettings;
use super::bundle::LOAD_UNKNOWNS;
use crate::arm::Load;

/// Standard deviation that stands for "known": in kg, m or kg m². Small against every other, large against rounding.
pub const KNOWN: f64 = 1e-4;

/// Mass, centre and inertia as they are expected, and the inverse of their variances.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// Means.
    pub mean: [f64; LOAD_UNKNOWNS],
    /// Standard deviations.
    pub deviation: [f64; LOAD_UNKNOWNS],
    /// Inverse of the variances.
    pub information: [f64; LOAD_UNKNOWNS],
}

impl Prior {
    /// Of a load that is known.
    pub fn known(load: &Load<f32>) -> Self {
        let deviation = [KNOWN; LOAD_UNKNOWNS];
        Self { mean: physical(load), deviation, information: deviation.map(|deviation| 1.0 / (deviation * deviation)) }
    }

    /// Of a load that is to be found.
    pub fn new(settings: &LoadSettings) -> Self {
        let centre = f64::from(settings.centre_standard_error_m).max(KNOWN);
        let inertia = f64::from(settings.inertia_standard_error_kg_m2).max(KNOWN);
        // Any mass is as likely as any other, so wide that it decides nothing.
        let deviation = [10.0 * f64::from(settings.maximum_kg), centre, centre, inertia];
        Self {
            mean: [
                0.5 * f64::from(settings.maximum_kg),
                f64::from(settings.centre_m[0]),
                f64::from(settings.centre_m[1]),
                f64::from(settings.inertia_kg_m2),
            ],
            deviation,
            information: deviation.map(|deviation| 1.0 / (deviation * deviation)),
        }
    }

    /// The same with so much weight beside the rows.
    pub fn weighted(self, weight: f64) -> Self {
        Self { information: self.information.map(|information| weight * information), ..self }
    }
}

/// Mass, centre and inertia of a load.
pub fn physical(load: &Load<f32>) -> [f64; LOAD_UNKNOWNS] {
    [load.mass_kg, load.centre_m[0], load.centre_m[1], load.inertia_kg_m2].map(f64::from)
}

/// How [`linear_load`] moves with mass, centre and inertia: rows by the former, columns by the latter.
#[inline(never)]
pub fn gradient(load: &Load<f32>) -> [[f64; LOAD_UNKNOWNS]; LOAD_UNKNOWNS] {
    let [mass, x, y, _] = physical(load);
    [
        [1.0, 0.0, 0.0, 0.0],
        [x, mass, 0.0, 0.0],
        [y, 0.0, mass, 0.0],
        [x * x + y * y, 2.0 * mass * x, 2.0 * mass * y, 1.0],
    ]
}

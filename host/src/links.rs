//! Masses, centres and inertias of the links: what f1..f9 they give, whether any within bounds give an f, and the nearest
//! f that some give.
//!
//! Formulae of f (the paper's, its misprints resolved: `Jm2` belongs to joint 2 and `Jm3` to joint 3, `Izz2` occurs once):
//! ```text
//! f1 = Jm3 k3² + f2       f2 = Izz3 + m3 (x3² + y3²)      f3 = m3 x3 a3   f4 = m3 y3 a3   f5 = m3 x3   f6 = m3 y3
//! f7 = Jm2 k2² + Izz2 + m2 (x2² + y2²) + m3 a3² + f2      f8 = m2 y2      f9 = m2 x2 + m3 a3
//! ```

mod file;
mod nearest;

use std::path::Path;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use shared::arm::PARAMETERS;

use crate::file_error::FileError;
use crate::model::Model;
use crate::robot::Robot;

pub use nearest::{Nearest, nearest};

/// Least and greatest value.
pub type Bounds = [f64; 2];

/// What is known of one link and its motor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkBounds {
    /// Mass in kg, above 0.
    pub mass_kg: Bounds,
    /// Centre of mass along the link's x axis in m.
    pub centre_x_m: Bounds,
    /// Centre of mass along the link's y axis in m.
    pub centre_y_m: Bounds,
    /// Inertia about the centre of mass in kg m², 0 or above.
    pub inertia_kg_m2: Bounds,
    /// Inertia of the motor's rotor in kg m², 0 or above.
    pub motor_inertia_kg_m2: Bounds,
}

/// What is known of the arm's links: index 0 is the upper arm, 1 the forearm with all it carries.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmBounds {
    /// Length of the upper arm, a3, in m.
    pub upper_arm_m: f64,
    /// The links.
    pub links: [LinkBounds; 2],
    /// Gear ratios of the two motors.
    pub gear_ratios: [f64; 2],
    /// Names of the joints that the links turn about, which are the links' own.
    pub joints: [String; 2],
}

/// One link with its motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Mass in kg.
    pub mass_kg: f64,
    /// Centre of mass in m.
    pub centre_m: [f64; 2],
    /// Inertia about the centre of mass in kg m².
    pub inertia_kg_m2: f64,
    /// Inertia of the motor's rotor in kg m².
    pub motor_inertia_kg_m2: f64,
}

/// A bound that no links can keep to if they are to give an f.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// What is bounded, in words.
    pub quantity: String,
    /// Its value in the links that break least.
    pub value: f64,
    /// Its bounds.
    pub bounds: Bounds,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.bounds;
        write!(formatter, "{} would be {:.4}, outside {low} to {high}", self.quantity, self.value)
    }
}

/// How finely masses are tried in a search for links: steps along each mass, and how often the neighbourhood of the best
/// is searched again, each time this much smaller.
const MASS_STEPS: usize = 60;
const REFINEMENTS: usize = 8;
const REFINEMENT: f64 = 0.1;

/// A violation below this share of the bounds' width is rounding.
const ROUNDING_SHARE: f64 = 1e-6;

impl ArmBounds {
    /// Reads bounds: `upper_arm_m` and a table for each link, `[link_2]` and `[link_3]` where the joints are called 2 and 3;
    /// each quantity with its `[least, greatest]`.
    pub fn read(path: &Path, robot: &Robot) -> Result<Self, FileError> {
        file::read(path, robot)
    }

    /// The range of each f over all links within bounds: exact, for in no f do two terms pull one quantity apart.
    pub fn ranges(&self) -> [Bounds; PARAMETERS] {
        let [upper, fore] = &self.links;
        let a3 = self.upper_arm_m;
        let times = |range: Bounds, factor: f64| range.map(|value| value * factor);
        let motor = |link: usize| times(self.links[link].motor_inertia_kg_m2, self.gear_ratios[link].powi(2));
        let f2 = fore.about_joint();
        let f5 = product(fore.mass_kg, fore.centre_x_m);
        let f6 = product(fore.mass_kg, fore.centre_y_m);
        let beyond = times(fore.mass_kg, a3 * a3);
        [
            sum([motor(1), f2]),
            f2,
            times(f5, a3),
            times(f6, a3),
            f5,
            f6,
            sum([sum([motor(0), upper.about_joint()]), sum([beyond, f2])]),
            product(upper.mass_kg, upper.centre_y_m),
            sum([product(upper.mass_kg, upper.centre_x_m), times(fore.mass_kg, a3)]),
        ]
    }

    /// The f that `links` give.
    pub fn f(&self, links: &[Link; 2]) -> [f64; PARAMETERS] {
        let a3 = self.upper_arm_m;
        let [upper, fore] = links;
        let motor = |link: usize| links[link].motor_inertia_kg_m2 * self.gear_ratios[link].powi(2);
        let f2 = fore.about_joint();
        let [f5, f6] = fore.centre_m.map(|centre| fore.mass_kg * centre);
        [
            motor(1) + f2,
            f2,
            a3 * f5,
            a3 * f6,
            f5,
            f6,
            motor(0) + upper.about_joint() + fore.mass_kg * a3 * a3 + f2,
            upper.mass_kg * upper.centre_m[1],
            upper.mass_kg * upper.centre_m[0] + fore.mass_kg * a3,
        ]
    }

    /// The links that give `f` and break the bounds least, and what they break; the ties of f3 and f4 are not looked at.
    ///
    /// Given both masses and motor 2's inertia, f decides everything else. The inertia is taken so that link 2's own is
    /// within its bounds if it can be; the masses are tried on a grid, then ever more finely around the best.
    pub fn links_of(&self, f: &[f64; PARAMETERS]) -> ([Link; 2], Vec<Violation>) {
        let [upper, fore] = self.links.map(|link| link.mass_kg);
        let mut centre = [0.5 * (upper[0] + upper[1]), 0.5 * (fore[0] + fore[1])];
        let mut reach = [0.5 * (upper[1] - upper[0]), 0.5 * (fore[1] - fore[0])];
        let mut best = (f64::INFINITY, self.links_with(f, centre));
        for _ in 0..=REFINEMENTS {
            let around = centre;
            for i in 0..=MASS_STEPS {
                for j in 0..=MASS_STEPS {
                    let at = |step: usize| 2.0 * step as f64 / MASS_STEPS as f64 - 1.0;
                    let mass = [
                        (around[0] + at(i) * reach[0]).clamp(upper[0], upper[1]),
                        (around[1] + at(j) * reach[1]).clamp(fore[0], fore[1]),
                    ];
                    let links = self.links_with(f, mass);
                    let broken: f64 = self.excesses(&links).iter().map(|(_, excess)| excess).sum();
                    if broken < best.0 {
                        best = (broken, links);
                        centre = mass;
                    }
                }
            }
            reach = reach.map(|reach| REFINEMENT * reach);
        }
        (best.1, self.violations(&best.1))
    }

    /// The bounds that `links` break, by more than rounding.
    pub fn violations(&self, links: &[Link; 2]) -> Vec<Violation> {
        let broken = self.excesses(links).into_iter().filter(|(_, excess)| *excess > ROUNDING_SHARE);
        broken.map(|(violation, _)| violation).collect()
    }

    /// The links of these masses (upper arm, forearm) that give `f`.
    fn links_with(&self, f: &[f64; PARAMETERS], mass_kg: [f64; 2]) -> [Link; 2] {
        let [f1, f2, _, _, f5, f6, f7, f8, f9] = *f;
        let [m2, m3] = mass_kg;
        let a3 = self.upper_arm_m;
        let fore_centre = [f5 / m3, f6 / m3];
        let upper_centre = [(f9 - m3 * a3) / m2, f8 / m2];
        let own = |about_joint: f64, mass: f64, [x, y]: [f64; 2]| about_joint - mass * (x * x + y * y);
        // What the upper arm's own inertia and its motor's share.
        let shared = own(f7 - f2 - m3 * a3 * a3, m2, upper_centre);
        let [k2, k3] = self.gear_ratios;
        let [low, high] = self.links[0].motor_inertia_kg_m2;
        let [least, most] = self.links[0].inertia_kg_m2;
        // The middle of what leaves the inertia within bounds, as far as the motor's bounds allow.
        let motor = (0.5 * ((shared - most) + (shared - least)) / (k2 * k2)).clamp(low, high);
        [
            Link {
                mass_kg: m2,
                centre_m: upper_centre,
                inertia_kg_m2: shared - motor * k2 * k2,
                motor_inertia_kg_m2: motor,
            },
            Link {
                mass_kg: m3,
                centre_m: fore_centre,
                inertia_kg_m2: own(f2, m3, fore_centre),
                motor_inertia_kg_m2: (f1 - f2) / (k3 * k3),
            },
        ]
    }

    /// How far each quantity of `links` is outside its bounds, as a share of their width.
    fn excesses(&self, links: &[Link; 2]) -> Vec<(Violation, f64)> {
        let mut excesses = Vec::with_capacity(10);
        for (index, (link, bounds)) in links.iter().zip(&self.links).enumerate() {
            let quantities = [
                ("mass of link", link.mass_kg, bounds.mass_kg, "kg"),
                ("centre x of link", link.centre_m[0], bounds.centre_x_m, "m"),
                ("centre y of link", link.centre_m[1], bounds.centre_y_m, "m"),
                ("inertia of link", link.inertia_kg_m2, bounds.inertia_kg_m2, "kg m²"),
                ("inertia of motor", link.motor_inertia_kg_m2, bounds.motor_inertia_kg_m2, "kg m²"),
            ];
            for (name, value, [low, high], unit) in quantities {
                let width = (high - low).max(1e-3 * high.abs().max(low.abs())).max(f64::MIN_POSITIVE);
                let excess = (low - value).max(value - high).max(0.0) / width;
                let quantity = format!("{name} {} ({unit})", self.joints[index]);
                excesses.push((Violation { quantity, value, bounds: [low, high] }, excess));
            }
        }
        excesses
    }
}

impl Link {
    /// Inertia about the link's joint in kg m².
    pub fn about_joint(&self) -> f64 {
        let [x, y] = self.centre_m;
        self.inertia_kg_m2 + self.mass_kg * (x * x + y * y)
    }
}

impl LinkBounds {
    fn about_joint(&self) -> Bounds {
        let distance2 = sum([square(self.centre_x_m), square(self.centre_y_m)]);
        sum([self.inertia_kg_m2, product(self.mass_kg, distance2)])
    }
}

fn sum(ranges: [Bounds; 2]) -> Bounds {
    [ranges[0][0] + ranges[1][0], ranges[0][1] + ranges[1][1]]
}

fn product(a: Bounds, b: Bounds) -> Bounds {
    let corners = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
    [corners.iter().copied().fold(f64::INFINITY, f64::min), corners.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
}

fn square([low, high]: Bounds) -> Bounds {
    let most = low.abs().max(high.abs()).powi(2);
    let least = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()).powi(2) };
    [least, most]
}

/// How exactly each f of `model` is known, as the inverse of a covariance; without standard errors every f counts by its own
/// size.
pub fn information(model: &Model) -> DMatrix<f64> {
    let deviation = |index: usize| match model.f_standard_error {
        Some(errors) if errors[index] > 0.0 && errors[index].is_finite() => errors[index],
        _ => 0.01 * model.f[index].abs().max(0.1),
    };
    DMatrix::from_fn(PARAMETERS, PARAMETERS, |i, j| if i == j { deviation(i).powi(-2) } else { 0.0 })
}

#[cfg(test)]
mod tests;

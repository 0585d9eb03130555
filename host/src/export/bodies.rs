//! Masses, centres and inertias of links that give a model's f.
//!
//! f leaves them open: seven numbers of a planar arm do not make ten. What is open is chosen here by stated rules, so that
//! the links are some that real matter could have, and f comes back from them.

use nalgebra::{DMatrix, DVector};
use shared::arm::PARAMETERS;

use crate::links::{ArmBounds, Link, LinkBounds, information, nearest};
use crate::model::Model;
use crate::robot::{Kind, Robot};

/// What a uniform rod that turns about its end has of m r² in its inertia about that end.
const ROD_SHARE: f64 = 0.75;

/// The most of the upper arm's inertia about its joint that is taken to be its motor's.
const MOST_MOTOR_SHARE: f64 = 0.5;

/// Least inertia of a link about its centre, as a share of f1, where no bounds are given.
const LEAST_INERTIA_SHARE: f64 = 1e-4;

/// Two links with their motors.
#[derive(Clone, Debug, PartialEq)]
pub struct Bodies {
    /// Upper arm and forearm.
    pub links: [Link; 2],
    /// The f that they give: the model's, or the nearest that links can give.
    pub f: [f64; PARAMETERS],
    /// How far that is from the model's, in standard errors.
    pub distance: f64,
    /// Whether bounds said what the links may be; otherwise what f leaves open follows the rules of this module.
    pub bounded: bool,
}

/// Why no links were found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BodiesError {
    /// One axis has no links to tell apart.
    #[error("the robot is a single axis, but links are those of a two-link arm; give a robot file of one")]
    SingleAxis,
    /// The bounds contradict each other.
    #[error("no links keep to all the bounds; widen them (`armid ranges BOUNDS --check MODEL` shows which bind)")]
    NoLinks,
    /// A link would have no extent.
    #[error(
        "the inertia of link {link} about its centre would be {inertia_kg_m2} kg m², but must be above 0; give its \
         inertia_kg_m2 a least value above 0 in the bounds"
    )]
    NoInertia {
        /// Name of the joint that it turns about.
        link: String,
        /// What it would be.
        inertia_kg_m2: f64,
    },
}

/// Links that give the f of `model`, or the nearest f that links within `bounds` can give.
pub fn bodies(model: &Model, robot: &Robot, bounds: Option<&ArmBounds>) -> Result<Bodies, BodiesError> {
    if robot.kind == Kind::SingleAxis {
        return Err(BodiesError::SingleAxis);
    }
    let within = bounds.cloned().unwrap_or_else(|| anything_real(model, robot));
    let information = information(model);
    let links_with = |f: &[f64; PARAMETERS]| match bounds {
        Some(bounds) => bounds.links_of(f),
        None => {
            let links = rod_like(f, &within);
            let violations = within.violations(&links);
            (links, violations)
        }
    };
    // Most often the ties of f3 and f4 are all that is broken, and what mends them is exact; a solver is not.
    let tied = tied(&model.f, within.upper_arm_m, &information);
    let (mut links, violations) = links_with(&tied);
    if !violations.is_empty() {
        links = nearest(&within, &model.f, &information).ok_or(BodiesError::NoLinks)?.links;
    }
    for (index, link) in links.iter().enumerate() {
        let inertia_kg_m2 = link.inertia_kg_m2;
        if !(inertia_kg_m2 > 0.0 && inertia_kg_m2.is_finite()) {
            return Err(BodiesError::NoInertia { link: within.joints[index].clone(), inertia_kg_m2 });
        }
    }
    let f = within.f(&links);
    let off = DVector::from_iterator(PARAMETERS, f.iter().zip(model.f).map(|(found, given)| found - given));
    let distance = off.dot(&(&information * &off)).max(0.0).sqrt();
    Ok(Bodies { links, f, distance, bounded: bounds.is_some() })
}

/// The f nearest to `f` in the metric of the diagonal of `information` that keeps f3 = a3 f5 and f4 = a3 f6.
fn tied(f: &[f64; PARAMETERS], upper_arm_m: f64, information: &DMatrix<f64>) -> [f64; PARAMETERS] {
    let mut tied = *f;
    for (coupling, moment) in [(2, 4), (3, 5)] {
        let variance = |index: usize| 1.0 / information[(index, index)];
        let broken = f[coupling] - upper_arm_m * f[moment];
        let share = broken / (variance(coupling) + upper_arm_m * upper_arm_m * variance(moment));
        tied[moment] += share * upper_arm_m * variance(moment);
        tied[coupling] = upper_arm_m * tied[moment];
    }
    tied
}

/// Bounds that hardly bound, around the size of the arm: positive masses and inertias.
fn anything_real(model: &Model, robot: &Robot) -> ArmBounds {
    let upper_arm_m = robot.upper_arm_m;
    let mass_kg = model.f[6] / (upper_arm_m * upper_arm_m);
    let reach = [-5.0 * upper_arm_m, 5.0 * upper_arm_m];
    let gear_ratios: [f64; 2] =
        std::array::from_fn(|joint| robot.joints.get(joint).map_or(1.0, |joint| joint.gear_ratio));
    let link = |joint: usize| LinkBounds {
        mass_kg: [1e-3 * mass_kg, 10.0 * mass_kg],
        centre_x_m: reach,
        centre_y_m: reach,
        inertia_kg_m2: [LEAST_INERTIA_SHARE * model.f[0], 10.0 * model.f[6]],
        motor_inertia_kg_m2: [0.0, 2.0 * model.f[0].max(model.f[6]) / gear_ratios[joint].powi(2)],
    };
    let joints =
        std::array::from_fn(|joint| robot.joints.get(joint).map_or_else(String::new, |joint| joint.name.clone()));
    ArmBounds { upper_arm_m, links: [link(0), link(1)], gear_ratios, joints }
}

/// Of the links that give `f`, those most like uniform rods, motor 2 being like motor 3.
fn rod_like(f: &[f64; PARAMETERS], bounds: &ArmBounds) -> [Link; 2] {
    let [f1, f2, _, _, f5, f6, f7, f8, f9] = *f;
    let a3 = bounds.upper_arm_m;
    let [k2, k3] = bounds.gear_ratios.map(|ratio| ratio * ratio);
    let least_inertia = bounds.links[1].inertia_kg_m2[0];
    // Lighter, the forearm's centre would be so far out that its own inertia is below the least; heavier, nothing of f7 is
    // left for the upper arm.
    let lightest = (f5 * f5 + f6 * f6) / (f2 - least_inertia).max(f64::MIN_POSITIVE);
    let heaviest = (f7 - f2 - least_inertia) / (a3 * a3);
    let m3 = rod_mass(f5 * f5 + f6 * f6, f2, a3).min(0.5 * (lightest + heaviest)).max(lightest);
    let fore = Link {
        mass_kg: m3,
        centre_m: [f5 / m3, f6 / m3],
        inertia_kg_m2: f2 - (f5 * f5 + f6 * f6) / m3,
        motor_inertia_kg_m2: ((f1 - f2) / k3).max(0.0),
    };
    let shared = f7 - f2 - m3 * a3 * a3;
    let motor = fore.motor_inertia_kg_m2.min(MOST_MOTOR_SHARE * shared / k2);
    let about_joint = shared - motor * k2;
    let [px, py] = [f9 - m3 * a3, f8];
    let m2 = rod_mass(px * px + py * py, about_joint, a3);
    let upper = Link {
        mass_kg: m2,
        centre_m: [px / m2, py / m2],
        inertia_kg_m2: about_joint - (px * px + py * py) / m2,
        motor_inertia_kg_m2: motor,
    };
    [upper, fore]
}

/// Mass of a uniform rod with this first moment squared and this inertia about its end; never so light that its radius of
/// gyration exceeds the length of the upper arm.
fn rod_mass(moment2: f64, about_joint: f64, upper_arm_m: f64) -> f64 {
    (moment2 / (ROD_SHARE * about_joint)).max(about_joint / (upper_arm_m * upper_arm_m))
}

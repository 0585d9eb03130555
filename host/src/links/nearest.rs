//! The nearest f that links within bounds give.
//!
//! f is linear in m, m x, m y, the inertias about the joints and the motors' inertias. In those, bounds on masses and
//! centres are linear, and a link's own inertia J − m r² ≥ least is a cone. Only its upper bound is not convex: it is
//! replaced by its tangent, which lies inside, at the last solution, until that stays (convex-concave procedure).

use nalgebra::{DMatrix, DVector};
use shared::arm::PARAMETERS;

use super::{ArmBounds, Link};
use crate::convex::{Cone, Row, minimise};

/// Unknowns of a link: m, m x, m y, J about its joint, Jm.
const PER_LINK: usize = 5;
const UNKNOWNS: usize = 2 * PER_LINK;

/// Tangents after which a solution that still moves is taken.
const ROUNDS: usize = 100;

/// Relative change of the cost at which the tangents stay.
const CONVERGED: f64 = 1e-7;

/// The nearest f within bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// f1..f9.
    pub f: [f64; PARAMETERS],
    /// How far it is from the f it was sought for, in standard errors (Mahalanobis distance).
    pub distance: f64,
    /// Links that give it.
    pub links: [Link; 2],
}

/// The f that links within `bounds` give, nearest to `f` in the metric of `information`, the inverse of the covariance of
/// f. Nothing where the bounds leave no links at all.
pub fn nearest(bounds: &ArmBounds, f: &[f64; PARAMETERS], information: &DMatrix<f64>) -> Option<Nearest> {
    let map = map(bounds);
    let target = DVector::from_column_slice(f);
    let scale = information.diagonal().max().max(f64::MIN_POSITIVE);
    let weight = information / scale;
    let quadratic = map.transpose() * &weight * &map;
    let linear = -(map.transpose() * &weight * &target);
    let (rows, cones) = constraints(bounds);
    let mut best = minimise(&quadratic, &linear, &rows, &cones)?;
    let within = |solution: &[f64]| {
        let most = |link: usize| bounds.links[link].inertia_kg_m2[1];
        (0..2).all(|link| own_inertia(solution, link) <= most(link) * (1.0 + 1e-7) + 1e-9)
    };
    // Without tangents it is the best of all; with them, the best once they stay.
    if !within(&best) {
        let mut before = f64::INFINITY;
        for _ in 0..ROUNDS {
            let tangents = (0..2).map(|link| tangent(bounds, &best, link));
            let rows: Vec<Row> = rows.iter().cloned().chain(tangents).collect();
            // Where the tangents leave nothing, those at the links that have most room do, if anything does.
            best = minimise(&quadratic, &linear, &rows, &cones).unwrap_or_else(|| roomiest(bounds));
            let at = DVector::from_column_slice(&best);
            let cost = 0.5 * at.dot(&(&quadratic * &at)) + linear.dot(&at) + 0.5 * target.dot(&(&weight * &target));
            if (before - cost).abs() <= CONVERGED * cost.abs() {
                break;
            }
            before = cost;
        }
    }
    let links = [0, 1].map(|link| {
        let [mass_kg, x, y, about_joint, motor_inertia_kg_m2] = unknowns(&best, link);
        Link {
            mass_kg,
            centre_m: [x / mass_kg, y / mass_kg],
            inertia_kg_m2: about_joint - (x * x + y * y) / mass_kg,
            motor_inertia_kg_m2,
        }
    });
    let found = &map * DVector::from_vec(best);
    let off = &found - &target;
    let distance = (off.transpose() * information * &off)[0].max(0.0).sqrt();
    Some(Nearest { f: std::array::from_fn(|index| found[index]), distance, links })
}

/// f as a linear map of the unknowns.
fn map(bounds: &ArmBounds) -> DMatrix<f64> {
    let a3 = bounds.upper_arm_m;
    let [motor2, motor3] = bounds.gear_ratios.map(|ratio| ratio * ratio);
    // Columns: m2, m2x2, m2y2, J2, Jm2, m3, m3x3, m3y3, J3, Jm3.
    DMatrix::from_row_slice(
        PARAMETERS,
        UNKNOWNS,
        &[
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, motor3],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, a3, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, a3, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, motor2, a3 * a3, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0, 0.0, a3, 0.0, 0.0, 0.0, 0.0],
        ]
        .concat(),
    )
}

/// A row with these weights on the unknowns of one link.
fn row(link: usize, weights: [f64; PER_LINK], limit: f64) -> Row {
    let mut all = vec![0.0; UNKNOWNS];
    all[PER_LINK * link..PER_LINK * (link + 1)].copy_from_slice(&weights);
    (all, limit)
}

fn constraints(bounds: &ArmBounds) -> (Vec<Row>, Vec<Cone>) {
    let (mut rows, mut cones) = (Vec::new(), Vec::new());
    for (link, known) in bounds.links.iter().enumerate() {
        let mut between = |weights: [f64; PER_LINK], [low, high]: [f64; 2]| {
            rows.push(row(link, weights, high));
            rows.push(row(link, weights.map(|weight| -weight), -low));
        };
        between([1.0, 0.0, 0.0, 0.0, 0.0], known.mass_kg);
        between([0.0, 0.0, 0.0, 0.0, 1.0], known.motor_inertia_kg_m2);
        for (axis, [low, high]) in [known.centre_x_m, known.centre_y_m].into_iter().enumerate() {
            let moment = |sign: f64, limit: f64| {
                let mut weights = [0.0; PER_LINK];
                weights[0] = -sign * limit;
                weights[1 + axis] = sign;
                row(link, weights, 0.0)
            };
            rows.push(moment(1.0, high));
            rows.push(moment(-1.0, low));
        }
        // (J − least) m ≥ |m r|²: (J − least) + m is at least the length of (2 m x, 2 m y, (J − least) − m).
        let least = known.inertia_kg_m2[0];
        cones.push(vec![
            row(link, [-1.0, 0.0, 0.0, -1.0, 0.0], -least),
            row(link, [0.0, -2.0, 0.0, 0.0, 0.0], 0.0),
            row(link, [0.0, 0.0, -2.0, 0.0, 0.0], 0.0),
            row(link, [1.0, 0.0, 0.0, -1.0, 0.0], -least),
        ]);
    }
    (rows, cones)
}

fn unknowns(solution: &[f64], link: usize) -> [f64; PER_LINK] {
    std::array::from_fn(|index| solution[PER_LINK * link + index])
}

fn own_inertia(solution: &[f64], link: usize) -> f64 {
    let [mass, x, y, about_joint, _] = unknowns(solution, link);
    about_joint - (x * x + y * y) / mass
}

/// J − (the tangent of |m r|²/m at `solution`) ≤ greatest own inertia.
fn tangent(bounds: &ArmBounds, solution: &[f64], link: usize) -> Row {
    let [mass, x, y, _, _] = unknowns(solution, link);
    let (x, y) = (x / mass, y / mass);
    row(link, [x * x + y * y, -2.0 * x, -2.0 * y, 1.0, 0.0], bounds.links[link].inertia_kg_m2[1])
}

/// The heaviest links with their centres as far out as bounds allow.
fn roomiest(bounds: &ArmBounds) -> Vec<f64> {
    let far = |[low, high]: [f64; 2]| if low.abs() > high.abs() { low } else { high };
    let of = |link: usize| {
        let known = &bounds.links[link];
        let mass = known.mass_kg[1];
        let (x, y) = (far(known.centre_x_m), far(known.centre_y_m));
        let about_joint = known.inertia_kg_m2[1] + mass * (x * x + y * y);
        [mass, mass * x, mass * y, about_joint, known.motor_inertia_kg_m2[1]]
    };
    [of(0), of(1)].concat()
}

//! What f1..f9 and friction of a real machine keep to, as linear bounds that a fit can stay within.
//!
//! f1 > f2 ≥ 0 (f1 − f2 is a motor's inertia), friction ≥ 0, and an inertia matrix that is positive definite for every
//! q3. The last is convex as well: D is linear in f, so each direction u and each q3 give one linear bound
//! uᵀ D(q3) u > 0, and a set of values breaks the one of its own weakest direction.

use shared::arm::{Arm, Pose};

use super::least_squares::Bound;
use super::parameters::{Parameter, Values};
use crate::robot::{Kind, Robot};

/// Least f1 − f2, least eigenvalue of D and least mass, in kg m² (kg): above rounding, below any motor.
const LEAST_INERTIA: f64 = 1e-6;

/// A bound on values: the value of a linear function, and its name.
struct Limit {
    name: String,
    function: Box<dyn Fn(&Values) -> f64>,
    least: f64,
}

/// The bounds of `free` that `values` break.
pub fn broken_bounds(robot: &Robot, values: &Values, free: &[Parameter]) -> Vec<Bound> {
    let slack = |limit: &Limit| (limit.function)(values) - limit.least;
    limits(robot, values).iter().filter(|limit| slack(limit) < 0.0).map(|limit| bound(limit, values, free)).collect()
}

/// The names of the bounds that `values` lie on.
pub fn touched_bounds(robot: &Robot, values: &Values) -> Vec<String> {
    let near = |limit: &Limit| (limit.function)(values) - limit.least < 10.0 * limit.least.max(1e-9);
    limits(robot, values).into_iter().filter(|limit| near(limit)).map(|limit| limit.name).collect()
}

fn bound(limit: &Limit, values: &Values, free: &[Parameter]) -> Bound {
    let zero = values.with(free, &vec![0.0; free.len()]);
    let rest = (limit.function)(&zero);
    let weight = |parameter: &Parameter| (limit.function)(&zero.with(&[*parameter], &[1.0])) - rest;
    // A little inside, or the solver's tolerance would leave the step outside.
    let inside = limit.least + 1e-3 * limit.least.max(1e-9);
    Bound { weights: free.iter().map(weight).collect(), least: inside - rest }
}

fn limits(robot: &Robot, values: &Values) -> Vec<Limit> {
    let limit = |name: String, least: f64, function: Box<dyn Fn(&Values) -> f64>| Limit { name, function, least };
    let mut limits = Vec::new();
    for (index, joint) in robot.joints.iter().enumerate() {
        let name = &joint.name;
        limits.push(limit(
            format!("viscous friction {name} ≥ 0"),
            0.0,
            Box::new(move |v| v.viscous_nm_s_per_rad[index]),
        ));
        limits.push(limit(format!("Coulomb friction {name} ≥ 0"), 0.0, Box::new(move |v| v.coulomb_nm[index])));
    }
    match robot.kind {
        Kind::SingleAxis => limits.push(limit("mass > 0".into(), LEAST_INERTIA, Box::new(|v| v.f[6]))),
        Kind::TwoLink => {
            limits.push(limit("f2 ≥ 0".into(), 0.0, Box::new(|v| v.f[1])));
            limits.push(limit("f1 > f2".into(), LEAST_INERTIA, Box::new(|v| v.f[0] - v.f[1])));
            let (u, q3_rad) = weakest_direction(&values.arm(robot));
            let stiffness = move |v: &Values| {
                let arm = Arm { f: v.f, gravity_m_s2: 0.0 };
                let moved = arm.inertia(&Pose::at([0.0, q3_rad])).times(u);
                u[0] * moved[0] + u[1] * moved[1]
            };
            limits.push(limit("D > 0 for every q3".into(), LEAST_INERTIA, Box::new(stiffness)));
        }
    }
    limits
}

/// The direction of joint velocities in which D is least, over all q3, and that q3.
///
/// The coupling f3 c3 − f4 s3 lies between ±√(f3² + f4²), and the least eigenvalue of D is concave in it: it is least at
/// an end.
fn weakest_direction(arm: &Arm<f64>) -> ([f64; 2], f64) {
    let phase = arm.f[3].atan2(arm.f[2]);
    let at = |q3_rad: f64| {
        let d = arm.inertia(&Pose::at([0.0, q3_rad]));
        let middle = 0.5 * (d.d11 + d.d22);
        let least = middle - (0.5 * (d.d11 - d.d22)).hypot(d.d12);
        // (D − least) u = 0: the row that is larger says more.
        let (a, b) = (d.d11 - least, d.d22 - least);
        let u = if a > b { [-d.d12, a] } else { [b, -d.d12] };
        let length = u[0].hypot(u[1]).max(f64::MIN_POSITIVE);
        (least, [u[0] / length, u[1] / length], q3_rad)
    };
    let (one, other) = (at(-phase), at(std::f64::consts::PI - phase));
    let weakest = if one.0 < other.0 { one } else { other };
    (weakest.1, weakest.2)
}

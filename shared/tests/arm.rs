//! The arm's equations are those of rigid bodies: Christoffel symbols, skew symmetry, potential, and a Newton–Euler
//! recursion with real masses, motors and loads; and the check of D for every q3 is exact.

mod robot;

use core::f64::consts::PI;

use proptest::prelude::*;
use robot::{GRAVITY, PAPER_F, Random, largest};
use shared::arm::{Arm, ArmError, Load, PARAMETERS, PUMA_UPPER_ARM_M, Pose, REFERENCE_F, SEARCH_HIGH, SEARCH_LOW};

/// Armstrong's PUMA 560 with the wrist locked (design.md §2).
const ARMSTRONG_F: [f64; PARAMETERS] = [0.9387, 0.3618, 0.0110, -0.3861, 0.0254, -0.8942, 4.4347, -0.1044, 3.7956];

fn arm(f: [f64; PARAMETERS]) -> Arm<f64> {
    Arm { f, gravity_m_s2: GRAVITY }
}

fn inertia(f: [f64; PARAMETERS], q3: f64) -> [[f64; 2]; 2] {
    let d = arm(f).inertia(&Pose::at([0.3, q3]));
    [[d.d11, d.d12], [d.d12, d.d22]]
}

fn determinant(f: [f64; PARAMETERS], q3: f64) -> f64 {
    let d = inertia(f, q3);
    d[0][0] * d[1][1] - d[0][1] * d[1][0]
}

/// ∂D/∂q3 by the five-point rule: its truncation is h⁴/30 of the fifth derivative, its rounding 1e-16/h, both below
/// 1e-12 of D at h = 0.002.
fn inertia_slope(f: [f64; PARAMETERS], q3: f64) -> [[f64; 2]; 2] {
    let h = 0.002;
    let at = |steps: f64| inertia(f, q3 + steps * h);
    let (a, b, c, d) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
    [0, 1].map(|i| [0, 1].map(|j| (a[i][j] - 8.0 * b[i][j] + 8.0 * c[i][j] - d[i][j]) / (12.0 * h)))
}

/// Velocity torque from the Christoffel symbols `c_ijk = ½ (∂D_ij/∂q_k + ∂D_ik/∂q_j − ∂D_jk/∂q_i)`.
fn christoffel_torque(f: [f64; PARAMETERS], q3: f64, v: [f64; 2]) -> [f64; 2] {
    let slope = inertia_slope(f, q3);
    // D does not depend on q2.
    let derivative = |i: usize, j: usize, k: usize| if k == 1 { slope[i][j] } else { 0.0 };
    [0, 1].map(|i| {
        let mut sum = 0.0;
        for j in 0..2 {
            for k in 0..2 {
                let symbol = 0.5 * (derivative(i, j, k) + derivative(i, k, j) - derivative(j, k, i));
                sum += symbol * v[j] * v[k];
            }
        }
        sum
    })
}

/// Any parameters, physical or not: the identities hold for all of them.
fn any_f(random: &mut Random) -> [f64; PARAMETERS] {
    core::array::from_fn(|_| random.between(-5.0, 5.0))
}

#[test]
fn velocity_torque_follows_from_the_christoffel_symbols_of_the_inertia_matrix() {
    let mut random = Random::new(1);
    for _ in 0..500 {
        let (f, q, v) = (any_f(&mut random), random.pair(PI), random.pair(3.0));
        let h = arm(f).velocity_torque_nm(&Pose::at(q), v);
        let expected = christoffel_torque(f, q[1], v);
        for joint in 0..2 {
            // |h| reaches 3·10·9 N m here and the slope is right to 1e-12 of it.
            assert!((h[joint] - expected[joint]).abs() < 1e-9, "{h:?} {expected:?}");
        }
    }
}

#[test]
fn derivative_of_inertia_less_twice_coriolis_is_skew_symmetric() {
    let mut random = Random::new(2);
    for _ in 0..500 {
        let (f, q, v) = (any_f(&mut random), random.pair(PI), random.pair(3.0));
        let pose = Pose::at(q);
        let h = |v| arm(f).velocity_torque_nm(&pose, v);
        // h is a quadratic form of v; its symmetric bilinear form gives C column by column.
        let column = |j: usize| {
            let mut unit = [0.0; 2];
            unit[j] = 1.0;
            let both = h([v[0] + unit[0], v[1] + unit[1]]);
            let (alone, of_unit) = (h(v), h(unit));
            [0, 1].map(|i| 0.5 * (both[i] - alone[i] - of_unit[i]))
        };
        let columns = [column(0), column(1)];
        let slope = inertia_slope(f, q[1]);
        let n = [0, 1].map(|i| [0, 1].map(|j| slope[i][j] * v[1] - 2.0 * columns[j][i]));
        assert!(n[0][0].abs() < 1e-9 && n[1][1].abs() < 1e-9 && (n[0][1] + n[1][0]).abs() < 1e-9, "{n:?}");
    }
}

#[test]
fn gravity_torque_is_the_gradient_of_the_height_of_the_masses() {
    let mut random = Random::new(3);
    for _ in 0..300 {
        let body = Robot::random(&mut random);
        let q = random.pair(PI);
        let g = body.arm().gravity_torque_nm(&Pose::at(q));
        let step = 0.002;
        for joint in 0..2 {
            let potential = |steps: f64| {
                let mut q = q;
                q[joint] += steps * step;
                body.potential_j(q)
            };
            let gradient =
                (potential(-2.0) - 8.0 * potential(-1.0) + 8.0 * potential(1.0) - potential(2.0)) / (12.0 * step);
            // Up to 100 N m, right to 1e-12 of it.
            assert!((g[joint] - gradient).abs() < 1e-9, "{} {gradient}", g[joint]);
        }
    }
}

// An independent Newton–Euler recursion in world coordinates (x forward, z up), written from the conventions alone.

type Vector = [f64; 2];

/// The derivative of a vector turning downward with 1 rad/s.
fn turned([x, z]: Vector) -> Vector {
    [z, -x]
}

fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1]]
}

fn scaled(a: f64, b: Vector) -> Vector {
    [a * b[0], a * b[1]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// A rigid body fixed to a link, in the link's frame.
#[derive(Clone, Copy, Debug)]
struct Body {
    mass: f64,
    centre: Vector,
    inertia: f64,
}

struct Robot {
    upper: Vec<Body>,
    forearm: Vec<Body>,
    /// Jm k² of both motors.
    motors: [f64; 2],
}

impl Robot {
    fn random(random: &mut Random) -> Self {
        let mut body = |mass: f64| Body {
            mass: random.between(0.5, mass),
            centre: random.pair(0.4),
            inertia: random.between(0.01, 0.5),
        };
        let (upper, forearm) = (vec![body(18.0)], vec![body(8.0)]);
        Self { upper, forearm, motors: [random.between(1.0, 5.0), random.between(0.3, 1.5)] }
    }

    /// A vector of a link's frame in the world: at angle 0 the frame's x points forward and its y down, and the
    /// forearm, lying along −y of its frame, straight up.
    fn in_world(angle: f64, [x, y]: Vector) -> Vector {
        let (s, c) = angle.sin_cos();
        [c * x - s * y, -s * x - c * y]
    }

    /// Force and moment about the link's origin that its bodies need.
    fn wrench(bodies: &[Body], angle: f64, omega: f64, alpha: f64, origin_acceleration: Vector) -> (Vector, f64) {
        let mut sum = ([0.0; 2], 0.0);
        for body in bodies {
            let arm = Self::in_world(angle, body.centre);
            let force = scaled(body.mass, Self::moved(arm, omega, alpha, origin_acceleration));
            sum = (add(sum.0, force), sum.1 + body.inertia * alpha + dot(force, turned(arm)));
        }
        sum
    }

    /// Acceleration of a point `arm` away from a turning link's origin.
    fn moved(arm: Vector, omega: f64, alpha: f64, origin_acceleration: Vector) -> Vector {
        add(origin_acceleration, add(scaled(alpha, turned(arm)), scaled(-omega * omega, arm)))
    }

    fn newton_euler(&self, q: [f64; 2], v: [f64; 2], a: [f64; 2]) -> [f64; 2] {
        // Gravity as an upward acceleration of the base.
        let base = [0.0, GRAVITY];
        let elbow_arm = Self::in_world(q[0], [PUMA_UPPER_ARM_M, 0.0]);
        let elbow = Self::moved(elbow_arm, v[0], a[0], base);
        let (force, moment) = Self::wrench(&self.forearm, q[0] + q[1], v[0] + v[1], a[0] + a[1], elbow);
        let (_, own) = Self::wrench(&self.upper, q[0], v[0], a[0], base);
        let shoulder = own + moment + dot(force, turned(elbow_arm));
        [shoulder + self.motors[0] * a[0], moment + self.motors[1] * a[1]]
    }

    fn potential_j(&self, q: [f64; 2]) -> f64 {
        let height = |body: &Body, angle| Self::in_world(angle, body.centre)[1];
        let elbow = Self::in_world(q[0], [PUMA_UPPER_ARM_M, 0.0])[1];
        let upper: f64 = self.upper.iter().map(|b| b.mass * height(b, q[0])).sum();
        let forearm: f64 = self.forearm.iter().map(|b| b.mass * (elbow + height(b, q[0] + q[1]))).sum();
        GRAVITY * (upper + forearm)
    }

    /// f1..f9 by the definitions of design.md §2, for one body a link.
    fn arm(&self) -> Arm<f64> {
        let [upper, forearm] = [self.upper[0], self.forearm[0]];
        let about_joint = |b: Body| b.inertia + b.mass * dot(b.centre, b.centre);
        let a3 = PUMA_UPPER_ARM_M;
        let [x3, y3] = forearm.centre;
        let f2 = about_joint(forearm);
        arm([
            self.motors[1] + f2,
            f2,
            forearm.mass * x3 * a3,
            forearm.mass * y3 * a3,
            forearm.mass * x3,
            forearm.mass * y3,
            self.motors[0] + about_joint(upper) + forearm.mass * a3 * a3 + f2,
            upper.mass * upper.centre[1],
            upper.mass * upper.centre[0] + forearm.mass * a3,
        ])
    }
}

/// Compares two torques relative to the largest term that can appear: states are bounded by 3 rad/s and 10 rad/s².
fn assert_same_torque(found: [f64; 2], expected: [f64; 2], relative: f64) {
    let scale = 1.0 + largest(expected);
    for joint in 0..2 {
        assert!((found[joint] - expected[joint]).abs() <= relative * scale, "{found:?} {expected:?}");
    }
}

#[test]
fn inverse_dynamics_equal_newton_and_euler_on_bodies_with_real_masses_and_motors() {
    let mut random = Random::new(4);
    for _ in 0..400 {
        let robot = Robot::random(&mut random);
        let (q, v, a) = (random.pair(PI), random.pair(3.0), random.pair(10.0));
        let found = robot.arm().inverse_dynamics_nm(q, v, a);
        assert_same_torque(found, robot.newton_euler(q, v, a), 1e-12);
    }
}

#[test]
fn conventions_of_the_joints_are_those_of_the_puma() {
    // One kilogram 0.3 m along the forearm (−y of its frame), a massless upper arm: what gravity asks of the joints.
    let forearm = |f9: f64| arm([1.0, 0.5, 0.0, -0.3 * PUMA_UPPER_ARM_M, 0.0, -0.3, 5.0, 0.0, f9]);
    let g = |q| forearm(PUMA_UPPER_ARM_M).gravity_torque_nm(&Pose::at(q));
    let weight = GRAVITY;
    // q = 0: upper arm horizontal, forearm straight up: only the shoulder carries, and it lifts, so negative.
    assert_same_torque(g([0.0, 0.0]), [-weight * PUMA_UPPER_ARM_M, 0.0], 1e-14);
    // q3 = π/2: in line with the upper arm, so both joints carry the whole reach.
    assert_same_torque(g([0.0, PI / 2.0]), [-weight * (PUMA_UPPER_ARM_M + 0.3), -weight * 0.3], 1e-14);
    // q2 = −π/2: upper arm up; with q3 = π/2 the forearm stands on it.
    assert_same_torque(g([-PI / 2.0, PI / 2.0]), [0.0, 0.0], 1e-14);
}

#[test]
fn load_changes_the_parameters_as_attaching_the_body_changes_newton_and_euler() {
    let mut random = Random::new(5);
    for _ in 0..300 {
        let mut robot = Robot::random(&mut random);
        let (q, v, a) = (random.pair(PI), random.pair(3.0), random.pair(10.0));
        let body = Body { mass: random.between(0.1, 4.0), centre: random.pair(0.6), inertia: random.between(0.0, 0.1) };
        let load = Load { mass_kg: body.mass, centre_m: body.centre, inertia_kg_m2: body.inertia };
        let (mut loaded, delta) = (robot.arm(), load.delta_f(PUMA_UPPER_ARM_M));
        for (f, delta) in loaded.f.iter_mut().zip(delta) {
            *f += delta;
        }
        robot.forearm.push(body);
        assert_same_torque(loaded.inverse_dynamics_nm(q, v, a), robot.newton_euler(q, v, a), 1e-12);
    }
}

#[test]
fn inverse_of_the_inertia_matrix_undoes_it() {
    let mut random = Random::new(6);
    for _ in 0..200 {
        let d = arm(REFERENCE_F).inertia(&Pose::at(random.pair(PI)));
        let vector = random.pair(10.0);
        let back = d.inverse().times(d.times(vector));
        // The condition number of the reference robot's D is below 20.
        assert_same_torque(back, vector, 1e-14);
    }
}

#[test]
fn single_precision_agrees_to_its_rounding() {
    let mut random = Random::new(7);
    let single = Arm { f: REFERENCE_F.map(|f| f as f32), gravity_m_s2: GRAVITY as f32 };
    for _ in 0..500 {
        let (q, v, a) = (random.pair(PI), random.pair(3.0), random.pair(10.0));
        let found = single.inverse_dynamics_nm(q.map(|x| x as f32), v.map(|x| x as f32), a.map(|x| x as f32));
        let expected = arm(REFERENCE_F).inverse_dynamics_nm(q, v, a);
        for joint in 0..2 {
            // Terms up to 150 N m, each with a few roundings of 6e-8.
            assert!((f64::from(found[joint]) - expected[joint]).abs() < 150.0 * 10.0 * 6e-8);
        }
    }
}

#[test]
fn sets_of_the_design_table_are_accepted() {
    for f in [REFERENCE_F, PAPER_F, ARMSTRONG_F] {
        assert_eq!(arm(f).check_inertia(), Ok(()));
    }
}

#[test]
fn misprinted_d11_of_the_paper_would_be_refused() {
    // The paper prints f1 in place of f7 in D11; design.md §2: det D < 0 on half the workspace.
    let mut f = PAPER_F;
    f[6] = f[0];
    assert!(matches!(arm(f).check_inertia(), Err(ArmError::Indefinite { .. })));
    let negative = (0..1000).filter(|&k| determinant(f, f64::from(k) * 2.0 * PI / 1000.0) < 0.0).count();
    assert!((300..=700).contains(&negative), "{negative} of 1000");
}

#[test]
fn parameters_that_are_no_numbers_are_refused_by_their_number() {
    for (index, value) in [(0, f64::NAN), (4, f64::INFINITY), (8, f64::NEG_INFINITY)] {
        let mut f = REFERENCE_F;
        f[index] = value;
        let error = arm(f).check_inertia().unwrap_err();
        assert!(matches!(error, ArmError::NotFinite { number, .. } if number == index + 1));
        assert!(error.to_string().contains(&format!("f{}", index + 1)), "{error}");
    }
}

#[test]
fn forearm_without_inertia_is_refused() {
    for value in [0.0, -1.0] {
        let mut f = REFERENCE_F;
        f[0] = value;
        assert_eq!(arm(f).check_inertia(), Err(ArmError::JointInertia { value }));
    }
}

#[test]
fn parameters_so_large_that_the_determinant_overflows_are_refused() {
    // f1 f7 and f2² both overflow, so their difference is no number.
    let mut f = REFERENCE_F;
    (f[0], f[1], f[6]) = (1e200, 1e200, 1e200);
    assert!(arm(f).check_inertia().is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn check_of_the_inertia_matrix_agrees_with_a_scan_of_every_q3(
        // A little beyond the search range: every sixth set is refused.
        share in prop::array::uniform9(-0.1..1.1),
    ) {
        let f: [f64; PARAMETERS] =
            core::array::from_fn(|i| SEARCH_LOW[i] + share[i] * (SEARCH_HIGH[i] - SEARCH_LOW[i]));
        let scan = (0..720).map(|k| determinant(f, f64::from(k) * PI / 360.0)).fold(f64::INFINITY, f64::min);
        // det D = const + p A − A² with A = R cos(q3 + …): its curvature over q3 is at most |p| R + 2 R², and the
        // least value is at most half a degree from a scanned one.
        let reach = f[2].hypot(f[3]);
        let slack = (2.0 * (f[0] - f[1]).abs() * reach + 2.0 * reach * reach) * (PI / 360.0).powi(2) / 8.0 + 1e-9;
        match arm(f).check_inertia() {
            Ok(()) => prop_assert!(f[0] > 0.0 && scan > 0.0, "accepted, but det D is {scan}"),
            Err(ArmError::JointInertia { value }) => prop_assert!(value == f[0] && value <= 0.0),
            Err(ArmError::Indefinite { determinant: least, q3_rad }) => {
                prop_assert!(least <= 0.0);
                prop_assert!((determinant(f, q3_rad) - least).abs() < 1e-9, "not reached at {q3_rad}");
                prop_assert!(least <= scan + 1e-9 && least >= scan - slack, "{least} is not the least, {scan} is");
                prop_assert!(q3_rad.abs() <= PI);
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

//! Rigid dynamics of the two-link arm: `D(q) a + h(q, v) + g(q) = tau`, with the nine parameters f1..f9.
//!
//! Source: Zakharov & Halász 2001, equations (1)–(5), with the misprints corrected: D11 contains f7 (not f1), the f4
//! term of h3 has c3 (not s3). `tests/arm.rs` proves the equations against an independent Newton–Euler recursion,
//! Christoffel symbols, the skew symmetry of Ḋ − 2C and the gravity potential.
//!
//! Conventions: index 0 is joint 2 and index 1 is joint 3 of a PUMA 560. q = 0: upper arm horizontal, forearm
//! straight up; q2 = −π/2: upper arm up; q3 = +π/2: forearm in line with the upper arm; positive q turns downward.
//!
//! Left out: everything that is not rigid or not in the vertical plane of the two links (joint 1, the wrist, joint
//! flexibility); friction and motors are in [`crate::drive`].

use crate::scalar::Scalar;

/// How many dynamic parameters the arm has.
pub const PARAMETERS: usize = 9;

/// Length a3 of the PUMA 560's upper arm, in metres: the paper's geometry for masses, centres and loads.
pub const PUMA_UPPER_ARM_M: f64 = 0.4318;

/// The reference robot: Armstrong's PUMA 560 with the wrist locked and a 2.5 kg tool (design table, f1..f9).
pub const REFERENCE_F: [f64; PARAMETERS] = [1.647, 1.070, -0.011, -0.958, -0.025, -2.219, 5.609, -0.104, 4.875];

/// The paper's search range of each f, low end.
pub const SEARCH_LOW: [f64; PARAMETERS] = [0.28, 0.0, -0.2, -1.25, -0.4, -2.5, 2.23, -1.75, -2.7];

/// The paper's search range of each f, high end.
pub const SEARCH_HIGH: [f64; PARAMETERS] = [4.07, 2.33, 0.2, 0.0, 0.4, 0.0, 17.95, 1.75, 11.25];

/// Rigid two-link arm in a vertical plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm<S> {
    /// f1..f9: f1, f2, f3, f4, f7 in kg m²; f5, f6, f8, f9 in kg m.
    pub f: [S; PARAMETERS],
    /// Gravitational acceleration in m/s²; 0 for an axis that does not feel gravity.
    pub gravity_m_s2: S,
}

/// Sines and cosines of a configuration; s2 = sin q2, c23 = cos(q2 + q3) and so on.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "the names are the definition")]
pub struct Pose<S> {
    pub s2: S,
    pub c2: S,
    pub s3: S,
    pub c3: S,
    pub s23: S,
    pub c23: S,
}

impl<S: Scalar> Pose<S> {
    /// The pose at joint angles `position_rad`.
    #[inline(always)]
    pub fn at(position_rad: [S; 2]) -> Self {
        let (s2, c2) = position_rad[0].sin_cos();
        let (s3, c3) = position_rad[1].sin_cos();
        Self::of([s2, s3], [c2, c3])
    }

    /// The pose after each joint has turned on by a small angle in rad, short of its cube's sixth: 2e-10 at 1e-3 rad.
    #[inline(always)]
    pub fn turned(&self, by_rad: [S; 2]) -> Self {
        let (s2, c2) = turn(self.s2, self.c2, by_rad[0]);
        let (s3, c3) = turn(self.s3, self.c3, by_rad[1]);
        Self::of([s2, s3], [c2, c3])
    }

    /// The pose after each joint has turned on by an angle within ±π/4.
    #[inline(always)]
    pub fn turned_within_eighth(&self, by_rad: [S; 2]) -> Self {
        let (s2, c2) = by_rad[0].sin_cos_within_eighth();
        let (s3, c3) = by_rad[1].sin_cos_within_eighth();
        Self::of(
            [self.s2.mul_add(c2, self.c2 * s2), self.s3.mul_add(c3, self.c3 * s3)],
            [self.c2.mul_add(c2, -(self.s2 * s2)), self.c3.mul_add(c3, -(self.s3 * s3))],
        )
    }

    #[inline(always)]
    fn of([s2, s3]: [S; 2], [c2, c3]: [S; 2]) -> Self {
        Self { s2, c2, s3, c3, s23: s2.mul_add(c3, c2 * s3), c23: c2.mul_add(c3, -(s2 * s3)) }
    }
}

/// Sine and cosine of an angle that grows by a small one in rad.
#[inline(always)]
fn turn<S: Scalar>(sine: S, cosine: S, by_rad: S) -> (S, S) {
    let half = by_rad * by_rad.constant(0.5);
    let mean_cosine = (-half).mul_add(sine, cosine);
    let mean_sine = half.mul_add(cosine, sine);
    (by_rad.mul_add(mean_cosine, sine), (-by_rad).mul_add(mean_sine, cosine))
}

/// The symmetric inertia matrix D in kg m², motors included.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "the names are the definition")]
pub struct Inertia<S> {
    pub d11: S,
    pub d12: S,
    pub d22: S,
}

impl<S: Scalar> Inertia<S> {
    /// D · vector.
    #[inline(always)]
    pub fn times(&self, vector: [S; 2]) -> [S; 2] {
        [self.d11.mul_add(vector[0], self.d12 * vector[1]), self.d12.mul_add(vector[0], self.d22 * vector[1])]
    }

    /// D⁻¹. Meaningful only where D is positive definite ([`Arm::check_inertia`]).
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let reciprocal = self.d11.constant(1.0) / (self.d11 * self.d22 - self.d12 * self.d12);
        Self { d11: self.d22 * reciprocal, d12: -self.d12 * reciprocal, d22: self.d11 * reciprocal }
    }
}

impl<S: Scalar> Arm<S> {
    /// The inertia matrix D(q3).
    #[inline(always)]
    pub fn inertia(&self, pose: &Pose<S>) -> Inertia<S> {
        let [f1, f2, f3, f4, _, _, f7, _, _] = self.f;
        let coupling = f3.mul_add(pose.c3, -(f4 * pose.s3));
        Inertia { d11: f7 + coupling + coupling, d12: f2 + coupling, d22: f1 }
    }

    /// Coriolis and centrifugal torque h in N m, at joint velocities in rad/s.
    #[inline(always)]
    pub fn velocity_torque_nm(&self, pose: &Pose<S>, velocity_rad_s: [S; 2]) -> [S; 2] {
        let left = self.less_velocity_torque_nm([pose.s2.constant(0.0); 2], pose, velocity_rad_s);
        [-left[0], -left[1]]
    }

    /// What h leaves of a torque in N m. Taken off term by term: every term is rounded once only.
    #[inline(always)]
    pub fn less_velocity_torque_nm(&self, torque_nm: [S; 2], pose: &Pose<S>, velocity_rad_s: [S; 2]) -> [S; 2] {
        let [v2, v3] = velocity_rad_s;
        let k = self.f[2].mul_add(pose.s3, self.f[3] * pose.c3);
        [(k * v3).mul_add(v3 + v2 + v2, torque_nm[0]), (-(k * v2)).mul_add(v2, torque_nm[1])]
    }

    /// Gravity torque g in N m.
    #[inline(always)]
    pub fn gravity_torque_nm(&self, pose: &Pose<S>) -> [S; 2] {
        let left = self.less_gravity_torque_nm([pose.s2.constant(0.0); 2], pose);
        [-left[0], -left[1]]
    }

    /// What g leaves of a torque in N m. Taken off term by term, because torque and gravity nearly cancel and single
    /// precision would lose what is left.
    #[inline(always)]
    pub fn less_gravity_torque_nm(&self, torque_nm: [S; 2], pose: &Pose<S>) -> [S; 2] {
        let [_, _, _, _, f5, f6, _, f8, f9] = self.f;
        let gravity = self.gravity_m_s2;
        let [g5, g6, g8, g9] = [gravity * f5, -(gravity * f6), -(gravity * f8), gravity * f9];
        let upper_arm = g8.mul_add(pose.s2, g9.mul_add(pose.c2, torque_nm[0]));
        [
            g6.mul_add(pose.s23, g5.mul_add(pose.c23, upper_arm)),
            g6.mul_add(pose.s23, g5.mul_add(pose.c23, torque_nm[1])),
        ]
    }

    /// Inverse dynamics: the joint torque in N m that gives `acceleration_rad_s2` at this state, friction apart.
    pub fn inverse_dynamics_nm(
        &self,
        position_rad: [S; 2],
        velocity_rad_s: [S; 2],
        acceleration_rad_s2: [S; 2],
    ) -> [S; 2] {
        let pose = Pose::at(position_rad);
        let inertial = self.inertia(&pose).times(acceleration_rad_s2);
        let h = self.velocity_torque_nm(&pose, velocity_rad_s);
        let g = self.gravity_torque_nm(&pose);
        [inertial[0] + h[0] + g[0], inertial[1] + h[1] + g[1]]
    }
}

/// Why a set of f1..f9 cannot be an arm.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// A parameter is NaN or infinite.
    #[error("f{number} is {value}, not a finite number; identify the arm again")]
    NotFinite {
        /// Number of the parameter, 1..=9.
        number: usize,
        /// Its value.
        value: f64,
    },
    /// D22 = f1, the inertia of joint 3, is not positive.
    #[error("f1 is {value} kg m², but the inertia of joint 3 must be above 0; identify the arm again")]
    JointInertia {
        /// The value of f1.
        value: f64,
    },
    /// det D is not positive for some q3.
    #[error(
        "the inertia matrix is not positive definite: det D falls to {determinant:.4} kg² m⁴ at q3 = {q3_rad:.3} rad, \
         and must stay above 0; identify the arm again or lower f2"
    )]
    Indefinite {
        /// The least determinant over all q3.
        determinant: f64,
        /// Where it occurs.
        q3_rad: f64,
    },
}

impl Arm<f64> {
    /// Accepts the arm only if every parameter is finite and D(q) is positive definite for every q3.
    ///
    /// With A = f3 c3 − f4 s3, det D = f1 (f7 + 2A) − (f2 + A)² is concave in A, so its least value over
    /// A ∈ [−R, R], R = √(f3² + f4²), lies at an end: two evaluations prove it for all q3.
    #[inline]
    pub fn check_inertia(&self) -> Result<(), ArmError> {
        for (index, &value) in self.f.iter().enumerate() {
            if !value.is_finite() {
                return Err(ArmError::NotFinite { number: index + 1, value });
            }
        }
        let [f1, f2, f3, f4, _, _, f7, _, _] = self.f;
        if f1 <= 0.0 {
            return Err(ArmError::JointInertia { value: f1 });
        }
        let reach = libm::sqrt(f3 * f3 + f4 * f4);
        let determinant_at = |coupling: f64| f1 * (f7 + 2.0 * coupling) - (f2 + coupling) * (f2 + coupling);
        let (low, high) = (determinant_at(-reach), determinant_at(reach));
        // Not `<=`: parameters so large that a determinant overflows to NaN are refused as well.
        if low > 0.0 && high > 0.0 {
            return Ok(());
        }
        // A = R cos(q3 + atan2(f4, f3)), so it is R at q3 = -atan2(f4, f3), and -R half a turn away.
        // In f32, which is exact enough for a message and takes the board half as much flash.
        let (f3, f4) = (f3 as f32, f4 as f32);
        let (determinant, q3_rad) =
            if high < low { (high, -libm::atan2f(f4, f3)) } else { (low, libm::atan2f(f4, -f3)) };
        Err(ArmError::Indefinite { determinant, q3_rad: f64::from(q3_rad) })
    }
}

/// A body held by the gripper, in the forearm's frame 3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load<S> {
    /// Mass in kg.
    pub mass_kg: S,
    /// Centre of mass in frame 3, metres.
    pub centre_m: [S; 2],
    /// Inertia about the load's own centre of mass in kg m².
    pub inertia_kg_m2: S,
}

impl<S: Scalar> Load<S> {
    /// What the load adds to f1..f9 on an arm whose upper arm is `upper_arm_m` long (design §6).
    pub fn delta_f(&self, upper_arm_m: S) -> [S; PARAMETERS] {
        let [x, y] = self.centre_m;
        let m = self.mass_kg;
        let about_joint = self.inertia_kg_m2 + m * (x * x + y * y);
        [
            about_joint,
            about_joint,
            m * x * upper_arm_m,
            m * y * upper_arm_m,
            m * x,
            m * y,
            m * upper_arm_m * upper_arm_m + about_joint,
            m.constant(0.0),
            m * upper_arm_m,
        ]
    }
}

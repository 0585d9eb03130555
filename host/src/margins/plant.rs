//! The arm about rest in continuous time: masses, shafts, viscous friction and amplifiers.

use nalgebra::{DMatrix, Matrix2};
use shared::arm::{Arm, Pose};

use super::ArmLoop;

/// `ẋ = A x + B u`, `y = C x`: u the joint torques commanded in N m, y the angles that the encoders see in rad.
pub(super) struct LinearArm {
    pub(super) a: DMatrix<f64>,
    pub(super) b: DMatrix<f64>,
    pub(super) c: DMatrix<f64>,
}

impl ArmLoop {
    /// D at a pose, motors included, in kg m².
    pub(super) fn inertia(&self, q3_rad: f64) -> Matrix2<f64> {
        let inertia = Arm { f: self.f, gravity_m_s2: 0.0 }.inertia(&Pose::at([0.0, q3_rad]));
        Matrix2::new(inertia.d11, inertia.d12, inertia.d12, inertia.d22)
    }
}

impl LinearArm {
    /// Coordinates are the two links' angles, then those of the motors behind a flexible shaft, then all velocities, then
    /// the torques of amplifiers that lag.
    pub(super) fn new(arm: &ArmLoop, q3_rad: f64) -> Self {
        let flexible: Vec<usize> = (0..2).filter(|&joint| arm.compliance_rad_per_nm[joint] > 0.0).collect();
        let angles = 2 + flexible.len();
        let whole = arm.inertia(q3_rad);
        let mut mass = DMatrix::zeros(angles, angles);
        let mut stiffness = DMatrix::zeros(angles, angles);
        let mut damping = DMatrix::zeros(angles, angles);
        mass.view_mut((0, 0), (2, 2)).copy_from(&whole);
        // Which angle is the motor's.
        let mut motor = [0, 1];
        for (index, &joint) in flexible.iter().enumerate() {
            let own = 2 + index;
            motor[joint] = own;
            mass[(joint, joint)] -= arm.motor_inertia_kg_m2[joint];
            mass[(own, own)] = arm.motor_inertia_kg_m2[joint];
            let spring = 1.0 / arm.compliance_rad_per_nm[joint];
            for (matrix, value) in [(&mut stiffness, spring), (&mut damping, spring * arm.shaft_damping_s[joint])] {
                matrix[(own, own)] += value;
                matrix[(joint, joint)] += value;
                matrix[(own, joint)] -= value;
                matrix[(joint, own)] -= value;
            }
        }
        for joint in 0..2 {
            damping[(motor[joint], motor[joint])] += arm.viscous_nm_s_per_rad[joint];
        }
        // The mass of an arm that passed its check is positive definite, and so are its parts (`ExtendedMachine`).
        let mobility = mass.clone().try_inverse().unwrap_or_else(|| DMatrix::zeros(angles, angles));

        let lagging: Vec<usize> = (0..2).filter(|&joint| arm.current_lag_s[joint] > 0.0).collect();
        let states = 2 * angles + lagging.len();
        let mut a = DMatrix::zeros(states, states);
        let mut b = DMatrix::zeros(states, 2);
        let mut c = DMatrix::zeros(2, states);
        a.view_mut((0, angles), (angles, angles)).fill_with_identity();
        a.view_mut((angles, 0), (angles, angles)).copy_from(&(-&mobility * stiffness));
        a.view_mut((angles, angles), (angles, angles)).copy_from(&(-&mobility * damping));
        for joint in 0..2 {
            c[(joint, motor[joint])] = 1.0;
            let pushed = mobility.column(motor[joint]);
            match lagging.iter().position(|&lags| lags == joint) {
                Some(index) => {
                    let torque = 2 * angles + index;
                    a.view_mut((angles, torque), (angles, 1)).copy_from(&pushed);
                    a[(torque, torque)] = -1.0 / arm.current_lag_s[joint];
                    b[(torque, joint)] = 1.0 / arm.current_lag_s[joint];
                }
                None => b.view_mut((angles, joint), (angles, 1)).copy_from(&pushed),
            }
        }
        Self { a, b, c }
    }
}

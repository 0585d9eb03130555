//! The arm from its masses, by a recursive Newton–Euler computation over the two links.
//!
//! Everything moves in one vertical plane. Plane coordinates: first forward, second **down**, so that a positive
//! joint angle, which turns the arm downward, is the usual turn from the first axis to the second. With both angles
//! zero the upper arm lies along the first axis and the forearm points up, along the negative second axis of its
//! own frame. Nothing here uses `f1..f9` except the two conversions at the end.

use super::base_parameters::{BaseParameters, UPPER_ARM_LENGTH_M};
use super::dynamics::EquationsOfMotion;

/// A vector in the arm's plane: forward, down.
type Planar = [f64; 2];

/// One link as a rigid body, in the frame fixed to it at its joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Mass in kilograms.
    pub mass_kg: f64,
    /// Centre of mass in the link's frame in metres: along the frame's first axis, along its second.
    pub centre_m: [f64; 2],
    /// Moment of inertia about the centre of mass, about the joint's direction, in kg m².
    pub inertia_kg_m2: f64,
    /// Inertia of the motor as seen at the joint: rotor inertia times the squared gear ratio, in kg m².
    pub motor_inertia_kg_m2: f64,
}

/// The arm as two rigid bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkMasses {
    /// Link 2 of the PUMA, from the shoulder to the elbow.
    pub upper_arm: Link,
    /// Link 3 of the PUMA with the locked wrist and the tool.
    pub forearm: Link,
}

/// The directions of both links at one pose.
#[derive(Clone, Copy)]
struct Pose {
    upper_arm: (f64, f64),
    forearm: (f64, f64),
}

impl Pose {
    fn at(angle_rad: [f64; 2]) -> Self {
        Self { upper_arm: angle_rad[0].sin_cos(), forearm: (angle_rad[0] + angle_rad[1]).sin_cos() }
    }
}

/// A link's vector in plane coordinates.
fn turned((sin, cos): (f64, f64), vector: Planar) -> Planar {
    [cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]]
}

/// Acceleration of a point at `arm` from an origin that itself accelerates.
fn carried(origin_acceleration: Planar, arm: Planar, speed: f64, acceleration: f64) -> Planar {
    [
        origin_acceleration[0] - acceleration * arm[1] - speed * speed * arm[0],
        origin_acceleration[1] + acceleration * arm[0] - speed * speed * arm[1],
    ]
}

/// Moment of a force at `arm`, positive in the direction of positive joint angles.
fn moment(arm: Planar, force: Planar) -> f64 {
    arm[0] * force[1] - arm[1] * force[0]
}

fn scaled(factor: f64, vector: Planar) -> Planar {
    [factor * vector[0], factor * vector[1]]
}

impl LinkMasses {
    /// Armstrong's measured PUMA 560 (as in Corke's Robotics Toolbox) with its wrist locked and a tool of 2.5 kg.
    ///
    /// The links, the gears and the 200e-6 kg m² of both rotors are Armstrong's. Forearm, wrist (1.25 kg) and tool
    /// are one body; its centre and inertia are those that give the reference row of design.md §2.
    #[must_use]
    pub fn reference() -> Self {
        Self {
            upper_arm: Link {
                mass_kg: 17.4,
                centre_m: [0.068, -0.006],
                inertia_kg_m2: 0.539,
                motor_inertia_kg_m2: 200e-6 * 107.8 * 107.8,
            },
            forearm: Link {
                mass_kg: 6.05 + 2.5,
                centre_m: [-0.002_97, -0.259_54],
                inertia_kg_m2: 0.494,
                motor_inertia_kg_m2: 200e-6 * 53.7 * 53.7,
            },
        }
    }

    /// Joint torques in N m that give the joint accelerations `acceleration_rad_s2` at this pose and speed.
    #[must_use]
    pub fn required_torque_nm(
        &self,
        angle_rad: [f64; 2],
        velocity_rad_s: [f64; 2],
        acceleration_rad_s2: [f64; 2],
        gravity_m_s2: f64,
    ) -> [f64; 2] {
        self.recursion(Pose::at(angle_rad), velocity_rad_s, acceleration_rad_s2, gravity_m_s2)
    }

    fn recursion(&self, pose: Pose, velocity: [f64; 2], acceleration: [f64; 2], gravity_m_s2: f64) -> [f64; 2] {
        let (upper, fore) = (&self.upper_arm, &self.forearm);
        // Outward: motion from the shoulder to the elbow. A shoulder that accelerates upward stands for gravity.
        let shoulder_acceleration = [0.0, -gravity_m_s2];
        let upper_centre = turned(pose.upper_arm, upper.centre_m);
        let elbow = turned(pose.upper_arm, [UPPER_ARM_LENGTH_M, 0.0]);
        let upper_centre_acceleration = carried(shoulder_acceleration, upper_centre, velocity[0], acceleration[0]);
        let elbow_acceleration = carried(shoulder_acceleration, elbow, velocity[0], acceleration[0]);
        let forearm_speed = velocity[0] + velocity[1];
        let forearm_spin = acceleration[0] + acceleration[1];
        let fore_centre = turned(pose.forearm, fore.centre_m);
        let fore_centre_acceleration = carried(elbow_acceleration, fore_centre, forearm_speed, forearm_spin);

        // Inward: forces and moments from the forearm back to the shoulder.
        let fore_force = scaled(fore.mass_kg, fore_centre_acceleration);
        let upper_force = scaled(upper.mass_kg, upper_centre_acceleration);
        let elbow_moment = fore.inertia_kg_m2 * forearm_spin + moment(fore_centre, fore_force);
        let shoulder_moment = upper.inertia_kg_m2 * acceleration[0]
            + moment(upper_centre, upper_force)
            + elbow_moment
            + moment(elbow, fore_force);
        // As in the paper a rotor turns with its own joint only, so its inertia lies on the diagonal.
        [
            shoulder_moment + upper.motor_inertia_kg_m2 * acceleration[0],
            elbow_moment + fore.motor_inertia_kg_m2 * acceleration[1],
        ]
    }

    /// Mass matrix and bias torques, each column from one pass of the recursion.
    #[must_use]
    pub fn equations(&self, angle_rad: [f64; 2], velocity_rad_s: [f64; 2], gravity_m_s2: f64) -> EquationsOfMotion {
        let pose = Pose::at(angle_rad);
        let rest = [0.0; 2];
        let first_column = self.recursion(pose, rest, [1.0, 0.0], 0.0);
        let second_column = self.recursion(pose, rest, [0.0, 1.0], 0.0);
        EquationsOfMotion {
            mass_kg_m2: [[first_column[0], second_column[0]], [first_column[1], second_column[1]]],
            bias_nm: self.recursion(pose, velocity_rad_s, rest, gravity_m_s2),
        }
    }

    /// Potential energy in joules from the heights of the two centres of mass above the shoulder.
    #[must_use]
    pub fn potential_energy_j(&self, angle_rad: [f64; 2], gravity_m_s2: f64) -> f64 {
        let pose = Pose::at(angle_rad);
        let elbow = turned(pose.upper_arm, [UPPER_ARM_LENGTH_M, 0.0]);
        let upper_depth = turned(pose.upper_arm, self.upper_arm.centre_m)[1];
        let fore_depth = elbow[1] + turned(pose.forearm, self.forearm.centre_m)[1];
        -gravity_m_s2 * (self.upper_arm.mass_kg * upper_depth + self.forearm.mass_kg * fore_depth)
    }

    /// The base parameters of this arm, by their definitions in design.md §2.
    #[must_use]
    pub fn base_parameters(&self) -> BaseParameters {
        let (upper, fore) = (&self.upper_arm, &self.forearm);
        let about_joint =
            |link: &Link| link.inertia_kg_m2 + link.mass_kg * (link.centre_m[0].powi(2) + link.centre_m[1].powi(2));
        let f2 = about_joint(fore);
        BaseParameters::with_consistent_elbow(
            fore.motor_inertia_kg_m2 + f2,
            f2,
            fore.mass_kg * fore.centre_m[0],
            fore.mass_kg * fore.centre_m[1],
            upper.motor_inertia_kg_m2 + about_joint(upper) + fore.mass_kg * UPPER_ARM_LENGTH_M.powi(2) + f2,
            upper.mass_kg * upper.centre_m[1],
            upper.mass_kg * upper.centre_m[0] + fore.mass_kg * UPPER_ARM_LENGTH_M,
        )
    }

    /// One of the many arms that have the base parameters `base`, or `None` if there is none because `f3` is not
    /// `a3 f5` or `f4` is not `a3 f6`.
    ///
    /// The link masses and the upper rotor are those of [`LinkMasses::reference`]; motion cannot tell the
    /// difference. Inertias may come out negative for sets far from the reference; the motion is still that of
    /// `base`.
    #[must_use]
    pub fn with_base_parameters(base: &BaseParameters) -> Option<Self> {
        let [f1, f2, f3, f4, f5, f6, f7, f8, f9] = base.0;
        let tolerance = 1e-9;
        if (f3 - UPPER_ARM_LENGTH_M * f5).abs() > tolerance || (f4 - UPPER_ARM_LENGTH_M * f6).abs() > tolerance {
            return None;
        }
        let Self { mut upper_arm, mut forearm } = Self::reference();
        forearm.centre_m = [f5 / forearm.mass_kg, f6 / forearm.mass_kg];
        forearm.inertia_kg_m2 = f2 - (f5 * f5 + f6 * f6) / forearm.mass_kg;
        forearm.motor_inertia_kg_m2 = f1 - f2;
        let upper_moment = f9 - forearm.mass_kg * UPPER_ARM_LENGTH_M;
        upper_arm.centre_m = [upper_moment / upper_arm.mass_kg, f8 / upper_arm.mass_kg];
        upper_arm.inertia_kg_m2 = f7
            - f2
            - forearm.mass_kg * UPPER_ARM_LENGTH_M.powi(2)
            - (upper_moment * upper_moment + f8 * f8) / upper_arm.mass_kg
            - upper_arm.motor_inertia_kg_m2;
        Some(Self { upper_arm, forearm })
    }
}

//! Which numbers are sought, and how a candidate becomes a plant.

use shared::arm::{Arm, PARAMETERS};
use shared::drive::Drive;
use shared::plant::Plant;

use crate::robot::{Kind, Robot};

/// One number that identification may seek.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// f1..f9 by index 0..=8. On a single axis index 6 is the moving mass or inertia.
    F(usize),
    /// Viscous friction of a joint, at the motor.
    Viscous(usize),
    /// Coulomb friction of a joint, at the motor.
    Coulomb(usize),
    /// Constant torque a joint's motor has to overcome.
    TorqueOffset(usize),
}

impl Parameter {
    /// Name with the robot's own joint names, as printed.
    pub fn name(self, robot: &Robot) -> String {
        let joint = |index: usize| &robot.joints[index].name;
        match (self, robot.kind) {
            (Self::F(_), Kind::SingleAxis) => "mass".to_owned(),
            (Self::F(index), Kind::TwoLink) => format!("f{}", index + 1),
            (Self::Viscous(index), _) => format!("viscous friction {}", joint(index)),
            (Self::Coulomb(index), _) => format!("Coulomb friction {}", joint(index)),
            (Self::TorqueOffset(index), _) => format!("torque offset {}", joint(index)),
        }
    }
}

/// Every number a plant needs that the robot file need not know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Values {
    /// f1..f9.
    pub f: [f64; PARAMETERS],
    /// Viscous friction at the motors in N m s/rad.
    pub viscous_nm_s_per_rad: [f64; 2],
    /// Coulomb friction at the motors in N m.
    pub coulomb_nm: [f64; 2],
    /// Constant torque the motors have to overcome in N m.
    pub torque_offset_nm: [f64; 2],
}

impl Values {
    /// The robot file's friction; f is still unknown and zero.
    pub fn of_robot(robot: &Robot) -> Self {
        let mut values = Self {
            f: [0.0; PARAMETERS],
            viscous_nm_s_per_rad: [0.0; 2],
            coulomb_nm: [0.0; 2],
            torque_offset_nm: [0.0; 2],
        };
        for (index, joint) in robot.joints.iter().enumerate().take(2) {
            values.viscous_nm_s_per_rad[index] = joint.viscous_friction_nm_s_per_rad.unwrap_or(0.0);
            values.coulomb_nm[index] = joint.coulomb_friction_nm.unwrap_or(0.0);
        }
        values
    }

    /// The value of one parameter.
    pub fn get(&self, parameter: Parameter) -> f64 {
        match parameter {
            Parameter::F(index) => self.f[index],
            Parameter::Viscous(joint) => self.viscous_nm_s_per_rad[joint],
            Parameter::Coulomb(joint) => self.coulomb_nm[joint],
            Parameter::TorqueOffset(joint) => self.torque_offset_nm[joint],
        }
    }

    /// Replaces the value of one parameter.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        match parameter {
            Parameter::F(index) => self.f[index] = value,
            Parameter::Viscous(joint) => self.viscous_nm_s_per_rad[joint] = value,
            Parameter::Coulomb(joint) => self.coulomb_nm[joint] = value,
            Parameter::TorqueOffset(joint) => self.torque_offset_nm[joint] = value,
        }
    }

    /// This with `values` for the parameters in `free`, in order.
    pub fn with(mut self, free: &[Parameter], values: &[f64]) -> Self {
        for (&parameter, &value) in free.iter().zip(values) {
            self.set(parameter, value);
        }
        self
    }

    /// The values of `free`, in order.
    pub fn of(&self, free: &[Parameter]) -> Vec<f64> {
        free.iter().map(|&parameter| self.get(parameter)).collect()
    }

    /// The arm these values describe.
    pub fn arm(&self, robot: &Robot) -> Arm<f64> {
        Arm { f: self.f, gravity_m_s2: robot.gravity_m_s2 }
    }

    /// The plant these values describe on this robot.
    pub fn plant(&self, robot: &Robot) -> Plant<f64> {
        let drive = |index: usize| {
            let joint = &robot.joints[index];
            Drive {
                gear_ratio: joint.gear_ratio,
                counts_per_rev: joint.counts_per_rev,
                torque_constant_nm_per_a: joint.torque_constant_nm_per_a,
                current_limit_a: joint.current_limit_a,
                viscous_friction_nm_s_per_rad: self.viscous_nm_s_per_rad[index],
                coulomb_friction_nm: self.coulomb_nm[index],
                torque_offset_nm: self.torque_offset_nm[index],
            }
        };
        match robot.kind {
            Kind::TwoLink => Plant { arm: self.arm(robot), drives: [drive(0), drive(1)] },
            Kind::SingleAxis => Plant::single_axis(self.f[6], drive(0)),
        }
    }
}

/// How friction enters the identification.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum FrictionMode {
    /// Sought together with f: costs no precision where the current is known, and trusts no motor test.
    #[default]
    Identify,
    /// As the robot file says; sought only where the file is silent.
    Known,
}

/// The parameters that are free for this robot: f (the mass alone on a single axis), friction where it is unknown or
/// asked for, and on a single axis the torque offset, which nothing else there could take up.
pub fn free_parameters(robot: &Robot, friction: FrictionMode) -> Vec<Parameter> {
    let mut free = match robot.kind {
        Kind::TwoLink => (0..PARAMETERS).map(Parameter::F).collect(),
        Kind::SingleAxis => vec![Parameter::F(6)],
    };
    for (index, joint) in robot.joints.iter().enumerate() {
        let asked = friction == FrictionMode::Identify;
        if asked || joint.viscous_friction_nm_s_per_rad.is_none() {
            free.push(Parameter::Viscous(index));
        }
        if asked || joint.coulomb_friction_nm.is_none() {
            free.push(Parameter::Coulomb(index));
        }
        if robot.kind == Kind::SingleAxis {
            free.push(Parameter::TorqueOffset(index));
        }
    }
    free
}

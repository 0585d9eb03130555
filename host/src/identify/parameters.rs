//! Which numbers are sought, and how a candidate becomes a plant.

use shared::arm::{Arm, PARAMETERS};
use shared::drive::Drive;
use shared::plant::Plant;

use crate::robot::{Kind, Law, Robot};

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
    /// What the amplifier makes of a joint's command: a factor on the position gain, 1 where the robot file is right.
    Gain(usize),
    /// Lead β of a joint's position loop, in loop ticks.
    Lead(usize),
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
            (Self::Gain(index), _) => format!("gain factor {}", joint(index)),
            (Self::Lead(index), _) => format!("lead {}", joint(index)),
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
    /// Factors on the position gains.
    pub gain: [f64; 2],
    /// Leads of the position loops in ticks; none where each recording's own is believed.
    pub lead: [Option<f64>; 2],
    /// Length of the upper arm in m where it is given: f3 and f4 then follow from f5 and f6.
    pub upper_arm_m: Option<f64>,
}

impl Values {
    /// The robot file's friction; f is still unknown and zero.
    pub fn of_robot(robot: &Robot) -> Self {
        let mut values = Self {
            f: [0.0; PARAMETERS],
            viscous_nm_s_per_rad: [0.0; 2],
            coulomb_nm: [0.0; 2],
            torque_offset_nm: [0.0; 2],
            gain: [1.0; 2],
            lead: [None; 2],
            upper_arm_m: None,
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
            Parameter::Gain(joint) => self.gain[joint],
            Parameter::Lead(joint) => self.lead[joint].unwrap_or(0.0),
        }
    }

    /// Replaces the value of one parameter, and of what follows from it.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        match parameter {
            Parameter::F(index) => {
                self.f[index] = value;
                // f3 = a3 f5 and f4 = a3 f6.
                if let (Some(length), 4 | 5) = (self.upper_arm_m, index) {
                    self.f[index - 2] = length * value;
                }
            }
            Parameter::Viscous(joint) => self.viscous_nm_s_per_rad[joint] = value,
            Parameter::Coulomb(joint) => self.coulomb_nm[joint] = value,
            Parameter::TorqueOffset(joint) => self.torque_offset_nm[joint] = value,
            Parameter::Gain(joint) => self.gain[joint] = value,
            Parameter::Lead(joint) => self.lead[joint] = Some(value),
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
                // The amplifier's factor and the motor's constant are one number to the arm.
                torque_constant_nm_per_a: self.gain[index] * joint.torque_constant_nm_per_a,
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

/// What is known of a parameter beforehand: a normal distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// The parameter.
    pub parameter: Parameter,
    /// Its most likely value.
    pub mean: f64,
    /// Its standard deviation, above 0.
    pub standard_deviation: f64,
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

/// Which parameters are sought.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sought {
    /// How friction enters.
    pub friction: FrictionMode,
    /// Whether the position gains are sought too.
    pub gain: bool,
    /// Whether the leads of the position loops are sought too.
    pub lead: bool,
    /// Length of the upper arm in m, where f3 and f4 are to follow from f5 and f6.
    pub upper_arm_m: Option<f64>,
}

/// Which f are moments, in kg m: f5, f6, f8 and f9, which act by their weight alone. The others are inertias, in kg m².
pub(crate) const MOMENTS: [usize; 4] = [4, 5, 7, 8];

/// The parameters that no movement of this robot shows: on an arm that feels no gravity what acts by weight alone, unless
/// f3 and f4 follow from it.
pub fn unseen_parameters(robot: &Robot, sought: &Sought) -> Vec<Parameter> {
    if robot.kind != Kind::TwoLink || robot.gravity_m_s2 != 0.0 {
        return Vec::new();
    }
    let shows = |index: usize| sought.upper_arm_m.is_some() && (index == 4 || index == 5);
    MOMENTS.into_iter().filter(|&index| !shows(index)).map(Parameter::F).collect()
}

/// The parameters that are free for this robot: f (the mass alone on a single axis) as far as a movement shows it, friction
/// where it is unknown or asked for, gains and leads where asked for, and on a single axis the torque offset, which nothing
/// else there could take up.
pub fn free_parameters(robot: &Robot, sought: &Sought) -> Vec<Parameter> {
    let tied = |index: usize| sought.upper_arm_m.is_some() && (index == 2 || index == 3);
    let mut free: Vec<Parameter> = match robot.kind {
        Kind::TwoLink => (0..PARAMETERS).filter(|&index| !tied(index)).map(Parameter::F).collect(),
        Kind::SingleAxis => vec![Parameter::F(6)],
    };
    let unseen = unseen_parameters(robot, sought);
    free.retain(|parameter| !unseen.contains(parameter));
    for (index, joint) in robot.joints.iter().enumerate() {
        let asked = sought.friction == FrictionMode::Identify;
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
    if sought.gain {
        free.extend((0..robot.joints.len()).map(Parameter::Gain));
    }
    if sought.lead {
        let has_lead = |&joint: &usize| matches!(robot.joints[joint].law, Law::Proportional(_));
        free.extend((0..robot.joints.len()).filter(has_lead).map(Parameter::Lead));
    }
    free
}

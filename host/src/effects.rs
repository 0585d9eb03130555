//! Effects by name: from model files and command lines to the plant's numbers, and back.

use std::collections::BTreeMap;

use shared::arm::Arm;
use shared::effects::catalogue::{self, Entry, LIBRARY, Parameter, Scope};
use shared::effects::{ArmEffects, Effects, ExtendedMachine, ExtendedPlant, JointEffects};
use shared::plant::Plant;

use crate::edit_distance::nearest;
use crate::model::Effect;
use crate::robot::{self, Kind, Robot};

/// The joint of an effect of the whole arm.
pub const BOTH_JOINTS: &str = "both";

/// Effects that a single axis, which feels no gravity, cannot have.
const NOT_ON_SINGLE_AXIS: &[&str] = &["base-tilt"];

/// An effect that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// The name is not in the library.
    #[error("\"{name}\" is no effect of the library; {remedy}")]
    UnknownName {
        /// The name.
        name: String,
        /// What may have been meant.
        remedy: String,
    },
    /// The effect has no such parameter.
    #[error("{effect}: \"{parameter}\" is no parameter of it; {remedy}")]
    UnknownParameter {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: String,
        /// What may have been meant.
        remedy: String,
    },
    /// A parameter without a usual value is not given.
    #[error("{effect}: {parameter} is missing: {meaning}, {low} to {high} {unit}")]
    MissingParameter {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// What it is.
        meaning: &'static str,
        /// Its least value.
        low: f64,
        /// Its greatest value.
        high: f64,
        /// Its unit.
        unit: &'static str,
    },
    /// A parameter is outside its range.
    #[error("{effect}: {parameter} is {value}, but must be {low} to {high} {unit}: {meaning}")]
    Range {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// Its value.
        value: f64,
        /// Its least value.
        low: f64,
        /// Its greatest value.
        high: f64,
        /// Its unit.
        unit: &'static str,
        /// What it is.
        meaning: &'static str,
    },
    /// The robot has no such joint.
    #[error("{effect}: the robot has no joint \"{joint}\"; use {choices}")]
    UnknownJoint {
        /// The effect.
        effect: &'static str,
        /// The joint.
        joint: String,
        /// Joints that may be meant.
        choices: String,
    },
    /// The effect is the whole arm's.
    #[error(
        "{effect}: it is the whole arm's, not that of joint \"{joint}\"; leave joint= out, or write joint={BOTH_JOINTS}"
    )]
    OfWholeArm {
        /// The effect.
        effect: &'static str,
        /// The joint.
        joint: String,
    },
    /// The same effect twice.
    #[error("{effect} of joint {joint} is given twice; give it once, with all its parameters")]
    Twice {
        /// The effect.
        effect: &'static str,
        /// The joint.
        joint: String,
    },
    /// A robot of this kind cannot have it.
    #[error("{effect}: a single axis does not feel gravity and has one joint only; leave it out")]
    NotOnSingleAxis {
        /// The effect.
        effect: &'static str,
    },
    /// The text on the command line cannot be taken apart.
    #[error("\"{text}\" is no effect; write NAME:joint=JOINT,PARAMETER=VALUE, such as backlash:joint=3,gap_rad=0.002")]
    Text {
        /// The text.
        text: String,
    },
    /// The value of a parameter is no number.
    #[error("{effect}: {parameter} is \"{value}\", which is no number")]
    NotANumber {
        /// The effect.
        effect: String,
        /// The parameter.
        parameter: String,
        /// The value.
        value: String,
    },
}

/// What a motor usually has of its joint's inertia at most. On the reference robot the usual motor is below that.
const USUAL_MOTOR_SHARE: f64 = 0.42;

/// The parameter of several effects that says how a joint's inertia is shared between motor and link.
pub const MOTOR_INERTIA: &str = "motor_inertia_kg_m2";

/// A motor's inertia this close to what was asked for is that: the rest is rounding.
const SAME_INERTIA: f64 = 1e-6;

/// Every effect of `robot` off.
pub fn off(robot: &Robot) -> Effects<f64> {
    if robot.kind == Kind::SingleAxis {
        return Effects::SINGLE_AXIS;
    }
    let mut effects =
        Effects { arm: ArmEffects { upper_arm_m: robot.upper_arm_m, ..Effects::OFF.arm }, ..Effects::OFF };
    let f = robot.expected_f();
    for ((effects, joint), whole) in effects.joints.iter_mut().zip(&robot.joints).zip([f[6], f[0]]) {
        let most = USUAL_MOTOR_SHARE * whole / (joint.gear_ratio * joint.gear_ratio);
        effects.motor_inertia_kg_m2 = JointEffects::OFF.motor_inertia_kg_m2.min(most);
    }
    effects
}

/// What the motors have of the joints' inertia, kg m² at the motors, as the plant with effects takes it on an arm of `f`:
/// within what the links leave them.
pub fn motor_inertia_kg_m2(robot: &Robot, f: [f64; 9], effects: Effects<f64>) -> [f64; 2] {
    let drives = [0, 1].map(|joint: usize| robot.joints[joint].drive());
    let arm = Arm { f, gravity_m_s2: robot.gravity_m_s2 };
    let at_joints =
        ExtendedMachine::new(&ExtendedPlant { plant: Plant { arm, drives }, effects }).motor_inertia_kg_m2();
    [0, 1].map(|joint: usize| at_joints[joint] / drives[joint].gear_ratio.powi(2))
}

/// A motor's inertia that an arm does not leave its motor.
#[derive(Clone, Debug, PartialEq)]
pub struct MotorInertiaBeyond {
    /// Which of the entries has it.
    pub entry: usize,
    /// What it says, kg m² at the motor.
    pub wanted_kg_m2: f64,
    /// What it can be instead, the other motor as light as it can be where nothing is said of it, kg m² at the motor.
    pub taken_kg_m2: f64,
}

impl MotorInertiaBeyond {
    /// Every motor's inertia in `entries` that cannot be on an arm of `f`.
    pub fn all(entries: &[Effect], robot: &Robot, f: [f64; 9]) -> Result<Vec<Self>, EffectError> {
        if robot.kind == Kind::SingleAxis {
            return Ok(Vec::new());
        }
        let said = |joint: &robot::Joint| {
            entries.iter().any(|effect| effect.joint == joint.name && effect.parameters.contains_key(MOTOR_INERTIA))
        };
        let mut effects = from_entries(entries, robot)?;
        for (effects, _) in effects.joints.iter_mut().zip(&robot.joints).filter(|(_, joint)| !said(joint)) {
            effects.motor_inertia_kg_m2 = 0.0;
        }
        let taken = motor_inertia_kg_m2(robot, f, effects);
        let of_entry = |(entry, effect): (usize, &Effect)| {
            let joint = robot.joints.iter().position(|joint| joint.name == effect.joint)?;
            let (&wanted_kg_m2, &taken_kg_m2) = (effect.parameters.get(MOTOR_INERTIA)?, taken.get(joint)?);
            let same = (taken_kg_m2 / wanted_kg_m2 - 1.0).abs() < SAME_INERTIA;
            (!same).then_some(Self { entry, wanted_kg_m2, taken_kg_m2 })
        };
        Ok(entries.iter().enumerate().filter_map(of_entry).collect())
    }
}

/// The effects that `entries` describe on `robot`; shape parameters that are not given have their usual values.
pub fn from_entries(entries: &[Effect], robot: &Robot) -> Result<Effects<f64>, EffectError> {
    let mut effects = off(robot);
    for (index, effect) in entries.iter().enumerate() {
        let entry = find(&effect.name)?;
        let joint = joint_index(entry, &effect.joint, robot)?;
        if entries[..index].iter().any(|other| other.name == effect.name && other.joint == effect.joint) {
            return Err(EffectError::Twice { effect: entry.name, joint: effect.joint.clone() });
        }
        for name in effect.parameters.keys() {
            if entry.parameter(name).is_none_or(|parameter| !exists(entry, parameter, robot)) {
                return Err(unknown_parameter(entry, name, robot));
            }
        }
        for parameter in entry.parameters {
            let Parameter { name, range: [low, high], unit, meaning, .. } = *parameter;
            match effect.parameters.get(name) {
                Some(&value) if parameter.accepts(value) => parameter.set(&mut effects, joint, value),
                Some(&value) => {
                    return Err(EffectError::Range {
                        effect: entry.name,
                        parameter: name,
                        value,
                        low,
                        high,
                        unit,
                        meaning,
                    });
                }
                None if parameter.required => {
                    return Err(EffectError::MissingParameter {
                        effect: entry.name,
                        parameter: name,
                        meaning,
                        low,
                        high,
                        unit,
                    });
                }
                None => {}
            }
        }
    }
    Ok(effects)
}

/// The effects that are on, as entries of a model file of `robot`, in the library's order.
pub fn to_entries(effects: &Effects<f64>, robot: &Robot) -> Vec<Effect> {
    let mut entries = Vec::new();
    for entry in LIBRARY {
        let joints: Vec<(usize, &str)> = match entry.scope {
            Scope::Arm => vec![(0, BOTH_JOINTS)],
            Scope::Joint => robot.joints.iter().map(|joint| joint.name.as_str()).enumerate().take(2).collect(),
        };
        for (index, joint) in joints {
            if !entry.is_on(effects, index) {
                continue;
            }
            let parameters: BTreeMap<String, f64> = entry
                .parameters
                .iter()
                .filter(|parameter| exists(entry, parameter, robot))
                .map(|parameter| (parameter.name.to_string(), parameter.get(effects, index)))
                .collect();
            entries.push(Effect {
                name: entry.name.into(),
                joint: joint.into(),
                parameters,
                standard_error: BTreeMap::new(),
            });
        }
    }
    entries
}

/// An effect as written on the command line, `NAME:joint=JOINT,PARAMETER=VALUE,…`; checked by [`from_entries`].
pub fn parse(text: &str) -> Result<Effect, EffectError> {
    let malformed = || EffectError::Text { text: text.into() };
    let (name, rest) = text.split_once(':').unwrap_or((text, ""));
    let entry = find(name.trim())?;
    let mut effect = Effect {
        name: entry.name.into(),
        joint: if entry.scope == Scope::Arm { BOTH_JOINTS.into() } else { String::new() },
        parameters: BTreeMap::new(),
        standard_error: BTreeMap::new(),
    };
    for part in rest.split(',').filter(|part| !part.trim().is_empty()) {
        let (key, value) = part.split_once('=').ok_or_else(malformed)?;
        let (key, value) = (key.trim(), value.trim());
        if key == "joint" {
            effect.joint = value.into();
            continue;
        }
        let number = value.parse().map_err(|_| EffectError::NotANumber {
            effect: name.into(),
            parameter: key.into(),
            value: value.into(),
        })?;
        if effect.parameters.insert(key.into(), number).is_some() {
            return Err(malformed());
        }
    }
    Ok(effect)
}

/// Every effect with its parameters, units and ranges, for a help text.
pub fn library_text() -> String {
    let mut text = String::from("Effects (s: size, which is zero or without limit where the effect is off):\n");
    for entry in LIBRARY {
        text += &format!("  {}: {}\n", entry.name, entry.meaning);
        for (index, parameter) in entry.parameters.iter().enumerate() {
            let Parameter { name, range: [low, high], meaning, .. } = parameter;
            let usual = if parameter.required { String::new() } else { format!(", else {}", parameter.neutral()) };
            let size = if index == 0 { "s " } else { "  " };
            text += &format!("    {size}{name} ({low} to {high}{usual}): {meaning}\n");
        }
    }
    text
}

fn find(name: &str) -> Result<&'static Entry, EffectError> {
    catalogue::find(name).ok_or_else(|| EffectError::UnknownName {
        name: name.into(),
        remedy: match nearest(name, LIBRARY.iter().map(|entry| entry.name)) {
            Some(meant) => format!("did you mean {meant}?"),
            None => format!("it has {}", list(LIBRARY.iter().map(|entry| entry.name))),
        },
    })
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

/// Where a payload sits on a single axis does not matter.
fn exists(entry: &Entry, parameter: &Parameter, robot: &Robot) -> bool {
    robot.kind == Kind::TwoLink || entry.scope == Scope::Joint || parameter.name == entry.size().name
}

fn unknown_parameter(entry: &'static Entry, name: &str, robot: &Robot) -> EffectError {
    let known: Vec<&str> = entry
        .parameters
        .iter()
        .filter(|parameter| exists(entry, parameter, robot))
        .map(|parameter| parameter.name)
        .collect();
    let remedy = match nearest(name, known.iter().copied()) {
        Some(meant) if meant != name => format!("did you mean {meant}?"),
        _ => format!("it has {}", known.join(", ")),
    };
    EffectError::UnknownParameter { effect: entry.name, parameter: name.into(), remedy }
}

fn joint_index(entry: &'static Entry, joint: &str, robot: &Robot) -> Result<usize, EffectError> {
    if robot.kind == Kind::SingleAxis && NOT_ON_SINGLE_AXIS.contains(&entry.name) {
        return Err(EffectError::NotOnSingleAxis { effect: entry.name });
    }
    let unknown = |choices: String| EffectError::UnknownJoint { effect: entry.name, joint: joint.into(), choices };
    match entry.scope {
        Scope::Arm if joint == BOTH_JOINTS => Ok(0),
        Scope::Arm => Err(EffectError::OfWholeArm { effect: entry.name, joint: joint.into() }),
        Scope::Joint => robot
            .joints
            .iter()
            .position(|candidate| candidate.name == joint)
            .ok_or_else(|| unknown(list(robot.joints.iter().map(|joint| joint.name.as_str())))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arm of a thousandth of the reference robot's mass: the usual motor would have ten times its joint's inertia.
    #[test]
    fn a_motor_has_no_more_inertia_than_its_joint() {
        let paper = Robot::paper();
        assert_eq!(off(&paper).joints.map(|joint| joint.motor_inertia_kg_m2), [2e-4; 2]);
        let f = paper.expected_f().map(|f| 1e-3 * f);
        let light = Robot { search: f.map(|f| [f - 0.1 * f.abs(), f + 0.1 * f.abs()]), ..paper };
        let beyond = |text: &str| MotorInertiaBeyond::all(&[parse(text).unwrap()], &light, f).unwrap();
        assert_eq!(beyond("joint-flexibility:joint=3,compliance_rad_per_nm=1e-2"), []);
        let [ref taken] = beyond("load-dependent-friction:joint=3,coefficient=0.1,motor_inertia_kg_m2=1e-4")[..] else {
            panic!("the motor has more than the joint")
        };
        let whole = f[0] / 53.7_f64.powi(2);
        assert!(taken.taken_kg_m2 > 0.5 * whole && taken.taken_kg_m2 < whole, "{taken:?} of {whole}");
        assert_eq!((taken.entry, taken.wanted_kg_m2), (0, 1e-4));
    }
}

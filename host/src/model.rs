//! The model file: what identification found.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use shared::arm::{Arm, PARAMETERS};
use toml::Spanned;

use crate::atomic;
use crate::effects;
use crate::file_error::{FileError, Problem};
use crate::robot::{FrictionError, Robot};
use crate::toml_text::TomlText;

/// An identified arm: f1..f9, friction, and effects found beyond them.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// f1..f9: f1, f2, f3, f4, f7 in kg m²; f5, f6, f8, f9 in kg m.
    pub f: [f64; PARAMETERS],
    /// Standard errors of f1..f9; infinite where the recordings do not tell.
    pub f_standard_error: Option<[f64; PARAMETERS]>,
    /// Viscous friction at each motor in N m s/rad.
    pub viscous_nm_s_per_rad: Vec<f64>,
    /// Standard errors of the viscous friction.
    pub viscous_standard_error: Option<Vec<f64>>,
    /// Coulomb friction at each motor in N m.
    pub coulomb_nm: Vec<f64>,
    /// Standard errors of the Coulomb friction.
    pub coulomb_standard_error: Option<Vec<f64>>,
    /// Effects beyond the rigid arm with friction.
    pub effects: Vec<Effect>,
    /// Where the model comes from: tool, recordings, method, seed.
    pub provenance: toml::Table,
}

/// One effect beyond the rigid arm with friction, as `explain` names them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// Its name in the library of effects.
    pub name: String,
    /// The joint's name, or "both".
    pub joint: String,
    /// Its parameters, named with their units.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// Standard errors of the parameters that have one.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub standard_error: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawModel {
    f: RawF,
    friction: Option<RawFriction>,
    #[serde(default)]
    effect: Vec<Effect>,
    #[serde(default)]
    provenance: toml::Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawF {
    value: Spanned<Vec<f64>>,
    standard_error: Option<Spanned<Vec<f64>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFriction {
    viscous_nm_s_per_rad: Spanned<Vec<f64>>,
    viscous_standard_error: Option<Spanned<Vec<f64>>>,
    coulomb_nm: Spanned<Vec<f64>>,
    coulomb_standard_error: Option<Spanned<Vec<f64>>>,
}

#[derive(Serialize)]
struct ModelText<'a> {
    f: FText<'a>,
    friction: FrictionText<'a>,
    #[serde(skip_serializing_if = "<[Effect]>::is_empty")]
    effect: &'a [Effect],
    provenance: &'a toml::Table,
}

#[derive(Serialize)]
struct FText<'a> {
    value: &'a [f64; PARAMETERS],
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_error: &'a Option<[f64; PARAMETERS]>,
}

#[derive(Serialize)]
struct FrictionText<'a> {
    viscous_nm_s_per_rad: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    viscous_standard_error: &'a Option<Vec<f64>>,
    coulomb_nm: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    coulomb_standard_error: &'a Option<Vec<f64>>,
}

/// Where a model's provenance has [`Robot::identity`] of the robot it was made for.
pub const ROBOT_IDENTITY: &str = "robot_identity";

impl Model {
    /// Reads and checks a model file of `robot`; friction left out of the file is the robot file's.
    pub fn read(path: &Path, robot: &Robot) -> Result<Self, FileError> {
        from_text(&TomlText::read(path)?, robot)
    }

    /// Parses a model file's bytes; `path` only names them in errors.
    pub fn from_bytes(path: &Path, bytes: Vec<u8>, robot: &Robot) -> Result<Self, FileError> {
        from_text(&TomlText::from_bytes(path, bytes)?, robot)
    }

    /// Writes the model file.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let text = self.to_toml().map_err(|error| FileError::not_serializable(path, error))?;
        atomic::write(path, text.as_bytes())
    }

    /// The model file's text.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(&ModelText {
            f: FText { value: &self.f, standard_error: &self.f_standard_error },
            friction: FrictionText {
                viscous_nm_s_per_rad: &self.viscous_nm_s_per_rad,
                viscous_standard_error: &self.viscous_standard_error,
                coulomb_nm: &self.coulomb_nm,
                coulomb_standard_error: &self.coulomb_standard_error,
            },
            effect: &self.effects,
            provenance: &self.provenance,
        })
    }

    /// The rigid arm of the model on `robot`.
    pub fn arm(&self, robot: &Robot) -> Arm<f64> {
        Arm { f: self.f, gravity_m_s2: robot.gravity_m_s2 }
    }
}

fn from_text(text: &TomlText<'_>, robot: &Robot) -> Result<Model, FileError> {
    let raw: RawModel = text.parse()?;
    check_robot(text, &raw.provenance, robot)?;
    let f = nine(text, "f.value", &raw.f.value)?;
    let f_standard_error = match &raw.f.standard_error {
        Some(values) => {
            check_standard_errors(text, "f.standard_error", values)?;
            Some(nine(text, "f.standard_error", values)?)
        }
        None => None,
    };
    let arm = Arm { f, gravity_m_s2: robot.gravity_m_s2 };
    arm.check_inertia().map_err(|error| {
        text.error(Some(raw.f.value.span().start), Problem::NotAnArm(error), "the board would refuse it as well")
    })?;
    effects::from_entries(&raw.effect, robot)
        .map_err(|error| text.error(None, Problem::Effect(error), "correct the [[effect]] entry"))?;
    let joints = robot.joints.len();
    let friction = raw.friction.as_ref();
    type Check = fn(&Robot, usize, f64) -> Result<(), FrictionError>;
    let values = |name: &str, values: Option<&Spanned<Vec<f64>>>, known: Vec<Option<f64>>, check: Check| match values {
        Some(values) => {
            check_length(text, name, values, joints)?;
            check_each(text, name, values, |value| value.is_finite() && value >= 0.0, "a finite number, 0 or above")?;
            values.get_ref().iter().enumerate().try_for_each(|(index, value)| check(robot, index, *value)).map_err(
                |error| text.error(Some(values.span().start), Problem::Friction(error), FrictionError::REMEDY),
            )?;
            Ok(values.get_ref().clone())
        }
        None => Ok(known.into_iter().map(|value| value.unwrap_or(0.0)).collect()),
    };
    let errors = |name: &str, values: Option<&Spanned<Vec<f64>>>| match values {
        Some(values) => {
            check_length(text, name, values, joints)?;
            check_standard_errors(text, name, values)?;
            Ok(Some(values.get_ref().clone()))
        }
        None => Ok(None),
    };
    let known_viscous = robot.joints.iter().map(|joint| joint.viscous_friction_nm_s_per_rad).collect();
    let known_coulomb = robot.joints.iter().map(|joint| joint.coulomb_friction_nm).collect();
    Ok(Model {
        f,
        f_standard_error,
        viscous_nm_s_per_rad: values(
            "friction.viscous_nm_s_per_rad",
            friction.map(|friction| &friction.viscous_nm_s_per_rad),
            known_viscous,
            Robot::check_viscous_friction,
        )?,
        viscous_standard_error: errors(
            "friction.viscous_standard_error",
            friction.and_then(|friction| friction.viscous_standard_error.as_ref()),
        )?,
        coulomb_nm: values(
            "friction.coulomb_nm",
            friction.map(|friction| &friction.coulomb_nm),
            known_coulomb,
            Robot::check_coulomb_friction,
        )?,
        coulomb_standard_error: errors(
            "friction.coulomb_standard_error",
            friction.and_then(|friction| friction.coulomb_standard_error.as_ref()),
        )?,
        effects: raw.effect,
        provenance: raw.provenance,
    })
}

/// Refuses a model that says it is of another robot; one that says nothing is taken as it is.
fn check_robot(text: &TomlText<'_>, provenance: &toml::Table, robot: &Robot) -> Result<(), FileError> {
    let word = |name: &str| provenance.get(name).and_then(toml::Value::as_str);
    let expected = robot.identity();
    let Some(found) = word(ROBOT_IDENTITY).filter(|found| *found != expected) else { return Ok(()) };
    let problem = Problem::OtherRobot { named: word("robot").unwrap_or("?").into(), found: found.into(), expected };
    let remedy = "pass the robot file that it was identified with as --robot; gear ratios, counts per revolution, torque \
                  constants and gravity must be the same";
    Err(text.error(None, problem, remedy))
}

fn nine(text: &TomlText<'_>, name: &str, values: &Spanned<Vec<f64>>) -> Result<[f64; PARAMETERS], FileError> {
    check_length(text, name, values, PARAMETERS)?;
    let mut nine = [0.0; PARAMETERS];
    nine.copy_from_slice(values.get_ref());
    Ok(nine)
}

fn check_length(text: &TomlText<'_>, name: &str, values: &Spanned<Vec<f64>>, wanted: usize) -> Result<(), FileError> {
    let found = values.get_ref().len();
    if found == wanted {
        return Ok(());
    }
    let problem = Problem::Value {
        field: name.into(),
        value: format!("a list of {found} numbers"),
        limit: format!("a list of {wanted}"),
    };
    Err(text.error(Some(values.span().start), problem, "check that model and robot file belong together"))
}

/// A standard error may be infinite: the parameter cannot be told from the recordings.
fn check_standard_errors(text: &TomlText<'_>, name: &str, values: &Spanned<Vec<f64>>) -> Result<(), FileError> {
    check_each(text, name, values, |value| value >= 0.0, "0 or above (inf where it cannot be told)")
}

fn check_each(
    text: &TomlText<'_>,
    name: &str,
    values: &Spanned<Vec<f64>>,
    good: impl Fn(f64) -> bool,
    limit: &str,
) -> Result<(), FileError> {
    for (index, value) in values.get_ref().iter().enumerate() {
        if !good(*value) {
            let problem =
                Problem::Value { field: format!("{name}[{index}]"), value: value.to_string(), limit: limit.into() };
            return Err(text.error(Some(values.span().start), problem, "identify again, or correct the number"));
        }
    }
    Ok(())
}

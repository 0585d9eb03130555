//! From an identification to a model file and back.

use shared::arm::PARAMETERS;

use crate::identify::{Identification, Parameter, Values};
use crate::model::{Effect, Model, ROBOT_IDENTITY};
use crate::recording::Recording;
use crate::robot::{Kind, Robot};

/// The model that an identification found.
///
/// On a single axis f7 is the moving mass or inertia and f1 is 1, the inertia of the second joint that does not move.
pub fn from_identification(robot: &Robot, found: &Identification, provenance: toml::Table) -> Model {
    let values = &found.values;
    let joints = robot.joints.len();
    let mut f = values.f;
    if robot.kind == Kind::SingleAxis {
        f[0] = 1.0;
    }
    // What was not sought is taken as known: its standard error is 0. What nothing shows is known as its range is.
    let unsought = |parameter: Parameter| match parameter {
        Parameter::F(index) if found.not_identifiable.contains(&parameter) => {
            let [low, high] = robot.search[index];
            high - low
        }
        _ => 0.0,
    };
    let errors = |of: &dyn Fn(usize) -> Parameter, count: usize| -> Option<Vec<f64>> {
        let known: Vec<Option<f64>> = (0..count).map(|index| found.standard_error(of(index))).collect();
        let all = known.iter().enumerate().map(|(index, error)| error.unwrap_or_else(|| unsought(of(index))));
        known.iter().any(Option::is_some).then(|| all.collect())
    };
    let f_standard_error = errors(&Parameter::F, PARAMETERS).and_then(|errors| errors.try_into().ok());
    let offset = |index: usize| {
        let parameter = Parameter::TorqueOffset(index);
        let sought = found.free.contains(&parameter);
        sought.then(|| Effect {
            name: TORQUE_OFFSET.into(),
            joint: robot.joints[index].name.clone(),
            parameters: [("torque_nm".to_string(), values.torque_offset_nm[index])].into(),
            standard_error: found
                .standard_error(parameter)
                .map(|error| ("torque_nm".to_string(), error))
                .into_iter()
                .collect(),
        })
    };
    Model {
        f,
        f_standard_error,
        viscous_nm_s_per_rad: values.viscous_nm_s_per_rad[..joints].to_vec(),
        viscous_standard_error: errors(&Parameter::Viscous, joints),
        coulomb_nm: values.coulomb_nm[..joints].to_vec(),
        coulomb_standard_error: errors(&Parameter::Coulomb, joints),
        effects: (0..joints).filter_map(offset).collect(),
        provenance,
    }
}

/// The name of the constant torque of a motor among a model's effects.
const TORQUE_OFFSET: &str = "torque-offset";

/// What a simulation takes from a model: f, friction and torque offsets. Other effects are left out.
pub fn values(robot: &Robot, model: &Model) -> Values {
    let mut values = Values::of_robot(robot);
    values.f = model.f;
    for (index, joint) in robot.joints.iter().enumerate().take(2) {
        let own = |values: &[f64], known: f64| values.get(index).copied().unwrap_or(known);
        values.viscous_nm_s_per_rad[index] = own(&model.viscous_nm_s_per_rad, values.viscous_nm_s_per_rad[index]);
        values.coulomb_nm[index] = own(&model.coulomb_nm, values.coulomb_nm[index]);
        let mut offsets = model.effects.iter().filter(|e| e.name == TORQUE_OFFSET && e.joint == joint.name);
        values.torque_offset_nm[index] =
            offsets.find_map(|effect| effect.parameters.get("torque_nm").copied()).unwrap_or(0.0);
    }
    values
}

/// Whether [`values()`] takes this effect of a model into a simulation.
pub fn is_simulated(effect: &Effect) -> bool {
    effect.name == TORQUE_OFFSET
}

/// Where a model comes from.
pub fn provenance(robot: &Robot, recordings: &[Recording], method: &str, seed: u64) -> toml::Table {
    let text = |text: &str| toml::Value::String(text.into());
    let paths = recordings.iter().map(|recording| text(&recording.path.display().to_string())).collect();
    toml::Table::from_iter([
        ("tool".to_string(), text(crate::TOOL_VERSION)),
        ("robot".to_string(), text(&robot.name)),
        (ROBOT_IDENTITY.to_string(), text(&robot.identity())),
        ("recordings".to_string(), toml::Value::Array(paths)),
        ("method".to_string(), text(method)),
        // TOML's integers are signed; seeds above keep their bits.
        ("seed".to_string(), toml::Value::Integer(seed as i64)),
    ])
}

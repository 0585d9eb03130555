//! A model as JSON, with its units.

use serde_json::{Value, json};

use crate::model::Model;
use crate::robot::{Robot, Unit};

/// Units of f1..f9 of an arm.
const F_UNITS: [&str; 9] = ["kg m²", "kg m²", "kg m²", "kg m²", "kg m", "kg m", "kg m²", "kg m", "kg m"];

/// `model` of `robot` as one JSON object. A standard error is null where the recordings do not tell the value, and absent
/// where it was not sought.
pub fn model_json(model: &Model, robot: &Robot) -> Value {
    let with_error = |mut value: Value, error: Option<f64>| {
        if let Some(error) = error {
            // JSON has no infinity: serde_json writes null.
            value["standard_error"] = json!(error);
        }
        value
    };
    let f: serde_json::Map<String, Value> = (0..model.f.len())
        .map(|index| {
            let unit = if robot.unit == Unit::Metre && index == 6 { "kg" } else { F_UNITS[index] };
            let error = model.f_standard_error.map(|errors| errors[index]);
            (format!("f{}", index + 1), with_error(json!({"value": model.f[index], "unit": unit}), error))
        })
        .collect();
    let at = |values: &Option<Vec<f64>>, joint: usize| values.as_ref().and_then(|values| values.get(joint).copied());
    let (viscous_unit, coulomb_unit) = match robot.unit {
        Unit::Radian => ("N m s/rad", "N m"),
        Unit::Metre => ("N s/m", "N"),
    };
    let joints: Vec<Value> = robot
        .joints
        .iter()
        .enumerate()
        .map(|(index, joint)| {
            let viscous = json!({"value": model.viscous_nm_s_per_rad[index], "unit": viscous_unit});
            let coulomb = json!({"value": model.coulomb_nm[index], "unit": coulomb_unit});
            json!({
                "name": joint.name,
                "viscous_friction_at_motor": with_error(viscous, at(&model.viscous_standard_error, index)),
                "coulomb_friction_at_motor": with_error(coulomb, at(&model.coulomb_standard_error, index)),
            })
        })
        .collect();
    json!({
        "robot": robot.name,
        "gravity_m_s2": robot.gravity_m_s2,
        "f": f,
        "joints": joints,
        "effects": model.effects,
        "provenance": model.provenance,
        "exported_by": crate::TOOL_VERSION,
    })
}

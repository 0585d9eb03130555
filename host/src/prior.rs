//! What is known of an arm before an identification: a file of values with their uncertainty, and the gains and leads that
//! a recorded current shows.

use std::collections::BTreeMap;
use std::path::Path;

use toml::Spanned;

use crate::calibrate::{CalibrateError, Source, calibrate, leads};
use crate::file_error::{FileError, Problem};
use crate::identify::{Parameter, Prior, Sought, free_parameters};
use crate::model::Model;
use crate::recording::Recording;
use crate::robot::{Law, Robot};
use crate::toml_text::TomlText;

/// A lead that is measured counts as known to this many ticks at best: a current is not measured at one instant.
const CURRENT_INSTANT_TICKS: f64 = 1e-3;

/// A gain that is measured counts as known to this share at best: no current sensor's scale is better.
const CURRENT_SCALE: f64 = 1e-4;

/// Reads prior knowledge of `robot`: a model file, whose values are taken with their standard errors, or a table of
/// `name = [mean, standard deviation]` with the names that `identify` prints (`f1`, `"Coulomb friction 2"` or
/// `coulomb_friction_2`).
pub fn read(path: &Path, robot: &Robot) -> Result<Vec<Prior>, FileError> {
    let text = TomlText::read(path)?;
    let table: toml::Table = text.parse()?;
    if table.contains_key("f") {
        return Ok(of_model(&Model::read(path, robot)?));
    }
    let entries: BTreeMap<Spanned<String>, Spanned<[f64; 2]>> = text.parse()?;
    let everything = free_parameters(robot, &Sought { gain: true, lead: true, ..Sought::default() });
    entries
        .into_iter()
        .map(|(key, entry)| {
            let refuse = |field: String, value: String, limit: String, remedy: &str| {
                text.error(Some(key.span().start), Problem::Value { field, value, limit }, remedy)
            };
            let known = everything.iter().find(|parameter| folded(&parameter.name(robot)) == folded(key.get_ref()));
            let Some(&parameter) = known else {
                let names: Vec<String> = everything.iter().map(|parameter| parameter.name(robot)).collect();
                return Err(refuse(
                    "a name".into(),
                    format!("`{}`", key.get_ref()),
                    format!("one of {}", names.join(", ")),
                    "correct the name",
                ));
            };
            let [mean, standard_deviation] = *entry.get_ref();
            if !(mean.is_finite() && standard_deviation.is_finite() && standard_deviation > 0.0) {
                return Err(refuse(
                    key.get_ref().clone(),
                    format!("[{mean}, {standard_deviation}]"),
                    "[mean, standard deviation], finite, the second above 0".into(),
                    "correct the numbers; leave the line out where nothing is known",
                ));
            }
            Ok(Prior { parameter, mean, standard_deviation })
        })
        .collect()
}

/// Names are the same whatever the case and whatever stands between the words.
fn folded(name: &str) -> String {
    name.to_lowercase().replace(['_', '-'], " ")
}

/// Every value of a model that has a standard error.
fn of_model(model: &Model) -> Vec<Prior> {
    let f = model.f_standard_error.as_ref().map(|errors| errors.as_slice()).unwrap_or_default();
    let viscous = model.viscous_standard_error.as_deref().unwrap_or_default();
    let coulomb = model.coulomb_standard_error.as_deref().unwrap_or_default();
    let of = |parameter: fn(usize) -> Parameter, values: &[f64], errors: &[f64]| -> Vec<Prior> {
        let each = values.iter().zip(errors).enumerate();
        each.map(|(index, (&mean, &standard_deviation))| Prior {
            parameter: parameter(index),
            mean,
            standard_deviation,
        })
        .collect()
    };
    let mut priors = of(Parameter::F, &model.f, f);
    priors.extend(of(Parameter::Viscous, &model.viscous_nm_s_per_rad, viscous));
    priors.extend(of(Parameter::Coulomb, &model.coulomb_nm, coulomb));
    priors.retain(|prior| prior.standard_deviation > 0.0 && prior.standard_deviation.is_finite());
    priors
}

/// What the measured current says about the gain factors: each recording's current against the command its own law
/// gives. Nothing where no current was measured, or where it does not follow the error.
pub fn gains_from_current(robot: &Robot, recordings: &[Recording]) -> Vec<Prior> {
    if robot.current_is_command {
        return Vec::new();
    }
    // Sums of weights and of weighted factors.
    let mut sums = vec![(0.0, 0.0); robot.joints.len()];
    for recording in recordings {
        let Ok(calibration) = calibrate(robot, std::slice::from_ref(recording)) else { continue };
        let Some(loops) = recording.position_loops(robot) else { continue };
        for (joint, found) in calibration.iter().enumerate() {
            let (measured, commanded) = match found.source {
                Source::Measured => (Some(found.position_gain_a_per_count), loops[joint].gain_a_per_count),
                Source::Command => (found.measured_gain_a_per_count, found.position_gain_a_per_count.value),
            };
            let Some(measured) = measured else { continue };
            let deviation = (measured.standard_error / commanded).abs().max(CURRENT_SCALE);
            let weight = 1.0 / (deviation * deviation);
            sums[joint].0 += weight;
            sums[joint].1 += weight * measured.value / commanded;
        }
    }
    let known = sums.into_iter().enumerate().filter(|(_, (weight, _))| *weight > 0.0);
    known
        .map(|(joint, (weight, sum))| Prior {
            parameter: Parameter::Gain(joint),
            mean: sum / weight,
            standard_deviation: weight.sqrt().recip(),
        })
        .collect()
}

/// The leads that the commands, or else the currents, of all `recordings` show: put in place of those noted in manifests
/// and robot file, for the fit to start from, and given as knowledge.
///
/// Where the loop runs faster than the recording most errors it saw are missing, and what a current shows of its lead is
/// good for a start only.
pub fn leads_from_current(
    robot: &mut Robot,
    recordings: &mut [Recording],
    held_out: &mut [Recording],
) -> Result<Vec<Prior>, CalibrateError> {
    let found = leads(robot, recordings)?;
    for (joint, lead) in robot.joints.iter_mut().zip(&found) {
        if let Law::Proportional(position_loop) = &mut joint.law {
            position_loop.lead = lead.value;
        }
    }
    for manifest in recordings.iter_mut().chain(held_out).filter_map(|recording| recording.manifest.as_mut()) {
        for (noted, lead) in manifest.joint.iter_mut().zip(&found) {
            noted.lead = lead.value;
        }
    }
    if robot.loop_ticks_per_record() > 1 {
        return Ok(Vec::new());
    }
    let prior = |(joint, lead): (usize, &crate::calibrate::Estimate)| Prior {
        parameter: Parameter::Lead(joint),
        mean: lead.value,
        standard_deviation: lead.standard_error.max(CURRENT_INSTANT_TICKS),
    };
    Ok(found.iter().enumerate().map(prior).collect())
}

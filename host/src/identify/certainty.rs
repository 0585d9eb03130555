//! What the covariance of a fit says, in words and numbers for people: correlations, directions left open, how well each
//! recording is foretold by the others, how far repeated recordings scatter.

use nalgebra::DMatrix;

use super::covariance::Certainty;
use super::experiment::Experiment;
use super::parameters::{Parameter, Values};
use crate::recording::Recording;
use crate::robot::Robot;

/// A component of a direction below this share of the largest is left out of its description, each measured by what
/// would still count as determined.
const NEGLIGIBLE: f64 = 0.1;

/// A combination of parameters that the recordings do not determine: moving all of them together by `components` changes
/// next to nothing of what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// The parameters that move, and by how much each, in its own unit: one standard deviation along the direction.
    pub components: Vec<(Parameter, f64)>,
    /// Where it is the common scale of f, friction and gains, which no movement can determine: the relative change of
    /// all of them that is one standard deviation.
    pub common_scale: Option<f64>,
}

impl Direction {
    /// The direction in a sentence, with what to do about it.
    pub fn sentence(&self, robot: &Robot) -> String {
        let names: Vec<String> = self.components.iter().map(|(parameter, _)| parameter.name(robot)).collect();
        let names = names.join(", ");
        if self.common_scale.is_some() {
            return format!(
                "{names} share a common factor that nothing here determines: position alone cannot tell a stronger motor \
                 from a heavier arm; give what is known of the friction (--friction known) or of the gains or anything \
                 else (--prior), or record the current in ampere"
            );
        }
        let f_alone = self.components.iter().all(|(parameter, _)| matches!(parameter, Parameter::F(_)));
        let remedy = if f_alone {
            "add a movement with another period, or a faster one"
        } else {
            "add a movement at other speeds, or give what is known beforehand (--prior)"
        };
        if let [(_, by)] = self.components.as_slice() {
            return format!("{names} is known to ±{:.3} only: {remedy}", by.abs());
        }
        let least = self.components.iter().map(|(_, by)| by.abs()).fold(f64::INFINITY, f64::min);
        let ratios: Vec<String> = self.components.iter().map(|(_, by)| format!("{:.3}", by / least)).collect();
        format!("{names} move together along ({}): {remedy}", ratios.join(", "))
    }
}

/// One recording judged by a fit to all others.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Closed-loop difference per joint on it, counts rms.
    pub rms_counts: Vec<f64>,
    /// Innovations per joint on it, counts rms.
    pub innovation_rms_counts: Vec<f64>,
}

/// One movement recorded several times: each recording fitted alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Repeats {
    /// The recordings, by their place among those given.
    pub recordings: Vec<usize>,
    /// Standard deviation of each sought parameter over the recordings.
    pub scatter: Vec<f64>,
    /// Standard error of each from one recording (root mean square over them).
    pub standard_errors: Vec<f64>,
}

impl Repeats {
    /// Scatter over standard error, root mean square over the parameters: about 1 where standard errors hold.
    pub fn ratio(&self) -> f64 {
        let squares =
            self.scatter.iter().zip(&self.standard_errors).map(|(scatter, stated)| (scatter / stated).powi(2));
        (squares.sum::<f64>() / self.scatter.len().max(1) as f64).sqrt()
    }
}

pub fn standard_errors(covariance: &DMatrix<f64>) -> Vec<f64> {
    covariance.diagonal().iter().map(|variance| variance.max(0.0).sqrt()).collect()
}

pub fn correlations(covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let errors = standard_errors(covariance);
    let of = |i: usize, j: usize| covariance[(i, j)] / (errors[i] * errors[j]);
    (0..errors.len()).map(|i| (0..errors.len()).map(|j| of(i, j)).collect()).collect()
}

pub fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

/// Largest over least eigenvalue; infinite where the least is lost in rounding.
pub fn condition_number(scaled_information: &DMatrix<f64>) -> f64 {
    let eigenvalues = scaled_information.clone().symmetric_eigenvalues();
    let (least, most) = (eigenvalues.min(), eigenvalues.max());
    if least > f64::EPSILON * most { most / least } else { f64::INFINITY }
}

/// The directions of `free` that `covariance` leaves open: along each, one standard deviation is more than `tolerances`,
/// the largest standard errors that count as determined.
pub fn weak_directions(
    values: &Values,
    free: &[Parameter],
    covariance: &DMatrix<f64>,
    tolerances: &[f64],
) -> Vec<Direction> {
    if covariance.iter().any(|value| !value.is_finite()) {
        return Vec::new();
    }
    let relative =
        DMatrix::from_fn(free.len(), free.len(), |i, j| covariance[(i, j)] / (tolerances[i] * tolerances[j]));
    let eigen = relative.symmetric_eigen();
    let mut order: Vec<usize> = (0..free.len()).filter(|&k| eigen.eigenvalues[k] > 1.0).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let direction = |k: usize| {
        let column = eigen.eigenvectors.column(k);
        let largest = column.amax();
        let deviation = eigen.eigenvalues[k].sqrt();
        let by = |i: usize| if column[i] == 0.0 { 0.0 } else { column[i] * tolerances[i] * deviation };
        let shown = |i: usize| column[i].abs() > NEGLIGIBLE * largest;
        let common_scale = free
            .iter()
            .position(|parameter| matches!(parameter, Parameter::Gain(_)))
            .map(|gain| by(gain) / values.get(free[gain]))
            .filter(|&factor| {
                factor != 0.0
                    && (0..free.len()).all(|i| {
                        let off = (by(i) - factor * values.get(free[i])) / (tolerances[i] * deviation);
                        off.abs() <= NEGLIGIBLE * largest || !tolerances[i].is_finite()
                    })
            });
        // Every parameter has its part in a common scale, however much of it would still count as determined.
        let is_part = |i: usize| if common_scale.is_some() { tolerances[i].is_finite() } else { shown(i) };
        let components = (0..free.len()).filter(|&i| is_part(i)).map(|i| (free[i], by(i))).collect();
        Direction { components, common_scale: common_scale.map(f64::abs) }
    };
    order.into_iter().map(direction).collect()
}

/// Every recording judged by the values that the others give.
pub fn left_out(
    robot: &Robot,
    recordings: &[Recording],
    values: &Values,
    free: &[Parameter],
    certainty: &Certainty,
) -> Vec<LeftOut> {
    if recordings.len() < 2 {
        return Vec::new();
    }
    let judge = |(index, recording): (usize, &Recording)| {
        let change = certainty.change_without(index);
        let moved: Vec<f64> = values.of(free).iter().zip(change.iter()).map(|(value, change)| value + change).collect();
        let values = values.with(free, &moved);
        // The recording is one of those just fitted, so that it can be prepared.
        let experiment = Experiment::new(robot, std::slice::from_ref(recording)).ok()?;
        Some(LeftOut {
            rms_counts: experiment.closed_loop_rms_counts(&values),
            innovation_rms_counts: experiment.innovation_rms_counts(&values),
        })
    };
    recordings.iter().enumerate().filter_map(judge).collect()
}

/// The movements among `recordings` that were made more than once.
pub fn repeats(recordings: &[Recording], certainty: &Certainty) -> Vec<Repeats> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (index, recording) in recordings.iter().enumerate() {
        let same = |group: &&mut Vec<usize>| recordings[group[0]].reference_counts == recording.reference_counts;
        match groups.iter_mut().find(same) {
            Some(group) => group.push(index),
            None => groups.push(vec![index]),
        }
    }
    let of_group = |group: Vec<usize>| {
        let alone: Vec<_> = group.iter().map(|&recording| certainty.alone(recording)).collect();
        let count = alone.len() as f64;
        let over_recordings = |of: &dyn Fn(usize) -> f64, parts: f64| {
            ((0..alone.len()).map(|k| of(k).powi(2)).sum::<f64>() / parts).sqrt()
        };
        let parameters = alone[0].0.len();
        let mean = |i: usize| alone.iter().map(|(change, _)| change[i]).sum::<f64>() / count;
        Repeats {
            scatter: (0..parameters).map(|i| over_recordings(&|k| alone[k].0[i] - mean(i), count - 1.0)).collect(),
            standard_errors: (0..parameters)
                .map(|i| over_recordings(&|k| alone[k].1[(i, i)].max(0.0).sqrt(), count))
                .collect(),
            recordings: group,
        }
    };
    groups.into_iter().filter(|group| group.len() > 1).map(of_group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values() -> Values {
        Values { f: shared::arm::REFERENCE_F, ..Values::of_robot(&Robot::paper()) }
    }

    /// A covariance that is small but along one direction.
    fn open_along(direction: &[f64], tolerances: &[f64]) -> DMatrix<f64> {
        DMatrix::from_fn(direction.len(), direction.len(), |i, j| {
            let small = if i == j { (0.1 * tolerances[i]).powi(2) } else { 0.0 };
            small + direction[i] * direction[j]
        })
    }

    #[test]
    fn the_direction_that_one_movement_leaves_open_is_named() {
        let free: Vec<Parameter> = (0..9).map(Parameter::F).collect();
        let tolerances = [0.02; 9];
        let mut direction = [0.0; 9];
        [direction[6], direction[7], direction[8]] = [0.47, 0.1, -0.1];
        let found = weak_directions(&values(), &free, &open_along(&direction, &tolerances), &tolerances);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].common_scale, None);
        let sentence = found[0].sentence(&Robot::paper());
        let signs = ["along (4.700, 1.000, -1.000)", "along (-4.700, -1.000, 1.000)"];
        assert!(sentence.starts_with("f7, f8, f9 move together"), "{sentence}");
        assert!(
            signs.iter().any(|signs| sentence.contains(signs)) && sentence.contains("another period"),
            "{sentence}"
        );
        assert_eq!(weak_directions(&values(), &free, &open_along(&[0.0; 9], &tolerances), &tolerances), []);
    }

    #[test]
    fn a_common_scale_is_told_from_other_directions() {
        let mut free: Vec<Parameter> = (0..9).map(Parameter::F).collect();
        for joint in 0..2 {
            free.extend([Parameter::Viscous(joint), Parameter::Coulomb(joint), Parameter::Gain(joint)]);
        }
        let values = values();
        let tolerances: Vec<f64> = values.of(&free).iter().map(|value| 0.02 * value.abs()).collect();
        let scale: Vec<f64> = values.of(&free).iter().map(|value| 0.3 * value).collect();
        let found = weak_directions(&values, &free, &open_along(&scale, &tolerances), &tolerances);
        assert_eq!(found.len(), 1);
        assert!((found[0].common_scale.unwrap() - 0.3).abs() < 0.01, "{found:?}");
        let sentence = found[0].sentence(&Robot::paper());
        assert!(sentence.contains("common factor") && sentence.contains("record the current"), "{sentence}");
        // The same without the gain of joint 3 is another direction.
        let mut other = scale;
        other[14] = 0.0;
        let found = weak_directions(&values, &free, &open_along(&other, &tolerances), &tolerances);
        assert_eq!(found[0].common_scale, None);
    }
}

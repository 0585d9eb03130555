//! The whole library at once: what each effect would add to the innovations, and how much of them it explains.

use rayon::prelude::*;

use super::fit::Setting;
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::instants::instants;
use super::library::{Kind, LIBRARY, MOTOR_INERTIA, Parameter, Role, Search};
use super::linear::{Base, Column, Fit};
use super::noise::{self, Noise};
use super::response::Response;
use super::rows::Rows;
use super::scan;
use super::trace::Trace;

/// Between which shares of a joint's inertia its motor's is first looked for.
const MOTOR_SHARES: [f64; 2] = [0.05, 0.8];

/// A model that was fitted, and what is left.
pub struct Stage<'a> {
    /// What is common to all.
    pub setting: &'a Setting<'a>,
    /// What was known beforehand.
    pub baseline: &'a Baseline,
    /// The model.
    pub hypothesis: &'a Hypothesis,
    /// What it leaves.
    pub residual: &'a Column,
    /// How that falls per unit of each of its parameters.
    pub columns: &'a [Column],
    /// Motion in the recordings.
    pub traces: &'a [Trace],
    /// What small torques leave.
    pub response: &'a Response,
    /// Innovations it leaves, in counts.
    pub innovations: &'a crate::identify::Columns,
}

/// How the coefficients of a feature's columns become an effect's values.
#[derive(Clone, Debug)]
enum Form {
    /// The coefficient is the size; these are the other values.
    Proportional(Vec<f64>),
    /// Cosine and sine, the same for all recordings or a pair for each; the shape's values.
    Wave(Vec<f64>),
    /// An instance as it was simulated.
    Whole(Instance),
    /// The coefficient is the size of this instance.
    Sized(Instance),
}

/// What an effect adds to the innovations.
pub struct Feature {
    /// Which effect.
    pub kind: &'static Kind,
    /// On which joint.
    pub joint: usize,
    /// Its columns.
    pub columns: Vec<Column>,
    form: Form,
    records: usize,
    /// How many parameters it counts for.
    pub price: f64,
}

impl Feature {
    /// The effect with these coefficients; none where they make no sense.
    pub fn instance(&self, coefficients: &[f64]) -> Option<Instance> {
        let kind = self.kind;
        match &self.form {
            Form::Proportional(others) => {
                let first = &kind.parameters[0];
                let size = coefficients[0].clamp(first.range[0], first.range[1]);
                let values: Vec<f64> = std::iter::once(size).chain(others.iter().copied()).collect();
                Some(Instance::new(kind, self.joint, &values, self.records))
            }
            Form::Wave(shape) => {
                let waves: Vec<(f64, f64)> =
                    coefficients.chunks(2).map(|pair| (pair[0].hypot(pair[1]), (-pair[1]).atan2(pair[0]))).collect();
                let size = waves.iter().map(|wave| wave.0).sum::<f64>() / waves.len() as f64;
                let first = &kind.parameters[0];
                let mut shape = shape.iter().copied();
                let values: Vec<f64> = kind
                    .parameters
                    .iter()
                    .map(|parameter| match parameter.role {
                        Role::Size => size.clamp(first.range[0], first.range[1]),
                        Role::Phase => waves[0].1,
                        Role::Shape | Role::Moment | Role::Detail => shape.next().unwrap_or(1.0),
                    })
                    .collect();
                let mut instance = Instance::new(kind, self.joint, &values, self.records);
                if waves.len() > 1 {
                    for (record, wave) in instance.records.iter_mut().zip(&waves) {
                        record[0] = wave.1;
                    }
                }
                Some(instance)
            }
            Form::Whole(instance) => (coefficients[0] > 0.0).then(|| instance.clone()),
            Form::Sized(instance) => {
                let mut instance = instance.clone();
                let [low, high] = kind.parameters[0].range;
                instance.common[0] = Some(coefficients[0].clamp(low, high));
                Some(instance)
            }
        }
    }
}

/// A feature with its score.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Index of the feature.
    pub feature: usize,
    /// By how much χ² falls less what its parameters cost.
    pub delta_bic: f64,
    /// The fit.
    pub fit: Fit,
}

/// One feature still to be simulated.
struct Planned {
    kind: &'static Kind,
    joint: usize,
    form: Form,
    /// Effects whose residuals are compared with the stage's own, and by what the difference is divided.
    points: Vec<(Instance, f64)>,
    masked: bool,
}

/// Every feature of the library beside what the stage's model has already.
pub fn features(stage: &Stage, weights: &[f64]) -> Vec<Feature> {
    let planned = plan(stage, weights);
    let candidates: Vec<_> = planned
        .iter()
        .flat_map(|planned| &planned.points)
        .map(|(instance, _)| {
            let with = stage.hypothesis.with(instance.clone());
            with.candidate(stage.baseline, stage.setting.experiment)
        })
        .collect();
    let possible: Vec<_> = candidates.iter().flatten().cloned().collect();
    let mut residuals = stage.setting.residuals(&possible).into_iter();
    let mut residuals = candidates.iter().map(|c| c.is_some().then(|| residuals.next()).flatten());
    let records = stage.setting.experiment.segments.len();
    let mut features = Vec::new();
    for planned in planned {
        let mut columns = Vec::new();
        let mut whole = true;
        for (_, by) in &planned.points {
            match residuals.next().flatten() {
                Some(residual) => columns.push(stage.residual.difference(&residual, *by)),
                None => whole = false,
            }
        }
        if !whole || columns.iter().any(|column| !column.motion.iter().all(|x| x.is_finite())) {
            continue;
        }
        if planned.masked {
            columns = (0..records)
                .flat_map(|record| columns.iter().map(move |column| (record, column)))
                .map(|(record, column)| masked(stage.setting.rows, column, record))
                .collect();
        }
        features.push(Feature {
            kind: planned.kind,
            joint: planned.joint,
            columns,
            form: planned.form,
            records,
            price: planned.kind.price(records),
        });
    }
    features
}

/// The column with zeros outside one recording.
fn masked(rows: &Rows, column: &Column, record: usize) -> Column {
    let mut motion = vec![0.0; column.motion.len()];
    for series in rows.series.iter().filter(|series| series.segment == record) {
        motion[series.rows.clone()].copy_from_slice(&column.motion[series.rows.clone()]);
    }
    Column { motion, current: Vec::new() }
}

fn plan(stage: &Stage, weights: &[f64]) -> Vec<Planned> {
    let robot = stage.setting.experiment.robot;
    let records = stage.setting.experiment.segments.len();
    let mut planned = Vec::new();
    for kind in &LIBRARY {
        let two_link = robot.joints.len() > 1;
        if !two_link && (matches!(kind.name, "base-tilt" | "gravity-spring")) {
            continue;
        }
        for joint in 0..if kind.of_arm { 1 } else { robot.joints.len() } {
            let has = stage.hypothesis.named.iter().any(|named| named.kind.name == kind.name && named.joint == joint);
            if has {
                continue;
            }
            let scale = scan::scale(stage, kind, joint);
            let new = |values: &[f64]| Instance::new(kind, joint, values, records);
            let mut add = |form, points, masked| planned.push(Planned { kind, joint, form, points, masked });
            match kind.search {
                Search::Proportional(shapes) => {
                    let step = kind.parameters[0].step * 3.0;
                    for shape in shapes {
                        let rest = kind.parameters[1 + shape.len()..].iter().map(|p| begin_with(stage, p, joint));
                        let shape: Vec<f64> = shape.iter().map(|value| value * scale).chain(rest).collect();
                        let values: Vec<f64> = std::iter::once(step).chain(shape.iter().copied()).collect();
                        add(Form::Proportional(shape), vec![(new(&values), step)], false);
                    }
                }
                Search::Wave(orders) => {
                    let scanned;
                    let orders: &[f64] = match orders {
                        Some(orders) => orders,
                        None => {
                            scanned = scan::orders(stage, kind, joint, weights);
                            &scanned
                        }
                    };
                    let step = kind.parameters[0].step * 3.0;
                    let per_record = kind.parameters.iter().any(|parameter| parameter.per_record);
                    for order in orders.iter().map(|order| order * scale) {
                        let at = |phase: f64| {
                            let value = |role: Role| match role {
                                Role::Size => step,
                                Role::Phase => phase,
                                Role::Shape | Role::Moment | Role::Detail => order,
                            };
                            let values: Vec<f64> = kind.parameters.iter().map(|p| value(p.role)).collect();
                            (new(&values), step)
                        };
                        let points = vec![at(0.0), at(-std::f64::consts::FRAC_PI_2)];
                        add(Form::Wave(vec![order]), points, per_record);
                    }
                }
                Search::Finite(points) => {
                    for values in points {
                        let rest = kind.parameters[values.len()..].iter().map(|p| begin_with(stage, p, joint));
                        let instance = new(&values.iter().copied().chain(rest).collect::<Vec<f64>>());
                        add(Form::Whole(instance.clone()), vec![(instance, 1.0)], false);
                    }
                }
                Search::Limit(shares) => {
                    if stage.setting.experiment.robot.current_is_command && kind.name == "voltage-saturation" {
                        continue;
                    }
                    for share in shares {
                        let values = scan::limit(stage, kind, joint, *share);
                        let instance = new(&values);
                        add(Form::Whole(instance.clone()), vec![(instance, 1.0)], false);
                    }
                }
                Search::Instant => {
                    for mut instance in instants(stage, kind, joint, weights, None) {
                        let step = kind.parameters[0].step * 3.0;
                        instance.common[0] = Some(step);
                        add(Form::Sized(instance.clone()), vec![(instance, step)], false);
                    }
                }
            }
        }
    }
    planned
}

/// Where a parameter begins that no start names. A motor's share of its joint's inertia: the elbow's is f1 − f2.
fn begin_with(stage: &Stage, parameter: &Parameter, joint: usize) -> f64 {
    let usual = parameter.usual();
    if parameter.name != MOTOR_INERTIA.name {
        return usual;
    }
    let robot = stage.setting.experiment.robot;
    let f = stage.baseline.values.f;
    let ratio = robot.joints[joint].gear_ratio;
    let whole = if joint == 0 { f[6] } else { f[0] } / (ratio * ratio);
    let share = if joint == 1 && f[0] > f[1] { (f[0] - f[1]) / f[0] } else { usual / whole };
    share.clamp(MOTOR_SHARES[0], MOTOR_SHARES[1]) * whole
}

/// Prior precisions (one over standard deviations) and offsets of a stage's parameters.
pub fn priors(stage: &Stage) -> (Vec<f64>, Vec<f64>) {
    let point = stage.hypothesis.point();
    let each = stage.hypothesis.unknowns(stage.baseline).into_iter().zip(point);
    each.map(|(unknown, value)| match unknown.prior {
        Some([centre, sigma]) => (1.0 / sigma, value - centre),
        None => (0.0, 0.0),
    })
    .unzip()
}

/// χ² gained by every feature beside `base`, best first.
pub fn score(base: &Base, features: &[Feature], rows: usize) -> Vec<Scored> {
    let alone = base.alone().cost;
    let mut scored: Vec<Scored> = features
        .par_iter()
        .enumerate()
        .map(|(index, feature)| {
            let columns: Vec<&Column> = feature.columns.iter().collect();
            let fit = base.with(&columns);
            let base_count = fit.coefficients.len() - columns.len();
            let possible = feature.instance(&fit.coefficients[base_count..]).is_some();
            let gain = if possible && fit.cost.is_finite() { alone - fit.cost } else { 0.0 };
            Scored { feature: index, delta_bic: gain - feature.price * (rows as f64).ln(), fit }
        })
        .collect();
    scored.sort_by(|a, b| b.delta_bic.total_cmp(&a.delta_bic));
    scored
}

/// The noise that is left once everything the library might explain is gone: features are taken one after the other
/// as long as they bring more than `threshold`.
pub fn cleaned_noise(stage: &Stage, features: &[Feature], threshold: f64, most: usize) -> Noise {
    let rows = stage.setting.rows;
    let white = rows.white_counts2(stage.innovations);
    let (precisions, offsets) = priors(stage);
    let mut columns: Vec<Column> = stage.columns.to_vec();
    let (mut precisions, mut offsets) = (precisions, offsets);
    let parameters = |columns: &[Column]| columns.len() as f64 * 0.5;
    let mut noise = noise::most_likely(rows, &stage.residual.motion, white, parameters(&columns));
    let mut taken: Vec<usize> = Vec::new();
    for step in 0..=most {
        let weights = noise::weights(rows, &noise);
        let base = Base::new(&columns, stage.residual, &weights, &precisions, &offsets);
        let fit = base.alone();
        let left = base.left(&fit, &[]);
        noise = noise::most_likely(rows, &left, white, parameters(&columns));
        if step == most {
            break;
        }
        let weights = noise::weights(rows, &noise);
        let base = Base::new(&columns, stage.residual, &weights, &precisions, &offsets);
        let scored = score(&base, features, rows.count());
        let Some(best) = scored.iter().find(|scored| !taken.contains(&scored.feature)) else { break };
        if best.delta_bic < threshold {
            break;
        }
        taken.push(best.feature);
        for column in &features[best.feature].columns {
            columns.push(column.clone());
            precisions.push(0.0);
            offsets.push(0.0);
        }
    }
    noise
}

//! A model under test: base parameters with what is known about them, and effects.

use super::fit::Unknown;
use super::instance::Instance;
use super::library::Role;
use super::simulate::{Candidate, neutral};
use crate::identify::{Experiment, Parameter, Values};

/// What is known before anything is explained.
#[derive(Clone, Debug)]
pub struct Baseline {
    /// Its values.
    pub values: Values,
    /// The parameters that a refit may move.
    pub free: Vec<Parameter>,
    /// Their standard errors; infinite where nothing is known.
    pub standard_error: Vec<f64>,
}

/// Base parameters and effects with their values.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// Values of [`Baseline::free`].
    pub base: Vec<f64>,
    /// The effects.
    pub named: Vec<Instance>,
}

impl Hypothesis {
    /// The baseline itself with the effects it came with.
    pub fn baseline(baseline: &Baseline, known: &[Instance]) -> Self {
        Self { base: baseline.values.of(&baseline.free), named: known.to_vec() }
    }

    /// This with one more effect.
    pub fn with(&self, instance: Instance) -> Self {
        let mut new = self.clone();
        new.named.push(instance);
        new
    }

    /// Every number of it.
    pub fn point(&self) -> Vec<f64> {
        let effects = self.named.iter().flat_map(|instance| instance.flat().into_iter().map(|(_, value)| value));
        self.base.iter().copied().chain(effects).collect()
    }

    /// This with other numbers.
    pub fn at(&self, point: &[f64]) -> Self {
        let (base, mut rest) = point.split_at(self.base.len());
        let named = self
            .named
            .iter()
            .map(|instance| {
                let count = instance.flat().len();
                let (own, others) = rest.split_at(count);
                rest = others;
                instance.with_flat(own)
            })
            .collect();
        Self { base: base.to_vec(), named }
    }

    /// What a refit may do to each number.
    pub fn unknowns(&self, baseline: &Baseline) -> Vec<Unknown> {
        let base = baseline.free.iter().zip(&baseline.standard_error).map(|(&parameter, &error)| {
            let centre = baseline.values.get(parameter);
            let step = match parameter {
                Parameter::F(_) => 1e-3 * centre.abs().max(0.3),
                Parameter::Viscous(_) => 1e-2 * centre.abs().max(1e-5),
                // As large as that of the effect of the same name: a smaller one shows mostly where the model sticks.
                Parameter::TorqueOffset(_) => 1e-2 * centre.abs().max(0.3),
                _ => 1e-2 * centre.abs().max(1e-3),
            };
            let low = match parameter {
                Parameter::Viscous(_) | Parameter::Coulomb(_) => 0.0,
                _ => f64::NEG_INFINITY,
            };
            Unknown {
                step,
                range: [low, f64::INFINITY],
                prior: error.is_finite().then_some([centre, error]),
                free: true,
            }
        });
        let effects = self.named.iter().flat_map(|instance| {
            instance.flat().into_iter().map(|(parameter, value)| {
                // A phase does nothing to a wave without size; its step is an angle either way.
                let step = if parameter.role == Role::Phase { 1e-2 } else { parameter.step };
                // Limits that are off are infinite: nothing to differentiate.
                Unknown { step, range: parameter.range, prior: None, free: value.is_finite() }
            })
        });
        base.chain(effects).collect()
    }

    /// The model to simulate; none if its inertia could not be an arm's.
    pub fn candidate(&self, baseline: &Baseline, experiment: &Experiment) -> Option<Candidate> {
        let values = baseline.values.with(&baseline.free, &self.base);
        let robot = experiment.robot;
        if robot.kind == crate::robot::Kind::TwoLink && values.arm(robot).check_inertia().is_err() {
            return None;
        }
        if robot.kind == crate::robot::Kind::SingleAxis && values.f[6] <= 0.0 {
            return None;
        }
        let effects = if self.named.is_empty() {
            Vec::new()
        } else {
            (0..experiment.segments.len())
                .map(|record| {
                    let mut effects = neutral(experiment);
                    self.named.iter().for_each(|instance| instance.apply(&mut effects, record));
                    effects
                })
                .collect()
        };
        Some(Candidate { plant: values.plant(robot), effects })
    }
}

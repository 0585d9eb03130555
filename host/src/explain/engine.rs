//! Refits of hypotheses on the recordings of an explanation, and what they leave.

use nalgebra::DMatrix;

use super::fit::{Refit, Setting, Solution};
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::library::{Parameter, Role};
use super::linear::Column;
use super::noise::{self, Noise};
use super::remainder::ESTIMATED;
use super::response::Response;
use super::screen::Stage;
use super::simulate::simulate;
use super::trace::{Trace, traces};
use super::verdict::MOST_TORQUE_NOISE;
use crate::identify::Columns;

/// Degrees of freedom that a refit takes out of the rows of each joint.
pub const FITTED: f64 = 6.0;

/// Recordings with everything that does not change while they are explained.
pub struct Engine<'a> {
    /// Recordings and their rows.
    pub setting: Setting<'a>,
    /// What was known beforehand.
    pub baseline: &'a Baseline,
    /// Their motion.
    pub traces: Vec<Trace>,
    /// What small torques leave in them.
    pub response: Response,
}

/// A hypothesis after its refit.
#[derive(Clone)]
pub struct Fitted {
    /// With its best values.
    pub hypothesis: Hypothesis,
    /// χ² of data and priors.
    pub cost: f64,
    /// What it leaves.
    pub residual: Column,
    /// How that falls with each parameter.
    pub columns: Vec<Column>,
}

/// Which parameters a refit may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Free {
    /// All.
    All,
    /// Those of the last effect.
    Last,
    /// Those that every recording has for itself.
    OfRecords,
}

impl<'a> Engine<'a> {
    /// Gets ready.
    pub fn new(setting: Setting<'a>, baseline: &'a Baseline) -> Self {
        let traces = traces(setting.experiment);
        let arm = baseline.values.arm(setting.experiment.robot);
        let response = Response::new(setting.experiment, &traces, &arm);
        Self { setting, baseline, traces, response }
    }

    /// A hypothesis with its best values; none where it describes nothing that can exist.
    pub fn refit(
        &self,
        hypothesis: &Hypothesis,
        weights: &[f64],
        known_columns: &[Column],
        free: Free,
        iterations: usize,
    ) -> Option<Fitted> {
        let mut unknowns = hypothesis.unknowns(self.baseline);
        let count = unknowns.len();
        match free {
            Free::All => {}
            Free::Last => {
                let own = hypothesis.named.last().map_or(0, |instance| instance.flat().len());
                unknowns.iter_mut().take(count - own).for_each(|unknown| unknown.free = false);
            }
            Free::OfRecords => {
                let effects = hypothesis.named.iter().flat_map(Instance::flat);
                let per_record = std::iter::repeat_n(false, hypothesis.base.len())
                    .chain(effects.map(|(parameter, _)| parameter.per_record));
                unknowns.iter_mut().zip(per_record).for_each(|(unknown, own)| unknown.free &= own);
            }
        }
        let build = |point: &[f64]| hypothesis.at(point).candidate(self.baseline, self.setting.experiment);
        let known: Vec<Option<Column>> = (0..count).map(|i| known_columns.get(i).cloned()).collect();
        let refit = Refit {
            setting: &self.setting,
            unknowns: &unknowns,
            build: &build,
            weights,
            known_columns: &known,
            iterations,
        };
        let Solution { values, cost, residual, columns } = refit.solve(&hypothesis.point())?;
        Some(Fitted { hypothesis: hypothesis.at(&values), cost, residual, columns })
    }

    /// χ² of data and priors of a fitted hypothesis under other weights.
    pub fn cost(&self, fitted: &Fitted, weights: &[f64]) -> f64 {
        fitted.residual.inner(&fitted.residual, weights) + self.prior_cost(&fitted.hypothesis)
    }

    /// χ² of the base parameters against what was known.
    pub fn prior_cost(&self, hypothesis: &Hypothesis) -> f64 {
        let each = hypothesis.unknowns(self.baseline).into_iter().zip(hypothesis.point());
        each.filter_map(|(unknown, value)| unknown.prior.map(|[centre, sigma]| ((value - centre) / sigma).powi(2)))
            .sum()
    }

    /// Covariance of a fitted hypothesis's free parameters, with their places in its point.
    pub fn covariance(&self, fitted: &Fitted, weights: &[f64]) -> (Vec<usize>, DMatrix<f64>) {
        let unknowns = fitted.hypothesis.unknowns(self.baseline);
        let build = |_: &[f64]| None;
        let refit = Refit {
            setting: &self.setting,
            unknowns: &unknowns,
            build: &build,
            weights,
            known_columns: &[],
            iterations: 0,
        };
        refit.covariance(&fitted.columns)
    }

    /// Standard errors of a fitted hypothesis's parameters, in the order of its point; infinite for what was not free.
    pub fn standard_errors(&self, fitted: &Fitted, weights: &[f64]) -> Vec<f64> {
        let (free, covariance) = self.covariance(fitted, weights);
        let mut errors = vec![f64::INFINITY; fitted.columns.len()];
        for (index, &of) in free.iter().enumerate() {
            errors[of] = covariance[(index, index)].max(0.0).sqrt();
        }
        errors
    }

    /// What the parameters of the `index`-th effect of a fitted hypothesis cost where χ² is weighed against them (BIC).
    pub fn price(&self, fitted: &Fitted, index: usize, weights: &[f64]) -> f64 {
        let whole = (self.setting.rows.count() as f64).ln();
        let named = &fitted.hypothesis.named;
        let own: Vec<&Parameter> = named[index].flat().into_iter().map(|(parameter, _)| parameter).collect();
        let mut price = named[index].kind.price(self.setting.experiment.segments.len()) * whole;
        if own.iter().any(|parameter| parameter.role == Role::Detail) {
            let before: usize = named[..index].iter().map(|other| other.flat().len()).sum();
            let errors = self.standard_errors(fitted, weights);
            let own = own.into_iter().zip(&errors[fitted.hypothesis.base.len() + before..]);
            let details = own.filter(|(parameter, _)| parameter.role == Role::Detail);
            price += details.map(|(parameter, &error)| parameter.price_of_detail(error, whole)).sum::<f64>();
        }
        price
    }

    /// Innovations of a hypothesis in counts.
    pub fn innovations(&self, hypothesis: &Hypothesis) -> Columns {
        let candidate = hypothesis.candidate(self.baseline, self.setting.experiment);
        let left = candidate.map(|candidate| simulate(self.setting.experiment, &[candidate]));
        left.and_then(|mut left| left.pop()).map(|left| left.innovations).unwrap_or_default()
    }

    /// The stage that a fitted hypothesis is.
    pub fn stage<'b>(&'b self, fitted: &'b Fitted, innovations: &'b Columns) -> Stage<'b> {
        Stage {
            setting: &self.setting,
            baseline: self.baseline,
            hypothesis: &fitted.hypothesis,
            residual: &fitted.residual,
            columns: &fitted.columns,
            traces: &self.traces,
            response: &self.response,
            innovations,
        }
    }

    /// Root mean square of settled innovations over all joints and recordings, in counts.
    pub fn gap(&self, innovations: &Columns) -> f64 {
        let joints = self.setting.experiment.robot.joints.len();
        let sum: f64 = self.joint_gaps(innovations).iter().take(joints).map(|gap| gap * gap).sum();
        (sum / joints as f64).sqrt()
    }

    /// Root mean square of settled innovations of each joint over all recordings, in counts; 0 for a joint that is not there.
    pub fn joint_gaps(&self, innovations: &Columns) -> [f64; 2] {
        let experiment = self.setting.experiment;
        let mut sums = [0.0; 2];
        for (segment, columns) in experiment.segments.iter().zip(innovations) {
            let settled = experiment.settled(segment);
            for (sum, column) in sums.iter_mut().zip(columns).take(experiment.robot.joints.len()) {
                *sum += column[settled.clone()].iter().map(|x| x * x).sum::<f64>();
            }
        }
        sums.map(|sum| (sum / self.length().max(1.0)).sqrt())
    }

    /// Settled samples of all recordings.
    pub fn length(&self) -> f64 {
        let experiment = self.setting.experiment;
        experiment.segments.iter().map(|segment| experiment.settled(segment).len() as f64).sum()
    }

    /// Standard deviation in N m at the motor of the torque noise behind `noise`.
    pub fn torque_noise_nm(&self, noise: &Noise) -> [f64; 2] {
        let period_s = self.setting.experiment.robot.record_period_s;
        [0, 1].map(|joint| {
            let mobility = self.response.own_mobility(joint);
            if mobility > 0.0 { noise[joint].acceleration_counts_s2(period_s) / mobility } else { 0.0 }
        })
    }

    /// `noise` with a torque noise of at most `share` of each joint's Coulomb friction.
    pub fn plausible(&self, noise: &Noise, share: f64) -> Noise {
        let torque = self.torque_noise_nm(noise);
        let mut plausible = *noise;
        for joint in 0..self.setting.experiment.robot.joints.len() {
            let most = share * self.baseline.values.coulomb_nm[joint];
            if torque[joint] > most && torque[joint] > 0.0 {
                plausible[joint].torque_counts2 *= (most / torque[joint]).powi(2);
            }
        }
        plausible
    }

    /// The noise that a fitted model leaves, as far as it can be noise; its white part is that of `noise`.
    pub fn own_noise(&self, fitted: &Fitted, noise: &Noise) -> Noise {
        let white = noise.map(|joint| joint.white_counts2);
        let own = noise::most_likely(self.setting.rows, &fitted.residual.motion, white, FITTED);
        self.plausible(&own, ESTIMATED * MOST_TORQUE_NOISE)
    }

    /// What noise like this leaves, over all joints, in counts rms.
    pub fn floor(&self, noise: &Noise) -> f64 {
        let joints = self.setting.experiment.robot.joints.len();
        let period_s = self.setting.experiment.robot.record_period_s;
        let sum: f64 = noise.iter().take(joints).map(|noise| noise.rms_counts(period_s).powi(2)).sum();
        (sum / joints as f64).sqrt()
    }

    /// Weights of the rows under a noise.
    pub fn weights(&self, noise: &Noise) -> Vec<f64> {
        noise::weights(self.setting.rows, noise)
    }
}

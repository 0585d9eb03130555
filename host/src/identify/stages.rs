//! The stages of an identification, one after the other.

use rayon::prelude::*;
use shared::genetic::{Coding, Settings};

use super::certainty::standard_errors;
use super::covariance::{Certainty, Fitted, Origin};
use super::experiment::{Experiment, Fineness};
use super::least_squares::{self, Bound, ITERATIONS, Problem, Series};
use super::low_pass::low_pass;
use super::noise::InnovationNoise;
use super::parameters::{Parameter, Prior, Values};
use super::search::{Found, Generation, SearchBox, Searcher, acceptable, search};
use super::sensitivity::{Columns, Residual};
use super::{IdentifyError, Progress, consistency, covariance, linear};
use crate::robot::Kind;
use crate::searchers::evolution_strategy;

/// Cut-off frequencies of the filter ladder in Hz: each stage's basin holds the stage before's result.
pub const LADDER_HZ: [f64; 3] = [8.0, 12.0, 15.0];

/// How far around the result the last search looks, in standard errors, and at most, as a share of the search range.
const SEARCHED_ERRORS: f64 = 10.0;
const NEIGHBOURHOOD: f64 = 0.01;

/// Candidates that the last search judges, for each parameter sought, and in a generation: a vector for each core.
const SEARCHED_PER_PARAMETER: usize = 160;
const SEARCH_OFFSPRING: usize = 64;

/// First step of the last search as a share of its box.
const FIRST_STEP: f64 = 0.2;

/// Relative improvement at which a stage stops: a rung of the ladder only has to reach the next one's basin.
const RUNG_TOLERANCE: f64 = 1e-3;
const FINAL_TOLERANCE: f64 = 1e-7;

/// Over how long residuals are taken to be correlated: longer than the memory of the 4 Hz state correction, and a few
/// dozen times in a movement, so that the estimate itself does not scatter. `tests/tests/identification.rs` judges it.
pub const CORRELATION_S: f64 = 0.35;

/// Innovations this many times above their own white part mean that the model lacks something.
const LACKING: f64 = 10.0;

/// What the stages found.
pub struct Outcome {
    /// The best values.
    pub values: Values,
    /// How well the free parameters are known, if the method tells.
    pub certainty: Option<Certainty>,
    /// Whether the model leaves far more than noise.
    pub lack_of_fit: bool,
    /// Simulations spent.
    pub evaluations: usize,
    /// The course of the search.
    pub generations: Vec<Generation>,
}

/// A residual and what is done to it, and to its sensitivities alike, before it is fitted.
struct Prepared<'a> {
    which: Residual,
    /// Linear, or the sensitivities of the outcome would be others.
    prepare: &'a (dyn Fn(Columns) -> Series + Sync),
}

/// One identification under way.
pub struct Run<'a> {
    /// The recordings to fit.
    pub experiment: &'a Experiment<'a>,
    /// The parameters sought.
    pub free: &'a [Parameter],
    /// What is known of them beforehand.
    pub priors: &'a [Prior],
    /// Length of the upper arm in m, where it ties f3 and f4 to f5 and f6.
    pub upper_arm_m: Option<f64>,
    /// Seed of the searches.
    pub seed: u64,
    /// Cut-off frequency of the filter both signals pass before they are compared, in Hz.
    pub filter_hz: Option<f64>,
    /// How the paper's genetic algorithm reads the bits of a gene, if not as the paper has it.
    pub coding: Option<Coding>,
    /// Told of every step.
    pub progress: &'a (dyn Fn(Progress) + Sync),
}

impl Run<'_> {
    /// The paper's genetic algorithm on the whole search range.
    pub fn paper(&self) -> Result<Outcome, IdentifyError> {
        let generations = Settings::paper().generations as usize + 1;
        let step = self.stage("genetic algorithm", 0, generations);
        let mut known = self.known();
        // The paper's ranges cover f alone. What else is unknown is taken from the linear start.
        let f: Vec<Parameter> = self.free.iter().copied().filter(|p| matches!(p, Parameter::F(_))).collect();
        if f.len() < self.free.len() {
            known = linear::linear_start(self.experiment, &known, self.free, self.priors, LADDER_HZ[0]);
        }
        let ranges: Vec<[f64; 2]> = f.iter().map(|&parameter| self.range(parameter, &known)).collect();
        let coding = self.coding.unwrap_or(Coding::Binary);
        let searcher = Searcher::Genetic(Settings { coding, ..Settings::paper() });
        let place = SearchBox { free: &f, ranges: &ranges, known: &known, start: None, searcher };
        let found = search(self.experiment, &place, self.seed, &step)?;
        Ok(Outcome {
            values: found.values,
            certainty: None,
            lack_of_fit: false,
            evaluations: found.evaluations,
            generations: found.generations,
        })
    }

    /// Linear start, filter ladder, innovations, and a search around what they give.
    pub fn full(&self) -> Result<Outcome, IdentifyError> {
        let experiment = self.experiment;
        let searched = (SEARCHED_PER_PARAMETER * self.free.len()).div_ceil(SEARCH_OFFSPRING);
        let total = (LADDER_HZ.len() + 2) * ITERATIONS + searched + 1;
        let mut evaluations = 0;

        let mut values = linear::linear_start(experiment, &self.known(), self.free, self.priors, LADDER_HZ[0]);
        values = self.nearest_possible(&values);
        for (rung, cutoff_hz) in LADDER_HZ.into_iter().enumerate() {
            let step = self.stage("filter ladder", rung * ITERATIONS, total);
            let period_s = experiment.robot.record_period_s;
            let cutoff_hz = self.filter_hz.map_or(cutoff_hz, |filter_hz| cutoff_hz.min(filter_hz));
            let smooth = |columns: Columns| -> Series {
                self.series(columns).into_iter().map(|s| low_pass(&s, period_s, cutoff_hz)).collect()
            };
            let residual = Prepared { which: Residual::ClosedLoop(Fineness::Coarse), prepare: &smooth };
            let fit = self.solve(&values, &residual, RUNG_TOLERANCE, &step);
            values = values.with(self.free, &fit.values);
            evaluations += fit.evaluations;
        }

        let done = LADDER_HZ.len() * ITERATIONS;
        let settled = |columns: Columns| self.settled(self.filtered(columns));
        let innovations = Prepared { which: Residual::Innovations, prepare: &settled };
        let step = self.stage("innovations", done, total);
        let fit = self.solve(&values, &innovations, FINAL_TOLERANCE, &step);
        evaluations += fit.evaluations;
        let best = values.with(self.free, &fit.values);
        let left = settled(experiment.innovations(&best));
        // What the filter stops is not to be explained; the white part it leaves nothing of.
        let lack_of_fit = match self.filter_hz {
            None => lacks_something(&left),
            Some(_) => experiment.robot.quantised && exceeds_rounding(&left),
        };

        let (residual, noise) = if lack_of_fit {
            // Where the model lacks something no estimate is the true one. The best is then the one that repeats the
            // tracking errors best, which is what the paper's Y asks for.
            (Residual::ClosedLoop(Fineness::Fine), None)
        } else {
            // Once more, every frequency now weighed by its own noise.
            (Residual::Innovations, self.noise(&left))
        };
        let joints = experiment.robot.joints.len();
        let weigh = |columns: Columns| -> Series {
            let series = settled(columns);
            let Some(noise) = &noise else { return series };
            series.iter().enumerate().map(|(index, series)| noise[index % joints].whiten(series)).collect()
        };
        let weighed = Prepared { which: residual, prepare: &weigh };
        let step = self.stage(if lack_of_fit { "closed loop" } else { "innovations" }, done, total);
        let fit = self.solve(&best, &weighed, FINAL_TOLERANCE, &step);
        evaluations += fit.evaluations + self.free.len() + 1;
        let values = best.with(self.free, &fit.values);
        let certainty = self.certainty(&values, &weighed, &step);

        let step = self.stage("search", done + 2 * ITERATIONS, total);
        // Told, not taken: less than the truth leaves is luck with the ringing, and many standard errors away from it.
        let found = self.search_around(&values, &certainty, &step)?;
        evaluations += found.as_ref().map_or(0, |found| found.evaluations);
        (self.progress)(Progress { stage: "done", done: total, total });
        Ok(Outcome {
            values,
            certainty: Some(certainty),
            lack_of_fit,
            evaluations,
            generations: found.map_or(Vec::new(), |found| found.generations),
        })
    }

    /// The least of the paper's Y near a result, by the search that wins `armid bench ga`. None behind a filter: what Y
    /// compares, the filter is there to leave out.
    fn search_around(
        &self,
        values: &Values,
        certainty: &Certainty,
        step: &(dyn Fn(f64) + Sync),
    ) -> Result<Option<Found>, IdentifyError> {
        if self.filter_hz.is_some() {
            return Ok(None);
        }
        let start = values.of(self.free);
        let errors = standard_errors(&certainty.covariance);
        let range = |((&parameter, &value), &error): ((&Parameter, &f64), &f64)| {
            let [low, high] = self.range(parameter, values);
            // An error that is no number is none to go by.
            let reach = (SEARCHED_ERRORS * error).min(NEIGHBOURHOOD * (high - low)).max(f64::EPSILON * (high - low));
            [value - reach, value + reach]
        };
        let ranges: Vec<[f64; 2]> = self.free.iter().zip(&start).zip(&errors).map(range).collect();
        let searcher = Searcher::EvolutionStrategy {
            settings: evolution_strategy::Settings {
                first_step: FIRST_STEP,
                offspring: Some(SEARCH_OFFSPRING),
                ..Default::default()
            },
            budget: SEARCHED_PER_PARAMETER * self.free.len(),
        };
        let place = SearchBox { free: self.free, ranges: &ranges, known: values, start: Some(&start), searcher };
        search(self.experiment, &place, self.seed, step).map(Some)
    }

    /// What is known before anything is identified.
    pub(super) fn known(&self) -> Values {
        let lead = self.experiment.recorded_leads(self.free);
        Values { upper_arm_m: self.upper_arm_m, lead, ..Values::of_robot(self.experiment.robot) }
    }

    /// The noise of each joint's innovations. The noise model is that of a held command: in a faster loop the rounding
    /// goes through the loop as well, and innovations stay as they are; so they do behind a filter.
    fn noise(&self, innovations: &Series) -> Option<Vec<InnovationNoise>> {
        let joints = self.experiment.robot.joints.len();
        let of_joint = |joint: usize| {
            let series = innovations.iter().skip(joint).step_by(joints).map(Vec::as_slice);
            InnovationNoise::of(series, self.experiment.robot.record_period_s)
        };
        (!self.experiment.commands_are_missing() && self.filter_hz.is_none())
            .then(|| (0..joints).map(of_joint).collect())
    }

    fn certainty(&self, values: &Values, residual: &Prepared, step: &(dyn Fn(f64) + Sync)) -> Certainty {
        let at = values.of(self.free);
        self.problem(values, residual, FINAL_TOLERANCE, step, |problem, level| {
            let (sensitivities, residuals) = ((problem.sensitivities)(&at), (problem.residuals)(&at));
            covariance::certainty(&self.fitted(&sensitivities, &residuals, level * level))
        })
    }

    /// Residuals of the recordings, one series per segment and joint, with what they come from.
    pub(super) fn fitted<'a>(
        &self,
        sensitivities: &'a [Series],
        residuals: &'a Series,
        prior_variance: f64,
    ) -> Fitted<'a> {
        let experiment = self.experiment;
        let joints = experiment.robot.joints.len();
        let of_segment = |recording: usize| (0..joints).map(move |joint| Origin { joint, recording });
        let origins: Vec<Origin> =
            experiment.segments.iter().flat_map(|segment| of_segment(segment.recording)).collect();
        Fitted {
            sensitivities,
            residuals,
            recordings: origins.iter().map(|origin| origin.recording + 1).max().unwrap_or(0),
            origins,
            period_s: experiment.robot.record_period_s,
            correlated_samples: (CORRELATION_S / experiment.robot.record_period_s) as usize,
            prior_variance,
        }
    }

    /// The columns after the filter, if there is one.
    fn filtered(&self, mut columns: Columns) -> Columns {
        if let Some(cutoff_hz) = self.filter_hz {
            let period_s = self.experiment.robot.record_period_s;
            for series in columns.iter_mut().flatten() {
                *series = low_pass(series, period_s, cutoff_hz);
            }
        }
        columns
    }

    fn broken_bounds(&self, values: &Values) -> Vec<Bound> {
        consistency::broken_bounds(self.experiment.robot, values, self.free)
    }

    /// `values` if they are possible, otherwise possible ones near them.
    fn nearest_possible(&self, values: &Values) -> Values {
        if self.broken_bounds(values).is_empty() {
            return *values;
        }
        let target = values.of(self.free);
        let scale: Vec<f64> = self
            .free
            .iter()
            .map(|&parameter| {
                let [low, high] = self.range(parameter, values);
                1.0 / (high - low)
            })
            .collect();
        let ones = |k: usize| (0..target.len()).map(|i| if i == k { scale[k] } else { 0.0 }).collect::<Vec<f64>>();
        let problem = Problem {
            residuals: &|at: &[f64]| {
                vec![at.iter().zip(&target).zip(&scale).map(|((at, target), scale)| (at - target) * scale).collect()]
            },
            sensitivities: &|at: &[f64]| (0..at.len()).map(|k| vec![ones(k)]).collect(),
            broken_bounds: &|at: &[f64]| self.broken_bounds(&values.with(self.free, at)),
            acceptable: &|_| true,
            tolerance: RUNG_TOLERANCE,
            progress: &|_| (),
        };
        // From the middle of the ranges, which is possible, toward the target.
        let middle: Vec<f64> =
            self.free.iter().map(|&p| self.range(p, values)).map(|[low, high]| 0.5 * (low + high)).collect();
        let fit = problem.solve(&middle);
        values.with(self.free, &fit.values)
    }

    /// The settled part of the robot's own joints, one series per segment and joint.
    fn settled(&self, columns: Vec<[Vec<f64>; 2]>) -> Series {
        let joints = self.experiment.robot.joints.len();
        let mut series = Vec::new();
        for (segment, pair) in self.experiment.segments.iter().zip(columns) {
            for column in pair.iter().take(joints) {
                series.push(column[self.experiment.settled(segment)].to_vec());
            }
        }
        series
    }

    /// The residuals of the robot's own joints, one series per segment and joint.
    fn series(&self, columns: Vec<[Vec<f64>; 2]>) -> Series {
        let joints = self.experiment.robot.joints.len();
        columns.into_iter().flat_map(|pair| pair.into_iter().take(joints)).collect()
    }

    fn solve(
        &self,
        values: &Values,
        residual: &Prepared,
        tolerance: f64,
        step: &(dyn Fn(f64) + Sync),
    ) -> least_squares::Fit {
        self.problem(values, residual, tolerance, step, |problem, _| problem.solve(&values.of(self.free)))
    }

    fn problem<T>(
        &self,
        values: &Values,
        residual: &Prepared,
        tolerance: f64,
        step: &(dyn Fn(f64) + Sync),
        work: impl FnOnce(&Problem, f64) -> T,
    ) -> T {
        let experiment = self.experiment;
        let at = |candidate: &[f64]| values.with(self.free, candidate);
        let prepared = |candidate: &[f64]| (residual.prepare)(experiment.residual(&at(candidate), residual.which));
        // A prior counts as one residual of the size that the others have.
        let level = if self.priors.is_empty() { 0.0 } else { rms(&prepared(&values.of(self.free))) };
        let weight = |prior: &Prior| level / prior.standard_deviation;
        let residuals = |candidate: &[f64]| {
            let mut series = prepared(candidate);
            let candidate = at(candidate);
            let of_prior = |prior: &Prior| (candidate.get(prior.parameter) - prior.mean) * weight(prior);
            series.extend(self.priors.iter().map(|prior| vec![of_prior(prior)]));
            series
        };
        let sensitivities = |candidate: &[f64]| -> Vec<Series> {
            let columns = experiment.sensitivities(&at(candidate), self.free, residual.which);
            let mut series: Vec<Series> = columns.into_par_iter().map(residual.prepare).collect();
            for (&parameter, series) in self.free.iter().zip(&mut series) {
                let slope = |prior: &Prior| if prior.parameter == parameter { weight(prior) } else { 0.0 };
                series.extend(self.priors.iter().map(|prior| vec![slope(prior)]));
            }
            series
        };
        let broken_bounds = |candidate: &[f64]| self.broken_bounds(&at(candidate));
        let acceptable = |candidate: &[f64]| acceptable(experiment, &at(candidate));
        let problem = Problem {
            residuals: &residuals,
            sensitivities: &sensitivities,
            broken_bounds: &broken_bounds,
            acceptable: &acceptable,
            tolerance,
            progress: step,
        };
        work(&problem, level)
    }

    /// The range a parameter lies in: the robot file's for f of an arm, otherwise around what is known.
    fn range(&self, parameter: Parameter, values: &Values) -> [f64; 2] {
        let robot = self.experiment.robot;
        let value = values.get(parameter);
        match (robot.kind, parameter) {
            (Kind::TwoLink, Parameter::F(index)) => robot.search[index],
            (_, Parameter::TorqueOffset(joint)) => {
                let reach = values.coulomb_nm[joint].max(1e-6);
                [value - reach, value + reach]
            }
            (_, Parameter::Gain(_)) => [0.5, 1.5],
            (_, Parameter::Lead(_)) => [value - 1.0, value + 1.0],
            _ => [0.0, 2.0 * value.abs().max(1e-6)],
        }
    }

    /// A callback that counts the steps of one stage.
    fn stage(&self, stage: &'static str, from: usize, total: usize) -> impl Fn(f64) + Sync + use<'_> {
        let count = std::sync::atomic::AtomicUsize::new(from);
        move |_| {
            let done = count.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            (self.progress)(Progress { stage, done: done.min(total), total });
        }
    }
}

/// Whether residuals are far larger than the rounding of an encoder.
fn exceeds_rounding(residuals: &Series) -> bool {
    const ROUNDING_COUNTS2: f64 = 1.0 / 12.0;
    residuals.iter().any(|series| {
        let mean_square = series.iter().map(|x| x * x).sum::<f64>() / series.len().max(1) as f64;
        mean_square > LACKING * LACKING * ROUNDING_COUNTS2
    })
}

fn rms(series: &Series) -> f64 {
    let count = series.iter().map(Vec::len).sum::<usize>().max(1);
    (series.iter().flatten().map(|x| x * x).sum::<f64>() / count as f64).sqrt()
}

/// Whether residuals are far larger than their white part, which second differences measure: √6 of it is all that
/// white noise leaves in them, and a slow misfit leaves next to nothing.
fn lacks_something(residuals: &Series) -> bool {
    residuals.iter().any(|series| {
        let rms = |sum: f64, count: usize| (sum / count.max(1) as f64).sqrt();
        let total = rms(series.iter().map(|x| x * x).sum(), series.len());
        let second_differences: f64 = series.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2)).sum();
        let white = rms(second_differences, series.len()) / 6f64.sqrt();
        total > LACKING * white
    })
}

//! What others do, to compare with: least squares on the torque equations, along the measured motion (IDIM-LS) and
//! along the simulated loop's (DIDIM; Gautier, Janot & Vandanjon 2013).
//!
//! Both believe the measured torque. IDIM-LS differentiates the filtered encoder and takes over what the filter
//! changes; DIDIM differentiates nothing that was measured, but the motion of a model under the robot's own loop.

use shared::drive::centre_of_count;

use super::Progress;
use super::covariance;
use super::experiment::{Experiment, Fineness, Segment};
use super::least_squares::Series;
use super::linear::{Equations, equations, solve};
use super::parameters::Values;
use super::search::acceptable;
use super::stages::{Outcome, Run};

/// Cut-off frequency of the signals in Hz where none is given: the best compromise of noise against bias.
const CUTOFF_HZ: f64 = 25.0;

/// Steps that DIDIM makes at most.
const ROUNDS: usize = 12;

/// How often a step of DIDIM is halved before it is given up.
const HALVINGS: i32 = 6;

/// Relative change of the torques' mismatch at which DIDIM has settled.
const SETTLED: f64 = 1e-4;

impl Run<'_> {
    /// Inverse dynamics on the measured motion.
    pub fn linear(&self) -> Outcome {
        let measured = |segment: &Segment| segment.measured_counts.clone();
        let equations = self.equations(&measured);
        let values = self.solve_equations(&equations);
        self.judged(values, &equations, 0)
    }

    /// Inverse dynamics on the simulated motion, simulated again with what it gives until the torques no longer come
    /// nearer.
    ///
    /// In a soft loop the simulated motion depends on the parameters more than the method supposes, and whole steps may
    /// lead away: steps are halved until the torques come nearer.
    pub fn didim(&self) -> Outcome {
        let mut values = self.linear().values;
        let (mut equations, mut mismatch) = self.mismatch(&values);
        let mut simulations = 1;
        for round in 0..ROUNDS {
            (self.progress)(Progress { stage: "DIDIM", done: round, total: ROUNDS });
            let [from, to] = [&values, &self.solve_equations(&equations)].map(|values| values.of(self.free));
            let better = (0..HALVINGS).find_map(|halving| {
                let share = 0.5_f64.powi(halving);
                let between: Vec<f64> = from.iter().zip(&to).map(|(from, to)| from + share * (to - from)).collect();
                let candidate = values.with(self.free, &between);
                simulations += 1;
                let (equations, reached) = self.mismatch(&candidate);
                (acceptable(self.experiment, &candidate) && reached < mismatch)
                    .then_some((candidate, equations, reached))
            });
            let Some((next, next_equations, reached)) = better else { break };
            let settled = mismatch - reached < SETTLED * mismatch;
            (values, equations, mismatch) = (next, next_equations, reached);
            if settled {
                break;
            }
        }
        self.judged(values, &equations, simulations)
    }

    /// The torque equations along the motion simulated with `values`, and the sum of squares by which these miss them.
    fn mismatch(&self, values: &Values) -> (Vec<Equations>, f64) {
        let simulated = |segment: &Segment| simulated_counts(self.experiment, values, segment);
        let equations = self.equations(&simulated);
        let values = values.of(self.free);
        let miss = |(row, rest): (&Vec<f64>, &f64)| (product(row, &values) - rest).powi(2);
        let sum = equations.iter().flat_map(|e| e.rows.iter().zip(&e.rest).map(miss)).sum();
        (equations, sum)
    }

    fn equations(&self, motion: &dyn Fn(&Segment) -> Vec<[f64; 2]>) -> Vec<Equations> {
        equations(self.experiment, &self.known(), self.free, self.filter_hz.unwrap_or(CUTOFF_HZ), motion)
    }

    fn solve_equations(&self, equations: &[Equations]) -> Values {
        solve(self.experiment, &self.known(), self.free, self.priors, equations)
    }

    /// The outcome with the standard errors that the scatter of the torque suggests.
    fn judged(&self, values: Values, equations: &[Equations], evaluations: usize) -> Outcome {
        let at = values.of(self.free);
        let misfits = |e: &Equations| e.rows.iter().zip(&e.rest).map(|(row, rest)| product(row, &at) - rest).collect();
        let residuals: Series = equations.iter().map(misfits).collect();
        let column = |index: usize| -> Series {
            equations.iter().map(|e| e.rows.iter().map(|row| row[index]).collect()).collect()
        };
        let sensitivities: Vec<Series> = (0..self.free.len()).map(column).collect();
        let certainty = covariance::certainty(&self.fitted(&sensitivities, &residuals, 0.0));
        Outcome { values, certainty: Some(certainty), lack_of_fit: false, evaluations, generations: Vec::new() }
    }
}

fn product(row: &[f64], values: &[f64]) -> f64 {
    row.iter().zip(values).map(|(a, b)| a * b).sum()
}

/// Motor positions of the model under the robot's loop, in counts.
fn simulated_counts(experiment: &Experiment, values: &Values, segment: &Segment) -> Vec<[f64; 2]> {
    let ticks = experiment.closed_loop(values, segment, Fineness::Coarse);
    let position = |(tick, reference): (&shared::replay::ClosedLoopTick<f64>, &[f64; 2])| {
        let actual = [0, 1].map(|joint| reference[joint] - tick.error_counts[joint]);
        if experiment.robot.quantised { actual.map(centre_of_count) } else { actual }
    };
    ticks.iter().zip(&segment.model_reference_counts).map(position).collect()
}

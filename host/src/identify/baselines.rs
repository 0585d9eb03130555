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
use super::stages::{Outcome, Run};

/// Cut-off frequency of the signals in Hz where none is given: the best compromise of noise against bias.
const CUTOFF_HZ: f64 = 25.0;

/// Simulations of the loop that DIDIM makes at most; from the linear start it settles in three or four.
const ROUNDS: usize = 12;

/// Relative change of the parameters at which DIDIM has settled.
const SETTLED: f64 = 1e-6;

impl Run<'_> {
    /// Inverse dynamics on the measured motion.
    pub fn linear(&self) -> Outcome {
        let measured = |segment: &Segment| segment.measured_counts.clone();
        let equations = self.equations(&measured);
        let values = self.solve_equations(&equations);
        self.judged(values, &equations, 0)
    }

    /// Inverse dynamics on the simulated motion, simulated again with what it gives until that no longer changes.
    pub fn didim(&self) -> Outcome {
        let mut values = self.linear().values;
        let mut equations = Vec::new();
        for round in 0..ROUNDS {
            (self.progress)(Progress { stage: "DIDIM", done: round, total: ROUNDS });
            let simulated = |segment: &Segment| simulated_counts(self.experiment, &values, segment);
            equations = self.equations(&simulated);
            let next = self.solve_equations(&equations);
            let change = |&parameter: &_| (next.get(parameter) - values.get(parameter)).abs();
            let size = |&parameter: &_| next.get(parameter).abs();
            let settled = self.free.iter().map(change).sum::<f64>() < SETTLED * self.free.iter().map(size).sum::<f64>();
            values = next;
            if settled {
                return self.judged(values, &equations, round + 1);
            }
        }
        self.judged(values, &equations, ROUNDS)
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
        let misfit = |row: &Vec<f64>, rest: &f64| row.iter().zip(&at).map(|(a, b)| a * b).sum::<f64>() - rest;
        let residuals: Series = equations
            .iter()
            .map(|e| e.rows.iter().zip(&e.rest).map(|(row, rest)| misfit(row, rest)).collect())
            .collect();
        let column = |index: usize| -> Series {
            equations.iter().map(|e| e.rows.iter().map(|row| row[index]).collect()).collect()
        };
        let sensitivities: Vec<Series> = (0..self.free.len()).map(column).collect();
        let certainty = covariance::certainty(&self.fitted(&sensitivities, &residuals, 0.0));
        Outcome { values, certainty: Some(certainty), lack_of_fit: false, evaluations, generations: Vec::new() }
    }
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

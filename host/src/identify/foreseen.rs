//! An experiment that has not been made: what the model says it would record, without rounding and noise.

use shared::control::LawState;
use shared::drive::centre_of_count;
use shared::plant::State;
use shared::replay::ClosedLoop;

use super::experiment::{Experiment, Fineness, Segment, laws};
use super::followed::Followed;
use super::parameters::Values;
use crate::robot::Robot;

/// How long the model holds the start of a movement before it, in s: the arm has sunk into the loop and sticks.
const HOLD_S: f64 = 1.0;

impl<'a> Experiment<'a> {
    /// What a robot with these values would record while following `references`, each a movement sampled every record
    /// period, in joint radians. Commands are those of the robot's own loop, before the amplifier's limit.
    pub fn foreseen(robot: &'a Robot, values: &Values, references_rad: &[Vec<[f64; 2]>]) -> Self {
        let mut experiment = Self::empty(robot);
        // Nothing measured is to be met: what the motion depends on shows at one step as well.
        experiment.innovation_substeps = 1;
        experiment.segments = references_rad
            .iter()
            .enumerate()
            .map(|(index, reference)| experiment.foreseen_segment(values, index, reference))
            .collect();
        experiment
    }

    fn foreseen_segment(&self, values: &Values, index: usize, reference_rad: &[[f64; 2]]) -> Segment {
        let plant = values.plant(self.robot);
        let laws = laws(self.robot, None);
        let counts_per_rad = [self.counts_per_rad(0), self.counts_per_rad(1)];
        let counts = |rad: &[f64; 2]| [rad[0] * counts_per_rad[0], rad[1] * counts_per_rad[1]];
        let reference_counts: Vec<[f64; 2]> = reference_rad.iter().map(counts).collect();
        let still = reference_rad.first().copied().unwrap_or_default();
        let settings = self.settings(self.closed_loop_substeps(Fineness::Coarse));
        let mut model = ClosedLoop::new(&plant, laws.map(LawState::new), &settings, State::at_rest(still));
        for _ in 0..(HOLD_S / self.robot.record_period_s) as usize {
            model.tick(counts(&still), counts(&still), [0.0; 2]);
        }
        let (mut error_counts, mut command_a) = (Vec::new(), Vec::new());
        for (k, &reference) in reference_counts.iter().enumerate() {
            let next = *reference_counts.get(k + 1).unwrap_or(&reference);
            let tick = model.tick(reference, next, [0.0; 2]);
            error_counts.push(tick.error_counts);
            command_a.push(tick.command_a);
        }
        let actual_counts: Vec<[f64; 2]> =
            reference_counts.iter().zip(&error_counts).map(|(r, e)| [r[0] - e[0], r[1] - e[1]]).collect();
        let measured_counts = if self.robot.quantised {
            actual_counts.iter().map(|&actual| actual.map(centre_of_count)).collect()
        } else {
            actual_counts.clone()
        };
        let start = self.start(&measured_counts);
        Segment {
            model_reference_counts: reference_counts.clone(),
            added_torque_nm: vec![[0.0; 2]; reference_counts.len()],
            reference_counts,
            actual_counts,
            error_counts,
            measured_counts,
            // What is measured at a sample is the command of the one before.
            current_a: std::iter::once(command_a[0]).chain(command_a.iter().copied()).take(command_a.len()).collect(),
            command_a,
            laws,
            recording: index,
            // No one searches for what is known.
            followed: Followed::default(),
            start_s: 0.0,
            start,
        }
    }
}

//! The model on a segment, in any number type: plain numbers for a result, lanes for many candidates at once, dual
//! numbers for sensitivities.

use shared::control::LawState;
use shared::plant::{Plant, State};
use shared::replay::{ClosedLoop, ClosedLoopTick, Innovations, RecordedSample, ReplaySettings};
use shared::scalar::Scalar;

use super::experiment::{Experiment, Segment};

/// A model about to repeat the segments of an experiment.
pub struct Simulation<'a, N> {
    /// What was measured.
    pub experiment: &'a Experiment<'a>,
    /// The model.
    pub plant: Plant<N>,
}

impl<N: Scalar> Simulation<'_, N> {
    #[inline(always)]
    fn pair(&self, values: [f64; 2]) -> [N; 2] {
        let number = self.plant.arm.gravity_m_s2;
        [number.constant(values[0]), number.constant(values[1])]
    }

    /// The robot's laws as they are at the first sample of `segment`.
    fn laws(&self, segment: &Segment) -> [LawState<N>; 2] {
        let number = |value| self.plant.arm.gravity_m_s2.constant(value);
        let law = |joint: usize| {
            let experiment = self.experiment;
            let counts_per_tick = segment.start.velocity_rad_s[joint]
                * experiment.counts_per_rad(joint)
                * experiment.robot.record_period_s;
            let error_counts = segment.error_counts[0][joint];
            let actual_counts = segment.reference_counts[0][joint] - error_counts;
            let law = segment.laws[joint].map(number);
            LawState::moving(law, number(error_counts), number(actual_counts), number(counts_per_tick))
        };
        [law(0), law(1)]
    }

    fn start(&self, segment: &Segment) -> State<N> {
        State {
            position_rad: self.pair(segment.start.position_rad),
            velocity_rad_s: self.pair(segment.start.velocity_rad_s),
        }
    }

    /// Follows a segment under the robot's own loop; `sample` gets the number of each, what the model does there, and
    /// the recorded minus the modelled tracking error in counts.
    #[inline(always)]
    pub fn closed_loop(
        &self,
        segment: &Segment,
        settings: &ReplaySettings,
        mut sample: impl FnMut(usize, &ClosedLoopTick<N>, [N; 2]),
    ) {
        let mut model = ClosedLoop::new(&self.plant, self.laws(segment), settings, self.start(segment));
        for k in 0..segment.error_counts.len() {
            let reference = segment.model_reference_counts[k];
            let tick = model.tick(self.pair(reference), self.pair(segment.added_torque_nm[k]));
            // The model's motor is ahead of the robot's by what its own error is smaller, references apart.
            let actual = segment.actual_counts[k];
            let recorded = self.pair([reference[0] - actual[0], reference[1] - actual[1]]);
            let difference = [recorded[0] - tick.error_counts[0], recorded[1] - tick.error_counts[1]];
            sample(k, &tick, difference);
        }
    }

    /// Follows a segment under the recorded command; `sample` gets the number of each and its innovation in counts.
    #[inline(always)]
    pub fn innovations(&self, segment: &Segment, settings: &ReplaySettings, mut sample: impl FnMut(usize, [N; 2])) {
        let mut model = Innovations::new(&self.plant, self.laws(segment), settings, self.start(segment));
        for k in 0..segment.error_counts.len() {
            let innovation = model.tick(&RecordedSample {
                reference_counts: self.pair(segment.model_reference_counts[k]),
                measured_counts: self.pair(segment.measured_counts[k]),
                command_a: self.pair(segment.command_a[k]),
                added_torque_nm: self.pair(segment.added_torque_nm[k]),
            });
            sample(k, innovation);
        }
    }
}

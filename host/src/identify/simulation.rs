//! The model on a segment, in any number type: plain numbers for a result, lanes for many candidates at once, dual
//! numbers for sensitivities.

use shared::control::{LawState, PositionLaw};
use shared::machine::{Machine, Movable};
use shared::plant::State;
use shared::replay::{ClosedLoop, ClosedLoopTick, Innovations, RecordedSample, ReplaySettings};
use shared::scalar::Scalar;

use super::experiment::{Experiment, Segment};

/// A model about to repeat the segments of an experiment.
pub struct Simulation<'a, P> {
    /// What was measured.
    pub experiment: &'a Experiment<'a>,
    /// The model: a plain plant, or one with effects.
    pub plant: P,
}

/// The motion of a model at a sample.
pub type Motion<P> = <<P as Movable>::Machine as Machine<<P as Movable>::Number>>::Motion;

/// Leads of the position loops in ticks that stand for the recorded ones, where they are given.
pub type Leads<N> = [Option<N>; 2];

#[inline(always)]
fn pair<N: Scalar, M: Machine<N>>(machine: &M, values: [f64; 2]) -> [N; 2] {
    [machine.number(values[0]), machine.number(values[1])]
}

impl<P: Movable> Simulation<'_, P> {
    /// The robot's laws as they are at the first sample of `segment`.
    pub(crate) fn laws(&self, machine: &P::Machine, segment: &Segment) -> [LawState<P::Number>; 2] {
        let number = |value| machine.number(value);
        let law = |joint: usize| {
            let experiment = self.experiment;
            let counts_per_tick =
                segment.start.velocity_rad_s[joint] * experiment.counts_per_rad(joint) * experiment.robot.loop_period_s;
            let error_counts = segment.error_counts[0][joint];
            let actual_counts = segment.reference_counts[0][joint] - error_counts;
            let law = segment.laws[joint].map(number);
            LawState::moving(law, number(error_counts), number(actual_counts), number(counts_per_tick))
        };
        [law(0), law(1)]
    }

    /// As [`Self::laws`], with other leads.
    fn laws_led(&self, machine: &P::Machine, segment: &Segment, leads: &Leads<P::Number>) -> [LawState<P::Number>; 2] {
        let [first, second] = self.laws(machine, segment);
        [led(first, leads[0]), led(second, leads[1])]
    }

    pub(crate) fn start(machine: &P::Machine, segment: &Segment) -> Motion<P> {
        let state = State {
            position_rad: pair(machine, segment.start.position_rad),
            velocity_rad_s: pair(machine, segment.start.velocity_rad_s),
        };
        machine.start(state, segment.start_s)
    }

    /// Follows a segment under the robot's own loop; `sample` gets the number of each, what the model does there, and
    /// the recorded minus the modelled tracking error in counts.
    #[inline(always)]
    pub fn closed_loop(
        &self,
        segment: &Segment,
        settings: &ReplaySettings,
        sample: impl FnMut(usize, &ClosedLoopTick<P::Number>, [P::Number; 2]),
    ) {
        self.closed_loop_led(segment, settings, &[None; 2], sample);
    }

    /// As [`Self::closed_loop`], with other leads.
    #[inline(always)]
    pub fn closed_loop_led(
        &self,
        segment: &Segment,
        settings: &ReplaySettings,
        leads: &Leads<P::Number>,
        mut sample: impl FnMut(usize, &ClosedLoopTick<P::Number>, [P::Number; 2]),
    ) {
        let machine = self.plant.machine();
        let start = Self::start(&machine, segment);
        let mut model = ClosedLoop::of(machine, self.laws_led(&machine, segment, leads), settings, start);
        for k in 0..segment.error_counts.len() {
            let reference = segment.model_reference_counts[k];
            let next = pair(&machine, segment.next_model_reference(k));
            let tick = model.tick(pair(&machine, reference), next, pair(&machine, segment.added_torque_nm[k]));
            // The model's motor is ahead of the robot's by what its own error is smaller, references apart.
            let actual = segment.actual_counts[k];
            let recorded: [P::Number; 2] = pair(&machine, [reference[0] - actual[0], reference[1] - actual[1]]);
            let difference = [recorded[0] - tick.error_counts[0], recorded[1] - tick.error_counts[1]];
            sample(k, &tick, difference);
        }
    }

    /// Follows a segment under the recorded command; `sample` gets the number of each and its innovation in counts. Where
    /// a joint's lead is given its command is not the recorded one but what its law makes of the recorded errors, so
    /// that the motion says how much lead there was.
    #[inline(always)]
    pub fn innovations_led(
        &self,
        segment: &Segment,
        settings: &ReplaySettings,
        leads: &Leads<P::Number>,
        mut sample: impl FnMut(usize, [P::Number; 2]),
    ) {
        self.innovations_and_motion_led(segment, settings, leads, |k, innovation, _| sample(k, innovation));
    }

    /// As [`Self::innovations_led`], with the recorded leads and the motion the model had come to at each sample, before its correction: the
    /// current it would measure, where it is a plant with effects (the first sample's apart).
    #[inline(always)]
    pub fn innovations_and_motion(
        &self,
        segment: &Segment,
        settings: &ReplaySettings,
        sample: impl FnMut(usize, [P::Number; 2], &Motion<P>),
    ) {
        self.innovations_and_motion_led(segment, settings, &[None; 2], sample);
    }

    #[inline(always)]
    fn innovations_and_motion_led(
        &self,
        segment: &Segment,
        settings: &ReplaySettings,
        leads: &Leads<P::Number>,
        mut sample: impl FnMut(usize, [P::Number; 2], &Motion<P>),
    ) {
        let machine = self.plant.machine();
        let start = Self::start(&machine, segment);
        let mut model = Innovations::of(machine, self.laws_led(&machine, segment, leads), settings, start);
        // The robot's own laws again, which see what was recorded.
        let law =
            |joint: usize| led(LawState::new(segment.laws[joint].map(|value| machine.number(value))), leads[joint]);
        let mut recorded_laws = [law(0), law(1)];
        for k in 0..segment.error_counts.len() {
            let motion = *model.motion();
            let mut command_a = pair(&machine, segment.command_a[k]);
            for joint in 0..2 {
                if leads[joint].is_some() {
                    let reference_counts = machine.number(segment.reference_counts[k][joint]);
                    let actual_counts = machine.number(segment.actual_counts[k][joint]);
                    command_a[joint] = recorded_laws[joint].command_a(reference_counts, actual_counts);
                }
            }
            let innovation = model.tick(&RecordedSample {
                reference_counts: pair(&machine, segment.model_reference_counts[k]),
                next_reference_counts: pair(&machine, segment.next_model_reference(k)),
                measured_counts: pair(&machine, segment.measured_counts[k]),
                command_a,
                added_torque_nm: pair(&machine, segment.added_torque_nm[k]),
            });
            sample(k, innovation, &motion);
        }
    }
}

/// A law with another lead, where one is given.
#[inline(always)]
fn led<N: Scalar>(law: LawState<N>, lead: Option<N>) -> LawState<N> {
    match lead {
        Some(lead) => law.with_lead(lead),
        None => law,
    }
}

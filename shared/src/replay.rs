//! A model arm repeating a recording, in two ways.
//!
//! [`ClosedLoop`] is the paper's experiment: the model runs under the same position loop as the robot and from the
//! reference alone; its tracking error is compared with the measured one (closed-loop output error, the paper's Y).
//!
//! [`Innovations`] drives the model with the command the robot really received and corrects its state a little at
//! every sample. What it could not foresee, the innovation, is at the true parameters the rounding of the encoder and
//! nothing else: white, 1/√12 counts rms. The correction is that of a 4 Hz observer, slow enough to leave the
//! parameters' traces in the innovations and fast enough to forget rounding and the start.
//!
//! The model's encoder is never rounded: only its mean effect is kept ([`mean_count`]), so that derivatives exist.

mod followed;

pub use followed::{FollowedLoop, FollowedModel, FollowedSample};

use crate::control::{PositionLaw, SampledTiming};
use crate::drive::mean_count;
use crate::machine::{Machine, PlainMachine};
use crate::plant::{Plant, State};
use crate::scalar::Scalar;

/// Bandwidth of the state correction of [`Innovations`] in Hz.
pub const CORRECTION_HZ: f64 = 4.0;
/// Damping ratio of the state correction: the position takes over 2ζω·period of an innovation, the velocity ω²·period.
pub const CORRECTION_DAMPING: f64 = 0.8;

/// How a recording was sampled and how finely the model integrates it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplaySettings {
    /// Periods and delay of the robot's loop and of the recording.
    pub timing: SampledTiming,
    /// Whether the recorded counts were truncated by `fix()`.
    pub quantised: bool,
    /// Integration steps per record period, at least 1; raised to the loop's ticks where those are more, but for 1.
    pub substeps: u32,
}

/// A machine with everything that stays constant over a recording.
#[derive(Clone, Copy, Debug)]
struct Model<S, M> {
    machine: M,
    quantised: bool,
    substeps: u32,
    substep_s: S,
    /// For how many substeps, fractions included, the command of the tick before still acts.
    late_substeps: f64,
}

impl<S: Scalar, M: Machine<S>> Model<S, M> {
    /// A model whose inputs are held for `period_s` and integrated in so many steps.
    fn new(machine: M, settings: &ReplaySettings, period_s: f64, substeps: u32) -> Self {
        let substep_s = period_s / f64::from(substeps);
        Self {
            machine,
            quantised: settings.quantised,
            substeps,
            substep_s: machine.number(substep_s),
            late_substeps: settings.timing.command_delay_s / substep_s,
        }
    }

    /// What the encoders show on average.
    #[inline(always)]
    fn counts(&self, motion: &M::Motion) -> [S; 2] {
        let exact = self.machine.position_counts(motion);
        if self.quantised { [mean_count(exact[0]), mean_count(exact[1])] } else { exact }
    }

    /// One period under a held input that takes over from `previous` after the command delay. Inputs of the
    /// two within one substep are averaged: the velocity is then exact and the position off by under 0.001 count.
    #[inline(always)]
    fn advance_held(&self, motion: &M::Motion, previous: [S; 2], input: [S; 2], added: [S; 2]) -> M::Motion {
        let mut next = *motion;
        let mut late = self.late_substeps;
        for _ in 0..self.substeps {
            let share = self.substep_s.constant(late.clamp(0.0, 1.0));
            let held = self.machine.held(share, previous, input, added);
            next = self.machine.step(&next, &held, self.substep_s);
            late -= 1.0;
        }
        next
    }
}

/// What the model does at one tick of a closed-loop replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosedLoopTick<S> {
    /// The model's tracking error in counts, comparable with the recorded one.
    pub error_counts: [S; 2],
    /// The model's command in A, before the amplifier's limit.
    pub command_a: [S; 2],
}

/// The model arm under the robot's own position loop.
///
/// The torque is held from tick to tick of the loop and integrated by the implicit midpoint rule. Where the loop runs faster
/// than the recording, each of its ticks is simulated, with the reference on a parabola through three samples; of the
/// encoder's rounding between the samples only the mean is kept. With one step a record period such a loop is emulated:
/// symplectic Euler with the feedback taken at the start, and the delay Td = loop period/2 + command delay applied to first
/// order, `e(t − Td) ≈ e − Td ė`. That is quick and good enough to search by, not to judge by.
#[derive(Clone, Copy, Debug)]
pub struct ClosedLoop<S: Scalar, L, M: Machine<S> = PlainMachine<S>> {
    model: Model<S, M>,
    laws: [L; 2],
    motion: M::Motion,
    previous_input: [S; 2],
    fast: Option<FastLoop<S>>,
    previous_reference: Option<[S; 2]>,
}

/// How a loop that is faster than the recording is followed.
#[derive(Clone, Copy, Debug)]
enum FastLoop<S> {
    /// Tick by tick, so many a record period.
    Ticks(u32),
    /// In one step.
    Emulated {
        /// How late each joint's feedback acts, its lead taken off.
        delay_s: [S; 2],
        record_period_s: S,
    },
}

impl<S: Scalar, L: PositionLaw<S>> ClosedLoop<S, L> {
    /// Starts a plain plant at `start`. The laws must be fresh: they remember the tick before.
    pub fn new(plant: &Plant<S>, laws: [L; 2], settings: &ReplaySettings, start: State<S>) -> Self {
        Self::of(PlainMachine::new(plant), laws, settings, start)
    }
}

impl<S: Scalar, L: PositionLaw<S>, M: Machine<S>> ClosedLoop<S, L, M> {
    /// Starts `machine` from `motion` ([`Machine::start`]). The laws must be fresh: they remember the tick before.
    pub fn of(machine: M, mut laws: [L; 2], settings: &ReplaySettings, motion: M::Motion) -> Self {
        let timing = &settings.timing;
        let number = |value| machine.number(value);
        let substeps = settings.substeps.max(1);
        let (mut period_s, mut held_substeps, mut fast) = (timing.record_period_s, substeps, None);
        if timing.loop_is_faster_than_recording() && substeps > 1 {
            let ticks = timing.ticks_per_record();
            (period_s, held_substeps) = (period_s / f64::from(ticks), substeps.div_ceil(ticks));
            fast = Some(FastLoop::Ticks(ticks));
        } else if timing.loop_is_faster_than_recording() {
            let delay_s = number(0.5 * timing.loop_period_s + timing.command_delay_s);
            let mut late = |joint: usize| delay_s - laws[joint].take_lead() * number(timing.loop_period_s);
            fast = Some(FastLoop::Emulated {
                delay_s: [late(0), late(1)],
                record_period_s: number(timing.record_period_s),
            });
        }
        Self {
            model: Model::new(machine, settings, period_s, held_substeps),
            laws,
            motion,
            previous_input: [number(0.0); 2],
            fast,
            previous_reference: None,
        }
    }

    /// What moves, as it is at the next sample: its measured current among others, where the machine knows it.
    #[inline(always)]
    pub fn motion(&self) -> &M::Motion {
        &self.motion
    }

    /// One record period: the error and command at its start, then the motion to the next. The reference at the next sample
    /// matters only where the loop is faster than the recording. `added_torque_nm` is a known motor torque beside the
    /// controller's, usually zero.
    #[inline(always)]
    pub fn tick(
        &mut self,
        reference_counts: [S; 2],
        next_reference_counts: [S; 2],
        added_torque_nm: [S; 2],
    ) -> ClosedLoopTick<S> {
        let actual = self.model.counts(&self.motion);
        let error = [reference_counts[0] - actual[0], reference_counts[1] - actual[1]];
        let course = [0, 1].map(|joint: usize| {
            let before = self.previous_reference.map(|before| before[joint]);
            Course::new(before, reference_counts[joint], next_reference_counts[joint])
        });
        let command = match self.fast {
            Some(FastLoop::Ticks(ticks)) => self.advance_ticks(ticks, &course, added_torque_nm),
            Some(FastLoop::Emulated { delay_s, record_period_s }) => {
                let rate = [0, 1].map(|joint: usize| course[joint].slope / record_period_s);
                self.advance_emulated(reference_counts, rate, delay_s, added_torque_nm)
            }
            None => {
                let command = self.command_a(reference_counts, actual);
                if self.previous_reference.is_none() {
                    self.begin(command);
                }
                self.advance_held(command, added_torque_nm);
                command
            }
        };
        self.previous_reference = Some(reference_counts);
        ClosedLoopTick { error_counts: error, command_a: command }
    }

    /// Before the first tick the arm was held: the command of then is that of now.
    #[inline(always)]
    fn begin(&mut self, command_a: [S; 2]) {
        self.previous_input = self.model.machine.input(command_a);
        self.motion = self.model.machine.begun(&self.motion, self.previous_input);
    }

    /// One period under a command that is held.
    #[inline(always)]
    fn advance_held(&mut self, command_a: [S; 2], added_torque_nm: [S; 2]) {
        let input = self.model.machine.input(command_a);
        self.motion = self.model.advance_held(&self.motion, self.previous_input, input, added_torque_nm);
        self.previous_input = input;
    }

    #[inline(always)]
    fn command_a(&mut self, reference_counts: [S; 2], actual_counts: [S; 2]) -> [S; 2] {
        [
            self.laws[0].command_a(reference_counts[0], actual_counts[0]),
            self.laws[1].command_a(reference_counts[1], actual_counts[1]),
        ]
    }

    /// One record period of a loop that runs faster than the recording, tick by tick; gives the command at its start.
    #[inline(always)]
    fn advance_ticks(&mut self, ticks: u32, course: &[Course<S>; 2], added_torque_nm: [S; 2]) -> [S; 2] {
        let mut first_command = None;
        for tick in 0..ticks {
            let share = self.model.substep_s.constant(f64::from(tick) / f64::from(ticks));
            let actual = self.model.counts(&self.motion);
            let command = self.command_a([course[0].at(share), course[1].at(share)], actual);
            if self.previous_reference.is_none() && first_command.is_none() {
                self.begin(command);
            }
            self.advance_held(command, added_torque_nm);
            first_command.get_or_insert(command);
        }
        first_command.unwrap_or([self.model.substep_s.constant(0.0); 2])
    }

    /// The same in one step.
    #[inline(always)]
    fn advance_emulated(
        &mut self,
        reference_counts: [S; 2],
        reference_rate: [S; 2],
        delay_s: [S; 2],
        added_torque_nm: [S; 2],
    ) -> [S; 2] {
        let counts_per_rad = self.model.machine.counts_per_rad();
        let actual = self.model.counts(&self.motion);
        let velocity = self.model.machine.state(&self.motion).velocity_rad_s;
        // The loop sees the error of Td ago: the reference's and the motor's travel since then come off.
        let seen = [0, 1].map(|joint: usize| {
            let rate = velocity[joint] * counts_per_rad[joint];
            actual[joint] + delay_s[joint] * (reference_rate[joint] - rate)
        });
        let command = self.command_a(reference_counts, seen);
        let machine = &self.model.machine;
        let input = machine.input(command);
        let held = machine.fresh(input, added_torque_nm);
        self.motion = if self.previous_reference.is_none() {
            machine.start_symplectic(&machine.begun(&self.motion, input), &held, self.model.substep_s)
        } else {
            machine.step_symplectic(&self.motion, &held, self.model.substep_s)
        };
        command
    }
}

/// The reference of one joint from a sample to the next, in counts: a parabola through three samples.
#[derive(Clone, Copy, Debug)]
pub struct Course<S> {
    here: S,
    slope: S,
    bend: S,
}

impl<S: Scalar> Course<S> {
    /// Through the sample here, the one before and the next; without one before, it begins as it goes on.
    #[inline(always)]
    pub fn new(before: Option<S>, here: S, next: S) -> Self {
        let half = here.constant(0.5);
        let before = before.unwrap_or(here + here - next);
        Self { here, slope: half * (next - before), bend: half * (next + before) - here }
    }

    /// After this share of the record period, from 0 to 1.
    #[inline(always)]
    pub fn at(&self, share: S) -> S {
        share.mul_add(share.mul_add(self.bend, self.slope), self.here)
    }
}

/// The model arm under the robot's recorded command, its state corrected by what it did not foresee.
#[derive(Clone, Copy, Debug)]
pub struct Innovations<S: Scalar, L, M: Machine<S> = PlainMachine<S>> {
    closed: ClosedLoop<S, L, M>,
    position_gain: S,
    velocity_gain: S,
}

/// One sample of a recording as [`Innovations`] takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedSample<S> {
    /// Reference in counts.
    pub reference_counts: [S; 2],
    /// The same at the next sample; it matters only where the loop is faster than the recording.
    pub next_reference_counts: [S; 2],
    /// Measured motor position in counts: the middle of the truncated count's cell.
    pub measured_counts: [S; 2],
    /// Command computed at this tick in A, applied after the command delay.
    pub command_a: [S; 2],
    /// Known motor torque beside the command in N m.
    pub added_torque_nm: [S; 2],
}

impl<S: Scalar, L: PositionLaw<S>> Innovations<S, L> {
    /// Starts a plain plant at `start`. `laws` are used only where the loop is faster than the recording.
    pub fn new(plant: &Plant<S>, laws: [L; 2], settings: &ReplaySettings, start: State<S>) -> Self {
        Self::of(PlainMachine::new(plant), laws, settings, start)
    }
}

impl<S: Scalar, L: PositionLaw<S>, M: Machine<S>> Innovations<S, L, M> {
    /// Starts `machine` from `motion` ([`Machine::start`]). `laws` are used only where the loop is faster than the
    /// recording.
    pub fn of(machine: M, laws: [L; 2], settings: &ReplaySettings, motion: M::Motion) -> Self {
        let omega = core::f64::consts::TAU * CORRECTION_HZ;
        let period_s = settings.timing.record_period_s;
        Self {
            closed: ClosedLoop::of(machine, laws, settings, motion),
            position_gain: machine.number(2.0 * CORRECTION_DAMPING * omega * period_s),
            velocity_gain: machine.number(omega * omega * period_s),
        }
    }

    /// What moves, as it is at the next sample, before that sample's correction.
    #[inline(always)]
    pub fn motion(&self) -> &M::Motion {
        self.closed.motion()
    }

    /// The innovation in counts at this sample, measured minus modelled; then the motion to the next.
    #[inline(always)]
    pub fn tick(&mut self, sample: &RecordedSample<S>) -> [S; 2] {
        let machine = &self.closed.model.machine;
        let counts_per_rad = machine.counts_per_rad();
        let modelled = machine.position_counts(&self.closed.motion);
        let innovation = [sample.measured_counts[0] - modelled[0], sample.measured_counts[1] - modelled[1]];
        let innovation_rad = [innovation[0] / counts_per_rad[0], innovation[1] / counts_per_rad[1]];
        self.closed.motion = machine.corrected(
            &self.closed.motion,
            [self.position_gain * innovation_rad[0], self.position_gain * innovation_rad[1]],
            [self.velocity_gain * innovation_rad[0], self.velocity_gain * innovation_rad[1]],
        );
        if self.closed.fast.is_some() {
            self.closed.tick(sample.reference_counts, sample.next_reference_counts, sample.added_torque_nm);
        } else {
            if self.closed.previous_reference.is_none() {
                self.closed.begin(sample.command_a);
                self.closed.previous_reference = Some(sample.reference_counts);
            }
            self.closed.advance_held(sample.command_a, sample.added_torque_nm);
        }
        innovation
    }
}

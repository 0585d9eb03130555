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
use crate::drive::{Drive, mean_count};
use crate::plant::{Plant, PreparedPlant, State};
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
    /// Integration steps per record period, at least 1.
    pub substeps: u32,
}

/// A model with everything that stays constant over a recording.
#[derive(Clone, Copy, Debug)]
struct Model<S> {
    plant: PreparedPlant<S>,
    drives: [Drive<S>; 2],
    counts_per_rad: [S; 2],
    quantised: bool,
    substeps: u32,
    substep_s: S,
    /// For how many substeps, fractions included, the command of the tick before still acts.
    late_substeps: f64,
}

impl<S: Scalar> Model<S> {
    fn new(plant: &Plant<S>, settings: &ReplaySettings) -> Self {
        let substeps = settings.substeps.max(1);
        let substep_s = settings.timing.record_period_s / f64::from(substeps);
        let number = |value| plant.arm.gravity_m_s2.constant(value);
        Self {
            plant: plant.prepare(),
            drives: plant.drives,
            counts_per_rad: [plant.drives[0].counts_per_rad(), plant.drives[1].counts_per_rad()],
            quantised: settings.quantised,
            substeps,
            substep_s: number(substep_s),
            late_substeps: settings.timing.command_delay_s / substep_s,
        }
    }

    #[inline(always)]
    fn motor_torque_nm(&self, command_a: [S; 2]) -> [S; 2] {
        [self.drives[0].motor_torque_nm(command_a[0]), self.drives[1].motor_torque_nm(command_a[1])]
    }

    /// What the encoders show on average.
    #[inline(always)]
    fn counts(&self, state: &State<S>) -> [S; 2] {
        [self.count(state, 0), self.count(state, 1)]
    }

    #[inline(always)]
    fn count(&self, state: &State<S>, joint: usize) -> S {
        let exact = state.position_rad[joint] * self.counts_per_rad[joint];
        if self.quantised { mean_count(exact) } else { exact }
    }

    /// One record period under a held torque that takes over from `previous` after the command delay. Torques of the
    /// two within one substep are averaged: the velocity is then exact and the position off by under 0.001 count.
    #[inline(always)]
    fn advance_held(&self, state: &State<S>, previous: [S; 2], torque: [S; 2], added: [S; 2]) -> State<S> {
        let mut next = *state;
        let mut late = self.late_substeps;
        for _ in 0..self.substeps {
            let share = self.substep_s.constant(late.clamp(0.0, 1.0));
            let mixed = [
                share.mul_add(previous[0] - torque[0], torque[0] + added[0]),
                share.mul_add(previous[1] - torque[1], torque[1] + added[1]),
            ];
            next = self.plant.step(&next, mixed, self.substep_s);
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
/// Where the loop runs once per record period the torque is held and integrated by the implicit midpoint rule. Where
/// it runs faster the loop is emulated at the substep: symplectic Euler with the feedback taken at the substep's
/// start, and the delay Td = loop period/2 + command delay applied to first order, `e(t − Td) ≈ e − Td ė`. Between two
/// samples the reference is continued at the speed it had.
#[derive(Clone, Copy, Debug)]
pub struct ClosedLoop<S, L> {
    model: Model<S>,
    laws: [L; 2],
    state: State<S>,
    previous_torque: [S; 2],
    fast: Option<FastLoop<S>>,
    previous_reference: Option<[S; 2]>,
}

#[derive(Clone, Copy, Debug)]
struct FastLoop<S> {
    /// How late each joint's feedback acts, its lead taken off.
    delay_s: [S; 2],
    record_period_s: S,
}

impl<S: Scalar, L: PositionLaw<S>> ClosedLoop<S, L> {
    /// Starts at `start`. The laws must be fresh: they remember the tick before.
    pub fn new(plant: &Plant<S>, mut laws: [L; 2], settings: &ReplaySettings, start: State<S>) -> Self {
        let timing = &settings.timing;
        let number = |value| plant.arm.gravity_m_s2.constant(value);
        let fast = timing.loop_is_faster_than_recording().then(|| {
            let delay_s = number(0.5 * timing.loop_period_s + timing.command_delay_s);
            let mut late = |joint: usize| delay_s - laws[joint].take_lead() * number(timing.loop_period_s);
            FastLoop { delay_s: [late(0), late(1)], record_period_s: number(timing.record_period_s) }
        });
        Self {
            model: Model::new(plant, settings),
            laws,
            state: start,
            previous_torque: [number(0.0); 2],
            fast,
            previous_reference: None,
        }
    }

    /// One record period: the error and command at its start, then the motion to the next. `added_torque_nm` is a
    /// known motor torque beside the controller's, usually zero.
    #[inline(always)]
    pub fn tick(&mut self, reference_counts: [S; 2], added_torque_nm: [S; 2]) -> ClosedLoopTick<S> {
        let actual = self.model.counts(&self.state);
        let error = [reference_counts[0] - actual[0], reference_counts[1] - actual[1]];
        let command = match self.fast {
            Some(fast) => self.advance_fast(&fast, reference_counts, added_torque_nm),
            None => {
                let command = self.command_a(reference_counts, actual);
                let torque = self.model.motor_torque_nm(command);
                if self.previous_reference.is_none() {
                    // Before the first tick the arm was held: the command of then is that of now.
                    self.previous_torque = torque;
                }
                self.state = self.model.advance_held(&self.state, self.previous_torque, torque, added_torque_nm);
                self.previous_torque = torque;
                command
            }
        };
        self.previous_reference = Some(reference_counts);
        ClosedLoopTick { error_counts: error, command_a: command }
    }

    #[inline(always)]
    fn command_a(&mut self, reference_counts: [S; 2], actual_counts: [S; 2]) -> [S; 2] {
        [
            self.laws[0].command_a(reference_counts[0], actual_counts[0]),
            self.laws[1].command_a(reference_counts[1], actual_counts[1]),
        ]
    }

    /// One record period of a loop that runs faster than the recording; gives the command at its start.
    #[inline(always)]
    fn advance_fast(&mut self, fast: &FastLoop<S>, reference_counts: [S; 2], added_torque_nm: [S; 2]) -> [S; 2] {
        let substep_s = self.model.substep_s;
        let before = self.previous_reference.unwrap_or(reference_counts);
        let reference_rate =
            [0, 1].map(|joint: usize| (reference_counts[joint] - before[joint]) / fast.record_period_s);
        let mut reference = reference_counts;
        let mut first_command = None;
        for _ in 0..self.model.substeps {
            let actual = self.model.counts(&self.state);
            // The loop sees the error of Td ago: the reference's and the motor's travel since then come off.
            let seen = [0, 1].map(|joint: usize| {
                let rate = self.state.velocity_rad_s[joint] * self.model.counts_per_rad[joint];
                actual[joint] + fast.delay_s[joint] * (reference_rate[joint] - rate)
            });
            let command = self.command_a(reference, seen);
            let torque = self.model.motor_torque_nm(command);
            let total = [torque[0] + added_torque_nm[0], torque[1] + added_torque_nm[1]];
            let starts = self.previous_reference.is_none() && first_command.is_none();
            self.state = if starts {
                self.model.plant.start_symplectic(&self.state, total, substep_s)
            } else {
                self.model.plant.step_symplectic(&self.state, total, substep_s)
            };
            first_command.get_or_insert(command);
            for joint in 0..2 {
                reference[joint] += reference_rate[joint] * substep_s;
            }
        }
        first_command.unwrap_or([substep_s.constant(0.0); 2])
    }

    /// Moves the model's state toward a measurement by the innovation, as [`Innovations`] does: for recordings of a
    /// loop faster than the recording, whose commands between the samples are not known.
    #[inline(always)]
    fn correct(&mut self, innovation_rad: [S; 2], gains: [S; 2]) {
        for (joint, innovation) in innovation_rad.into_iter().enumerate() {
            self.state.position_rad[joint] += gains[0] * innovation;
            self.state.velocity_rad_s[joint] += gains[1] * innovation;
        }
    }
}

/// The model arm under the robot's recorded command, its state corrected by what it did not foresee.
#[derive(Clone, Copy, Debug)]
pub struct Innovations<S, L> {
    closed: ClosedLoop<S, L>,
    position_gain: S,
    velocity_gain: S,
}

/// One sample of a recording as [`Innovations`] takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedSample<S> {
    /// Reference in counts.
    pub reference_counts: [S; 2],
    /// Measured motor position in counts: the middle of the truncated count's cell.
    pub measured_counts: [S; 2],
    /// Command computed at this tick in A, applied after the command delay.
    pub command_a: [S; 2],
    /// Known motor torque beside the command in N m.
    pub added_torque_nm: [S; 2],
}

impl<S: Scalar, L: PositionLaw<S>> Innovations<S, L> {
    /// Starts at `start`. `laws` are used only where the loop is faster than the recording.
    pub fn new(plant: &Plant<S>, laws: [L; 2], settings: &ReplaySettings, start: State<S>) -> Self {
        let number = |value| plant.arm.gravity_m_s2.constant(value);
        let omega = core::f64::consts::TAU * CORRECTION_HZ;
        let period_s = settings.timing.record_period_s;
        Self {
            closed: ClosedLoop::new(plant, laws, settings, start),
            position_gain: number(2.0 * CORRECTION_DAMPING * omega * period_s),
            velocity_gain: number(omega * omega * period_s),
        }
    }

    /// The innovation in counts at this sample, measured minus modelled; then the motion to the next.
    #[inline(always)]
    pub fn tick(&mut self, sample: &RecordedSample<S>) -> [S; 2] {
        let counts_per_rad = self.closed.model.counts_per_rad;
        // Written out: a closure would not be compiled for the vector instructions of the caller.
        let position_rad = self.closed.state.position_rad;
        let innovation = [
            sample.measured_counts[0] - position_rad[0] * counts_per_rad[0],
            sample.measured_counts[1] - position_rad[1] * counts_per_rad[1],
        ];
        self.closed.correct(
            [innovation[0] / counts_per_rad[0], innovation[1] / counts_per_rad[1]],
            [self.position_gain, self.velocity_gain],
        );
        if self.closed.fast.is_some() {
            self.closed.tick(sample.reference_counts, sample.added_torque_nm);
        } else {
            let closed = &mut self.closed;
            let torque = closed.model.motor_torque_nm(sample.command_a);
            if closed.previous_reference.is_none() {
                closed.previous_torque = torque;
                closed.previous_reference = Some(sample.reference_counts);
            }
            closed.state =
                closed.model.advance_held(&closed.state, closed.previous_torque, torque, sample.added_torque_nm);
            closed.previous_torque = torque;
        }
        innovation
    }
}

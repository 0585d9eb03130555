//! The closed loop counted from a motion that is known beforehand, such as the recorded one.
//!
//! A model worth its name stays within a few counts of the robot. Counted from the robot's own motion its state is that
//! small, and single precision carries it to a hundred-thousandth of a count; counted from zero it would lose a
//! hundredth at every step. Sine and cosine of the known motion are computed once for all models.

use super::ReplaySettings;
use crate::control::PositionLoop;
use crate::drive::mean_count_shift;
use crate::plant::{Frame, Plant, PreparedPlant, State};
use crate::scalar::Scalar;

/// The known motion at one sample, and from it to the next.
#[derive(Clone, Copy, Debug)]
pub struct FollowedSample<S> {
    /// Position of the known motion in counts.
    pub position_counts: [S; 2],
    /// The known motion over the record period that begins here.
    pub frame: Frame<S>,
    /// By how much the velocity of the known motion falls at the next sample, in rad/s.
    pub slowing_rad_s: [S; 2],
    /// Reference of the robot's loop, counted from the known motion, in counts.
    pub reference_counts: [S; 2],
    /// Known motor torque beside the controller's, in N m.
    pub added_torque_nm: [S; 2],
}

/// What a followed loop needs of one drive and its position loop.
#[derive(Clone, Copy, Debug)]
struct Joint<S> {
    position_loop: PositionLoop<S>,
    torque_constant_nm_per_a: S,
    current_limit_a: S,
    torque_offset_nm: S,
    counts_per_rad: S,
}

/// A model with everything that stays constant over a recording.
#[derive(Clone, Copy, Debug)]
pub struct FollowedModel<S> {
    plant: PreparedPlant<S>,
    joints: [Joint<S>; 2],
    period_s: S,
    /// For which share of a period the command of the tick before still acts.
    late_share: S,
    quantised: bool,
}

impl FollowedModel<f64> {
    /// A model under the robot's position loops, recorded as `settings` say; their substeps are not used.
    pub fn new(plant: &Plant<f64>, loops: &[PositionLoop<f64>; 2], settings: &ReplaySettings) -> Self {
        let joint = |index: usize| {
            let drive = &plant.drives[index];
            Joint {
                position_loop: loops[index],
                torque_constant_nm_per_a: drive.torque_constant_nm_per_a,
                current_limit_a: drive.current_limit_a,
                torque_offset_nm: drive.torque_offset_nm,
                counts_per_rad: drive.counts_per_rad(),
            }
        };
        let period_s = settings.timing.record_period_s;
        Self {
            plant: plant.prepare(),
            joints: [joint(0), joint(1)],
            period_s,
            late_share: (settings.timing.command_delay_s / period_s).clamp(0.0, 1.0),
            quantised: settings.quantised,
        }
    }

    /// The same model in this number type: `number` is asked for every constant of it in turn, with a function that
    /// gives this constant of a model in double precision. Made of constants that are already multiplied out, so that
    /// each is rounded once.
    #[inline(always)]
    pub fn in_numbers<S: Scalar>(
        number: impl Fn(&dyn Fn(&FollowedModel<f64>) -> f64) -> S,
        quantised: bool,
    ) -> FollowedModel<S> {
        let joint = |index: usize| Joint {
            position_loop: PositionLoop {
                gain_a_per_count: number(&|model| model.joints[index].position_loop.gain_a_per_count),
                lead: number(&|model| model.joints[index].position_loop.lead),
            },
            torque_constant_nm_per_a: number(&|model| model.joints[index].torque_constant_nm_per_a),
            current_limit_a: number(&|model| model.joints[index].current_limit_a),
            torque_offset_nm: number(&|model| model.joints[index].torque_offset_nm),
            counts_per_rad: number(&|model| model.joints[index].counts_per_rad),
        };
        FollowedModel {
            plant: PreparedPlant::from_constants(|constant| number(&|model| constant(&model.plant))),
            joints: [joint(0), joint(1)],
            period_s: number(&|model| model.period_s),
            late_share: number(&|model| model.late_share),
            quantised,
        }
    }
}

/// A model arm under the robot's position loop, as [`super::ClosedLoop`] has it, counted from a known motion. For loops
/// that run once a record period; one step a period.
#[derive(Clone, Copy, Debug)]
pub struct FollowedLoop<S> {
    model: FollowedModel<S>,
    state: State<S>,
    previous_torque: [S; 2],
    previous_error: [S; 2],
    started: bool,
}

impl<S: Scalar> FollowedLoop<S> {
    /// Starts at `start`, counted from the known motion's first sample, with the errors in counts of the tick before
    /// the first.
    #[inline(always)]
    pub fn new(model: FollowedModel<S>, start: State<S>, previous_error_counts: [S; 2]) -> Self {
        let zero = model.period_s.constant(0.0);
        let previous_error = previous_error_counts;
        Self { model, state: start, previous_torque: [zero; 2], previous_error, started: false }
    }

    /// One record period; gives the motor positions at its start, counted from the known motion, as the encoders show
    /// them on average.
    #[inline(always)]
    pub fn tick(&mut self, sample: &FollowedSample<S>) -> [S; 2] {
        let actual = [self.counts(sample, 0), self.counts(sample, 1)];
        let error = [sample.reference_counts[0] - actual[0], sample.reference_counts[1] - actual[1]];
        let torque = [self.motor_torque_nm(error, 0), self.motor_torque_nm(error, 1)];
        self.previous_error = error;
        if !self.started {
            // Before the first tick the arm was held: the command of then is that of now.
            self.previous_torque = torque;
            self.started = true;
        }
        let added = sample.added_torque_nm;
        let share = self.model.late_share;
        let mixed = [
            share.mul_add(self.previous_torque[0] - torque[0], torque[0] + added[0]),
            share.mul_add(self.previous_torque[1] - torque[1], torque[1] + added[1]),
        ];
        self.previous_torque = torque;
        self.state = self.model.plant.step_from(&sample.frame, &self.state, mixed, self.model.period_s);
        self.state.velocity_rad_s[0] += sample.slowing_rad_s[0];
        self.state.velocity_rad_s[1] += sample.slowing_rad_s[1];
        actual
    }

    #[inline(always)]
    fn counts(&self, sample: &FollowedSample<S>, joint: usize) -> S {
        let apart = self.state.position_rad[joint] * self.model.joints[joint].counts_per_rad;
        if self.model.quantised { apart - mean_count_shift(sample.position_counts[joint] + apart) } else { apart }
    }

    #[inline(always)]
    fn motor_torque_nm(&self, error_counts: [S; 2], index: usize) -> S {
        let joint = &self.model.joints[index];
        let command_a = joint.position_loop.command_a(error_counts[index], self.previous_error[index]);
        command_a.clamp_abs(joint.current_limit_a) * joint.torque_constant_nm_per_a - joint.torque_offset_nm
    }
}

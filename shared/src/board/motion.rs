//! Modes and what happens in them: from the inputs of a tick to commands or a fault.

use super::constants::{Constants, JointTick};
use super::encoders::Jump;
use super::path::{Clock, HeldCounts, Path};
use super::trajectories::Accepted;
use super::{Inputs, MID_SCALE};
use crate::arm::PARAMETERS;
use crate::control::{ComputedTorque, ComputedTorqueInput};
use crate::protocol::{ActiveLimit, ControlLaw, Fault, Joint, LimitsActive, Link, Mode, Sample};
use crate::scalar::Scalar as _;
use crate::trajectory::Approach;

#[cfg(test)]
mod tests;

/// What a tick looks at.
pub(super) struct Tick<'a> {
    pub(super) inputs: &'a Inputs,
    pub(super) constants: &'a Constants,
    /// Motor positions in counts.
    pub(super) position_counts: [i32; 2],
    pub(super) jump: Option<Jump>,
    pub(super) trajectory: Option<Accepted<'a>>,
}

/// What a tick gives while the amplifiers are on.
pub(super) struct Step {
    pub(super) command_code: [u16; 2],
    /// The row to record, where this is a record tick of a movement.
    pub(super) sample: Option<Sample>,
    /// Whether the movement is complete with this tick.
    pub(super) completed: bool,
    /// Limits that acted in this tick.
    pub(super) limits: LimitsActive,
}

/// What a movement is begun with.
pub(super) struct Start {
    pub(super) law: ControlLaw,
    /// The controller, where the law is computed torque.
    pub(super) computed_torque: Option<ComputedTorque<f32>>,
    pub(super) approach: Approach,
    pub(super) settle_ns: u64,
    pub(super) rows: u32,
    /// The link that asked for it.
    pub(super) commander: Link,
}

/// The movement under way, or the last one.
#[derive(Clone, Copy, Debug)]
struct Movement {
    /// Time from the start of the approach to the start of the trajectory.
    approach_ns: u64,
    rows: u32,
    recorded: u32,
    /// Loop ticks since the last row; a row is recorded at 0.
    loops_since_row: u32,
}

/// A law at work.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one of it, and nothing here allocates")]
enum Law {
    Position,
    ComputedTorque(ComputedTorque<f32>),
}

/// Mode, reference and law.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    mode: Mode,
    /// Whether the mode changed since the last event.
    mode_changed: bool,
    last_fault: Option<Fault>,
    path: Path,
    clock: Clock,
    law: Law,
    /// The link that switched on or began the last movement. It must stay alive as long as the amplifiers are on: an
    /// arm that nobody looks after is held by its brakes, not by its motors.
    commander: Link,
    /// Time since the last valid request of the commander.
    silent_ns: u64,
    movement: Option<Movement>,
    /// Errors of the tick before; `None` where there was none, or under another reference.
    previous_error: Option<[i32; 2]>,
    /// Current last commanded, in A.
    command_a: [f32; 2],
    /// How long each command has been at its limit.
    at_limit_ns: [u64; 2],
    /// Positions at the start of the present speed measurement, and ticks since.
    speed_from: Option<[i32; 2]>,
    speed_ticks: u32,
    limits: LimitsActive,
}

impl Motion {
    pub(super) const fn new() -> Self {
        Self {
            mode: Mode::Idle,
            mode_changed: false,
            last_fault: None,
            path: Path::Counts(HeldCounts::new([0; 2])),
            clock: Clock::START,
            law: Law::Position,
            commander: Link::Usb,
            silent_ns: 0,
            movement: None,
            previous_error: None,
            command_a: [0.0; 2],
            at_limit_ns: [0; 2],
            speed_from: None,
            speed_ticks: 0,
            limits: LimitsActive::NONE,
        }
    }

    pub(super) fn mode(&self) -> Mode {
        self.mode
    }

    pub(super) fn last_fault(&self) -> Option<Fault> {
        self.last_fault
    }

    pub(super) fn report_last_fault(&mut self, fault: Fault) {
        self.last_fault = Some(fault);
    }

    /// Reference less actual position at the last tick; 0 while the amplifiers are off.
    pub(super) fn error_counts(&self) -> [i32; 2] {
        self.previous_error.filter(|_| self.mode.is_powered()).unwrap_or_default()
    }

    /// Limits that acted since arming.
    pub(super) fn limits(&self) -> LimitsActive {
        self.limits
    }

    /// The new mode, once after each change.
    pub(super) fn take_mode_change(&mut self) -> Option<Mode> {
        core::mem::take(&mut self.mode_changed).then_some(self.mode)
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.mode_changed = true;
    }

    /// A valid request came over `link`.
    pub(super) fn heard(&mut self, link: Link) {
        if self.commander == link {
            self.silent_ns = 0;
        }
    }

    /// Switches on for `commander` and holds `position_counts`.
    pub(super) fn arm(&mut self, commander: Link, position_counts: [i32; 2]) {
        let path = Path::Counts(HeldCounts::new(position_counts));
        *self = Self { last_fault: self.last_fault, path, commander, ..Self::new() };
        self.enter(Mode::Armed);
    }

    /// Switches off, or stays off.
    pub(super) fn switch_off(&mut self) {
        if self.mode != Mode::Idle {
            self.enter(Mode::Idle);
        }
    }

    /// Switches off because of a fault.
    pub(super) fn fail(&mut self, fault: Fault) {
        self.last_fault = Some(fault);
        self.enter(Mode::Fault(fault));
    }

    /// The counts at which the position loop holds the arm from now on without a jerk: where it already holds, those;
    /// under computed torque, so far from the actual position that the loop asks for the current that flows now.
    pub(super) fn holding_counts(&self, position_counts: [i32; 2], constants: &Constants) -> [i32; 2] {
        if let (Path::Counts(held), Law::Position) = (&self.path, &self.law) {
            return held.counts;
        }
        Joint::ALL.map(|joint| {
            let index = joint.index();
            let joint = &constants.joints[index];
            let limit = joint.following_error_limit_counts as f32;
            let error = (self.command_a[index] / joint.position_loop.gain_a_per_count).clamp_abs(limit);
            position_counts[index].saturating_add(error as i32)
        })
    }

    /// Begins the approach to the trajectory.
    pub(super) fn start(&mut self, start: Start) {
        if start.law == ControlLaw::ComputedTorque || matches!(self.law, Law::ComputedTorque(_)) {
            // The reference jumps from one law's to the other's; the loop must not see that as a change of error.
            self.previous_error = None;
        }
        self.law = match start.computed_torque {
            Some(mut controller) => {
                controller.follow(self.command_a);
                Law::ComputedTorque(controller)
            }
            None => Law::Position,
        };
        self.path = Path::Approach(start.approach);
        self.clock = Clock::START;
        self.movement = Some(Movement {
            approach_ns: start.approach.duration_ns().saturating_add(start.settle_ns),
            rows: start.rows,
            recorded: 0,
            loops_since_row: 0,
        });
        self.commander = start.commander;
        self.silent_ns = 0;
        self.enter(Mode::Approaching(start.law));
    }

    /// Goes on with another model, where computed torque is in charge.
    pub(super) fn change_model(&mut self, next: &ComputedTorque<f32>) {
        if let Law::ComputedTorque(controller) = &mut self.law {
            controller.change_to(next);
        }
    }

    /// Adds to f1..f9 of the model that computed torque runs with, where it does.
    pub(super) fn add_to_f(&mut self, added: &[f32; PARAMETERS]) {
        if let Law::ComputedTorque(controller) = &mut self.law {
            controller.add_to_f(added);
        }
    }

    /// Begins to slow down, or leaves the end of a trajectory for [`Mode::Armed`].
    pub(super) fn stop(&mut self, position_counts: [i32; 2], constants: &Constants) {
        match self.mode {
            Mode::Approaching(law) | Mode::Running(law) => {
                self.clock.stop(constants.stop_time_ns);
                self.enter(Mode::Stopping(law));
            }
            Mode::Holding(_) => self.hold_armed(position_counts, constants),
            Mode::Idle | Mode::Armed | Mode::Stopping(_) | Mode::Fault(_) => {}
        }
    }

    fn hold_armed(&mut self, position_counts: [i32; 2], constants: &Constants) {
        let counts = self.holding_counts(position_counts, constants);
        if matches!(self.law, Law::ComputedTorque(_)) {
            self.previous_error = None;
        }
        self.path = Path::Counts(HeldCounts::new(counts));
        self.law = Law::Position;
        self.clock = Clock::START;
        self.movement = None;
        self.enter(Mode::Armed);
    }

    /// One tick with the amplifiers on. A fault leaves the state as it was; the caller ends it with [`Self::fail`].
    ///
    /// Not inlined, so that it is compiled here, for speed, and not for size with the firmware.
    #[inline(never)]
    pub(super) fn step(&mut self, tick: &Tick<'_>) -> Result<Step, Fault> {
        let constants = tick.constants;
        self.check_inputs(tick)?;
        if let Path::Counts(held) = &self.path
            && !held.is_whole()
        {
            return Err(Fault::MemoryCorrupted);
        }
        let trajectory = tick.trajectory.map(|accepted| accepted.trajectory);
        let reference = self.path.reference(&self.clock, 0, trajectory, constants);
        let error = [0, 1].map(|index: usize| reference.counts[index].saturating_sub(tick.position_counts[index]));
        for (joint, error_counts) in constants.joints.iter().zip(error) {
            let limit_counts = joint.following_error_limit_counts;
            if error_counts.unsigned_abs() > limit_counts.unsigned_abs() {
                return Err(Fault::FollowingError { joint: joint.joint, error_counts, limit_counts });
            }
        }

        let asked = match &mut self.law {
            Law::Position => {
                let before = self.previous_error.unwrap_or(error);
                let ask = |joint: &JointTick| {
                    let index = joint.joint.index();
                    joint.position_loop.command_a(error[index] as f32, before[index] as f32)
                };
                [ask(&constants.joints[0]), ask(&constants.joints[1])]
            }
            Law::ComputedTorque(controller) => {
                let ahead = self.path.reference(&self.clock, constants.ahead_ns, trajectory, constants);
                let input = ComputedTorqueInput {
                    reference: reference.joint,
                    reference_ahead: ahead.joint,
                    encoder_counts: tick.position_counts.map(|counts| counts as f32),
                };
                controller.tick(&input).unlimited_command_a
            }
        };
        self.previous_error = Some(error);
        let mut limits = LimitsActive::NONE;
        let command_code = self.limit(asked, constants, &mut limits)?;
        self.limits.merge(limits);

        let sample = self.sample(tick, reference.counts, error, command_code);
        let completed = self.advance(tick, reference.counts);
        Ok(Step { command_code, sample, completed, limits })
    }

    /// Everything that is a fault whatever the reference.
    fn check_inputs(&mut self, tick: &Tick<'_>) -> Result<(), Fault> {
        let constants = tick.constants;
        if tick.inputs.emergency_stop {
            return Err(Fault::EmergencyStop);
        }
        if tick.inputs.deadline_missed {
            return Err(Fault::DeadlineMissed);
        }
        if let Some(jump) = tick.jump
            && let Some(joint) = constants.joints.get(jump.index)
        {
            return Err(Fault::EncoderJump {
                joint: joint.joint,
                jump_counts: jump.counts,
                limit_counts: joint.jump_limit_counts,
            });
        }
        for (joint, code) in constants.joints.iter().zip(tick.inputs.current_code) {
            let current_a = joint.measured_a(code);
            if current_a.abs() > joint.over_current_limit_a {
                let limit_a = joint.over_current_limit_a;
                return Err(Fault::OverCurrent { joint: joint.joint, current_a, limit_a });
            }
        }
        self.check_speed(tick)?;
        self.silent_ns = self.silent_ns.saturating_add(constants.loop_period_ns);
        if self.silent_ns > constants.link_timeout_ns {
            return Err(Fault::LinkLost { silent_ns: self.silent_ns, limit_ns: constants.link_timeout_ns });
        }
        Ok(())
    }

    /// Over a whole record period, because at a short loop period one count a tick is already fast.
    fn check_speed(&mut self, tick: &Tick<'_>) -> Result<(), Fault> {
        let constants = tick.constants;
        let from = *self.speed_from.get_or_insert(tick.position_counts);
        if self.speed_ticks < constants.loops_per_record {
            self.speed_ticks += 1;
            return Ok(());
        }
        self.speed_ticks = 1;
        self.speed_from = Some(tick.position_counts);
        for (joint, (now, before)) in constants.joints.iter().zip(tick.position_counts.into_iter().zip(from)) {
            let travel = now.saturating_sub(before);
            if travel.unsigned_abs() > joint.travel_limit_counts.unsigned_abs() {
                let period_s = constants.record_period_ns as f32 * 1.0e-9;
                return Err(Fault::OverSpeed {
                    joint: joint.joint,
                    speed_rad_s: (travel as f32 / joint.counts_per_rad / period_s).abs(),
                    limit_rad_s: joint.speed_limit_rad_s,
                });
            }
        }
        Ok(())
    }

    /// Cuts the currents asked for to what may be commanded, and turns them into codes.
    fn limit(
        &mut self,
        asked_a: [f32; 2],
        constants: &Constants,
        limits: &mut LimitsActive,
    ) -> Result<[u16; 2], Fault> {
        let mut codes = [MID_SCALE; 2];
        for joint in &constants.joints {
            let index = joint.joint.index();
            let asked_a = asked_a[index];
            if !asked_a.is_finite() {
                return Err(Fault::BadModel { joint: joint.joint });
            }
            let limit_a = joint.drive.current_limit_a;
            let command_a = asked_a.clamp_abs(limit_a);
            if asked_a.abs() > limit_a {
                limits.insert(ActiveLimit::current(joint.joint));
                self.at_limit_ns[index] = self.at_limit_ns[index].saturating_add(constants.loop_period_ns);
                let held_ns = self.at_limit_ns[index];
                if held_ns > constants.current_limit_time_ns {
                    return Err(Fault::CurrentLimit { joint: joint.joint, limit_a, held_ns });
                }
            } else {
                self.at_limit_ns[index] = 0;
            }
            let (code, beyond) = joint.command_code(command_a);
            if beyond {
                limits.insert(ActiveLimit::converter(joint.joint));
            }
            self.command_a[index] = command_a;
            codes[index] = code;
        }
        Ok(codes)
    }

    /// The row of this tick, if it is a record tick of a movement. The following-error limit keeps errors inside
    /// 16 bits.
    fn sample(
        &self,
        tick: &Tick<'_>,
        reference_counts: [i32; 2],
        error: [i32; 2],
        command_code: [u16; 2],
    ) -> Option<Sample> {
        let movement = self.movement.as_ref().filter(|movement| {
            matches!(self.mode, Mode::Running(_)) && movement.loops_since_row == 0 && movement.recorded < movement.rows
        })?;
        Some(Sample {
            index: movement.recorded,
            reference_counts,
            error_counts: error.map(|counts| counts as i16),
            current_code: tick.inputs.current_code,
            command_code,
        })
    }

    /// Moves on to the next tick; true where the movement is complete with this one.
    fn advance(&mut self, tick: &Tick<'_>, reference_counts: [i32; 2]) -> bool {
        let constants = tick.constants;
        self.clock.advance(constants.loop_period_ns);
        let Some(movement) = &mut self.movement else {
            return false;
        };
        match self.mode {
            Mode::Approaching(law) if self.clock.time_ns() >= movement.approach_ns => {
                self.path = Path::Trajectory;
                self.clock = Clock::START;
                self.enter(Mode::Running(law));
                false
            }
            Mode::Running(law) => {
                if movement.loops_since_row == 0 {
                    movement.recorded = movement.recorded.saturating_add(1);
                }
                movement.loops_since_row += 1;
                if movement.loops_since_row < constants.loops_per_record {
                    return false;
                }
                movement.loops_since_row = 0;
                if movement.recorded < movement.rows {
                    return false;
                }
                self.hold_end(law, tick);
                true
            }
            Mode::Stopping(_) if self.clock.has_stopped() => {
                if matches!(self.law, Law::Position) {
                    self.path = Path::Counts(HeldCounts::new(reference_counts));
                }
                self.hold_armed(tick.position_counts, constants);
                false
            }
            _ => false,
        }
    }

    /// Holds the end of the trajectory under the law that led there.
    fn hold_end(&mut self, law: ControlLaw, tick: &Tick<'_>) {
        let [first, second] = &tick.constants.joints;
        let end_rad = tick.trajectory.map_or([f32::NAN; 2], |accepted| accepted.end_rad);
        self.path = match law {
            ControlLaw::Position => {
                let [a, b] = end_rad;
                Path::Counts(HeldCounts::new([first.reference_counts(a), second.reference_counts(b)]))
            }
            ControlLaw::ComputedTorque => Path::Pose(end_rad),
        };
        self.clock = Clock::START;
        self.movement = None;
        self.enter(Mode::Holding(law));
    }
}

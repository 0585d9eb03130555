//! The whole board as a pure state machine: inputs and requests in, outputs and replies out.
//!
//! The firmware owns registers and interrupts and decides nothing: once a loop period it samples everything at one
//! instant, calls [`Board::tick`] and writes the outputs; then it hands over a request with [`Board::handle`], or lets
//! the board go on with a check. The simulated board does the same around a plant. Both calls take bounded time, allocate
//! nothing, lock nothing, and panic on nothing.
//!
//! # Safety
//! - Amplifiers are off and both commands at [`MID_SCALE`] in [`Mode::Idle`] and [`Mode::Fault`]. Nothing moves before
//!   [`Arm`](crate::protocol::Request::Arm), which needs robot constants and a declared pose.
//! - A fault switches off in the tick that sees it. On a PUMA the brakes then engage, because power releases them.
//!   Everything that stops the arm has a name: [`crate::protocol::Fault`].
//! - A stop on request slows down along the path and then holds.
//!
//! - Parameters are written to the flash memory only while idle, and meanwhile nothing can be armed
//!   ([`Board::begin_store`]): the amplifiers are never on during a write.
//!
//! # What a recorded row means
//! At a record tick reference and error are those of this instant; the currents are measured at the same instant, so
//! they show the command of the tick before; the command is the one computed from this row's error, as the code that
//! was sent. Rows are stored packed ([`PackedSample`]), may be read any number of times until the next movement, and
//! what is streamed is a copy of the same rows. The row of the tick that finds a fault is not recorded: nothing was
//! commanded then.
//!
//! # Time in a tick
//! One reference under the position loop, two and one inverse dynamics under computed torque; one packed row at a
//! record tick. All of it `f32`. A trajectory is checked in the time that is left ([`Board::advance_check`]): one sample
//! a tick while the amplifiers are on, a fifth of a loop period otherwise.
//!
//! Requests that are possible while the amplifiers are on cost less than a law of control. What takes `f64`, which a
//! Cortex-M4 emulates, is found out before, by whoever receives the request ([`Findings`]). Two requests take longer
//! than a tick, and are accepted only while the amplifiers are off, when a late tick matters to nobody: applying a
//! configuration, about a million cycles (counted in an emulated chip), and the last points of a spline, some 70
//! operations in `f64` a point.

mod constants;
mod encoders;
mod findings;
mod kept_fault;
mod load;
mod motion;
mod parameters;
mod path;
mod recording;
mod requests;
mod session;
mod storing;
mod trajectories;
mod trajectory_check;

use crate::load::{LoadNews, LoadRow};
use crate::protocol::{
    BoardIdentity, Configuration, ControlLaw, EndedBy, Event, Fault, Link, LinkCounters, Mode, Model, ModelSlot,
    PackedSample, Refusal, Request, Sample, StoreFailure, Timing,
};
use crate::storage::{Found, Parameters as Stored};
use encoders::Encoders;
pub use findings::Findings;
pub use kept_fault::KeptFault;
use load::LoadControl;
pub use load::LoadOrder;
use motion::{Motion, Tick};
use parameters::{Change, Parameters};
use recording::Recording;
use session::Session;
use storing::Storing;
use trajectories::Trajectories;

/// Code of both converters for 0 V: no current is asked for. 12 bits.
pub const MID_SCALE: u16 = 2048;

/// Rows a recording needs room for: 7.35 s at 0.7 ms, the longest movement of the method (T = 7.3 s).
pub const DEFAULT_SAMPLES: usize = 10_500;

/// Loop period of a board without configuration, in ns.
pub const DEFAULT_LOOP_PERIOD_NS: u32 = 700_000;

/// Longest time to stand at the start of a trajectory, in ns.
pub const LONGEST_SETTLE_NS: u64 = 60_000_000_000;

/// What the board sees at a loop tick, all sampled at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inputs {
    /// Raw 32-bit encoder counters; they wrap, and where they stand at the start means nothing.
    pub counts: [i32; 2],
    /// Codes of the analogue-digital converter for both armature currents, 12 bits.
    pub current_code: [u16; 2],
    /// Whether the emergency stop is pressed.
    pub emergency_stop: bool,
    /// Whether a tick since the last one came too late or was left out. A fault while the amplifiers are on.
    pub deadline_missed: bool,
}

/// What the board does at a loop tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// Codes for the digital-analogue converter, 12 bits; [`MID_SCALE`] whenever the amplifiers are off.
    pub command_code: [u16; 2],
    /// Whether the amplifiers are on.
    pub amplifier_enable: bool,
    /// The row recorded at this tick, where a host asked for the stream.
    pub telemetry: Option<Telemetry>,
    /// Something to tell on every link: the mode at the end of this tick, if it changed since the last.
    pub event: Option<Event>,
    /// What the identification of the load is to see of this tick's row.
    pub load_row: Option<LoadRow>,
}

impl Outputs {
    /// Amplifiers off, no current asked for: what the firmware writes before the first tick, on a panic and on a
    /// hardware fault.
    pub const SAFE: Self =
        Self { command_code: [MID_SCALE; 2], amplifier_enable: false, telemetry: None, event: None, load_row: None };
}

/// A recorded row on its way to a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Telemetry {
    /// Where to send it.
    pub link: Link,
    /// Number of the movement.
    pub movement: u32,
    /// The row.
    pub sample: Sample,
}

/// The board. `R` is the room for its recording: `&'static mut [PackedSample]` in the firmware, a `Vec` or an array
/// elsewhere.
///
/// The room is not part of the board, because only a static of zeros costs no flash: the firmware takes it from a
/// static `[PackedSample::EMPTY; DEFAULT_SAMPLES]` (147 000 bytes of .bss) and builds the board itself, some 13 KB, at
/// run time.
#[derive(Clone, Debug)]
pub struct Board<R> {
    identity: BoardIdentity,
    timing: Timing,
    links: [LinkCounters; 2],
    sessions: [Session; 2],
    parameters: Parameters,
    storing: Storing,
    trajectories: Trajectories,
    encoders: Encoders,
    motion: Motion,
    recording: Recording<R>,
    load: LoadControl,
    /// Where to send rows as they are recorded.
    stream: Option<Link>,
    tick: u64,
    current_code: [u16; 2],
    emergency_stop: bool,
}

impl<R: AsRef<[PackedSample]> + AsMut<[PackedSample]>> Board<R> {
    /// A board that has just started: idle, without configuration, pose, trajectory and model. `rows` is the room for
    /// the recording; what is in it does not matter.
    pub fn new(identity: BoardIdentity, rows: R) -> Self {
        Self {
            identity,
            timing: Timing::default(),
            links: [LinkCounters::default(); 2],
            sessions: [const { Session::new() }; 2],
            parameters: Parameters::new(),
            storing: Storing::new(),
            trajectories: Trajectories::new(),
            encoders: Encoders::new(),
            motion: Motion::new(),
            recording: Recording::new(rows),
            load: LoadControl::new(),
            stream: None,
            tick: 0,
            current_code: [MID_SCALE; 2],
            emergency_stop: false,
        }
    }

    /// Takes up what was found in the flash memory: parameters, checked like an upload, or why there are none. For use
    /// before the first tick. What came of it is in [`crate::protocol::Status::stored`].
    pub fn restore_stored(&mut self, found: &Found) {
        let accepted = match &found.parameters {
            Ok(Some(stored)) => self.restore(&stored.configuration, stored.model.as_ref()).is_ok(),
            Ok(None) | Err(_) => true,
        };
        self.storing.restored(found, accepted);
    }

    /// Takes up configuration and active model, both checked like an upload, as if they were stored already. The pose
    /// stays unknown. For use before the first tick.
    ///
    /// A refused configuration leaves the board without one, a refused model without that.
    pub fn restore(&mut self, configuration: &Configuration, model: Option<&Model>) -> Result<(), Refusal> {
        self.parameters.apply(configuration)?;
        if let Some(model) = model {
            let crc = model.crc();
            let findings = Findings::of(&Request::StageModel { model: *model, crc });
            self.parameters.stage_model(model, crc, &findings)?;
            self.parameters.commit_model(crc)?;
        }
        Ok(())
    }

    /// One loop period: reads inputs, computes outputs. Bounded time, no panic.
    pub fn tick(&mut self, inputs: &Inputs) -> Outputs {
        self.tick = self.tick.wrapping_add(1);
        self.current_code = inputs.current_code;
        self.emergency_stop = inputs.emergency_stop;
        // Not a copy of the constant, which would write every byte of what is none.
        let mut outputs = Outputs {
            command_code: [MID_SCALE; 2],
            amplifier_enable: false,
            telemetry: None,
            event: None,
            load_row: None,
        };
        if let Some(applied) = &self.parameters.applied {
            let constants = &applied.constants;
            let jump = self.encoders.update(inputs.counts, constants.jump_limit_counts());
            if self.motion.mode().is_powered() {
                let tick = Tick {
                    inputs,
                    constants,
                    position_counts: self.encoders.position_counts(),
                    jump,
                    trajectory: self.trajectories.accepted(),
                };
                self.load.enter(&mut self.motion);
                match self.motion.step(&tick) {
                    Ok(step) => {
                        outputs.command_code = step.command_code;
                        outputs.amplifier_enable = true;
                        if self.motion.mode().is_moving() || step.completed {
                            self.recording.note_limits(step.limits);
                        }
                        if let Some(sample) = step.sample {
                            self.recording.push(&sample);
                            if self.motion.mode().law() == Some(ControlLaw::ComputedTorque) {
                                outputs.load_row = self.load.row(&sample);
                            }
                            let movement = self.recording.info().movement;
                            outputs.telemetry = self.stream.map(|link| Telemetry { link, movement, sample });
                        }
                        if step.completed {
                            self.recording.end(EndedBy::Completed);
                        }
                    }
                    Err(fault) => {
                        self.motion.fail(fault);
                        self.recording.end(EndedBy::Fault(fault));
                    }
                }
            }
        } else {
            // Without constants there is no limit to call a change a jump.
            self.encoders.update(inputs.counts, [i32::MAX; 2]);
        }
        let tick = self.tick;
        if let Some(mode) = self.motion.take_mode_change() {
            outputs.event = Some(Event::Mode { tick, mode });
        } else if self.load.has_event() {
            outputs.event = self.load.take_event().map(|news| Event::Load { tick, news });
        }
        outputs
    }

    /// Goes on with what is not urgent: the check of a trajectory. To be called after a tick that is not followed by a
    /// request, which so much time is left for. Bounded time, no panic.
    pub fn advance_check(&mut self) {
        let mode = self.motion.mode();
        if let Some(applied) = &self.parameters.applied
            && !mode.is_moving()
        {
            self.trajectories.advance_check(&applied.constants, mode.is_powered());
        }
    }

    /// What the firmware told about itself.
    pub fn identity(&self) -> &BoardIdentity {
        &self.identity
    }

    /// What the board is doing.
    pub fn mode(&self) -> Mode {
        self.motion.mode()
    }

    /// Period of [`Self::tick`] in ns: of the configuration, [`DEFAULT_LOOP_PERIOD_NS`] without one. Changes only
    /// while idle.
    pub fn loop_period_ns(&self) -> u32 {
        self.configuration().map_or(DEFAULT_LOOP_PERIOD_NS, |configuration| configuration.common.loop_period_ns)
    }

    /// The applied configuration.
    pub fn configuration(&self) -> Option<&Configuration> {
        self.parameters.applied.as_ref().map(|applied| &applied.configuration)
    }

    /// The active model.
    pub fn active_model(&self) -> Option<&Model> {
        self.parameters.model(ModelSlot::Active).map(|held| &held.model)
    }

    /// What is to be stored now, if anything is: the applied configuration with the active model, or an inner `None` to
    /// forget what is stored. From then on until [`Self::end_store`] arming is refused.
    ///
    /// To be asked after every tick and request; only in [`Mode::Idle`] there is ever something to store, so nothing is
    /// written while the amplifiers are on. Takes little time but where there is something: then it copies less than a
    /// kilobyte.
    pub fn begin_store(&mut self) -> Option<Option<Stored>> {
        if self.mode() != Mode::Idle { None } else { self.storing.begin(&self.parameters) }
    }

    /// What came of the store that was begun.
    pub fn end_store(&mut self, result: Result<(), StoreFailure>) {
        self.storing.end(result);
    }

    /// What the identification of the load is to do, once after each change. To be asked after every request.
    pub fn take_load_order(&mut self) -> Option<LoadOrder> {
        self.load.take_order()
    }

    /// The identification of the load has something to tell, which may change what computed torque runs with. To be
    /// called between two ticks.
    pub fn hear_of_load(&mut self, news: &LoadNews) {
        self.load.hear(news, self.tick, u64::from(self.loop_period_ns()));
    }

    /// Takes in what the firmware measured, to be shown by `info`.
    pub fn report_timing(&mut self, timing: Timing) {
        self.timing = timing;
    }

    /// Takes in what the firmware counted on a link, to be shown by `info`.
    pub fn report_link(&mut self, link: Link, counters: LinkCounters) {
        match link {
            Link::Usb => self.links[0] = counters,
            Link::Serial => self.links[1] = counters,
        }
    }

    /// Takes in the fault before the last reset, to be shown by `info` as the last one.
    pub fn report_last_fault(&mut self, fault: Fault) {
        self.motion.report_last_fault(fault);
    }

    /// What a change of configuration makes invalid is forgotten.
    fn configuration_changed(&mut self, change: Change) {
        if change != Change::Nothing {
            self.trajectories.clear();
            self.load.forget();
        }
        if change == Change::Robot {
            self.encoders.forget_pose();
        }
    }
}

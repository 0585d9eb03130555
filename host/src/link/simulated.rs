//! A board in this process: [`shared::board::Board`] around [`shared::plant`], spoken to through the bytes of the
//! protocol.
//!
//! Time is virtual: it moves on when the host waits for bytes, and one tick with every send, so a run takes no longer
//! than its computing and two runs are the same to the bit.
//!
//! Modelled: sampling both encoders at one instant, `fix()`, the command acting its delay after sampling, the
//! converters' 12 bits and their full scale, noise of the current sensor, brakes that hold while the amplifiers are
//! off, a flash memory that keeps the parameters and is busy for as long as a real one, power cuts, and effects
//! of the library where the hidden robot has them.

mod arm;
mod flash;
mod load;

use std::collections::VecDeque;
use std::time::Duration;

use shared::arm::Load;
use shared::board::{Board, DEFAULT_SAMPLES, Inputs, MID_SCALE, Telemetry};
use shared::protocol::{
    BoardIdentity, BoardMessage, CurrentScale, Decoder, FrameError, Link as BoardLink, LinkCounters, MAX_FRAME, Mode,
    PROTOCOL_VERSION, PackedSample, Reply, ResetCause, StoreFailure, encode_board_message,
};
use shared::storage::Log;

use arm::SimulatedArm;
pub use flash::{FlashHistory, MemoryFlash, POWER_CUT, complete};
pub use load::LoadChange;
use load::SimulatedLoad;

use super::{Link, LinkError};
use crate::hidden_robot::HiddenRobot;
use crate::random::Random;
use crate::robot::Robot;

/// Torque that no model knows: a random torque at each motor, of a memory of its own (Gauss–Markov process).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueNoise {
    /// Standard deviation at each motor in N m.
    pub deviation_nm: [f64; 2],
    /// Time after which its correlation has fallen to 1/e, in s.
    pub correlation_time_s: f64,
}

/// Noise of the current sensor, A rms.
const CURRENT_NOISE_A: f64 = 0.02;

/// Most bytes waiting for the host, as many as a system holds for a serial port that nobody reads; further telemetry is
/// dropped.
const OUTPUT_BYTES: usize = 1 << 12;

/// How long a power cut lasts.
const POWER_CUT_NS: u64 = 1_000_000;

/// A board with its robot, inside this process.
pub struct SimulatedBoard {
    board: Board<Vec<PackedSample>>,
    hidden: HiddenRobot,
    arm: SimulatedArm,
    current_scale: [CurrentScale; 2],
    command_delay_ns: u64,
    amplifiers_on: bool,
    /// What the board put out at its last tick.
    command_code: [u16; 2],
    /// What the counters show beyond the position of the arm.
    counter_offset: [i32; 2],
    emergency_stop: bool,
    /// Whether the next tick is to find that one was too late.
    deadline_missed: bool,
    random: Random,
    torque_noise: Option<TorqueNoise>,
    torque_random: Random,
    noise_nm: [f64; 2],
    time_ns: u64,
    from_host: Decoder,
    to_host: VecDeque<u8>,
    telemetry_dropped: u32,
    flash: MemoryFlash,
    log: Log,
    load: SimulatedLoad,
    /// Until when the memory is busy, and what the board hears then.
    storing: Option<(u64, Result<(), StoreFailure>)>,
    /// When power fails: in the middle of what is being stored.
    power_fails_ns: Option<u64>,
    restarts: usize,
}

impl SimulatedBoard {
    /// A board whose robot is drawn from `seed` around the reference robot, with the drives of `robot`.
    pub fn hidden(robot: &Robot, seed: u64) -> Self {
        Self::new(robot, HiddenRobot::draw(robot, seed), seed)
    }

    /// A board whose robot is `hidden`, with the drives of `robot`; `seed` makes the noise. The arm rests at zero
    /// angles: upper arm horizontal, forearm up.
    pub fn new(robot: &Robot, hidden: HiddenRobot, seed: u64) -> Self {
        let identity = BoardIdentity {
            firmware_version: firmware_version(),
            git_revision: heapless::String::new(),
            board: heapless::String::try_from("simulated").unwrap_or_default(),
            chip_id: [0; 12],
            chip_revision: 0,
            reset_cause: ResetCause::PowerOn,
        };
        let scale = |joint: usize| CurrentScale::symmetric(robot.joints[joint].current_full_scale_a);
        let flash = MemoryFlash::default();
        let (log, _) = Log::open(&flash);
        Self {
            board: Board::new(identity, vec![PackedSample::EMPTY; DEFAULT_SAMPLES]),
            arm: SimulatedArm::new(robot, &hidden),
            hidden,
            current_scale: [scale(0), scale(1)],
            command_delay_ns: (robot.command_delay_s * 1e9).round() as u64,
            amplifiers_on: false,
            command_code: [MID_SCALE; 2],
            counter_offset: [0; 2],
            emergency_stop: false,
            deadline_missed: false,
            random: Random::new(seed, 2),
            torque_noise: None,
            torque_random: Random::new(seed, 3),
            noise_nm: [0.0; 2],
            time_ns: 0,
            from_host: Decoder::new(),
            to_host: VecDeque::new(),
            telemetry_dropped: 0,
            flash,
            log,
            load: SimulatedLoad::new(robot.upper_arm_m),
            storing: None,
            power_fails_ns: None,
            restarts: 0,
        }
    }

    /// The board, just switched on with what `flash` has kept. For use before anything else.
    pub fn with_flash(mut self, flash: MemoryFlash) -> Self {
        let (log, found) = Log::open(&flash);
        self.board.restore_stored(&found);
        Self { flash, log, ..self }
    }

    /// The robot inside, to compare what was found with.
    pub fn truth(&self) -> &HiddenRobot {
        &self.hidden
    }

    /// With something in the gripper, from the start and at every change of `changes`, whose times count from the start of
    /// each movement that is recorded under computed torque.
    pub fn with_load(mut self, from_start: Load<f64>, changes: &[LoadChange]) -> Self {
        self.load.carry(from_start, changes);
        self.arm.set_load(self.load.added_f());
        self
    }

    /// The arm carries `load` from now on, whatever it carried before.
    pub fn carry(&mut self, load: &Load<f64>) {
        self.load.carry(*load, &[]);
        self.arm.set_load(self.load.added_f());
    }

    /// With `noise` at the motors.
    pub fn with_torque_noise(mut self, noise: TorqueNoise) -> Self {
        self.torque_noise = Some(noise);
        self.noise_nm = noise.deviation_nm.map(|deviation| deviation * self.torque_random.normal());
        self
    }

    /// Presses or releases the emergency stop.
    pub fn set_emergency_stop(&mut self, pressed: bool) {
        self.emergency_stop = pressed;
    }

    /// Lets both hardware counters, which wrap, count on by `counts` although the arm does not move: as if they had
    /// started elsewhere, or the motors had been turned uncoupled.
    pub fn count_on(&mut self, counts: [i32; 2]) {
        for (offset, counts) in self.counter_offset.iter_mut().zip(counts) {
            *offset = offset.wrapping_add(counts);
        }
    }

    /// Codes of both current commands after the last tick, and whether the amplifiers are on.
    pub fn outputs(&self) -> ([u16; 2], bool) {
        (self.command_code, self.amplifiers_on)
    }

    /// Lets the next tick find that the one before was too late.
    pub fn miss_deadline(&mut self) {
        self.deadline_missed = true;
    }

    /// Lets time pass with nobody at the line.
    pub fn run(&mut self, duration: Duration) {
        let until_ns = self.time_ns.saturating_add(duration.as_nanos().try_into().unwrap_or(u64::MAX));
        while self.time_ns < until_ns {
            self.tick();
        }
    }

    /// Its memory for parameters, to look at, or to let power fail in the middle of a store.
    pub fn flash(&self) -> &MemoryFlash {
        &self.flash
    }

    /// Cuts the power for a millisecond. The board starts anew, with what its flash memory has kept, and with counters
    /// at zero wherever the arm is. What the board had begun to store is stored: for a cut in the middle of that see
    /// [`MemoryFlash::cut_power_after`].
    pub fn cut_power(&mut self) {
        let counts = self.counts();
        for (offset, count) in self.counter_offset.iter_mut().zip(counts) {
            *offset = offset.wrapping_sub(count);
        }
        self.flash.switch_on();
        let (log, found) = Log::open(&self.flash);
        self.log = log;
        self.board = Board::new(self.board.identity().clone(), vec![PackedSample::EMPTY; DEFAULT_SAMPLES]);
        self.board.restore_stored(&found);
        self.load.restart();
        self.storing = None;
        self.power_fails_ns = None;
        self.from_host = Decoder::new();
        self.to_host.clear();
        self.telemetry_dropped = 0;
        self.switch_off();
        self.command_code = [MID_SCALE; 2];
        self.time_ns += POWER_CUT_NS;
        self.restarts += 1;
    }

    /// How often it was started anew.
    pub fn restarts(&self) -> usize {
        self.restarts
    }

    /// What the counters show.
    fn counts(&self) -> [i32; 2] {
        let exact = self.arm.position_counts();
        std::array::from_fn(|joint| (exact[joint].floor() as i32).wrapping_add(self.counter_offset[joint]))
    }

    /// The brakes engage when power goes, and hold at once.
    fn switch_off(&mut self) {
        self.amplifiers_on = false;
        self.arm.brake();
    }

    /// One loop period: sample, decide, let the arm move.
    fn tick(&mut self) {
        // A recording's first row is of the tick after the one that begins to run.
        self.arm.set_recording(matches!(self.board.mode(), Mode::Running(_) | Mode::Stopping(_)));
        let current_a = self.arm.current_a();
        let inputs = Inputs {
            counts: self.counts(),
            current_code: std::array::from_fn(|joint| {
                let measured_a = current_a[joint] + CURRENT_NOISE_A * self.random.normal();
                let scale = &self.current_scale[joint];
                let code = (measured_a - scale.adc_offset_a) / scale.adc_a_per_code + f64::from(MID_SCALE);
                code.round().clamp(0.0, 4095.0) as u16
            }),
            emergency_stop: self.emergency_stop,
            deadline_missed: std::mem::take(&mut self.deadline_missed),
        };
        let period_ns = u64::from(self.board.loop_period_ns());
        if let Some(noise) = self.torque_noise {
            // Exact for this process at any period.
            let kept = (-1e-9 * period_ns as f64 / noise.correlation_time_s).exp();
            let fresh = (1.0 - kept * kept).sqrt();
            for (torque_nm, deviation_nm) in self.noise_nm.iter_mut().zip(noise.deviation_nm) {
                *torque_nm = kept * *torque_nm + fresh * deviation_nm * self.torque_random.normal();
            }
        }
        let outputs = self.board.tick(&inputs);
        self.command_code = outputs.command_code;
        self.board.advance_check();
        if self.load.pass(self.board.mode(), period_ns) {
            self.arm.set_load(self.load.added_f());
        }
        self.load.identify(&mut self.board, outputs.load_row, period_ns);
        if !outputs.amplifier_enable {
            self.switch_off();
        } else {
            let delay_ns = if self.amplifiers_on { self.command_delay_ns.min(period_ns) } else { 0 };
            self.amplifiers_on = true;
            self.arm.advance(delay_ns, self.noise_nm);
            self.arm
                .command(std::array::from_fn(|joint| self.current_scale[joint].command_a(outputs.command_code[joint])));
            self.arm.advance(period_ns - delay_ns, self.noise_nm);
        }
        self.time_ns += period_ns;
        match outputs.telemetry {
            Some(_) if self.to_host.len() >= OUTPUT_BYTES => self.telemetry_dropped += 1,
            Some(Telemetry { movement, sample, .. }) => {
                self.send_to_host(&BoardMessage::Telemetry { movement, sample });
            }
            None => {}
        }
        if let Some(event) = outputs.event {
            self.send_to_host(&BoardMessage::Event(event));
        }
        self.store();
        if self.power_fails_ns.is_some_and(|fails_ns| self.time_ns >= fails_ns) {
            self.cut_power();
        }
    }

    /// Stores what the board wants stored, and tells it when the memory would be done.
    fn store(&mut self) {
        match self.storing.take() {
            Some((until_ns, result)) if self.time_ns >= until_ns => self.board.end_store(result),
            Some(waiting) => self.storing = Some(waiting),
            None => {}
        }
        if let Some(parameters) = self.board.begin_store() {
            let before_ns = self.flash.busy_ns();
            let stored = complete(self.log.store(&mut self.flash, parameters.as_ref()));
            let until_ns = self.time_ns + self.flash.busy_ns() - before_ns;
            if self.flash.has_power() {
                self.storing = Some((until_ns, stored.unwrap_or(Err(StoreFailure::Timeout { waited_ms: 0 }))));
            } else {
                // The board does not hear of it any more.
                self.power_fails_ns = Some(until_ns);
            }
        }
    }

    fn send_to_host(&mut self, message: &BoardMessage) {
        let mut buffer = [0; MAX_FRAME];
        // Every message of the protocol fits a frame; one that did not would be lost, as on a wire.
        if let Ok(frame) = encode_board_message(message, &mut buffer) {
            self.to_host.extend(frame);
        }
    }
}

/// The simulated firmware is this tool's own.
fn firmware_version() -> heapless::String<16> {
    heapless::String::try_from(env!("CARGO_PKG_VERSION")).unwrap_or_default()
}

impl Link for SimulatedBoard {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        for &byte in bytes {
            let message = match self.from_host.host_message(byte) {
                None => continue,
                Some(Ok(message)) => message,
                Some(Err(FrameError::Version { theirs, .. })) => {
                    let firmware_version = firmware_version();
                    let reply = Reply::WrongVersion { board: PROTOCOL_VERSION, host: theirs, firmware_version };
                    self.send_to_host(&BoardMessage::Reply { sequence: 0, reply });
                    continue;
                }
                // What is damaged is thrown away; the host repeats it.
                Some(Err(_)) => continue,
            };
            let counters = self.from_host.counters();
            self.board.report_link(
                BoardLink::Usb,
                LinkCounters {
                    received: counters.received,
                    bad_frames: counters.bad(),
                    telemetry_dropped: self.telemetry_dropped,
                    replies_dropped: 0,
                },
            );
            let reply = self.board.handle(BoardLink::Usb, message.sequence, &message.request);
            self.send_to_host(&BoardMessage::Reply { sequence: message.sequence, reply });
        }
        self.tick();
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let until_ns = self.time_ns.saturating_add(timeout.as_nanos().try_into().unwrap_or(u64::MAX));
        while self.to_host.is_empty() && self.time_ns < until_ns {
            self.tick();
        }
        let count = buffer.len().min(self.to_host.len());
        for (slot, byte) in buffer.iter_mut().zip(self.to_host.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.time_ns)
    }

    fn name(&self) -> String {
        "sim".into()
    }
}

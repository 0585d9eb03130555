//! The position loop around the plant: what a controller with this law would see and record.
//!
//! At every loop sample: reference and actual position lose their fractions (toward zero), the law turns their
//! difference into a current, the amplifier limits it, and `command_delay_s` later it flows until the next command
//! takes over. Every record period reference, error and measured current are noted at the instant of the sample, so
//! the current is the one commanded a loop sample earlier.

use super::noise::{Purpose, RandomStream, TorqueDisturbance, TorqueNoise};
use super::plant::{Plant, State};
use super::recording::Recording;
use super::reference::Reference;
use super::robot::Robot;

/// Amperes between the neighbouring codes of the current measurement: 12 bits over ±15 A.
pub const CURRENT_STEP_A: f64 = 30.0 / 4096.0;

/// The current measurement ends here, in A.
const CURRENT_RANGE_A: f64 = 15.0;

/// How a recording is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunSettings {
    /// Decides every random number of the run.
    pub seed: u64,
    /// Time of holding at the start of the reference before tick 0, in seconds. The arm begins at rest exactly at
    /// the start, falls into the loop and comes to stick; so its first errors are those of a real arm.
    pub hold_s: f64,
    /// Longest integration step in seconds.
    pub max_step_s: f64,
    /// Standard deviation of the current measurement in A, before rounding.
    pub current_noise_a: f64,
    /// Disturbing torque, if any.
    pub torque_noise: Option<TorqueNoise>,
    /// Added to the actual position before it is rounded, in counts: where between two counts the encoder's zero
    /// lies. Moves only the rounding, so several runs differing in it show what rounding alone does.
    pub encoder_phase_counts: [f64; 2],
}

impl Default for RunSettings {
    fn default() -> Self {
        Self {
            seed: 0,
            hold_s: 2.0,
            max_step_s: 20e-6,
            current_noise_a: 0.02,
            torque_noise: None,
            encoder_phase_counts: [0.0; 2],
        }
    }
}

/// Everything that changes during a run.
struct Run<'a> {
    robot: &'a Robot,
    settings: &'a RunSettings,
    plant: Plant,
    state: State,
    disturbance: TorqueDisturbance,
    current_a: [f64; 2],
    previous_error: Option<[i32; 2]>,
}

/// Rounds as the paper's `fix()`: toward zero.
fn fix(counts: f64) -> i32 {
    counts.trunc() as i32
}

impl Run<'_> {
    /// Samples, commands, and moves on by one loop period. Returns the error and the new command.
    fn sample(&mut self, reference_counts: [i32; 2]) -> ([i32; 2], [f64; 2]) {
        let error = self.error_counts(reference_counts);
        let previous = self.previous_error.replace(error).unwrap_or(error);
        let command_a: [f64; 2] = std::array::from_fn(|joint| {
            let drive = &self.robot.drives[joint];
            let change = f64::from(error[joint] - previous[joint]);
            let wanted = drive.position_gain_a_per_count * (f64::from(error[joint]) + drive.lead * change);
            wanted.clamp(-drive.current_limit_a, drive.current_limit_a)
        });

        let disturbance_nm = self.disturbance.next_nm(self.robot.loop_period_s);
        self.flow(disturbance_nm, self.robot.command_delay_s);
        self.current_a = command_a;
        self.flow(disturbance_nm, self.robot.loop_period_s - self.robot.command_delay_s);
        (error, command_a)
    }

    fn error_counts(&self, reference_counts: [i32; 2]) -> [i32; 2] {
        std::array::from_fn(|joint| {
            let position = self.state.angle_rad[joint] * self.robot.drives[joint].counts_per_joint_rad();
            reference_counts[joint] - fix(position + self.settings.encoder_phase_counts[joint])
        })
    }

    /// Lets the present current flow for a while.
    fn flow(&mut self, disturbance_nm: [f64; 2], duration_s: f64) {
        if duration_s <= 0.0 {
            return;
        }
        let joint_torque_nm = std::array::from_fn(|joint| {
            let drive = &self.robot.drives[joint];
            drive.gear_ratio * (drive.torque_constant_nm_per_a * self.current_a[joint] + disturbance_nm[joint])
        });
        self.plant.advance(&mut self.state, joint_torque_nm, duration_s, self.settings.max_step_s);
    }
}

/// Simulates `robot` along `reference` and returns what it would have recorded.
///
/// # Panics
/// If the loop period does not fit the record period a whole number of times, or the command delay does not fit
/// into the loop period.
#[must_use]
pub fn record(robot: &Robot, reference: &Reference, settings: &RunSettings) -> Recording {
    let loops = robot.loops_per_record();
    assert!(
        (0.0..robot.loop_period_s).contains(&robot.command_delay_s),
        "command delay {} s must be at least 0 and less than the loop period {} s",
        robot.command_delay_s,
        robot.loop_period_s
    );
    let start_counts = reference.counts(robot, 0, 0, loops);
    let start_rad = std::array::from_fn(|joint| start_counts[joint] / robot.drives[joint].counts_per_joint_rad());
    let mut run = Run {
        robot,
        settings,
        plant: Plant::of(robot),
        state: State::at_rest(start_rad),
        disturbance: TorqueDisturbance::new(settings.torque_noise, settings.seed),
        current_a: [0.0; 2],
        previous_error: None,
    };
    for _ in 0..(settings.hold_s / robot.loop_period_s).round() as usize {
        run.sample(start_counts.map(fix));
    }

    let mut measurement = RandomStream::new(settings.seed, Purpose::Current);
    let ticks = reference.ticks(robot.record_period_s);
    let mut recording = Recording::with_capacity(ticks);
    for tick in 0..ticks {
        for part in 0..loops {
            let reference_counts = reference.counts(robot, tick, part, loops).map(fix);
            let (state, current_a) = (run.state, run.current_a);
            let (error, command_a) = run.sample(reference_counts);
            if part == 0 {
                let measured_a =
                    current_a.map(|current| measured(current, settings.current_noise_a * measurement.gaussian()));
                recording.push(reference_counts, error, measured_a, command_a, &state);
            }
        }
    }
    recording
}

/// What a 12-bit converter reads from a noisy current.
fn measured(current_a: f64, noise_a: f64) -> f64 {
    let inside = (current_a + noise_a).clamp(-CURRENT_RANGE_A, CURRENT_RANGE_A - CURRENT_STEP_A);
    (inside / CURRENT_STEP_A).round() * CURRENT_STEP_A
}

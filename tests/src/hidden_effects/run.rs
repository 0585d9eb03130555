//! The position loop around the machine: encoder, law, converter, delay, and what is written down.

use crate::simulator::noise::{Purpose, RandomStream, TorqueDisturbance};
use crate::simulator::{Reference, Robot, TorqueNoise};

use super::machine::Machine;
use super::motion::{Drive, Motion};
use super::outside::Outside;

/// Amperes between neighbouring codes of both converters: 12 bits over ±15 A.
pub const CURRENT_STEP_A: f64 = 30.0 / 4096.0;

/// How a recording is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Decides every random number of the run.
    pub seed: u64,
    /// Seconds of holding at the start before tick 0.
    pub hold_s: f64,
    /// Where the arm stands when holding begins, off the start, in rad.
    pub start_off_rad: [f64; 2],
    /// Longest integration step in s.
    pub step_s: f64,
    /// Standard deviation of the current measurement in A.
    pub current_noise_a: f64,
    /// Gain of the current measurement; 1 for a right one.
    pub current_sensor_gain: [f64; 2],
    /// Zero of the current measurement in A.
    pub current_sensor_zero_a: [f64; 2],
    /// Disturbing torque.
    pub torque_noise: Option<TorqueNoise>,
}

impl Settings {
    /// No noise but that of the current measurement.
    #[must_use]
    pub fn quiet(seed: u64) -> Self {
        Self {
            seed,
            hold_s: 2.0,
            start_off_rad: [0.0; 2],
            step_s: 20e-6,
            current_noise_a: 0.02,
            current_sensor_gain: [1.0; 2],
            current_sensor_zero_a: [0.0; 2],
            torque_noise: None,
        }
    }
}

/// What was recorded, one entry per tick of 0.7 ms.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Reference in whole counts.
    pub reference_counts: [Vec<i32>; 2],
    /// Reference less actual in whole counts.
    pub error_counts: [Vec<i32>; 2],
    /// Measured current in A.
    pub current_a: [Vec<f64>; 2],
    /// Command in A as sent.
    pub command_a: [Vec<f64>; 2],
    /// Current that flowed when it was measured, in A. Not in the file.
    pub true_current_a: [Vec<f64>; 2],
    /// Motor speed in rad/s. Not in the file.
    pub motor_speed_rad_s: [Vec<f64>; 2],
    /// Motor position in counts, unrounded and without the encoder's faults. Not in the file.
    pub motor_counts: [Vec<f64>; 2],
}

impl Record {
    /// Root-mean-square difference of the errors of two records per joint, in counts.
    #[must_use]
    pub fn gap_counts(&self, other: &Self) -> [f64; 2] {
        std::array::from_fn(|joint| {
            rms(self.error_counts[joint].iter().zip(&other.error_counts[joint]).map(|(one, two)| f64::from(one - two)))
        })
    }

    /// Root-mean-square difference of the commands per joint, in A.
    #[must_use]
    pub fn command_gap_a(&self, other: &Self) -> [f64; 2] {
        std::array::from_fn(|joint| {
            rms(self.command_a[joint].iter().zip(&other.command_a[joint]).map(|(one, two)| one - two))
        })
    }

    /// The recording's file (design.md §8), with the columns of the command if `commands`.
    #[must_use]
    pub fn to_csv(&self, commands: bool) -> String {
        use std::fmt::Write as _;
        let mut text = String::from("tick,ref2,ref3,err2,err3,cur2,cur3");
        text += if commands { ",cmd2,cmd3\n" } else { "\n" };
        for row in 0..self.error_counts[0].len() {
            let [reference2, reference3] = [0, 1].map(|joint| self.reference_counts[joint][row]);
            let [error2, error3] = [0, 1].map(|joint| self.error_counts[joint][row]);
            let [current2, current3] = [0, 1].map(|joint| self.current_a[joint][row]);
            // Writing to a string cannot fail.
            let _ = write!(text, "{row},{reference2},{reference3},{error2},{error3},{current2:.4},{current3:.4}");
            if commands {
                let [command2, command3] = [0, 1].map(|joint| self.command_a[joint][row]);
                let _ = write!(text, ",{command2},{command3}");
            }
            text.push('\n');
        }
        text
    }
}

/// Root mean square of `values`; 0 of none.
#[must_use]
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, squares) = values.fold((0_usize, 0.0), |(count, squares), value| (count + 1, squares + value * value));
    (squares / count.max(1) as f64).sqrt()
}

/// Simulates `machine` along `reference`. `robot` gives the reference's counts: the machine as its maker describes it.
#[must_use]
pub fn record(machine: &Machine, robot: &Robot, reference: &Reference, settings: &Settings) -> Record {
    let start_counts = reference.counts(robot, 0, 0, 1);
    let start_rad = std::array::from_fn(|joint| {
        start_counts[joint] / machine.joints[joint].counts_per_rad() + settings.start_off_rad[joint]
    });
    let held = (settings.hold_s / machine.period_s).round() as usize;
    let mut motion = Motion::at_rest(machine, start_rad, -(held as f64) * machine.period_s, settings.step_s);
    let mut disturbance = TorqueDisturbance::new(settings.torque_noise, settings.seed);
    let mut measurement = RandomStream::new(settings.seed, Purpose::Current);
    let mut jitter = Jitter::new(machine.outside.as_ref(), machine.period_s, settings.seed);
    let mut drive = Drive::default();
    let ticks = reference.ticks(machine.period_s);
    let mut record = Record::default();
    for step in 0..held + ticks {
        let tick = step.checked_sub(held);
        // Counted from the ticks, so that rounding of a sum of steps never moves an event to a neighbouring tick.
        motion.time_s = (step as f64 - held as f64) * machine.period_s;
        let reference_counts = tick.map_or(start_counts, |tick| reference.counts(robot, tick, 0, 1)).map(fix);
        let late_s = jitter.next_s();
        let error: [i32; 2] =
            std::array::from_fn(|joint| reference_counts[joint] - counted(machine, &motion, joint, late_s[joint]));
        let flowing_a = motion.current_a(&drive);
        let command_a: [f64; 2] = std::array::from_fn(|joint| command_a(machine, joint, error[joint]));
        if tick.is_some() {
            for joint in 0..2 {
                let part = &machine.joints[joint];
                let motor_rad = motion.motor_angle_at_joint_rad(joint) * part.gear_ratio;
                let noise_a = settings.current_noise_a * measurement.gaussian();
                let shown_a = settings.current_sensor_gain[joint] * flowing_a[joint]
                    + settings.current_sensor_zero_a[joint]
                    + noise_a;
                record.reference_counts[joint].push(reference_counts[joint]);
                record.error_counts[joint].push(error[joint]);
                record.current_a[joint].push(rounded(shown_a));
                record.command_a[joint].push(command_a[joint]);
                record.true_current_a[joint].push(flowing_a[joint]);
                record.motor_speed_rad_s[joint].push(motion.motor_speed_at_joint_rad_s(joint) * part.gear_ratio);
                record.motor_counts[joint].push(motor_rad * part.counts_per_rev / std::f64::consts::TAU);
            }
        }
        drive.disturbance_nm = disturbance.next_nm(machine.period_s);
        motion.advance(&drive, machine.command_delay_s);
        drive.command_a = command_a;
        motion.advance(&drive, machine.period_s - machine.command_delay_s);
    }
    record
}

/// Toward zero, as the paper's `fix()`.
fn fix(counts: f64) -> i32 {
    counts.trunc() as i32
}

/// A 12-bit converter's nearest code, in A.
fn rounded(current_a: f64) -> f64 {
    let inside = current_a.clamp(-15.0, 15.0 - CURRENT_STEP_A);
    (inside / CURRENT_STEP_A).round() * CURRENT_STEP_A
}

fn command_a(machine: &Machine, joint: usize, error_counts: i32) -> f64 {
    let part = &machine.joints[joint];
    let wanted = (part.gain_a_per_count * f64::from(error_counts)).clamp(-part.command_limit_a, part.command_limit_a);
    if machine.converter { rounded(wanted) } else { wanted }
}

fn counted(machine: &Machine, motion: &Motion<'_>, joint: usize, late_s: f64) -> i32 {
    let part = &machine.joints[joint];
    let at_joint = motion.motor_angle_at_joint_rad(joint) + late_s * motion.motor_speed_at_joint_rad_s(joint);
    let counts = part.encoder_counts(at_joint * part.gear_ratio, motion.time_s);
    match machine.outside {
        Some(Outside::CoarseEncoder { joint: coarse, step_counts }) if coarse == joint => {
            fix(fix(counts / step_counts) as f64 * step_counts)
        }
        _ => fix(counts),
    }
}

/// The wandering instant of [`Outside::SamplingJitter`].
struct Jitter {
    random: RandomStream,
    late_s: [f64; 2],
    joint: usize,
    deviation_s: f64,
    kept: f64,
}

impl Jitter {
    fn new(outside: Option<&Outside>, period_s: f64, seed: u64) -> Self {
        let random = RandomStream::new(seed ^ 0x5eed, Purpose::Reference);
        let (joint, deviation_s, kept) = match outside {
            Some(&Outside::SamplingJitter { joint, deviation_s, correlation_s }) => {
                (joint, deviation_s, (-period_s / correlation_s).exp())
            }
            _ => (0, 0.0, 0.0),
        };
        Self { random, late_s: [0.0; 2], joint, deviation_s, kept }
    }

    fn next_s(&mut self) -> [f64; 2] {
        if self.deviation_s > 0.0 {
            let fresh = (1.0 - self.kept * self.kept).sqrt() * self.deviation_s * self.random.gaussian();
            self.late_s[self.joint] = self.kept * self.late_s[self.joint] + fresh;
        }
        self.late_s
    }
}

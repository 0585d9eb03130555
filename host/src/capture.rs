//! From a movement's rows to a recording with its manifest.

use std::path::PathBuf;

use shared::protocol::{CurrentScale, Info, Sample};

use crate::client::Movement;
use crate::joint_names;
use crate::recording::{Manifest, ManifestJoint, Mode, Recording};
use crate::robot::{Law, Robot};

/// What the rows themselves do not say.
#[derive(Clone, Debug)]
pub struct Circumstances<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// The controller that ran.
    pub mode: Mode,
    /// The movement in words.
    pub trajectory: String,
    /// Who the board is.
    pub board: Info,
    /// Seed of a simulated robot.
    pub seed: Option<u64>,
}

/// The recording of `movement`, to be written to `path`.
pub fn recording(movement: &Movement, circumstances: &Circumstances<'_>, path: PathBuf) -> Recording {
    let robot = circumstances.robot;
    let samples = &movement.samples;
    let scales: Vec<CurrentScale> =
        robot.joints.iter().map(|joint| CurrentScale::symmetric(joint.current_full_scale_a)).collect();
    let columns = |value: &dyn Fn(&Sample, usize) -> f64| -> Vec<Vec<f64>> {
        (0..robot.joints.len()).map(|joint| samples.iter().map(|sample| value(sample, joint)).collect()).collect()
    };
    // Converter codes are worth 7 mA: microamperes keep them exactly and leave out the digits of the division.
    let rounded = |current_a: f64| (current_a * 1e6).round() / 1e6;
    Recording {
        path,
        tick: samples.iter().map(|sample| sample.index).collect(),
        reference_counts: columns(&|sample, joint| f64::from(sample.reference_counts[joint])),
        error_counts: columns(&|sample, joint| f64::from(sample.error_counts[joint])),
        current_a: columns(&|sample, joint| rounded(scales[joint].measured_a(sample.current_code[joint]))),
        command_a: Some(columns(&|sample, joint| rounded(scales[joint].command_a(sample.command_code[joint])))),
        added_torque: None,
        manifest: Some(manifest(movement, circumstances)),
        notes: Vec::new(),
    }
}

fn manifest(movement: &Movement, circumstances: &Circumstances<'_>) -> Manifest {
    let Circumstances { robot, mode, trajectory, board, seed } = circumstances;
    let gains = |joint: &crate::robot::Joint| match joint.law {
        Law::Proportional(position_loop) => Some(ManifestJoint {
            name: joint.name.clone(),
            position_gain_a_per_count: position_loop.gain_a_per_count,
            lead: position_loop.lead,
        }),
        Law::Cascade { .. } => None,
    };
    let identity = &board.identity;
    let revision =
        if identity.git_revision.is_empty() { String::new() } else { format!(" ({})", identity.git_revision) };
    Manifest {
        rows: None,
        mode: *mode,
        robot: robot.name.clone(),
        trajectory: trajectory.clone(),
        tool: crate::TOOL_VERSION.into(),
        firmware: format!("{} {}{revision}", identity.board, identity.firmware_version),
        record_period_s: Some(robot.record_period_s),
        loop_period_s: Some(robot.loop_period_s),
        seed: *seed,
        model_crc: movement.recording.and_then(|info| info.model_crc).map(|crc| format!("{crc:08x}")),
        rows_read_again: Some(movement.reread_rows),
        partial: movement.partial.as_ref().map(|reason| {
            joint_names::of(robot).map_or_else(|| reason.clone(), |names| joint_names::in_message(reason, &names))
        }),
        joint: robot.joints.iter().filter_map(gains).collect(),
        csv: None,
    }
}

/// How well one joint was held on its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackingQuality {
    /// Largest tracking error in counts, without its sign.
    pub max_abs_error_counts: f64,
    /// Root mean square of the tracking error in counts.
    pub rms_error_counts: f64,
    /// Percentage of samples whose recorded error is −1, 0 or 1.
    ///
    /// The recorded error is the difference of two counts truncated toward zero, an integer; the true error of such a
    /// sample is below 2 counts.
    pub within_one_count_percent: f64,
}

/// The tracking quality of every joint over a whole recording.
pub fn tracking_quality(recording: &Recording) -> Vec<TrackingQuality> {
    recording
        .error_counts
        .iter()
        .map(|errors| {
            let n = errors.len().max(1) as f64;
            let within = errors.iter().filter(|error| error.abs() <= 1.0).count() as f64;
            TrackingQuality {
                max_abs_error_counts: errors.iter().fold(0.0, |largest: f64, error| largest.max(error.abs())),
                rms_error_counts: (errors.iter().map(|error| error * error).sum::<f64>() / n).sqrt(),
                within_one_count_percent: 100.0 * within / n,
            }
        })
        .collect()
}

/// What moving one joint took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Root mean square of the motor's torque commanded, N m.
    pub torque_rms_nm: f64,
    /// How long the command was at the amplifier's limit, s.
    pub time_in_limits_s: f64,
}

/// What every joint took over a whole recording; nothing where it does not have the commands.
pub fn efforts(recording: &Recording, robot: &Robot) -> Vec<Effort> {
    let commands = recording.command_a.iter().flatten();
    commands
        .zip(&robot.joints)
        .map(|(command_a, joint)| {
            let n = command_a.len().max(1) as f64;
            let square = command_a.iter().map(|command| command * command).sum::<f64>() / n;
            // A limited command is recorded as the code nearest to it.
            let code_a = CurrentScale::symmetric(joint.current_full_scale_a).dac_a_per_code;
            let limit_a = joint.current_limit_a.min(joint.current_full_scale_a - code_a);
            let limited = command_a.iter().filter(|command| command.abs() > limit_a - 0.75 * code_a).count();
            Effort {
                torque_rms_nm: joint.torque_constant_nm_per_a * square.sqrt(),
                time_in_limits_s: limited as f64 * robot.record_period_s,
            }
        })
        .collect()
}

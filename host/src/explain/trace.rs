//! What happened in a recording, smoothed: motion, motor torque, and the torque the model lacks.
//!
//! The torque comes out of the innovations: a missing acceleration a appears in them as a/(s² + L1 s + L2), with the
//! gains of the state correction. Undone, low-passed without phase, and multiplied by the arm's inertia this is the
//! residual torque without any bias of the loop: good to look at and to find orders and instants by. Decisions are
//! taken on the innovations themselves.

use shared::arm::{Arm, Pose};
use shared::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

use crate::identify::{Columns, Experiment, Segment, low_pass};

/// Everything is low-passed at this frequency.
const CUTOFF_HZ: f64 = 25.0;

/// A recording's motion.
#[derive(Clone, Debug)]
pub struct Trace {
    /// Seconds since the record's start.
    pub time_s: Vec<f64>,
    /// Joint angles in rad.
    pub position_rad: [Vec<f64>; 2],
    /// Joint speeds in rad/s.
    pub velocity_rad_s: [Vec<f64>; 2],
    /// Motor torque as commanded in N m.
    pub motor_torque_nm: [Vec<f64>; 2],
    /// Seconds to the nearest reversal before, per joint.
    pub since_reversal_s: [Vec<f64>; 2],
}

/// The motion of every segment.
pub fn traces(experiment: &Experiment) -> Vec<Trace> {
    experiment.segments.iter().map(|segment| trace(experiment, segment)).collect()
}

fn trace(experiment: &Experiment, segment: &Segment) -> Trace {
    let period_s = experiment.robot.record_period_s;
    let samples = segment.error_counts.len();
    let joints = experiment.robot.joints.len();
    let position_rad: [Vec<f64>; 2] = std::array::from_fn(|joint| {
        let counts: Vec<f64> = segment.measured_counts.iter().map(|pair| pair[joint]).collect();
        low_pass(&counts, period_s, CUTOFF_HZ).into_iter().map(|c| c / experiment.counts_per_rad(joint)).collect()
    });
    let velocity_rad_s: [Vec<f64>; 2] = std::array::from_fn(|joint| slope(&position_rad[joint], period_s));
    let motor_torque_nm = std::array::from_fn(|joint| match experiment.robot.joints.get(joint) {
        Some(robot) => segment
            .command_a
            .iter()
            .map(|pair| {
                pair[joint].clamp(-robot.current_limit_a, robot.current_limit_a) * robot.torque_constant_nm_per_a
            })
            .collect(),
        None => vec![0.0; samples],
    });
    let since_reversal_s = std::array::from_fn(|joint| {
        if joint >= joints {
            return vec![f64::INFINITY; samples];
        }
        // Speeds within half a count per filter time are rest, not reversals.
        let still = 0.5 / experiment.counts_per_rad(joint).abs() * CUTOFF_HZ;
        let mut direction = 0.0;
        let mut last = f64::NEG_INFINITY;
        (0..samples)
            .map(|k| {
                let velocity = velocity_rad_s[joint][k];
                if velocity.abs() > still && velocity.signum() != direction {
                    direction = velocity.signum();
                    last = k as f64;
                }
                (k as f64 - last) * period_s
            })
            .collect()
    });
    Trace {
        time_s: (0..samples).map(|k| k as f64 * period_s).collect(),
        position_rad,
        velocity_rad_s,
        motor_torque_nm,
        since_reversal_s,
    }
}

fn slope(values: &[f64], period_s: f64) -> Vec<f64> {
    let last = values.len() - 1;
    (0..values.len())
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
            (values[b] - values[a]) / ((b - a).max(1) as f64 * period_s)
        })
        .collect()
}

/// The motor torque in N m that the model lacks, per segment and joint, from its innovations.
pub fn residual_torque(experiment: &Experiment, traces: &[Trace], arm: &Arm<f64>, innovations: &Columns) -> Columns {
    let period_s = experiment.robot.record_period_s;
    let omega = std::f64::consts::TAU * CORRECTION_HZ;
    let joints = experiment.robot.joints.len();
    let of = |(trace, columns): (&Trace, &[Vec<f64>; 2])| -> [Vec<f64>; 2] {
        let acceleration: [Vec<f64>; 2] = std::array::from_fn(|joint| {
            if joint >= joints {
                return vec![0.0; columns[joint].len()];
            }
            let smooth = low_pass(&columns[joint], period_s, CUTOFF_HZ);
            let first = slope(&smooth, period_s);
            let second = slope(&first, period_s);
            let per_rad = experiment.counts_per_rad(joint);
            (0..smooth.len())
                .map(|k| {
                    (second[k] + 2.0 * CORRECTION_DAMPING * omega * first[k] + omega * omega * smooth[k]) / per_rad
                })
                .collect()
        });
        let mut torque = [Vec::with_capacity(trace.time_s.len()), Vec::with_capacity(trace.time_s.len())];
        for (k, (&a, &b)) in acceleration[0].iter().zip(&acceleration[1]).enumerate() {
            let inertia = arm.inertia(&Pose::at([trace.position_rad[0][k], trace.position_rad[1][k]]));
            let joint_torque = [inertia.d11 * a + inertia.d12 * b, inertia.d12 * a + inertia.d22 * b];
            for joint in 0..2 {
                let ratio = experiment.robot.joints.get(joint).map_or(1.0, |joint| joint.gear_ratio);
                torque[joint].push(joint_torque[joint] / ratio);
            }
        }
        torque
    };
    traces.iter().zip(innovations).map(of).collect()
}

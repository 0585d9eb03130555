//! A recording in SI units: columns whose names end in their unit.

use crate::recording::Recording;
use crate::robot::{Robot, Unit};

/// What belongs together in a viewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Where each joint should be and is.
    JointStates,
    /// How far each joint is from where it should be.
    TrackingErrors,
    /// What drives each joint.
    Drives,
}

impl Channel {
    /// Every channel.
    pub const ALL: [Self; 3] = [Self::JointStates, Self::TrackingErrors, Self::Drives];

    /// Its topic in an MCAP file.
    pub fn topic(self) -> &'static str {
        match self {
            Self::JointStates => "/joint_states",
            Self::TrackingErrors => "/tracking_errors",
            Self::Drives => "/drives",
        }
    }
}

/// One quantity of one joint over the whole recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// What it is shown with.
    pub channel: Channel,
    /// Index of the joint.
    pub joint: usize,
    /// Name ending in the unit, such as `position_rad`.
    pub quantity: String,
    /// What it is, in words.
    pub meaning: &'static str,
    /// One value a sample.
    pub values: Vec<f64>,
}

/// A recording in SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name of each joint, as in the robot file.
    pub joints: Vec<String>,
    /// Time of each sample since tick 0, in ns.
    pub time_ns: Vec<u64>,
    /// Every quantity of every joint, joint by joint.
    pub columns: Vec<Column>,
}

impl Series {
    /// `recording` of `robot` in SI units.
    ///
    /// Angles and lengths are those of the joint: counts through encoder and gear. What a linear axis is driven with has
    /// a unit that the robot file does not name; it is given as the force it makes.
    pub fn of(recording: &Recording, robot: &Robot) -> Self {
        let length = if robot.unit == Unit::Metre { "m" } else { "rad" };
        let mut columns = Vec::new();
        for (joint, known) in robot.joints.iter().enumerate() {
            let mut column = |channel, quantity: String, meaning, values| {
                columns.push(Column { channel, joint, quantity, meaning, values });
            };
            let (reference, error) = (&recording.reference_counts[joint], &recording.error_counts[joint]);
            let counts_per_unit = known.counts_per_rad();
            // 0 is added because it would stand as -0 behind a gear that turns the other way.
            let in_unit = |counts: f64| counts / counts_per_unit + 0.0;
            column(
                Channel::JointStates,
                format!("reference_{length}"),
                "where the joint should be",
                reference.iter().map(|&counts| in_unit(counts)).collect(),
            );
            column(
                Channel::JointStates,
                format!("position_{length}"),
                "where its encoder says it is",
                reference.iter().zip(error).map(|(reference, error)| in_unit(reference - error)).collect(),
            );
            column(
                Channel::TrackingErrors,
                format!("error_{length}"),
                "reference less position, at the joint",
                error.iter().map(|&counts| in_unit(counts)).collect(),
            );
            column(
                Channel::TrackingErrors,
                "error_counts".into(),
                "reference less position, in counts at the motor",
                error.clone(),
            );
            let (of_drive, factor) = match robot.unit {
                Unit::Radian => ("current_a", 1.0),
                Unit::Metre => ("force_n", known.torque_constant_nm_per_a),
            };
            let drives = [
                ("measured", "as measured at the sample's instant", Some(&recording.current_a)),
                (
                    "commanded",
                    "as commanded at the sample's instant, in force a delay later",
                    recording.command_a.as_ref(),
                ),
                ("added", "known, added to the command after the controller", recording.added_torque.as_ref()),
            ];
            for (what, meaning, values) in drives {
                let Some(values) = values else { continue };
                let (what, meaning) = match what {
                    "measured" if robot.current_is_command => ("commanded", "as the controller computed it"),
                    _ => (what, meaning),
                };
                let values = values[joint].iter().map(|value| value * factor).collect();
                column(Channel::Drives, format!("{what}_{of_drive}"), meaning, values);
            }
        }
        let period_ns = robot.record_period_s * 1e9;
        Self {
            joints: robot.joints.iter().map(|joint| joint.name.clone()).collect(),
            time_ns: recording.tick.iter().map(|&tick| (f64::from(tick) * period_ns).round() as u64).collect(),
            columns,
        }
    }

    /// Time of sample `index` since tick 0, in s.
    pub fn time_s(&self, index: usize) -> f64 {
        self.time_ns[index] as f64 / 1e9
    }
}

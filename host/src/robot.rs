//! The robot file: what is known about a robot before it is identified.

mod computed_torque;
mod file;
mod friction;
mod gripper;
mod identity;
mod stability;
mod write;

use std::path::Path;

use shared::arm::{PARAMETERS, PUMA_UPPER_ARM_M, REFERENCE_F, SEARCH_HIGH, SEARCH_LOW};
use shared::control::{ComputedTorqueSettings, PositionLoop};
use shared::drive::Drive;
use shared::trajectory::MotionLimits;

use crate::file_error::FileError;

pub use friction::FrictionError;
pub use gripper::Gripper;
pub use stability::UnsafeGain;

/// Everything known about a robot beforehand.
///
/// A linear axis (`unit = "m"`) is a joint with gear ratio 1 whose "radian" is a metre: counts per revolution are
/// 2π · counts per metre, the torque constant is the actuator's gain (N per command unit), torques are forces.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Name, for people.
    pub name: String,
    /// How many joints move, and how.
    pub kind: Kind,
    /// What a joint's position is measured in.
    pub unit: Unit,
    /// Gravitational acceleration in m/s²; 0 for a single axis that does not feel it.
    pub gravity_m_s2: f64,
    /// Time between two recorded samples, in s.
    pub record_period_s: f64,
    /// Time between two ticks of the position loop, in s; divides the record period.
    pub loop_period_s: f64,
    /// From sampling the encoders to the new current, in s; below one loop period.
    pub command_delay_s: f64,
    /// The most counts the reference of either joint may move in one record period, if the file gives it; otherwise
    /// what the speed limits allow.
    pub counts_per_tick_limit: Option<f64>,
    /// Length a3 of the upper arm in m, from joint to joint: what ties f3 and f4 to f5 and f6, and what a load at the
    /// tool adds to f. The paper's where the file gives none.
    pub upper_arm_m: f64,
    /// Tracking error in counts at which the board stops the arm, if the file gives it; otherwise
    /// [`DEFAULT_FOLLOWING_ERROR_LIMIT_COUNTS`].
    pub following_error_limit_counts: Option<f64>,
    /// References and errors are whole counts after `fix()`.
    pub quantised: bool,
    /// `cur` is the controller's output of the same tick, not a measurement of the tick before.
    pub current_is_command: bool,
    /// The joints, in the order of the recording's columns.
    pub joints: Vec<Joint>,
    /// What the arm may carry, and where; unknown where the file of another arm than the reference robot does not give it.
    pub gripper: Option<Gripper>,
    /// Bandwidths of computed torque.
    pub computed_torque: ComputedTorqueSettings<f64>,
    /// Search range of f1..f9: `[low, high]`.
    pub search: [[f64; 2]; 9],
}

/// How many joints move, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Two joints in a vertical plane: links 2 and 3 of a PUMA 560.
    TwoLink,
    /// One axis without gravity.
    SingleAxis,
}

/// What a joint's position is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Radians, torques in N m.
    Radian,
    /// Metres, forces in N.
    Metre,
}

/// One joint with its drive and its position loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name: the ending of the joint's columns in a recording, "2" for `err2`.
    pub name: String,
    /// Motor turns per joint turn; negative where the motor turns the other way.
    pub gear_ratio: f64,
    /// Encoder counts per motor turn, quadrature included.
    pub counts_per_rev: f64,
    /// Motor torque per ampere in N m/A.
    pub torque_constant_nm_per_a: f64,
    /// Largest current of the amplifier in A (largest command of a linear axis).
    pub current_limit_a: f64,
    /// The position loop the joint runs under.
    pub law: Law,
    /// Viscous friction at the motor in N m s/rad, if known.
    pub viscous_friction_nm_s_per_rad: Option<f64>,
    /// Coulomb friction at the motor in N m, if known.
    pub coulomb_friction_nm: Option<f64>,
    /// Current in A at full scale of the board's converters, for command and measurement alike.
    pub current_full_scale_a: f64,
    /// Where and how fast the joint may move.
    pub limits: JointLimits,
}

/// A joint's position loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// `u = G (e + β (e − e_previous))`, e in counts.
    Proportional(PositionLoop<f64>),
    /// A velocity loop inside a position loop, in units of the joint:
    /// `u[k] = kv (kp (ref[k] − act[k]) − (m[k] − m[k−1]) / period)`, `m[k] = (act[k] + act[k−1]) / 2`.
    Cascade {
        /// kp in 1/s.
        position_gain_per_s: f64,
        /// kv in A s/rad (V s/m for a linear axis with a voltage command).
        velocity_gain: f64,
    },
}

/// Where and how fast a joint may move: checked before any motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Least joint angle in rad.
    pub position_low_rad: f64,
    /// Greatest joint angle in rad.
    pub position_high_rad: f64,
    /// Greatest speed in rad/s.
    pub speed_rad_s: f64,
    /// Greatest acceleration in rad/s².
    pub acceleration_rad_s2: f64,
}

impl JointLimits {
    /// Limits of joint `index` where the file gives none.
    pub(crate) fn not_given(index: usize, unit: Unit) -> Self {
        match unit {
            Unit::Radian => Self::reference_robot(index),
            // Nothing is known about a linear axis' travel; it is never moved by this tool.
            Unit::Metre => Self {
                position_low_rad: f64::MIN,
                position_high_rad: f64::MAX,
                speed_rad_s: f64::MAX,
                acceleration_rad_s2: f64::MAX,
            },
        }
    }

    /// Limits of joint `index` where the file gives none: those of the reference robot,
    /// [`MotionLimits::reference_robot`].
    pub fn reference_robot(index: usize) -> Self {
        let limits = MotionLimits::reference_robot();
        let joint = index.min(1);
        // Through decimal text, so that the f32's 2.7 is 2.7 and not 2.7000000476837160.
        let decimal = |value: f32| value.to_string().parse().unwrap_or(f64::from(value));
        Self {
            position_low_rad: decimal(limits.position_low_rad[joint]),
            position_high_rad: decimal(limits.position_high_rad[joint]),
            speed_rad_s: decimal(limits.speed_rad_s[joint]),
            acceleration_rad_s2: decimal(limits.acceleration_rad_s2[joint]),
        }
    }
}

/// Tracking error that is a fault where the file gives none, in counts: six times what the default loop shows on the
/// paper's movement.
pub const DEFAULT_FOLLOWING_ERROR_LIMIT_COUNTS: f64 = 1000.0;

/// Current at full scale of both converters where the file gives none: a ±15 A sensor around the ±12 A amplifier.
pub(crate) const DEFAULT_FULL_SCALE_A: f64 = 15.0;

impl Joint {
    /// Counts per joint radian (per metre of a linear axis), with the sign of the gear.
    pub fn counts_per_rad(&self) -> f64 {
        self.gear_ratio * self.counts_per_rev / std::f64::consts::TAU
    }

    /// The joint's drive with the friction the file gives; friction that is not known is 0.
    pub fn drive(&self) -> Drive<f64> {
        Drive {
            gear_ratio: self.gear_ratio,
            counts_per_rev: self.counts_per_rev,
            torque_constant_nm_per_a: self.torque_constant_nm_per_a,
            current_limit_a: self.current_limit_a,
            viscous_friction_nm_s_per_rad: self.viscous_friction_nm_s_per_rad.unwrap_or(0.0),
            coulomb_friction_nm: self.coulomb_friction_nm.unwrap_or(0.0),
            torque_offset_nm: 0.0,
        }
    }
}

/// A value of a robot that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}{field} is {value}, but must be {limit}; {remedy}", place = joint_place(joint))]
pub struct RobotError {
    /// Index of the joint, if it is a joint's value.
    pub joint: Option<usize>,
    /// The key of the robot file.
    pub field: &'static str,
    /// Its value.
    pub value: String,
    /// What would be accepted.
    pub limit: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
}

fn joint_place(joint: &Option<usize>) -> String {
    joint.map(|joint| format!("joint {}: ", joint + 1)).unwrap_or_default()
}

/// Gains of the default loop: half the stability limit at 0.7 ms (design §4), A/count.
const DEFAULT_GAINS_A_PER_COUNT: [f64; 2] = [0.036, 0.048];

impl Robot {
    /// Reads and checks a robot file. Gains are not compared with the stability limit: see
    /// [`Robot::read_for_motion`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        file::read(path)
    }

    /// Reads and checks a robot file that is about to move a robot: gains must be stable too.
    pub fn read_for_motion(path: &Path) -> Result<Self, FileError> {
        file::read_for_motion(path)
    }

    /// Reads and checks a robot file whose loop is about to be computed again from recordings: gains must be stable.
    pub fn read_for_repeating(path: &Path) -> Result<Self, FileError> {
        file::read_for_repeating(path)
    }

    /// Parses a robot file's bytes; `path` only names them in errors.
    pub fn from_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, FileError> {
        file::from_bytes(path, bytes)
    }

    /// Writes the robot file.
    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        write::write(self, path)
    }

    /// The robot file's text, every key of it.
    pub fn to_toml(&self) -> String {
        write::to_toml(self)
    }

    /// The paper's PUMA 560, links 2 and 3, with the default loop's gains.
    pub fn paper() -> Self {
        let joint = |index, name: &str, gear_ratio, counts_per_rev, viscous, coulomb| Joint {
            name: name.into(),
            gear_ratio,
            counts_per_rev,
            torque_constant_nm_per_a: 0.25,
            current_limit_a: 12.0,
            law: Law::Proportional(PositionLoop { gain_a_per_count: DEFAULT_GAINS_A_PER_COUNT[index], lead: 0.0 }),
            viscous_friction_nm_s_per_rad: Some(viscous),
            coulomb_friction_nm: Some(coulomb),
            current_full_scale_a: DEFAULT_FULL_SCALE_A,
            limits: JointLimits::reference_robot(index),
        };
        Self {
            name: "PUMA 560, links 2 and 3".into(),
            kind: Kind::TwoLink,
            unit: Unit::Radian,
            gravity_m_s2: 9.81,
            record_period_s: 0.0007,
            loop_period_s: 0.0007,
            command_delay_s: 0.00003,
            counts_per_tick_limit: None,
            upper_arm_m: PUMA_UPPER_ARM_M,
            following_error_limit_counts: None,
            quantised: true,
            current_is_command: false,
            joints: vec![joint(0, "2", 107.8, 800.0, 0.817e-3, 0.124), joint(1, "3", -53.7, 1000.0, 1.38e-3, 0.146)],
            gripper: Some(Gripper::REFERENCE),
            computed_torque: ComputedTorqueSettings::at_record_period(),
            search: default_search(),
        }
    }

    /// The f to expect before an identification: the reference robot's, or, where that is outside the search ranges, their
    /// middle.
    pub fn expected_f(&self) -> [f64; PARAMETERS] {
        let inside = self.search.iter().zip(REFERENCE_F).all(|(&[low, high], f)| (low..=high).contains(&f));
        if inside { REFERENCE_F } else { self.search.map(|[low, high]| 0.5 * (low + high)) }
    }

    /// How many ticks of the loop fall into one record period.
    pub fn loop_ticks_per_record(&self) -> usize {
        (self.record_period_s / self.loop_period_s).round() as usize
    }

    /// Accepts the robot only if every value is one a robot can have.
    pub fn check(&self) -> Result<(), RobotError> {
        let check = |joint, field, value: f64, good: bool, limit, remedy| {
            if good && value.is_finite() {
                return Ok(());
            }
            Err(RobotError { joint, field, value: format!("{value}"), limit, remedy })
        };
        let all = |field, value: f64, good, limit, remedy| check(None, field, value, good, limit, remedy);
        all(
            "gravity_m_s2",
            self.gravity_m_s2,
            self.gravity_m_s2.abs() < 100.0,
            "below 100 m/s² in size",
            "give it in m/s²",
        )?;
        let periods = "0.00001 to 0.1 s";
        let in_range = |period: f64| (1e-5..=0.1).contains(&period);
        all("record_period_s", self.record_period_s, in_range(self.record_period_s), periods, "give it in seconds")?;
        all("loop_period_s", self.loop_period_s, in_range(self.loop_period_s), periods, "give it in seconds")?;
        let ratio = self.record_period_s / self.loop_period_s;
        all(
            "loop_period_s",
            self.loop_period_s,
            ratio.round() >= 1.0 && (ratio - ratio.round()).abs() < 1e-6 * ratio,
            "a whole fraction of record_period_s",
            "choose record_period_s / 1, 2, 3…; the board offers 0.0007, 0.00035, 0.0001 and 0.00005 s",
        )?;
        all(
            "command_delay_s",
            self.command_delay_s,
            (0.0..self.loop_period_s).contains(&self.command_delay_s),
            "from 0 to below one loop period",
            "give it in seconds",
        )?;
        if let Some(limit) = self.counts_per_tick_limit {
            all(
                "counts_per_tick_limit",
                limit,
                limit > 0.0,
                "a finite number above 0",
                "leave it out for what the speed limits allow",
            )?;
        }
        all(
            "upper_arm_m",
            self.upper_arm_m,
            (1e-3..=100.0).contains(&self.upper_arm_m),
            "0.001 to 100 m",
            "give the distance of the two joints in m",
        )?;
        if let Some(limit) = self.following_error_limit_counts {
            all(
                "following_error_limit_counts",
                limit,
                limit >= 1.0,
                "a finite number, 1 or above",
                "give it in counts at the motor, or leave it out for 1000",
            )?;
        }
        self.check_joint_names()?;
        for (index, joint) in self.joints.iter().enumerate() {
            joint.check(|field, value, good, limit, remedy| check(Some(index), field, value, good, limit, remedy))?;
        }
        if let Some(gripper) = &self.gripper {
            gripper.check()?;
        }
        computed_torque::check(&self.computed_torque)?;
        for [low, high] in self.search {
            let good = low.is_finite() && low < high;
            all("search", high, good, "a range [low, high] with low below high", "correct the range")?;
        }
        Ok(())
    }

    fn check_joint_names(&self) -> Result<(), RobotError> {
        let wanted = match self.kind {
            Kind::TwoLink => 2,
            Kind::SingleAxis => 1,
        };
        if self.joints.len() != wanted {
            return Err(RobotError {
                joint: None,
                field: "number of [[joint]] tables",
                value: self.joints.len().to_string(),
                limit: if wanted == 2 { "2" } else { "1" },
                remedy: "give one [[joint]] table a joint, or set kind = \"single-axis\" for one",
            });
        }
        for (index, joint) in self.joints.iter().enumerate() {
            let letters = !joint.name.is_empty()
                && joint.name.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '-' || letter == '_');
            let new = self.joints[..index].iter().all(|other| other.name != joint.name);
            if !(letters && new) {
                return Err(RobotError {
                    joint: Some(index),
                    field: "name",
                    value: format!("{:?}", joint.name),
                    limit: "a name of its own of letters, digits, - and _",
                    remedy: "it ends the joint's column names in a recording, as 2 in err2",
                });
            }
        }
        Ok(())
    }
}

impl Joint {
    fn check(
        &self,
        check: impl Fn(&'static str, f64, bool, &'static str, &'static str) -> Result<(), RobotError>,
    ) -> Result<(), RobotError> {
        let positive = "a finite number above 0";
        check(
            "gear_ratio",
            self.gear_ratio,
            self.gear_ratio != 0.0,
            "a finite number other than 0",
            "give motor turns per joint turn, negative where the motor turns the other way",
        )?;
        check(
            "counts_per_rev",
            self.counts_per_rev,
            self.counts_per_rev > 0.0,
            positive,
            "give quadrature counts per motor turn; a direction goes into the sign of gear_ratio",
        )?;
        check(
            "torque_constant_nm_per_a",
            self.torque_constant_nm_per_a,
            self.torque_constant_nm_per_a > 0.0,
            positive,
            "give motor torque per ampere",
        )?;
        check(
            "current_limit_a",
            self.current_limit_a,
            self.current_limit_a > 0.0,
            positive,
            "give the amplifier's peak",
        )?;
        match self.law {
            Law::Proportional(PositionLoop { gain_a_per_count, lead }) => {
                let remedy = "give ampere per count of tracking error";
                check("position_gain_a_per_count", gain_a_per_count, gain_a_per_count > 0.0, positive, remedy)?;
                check("lead", lead, (0.0..=20.0).contains(&lead), "from 0 to 20 ticks", "0 is a pure P loop")?;
            }
            Law::Cascade { position_gain_per_s, velocity_gain } => {
                let remedy = "give the cascade's gains";
                check("position_gain_per_s", position_gain_per_s, position_gain_per_s > 0.0, positive, remedy)?;
                check("velocity_gain", velocity_gain, velocity_gain > 0.0, positive, remedy)?;
            }
        }
        // Friction that holds the motor fast against its own greatest torque is a number in another unit.
        let greatest_torque_nm = self.torque_constant_nm_per_a * self.current_limit_a;
        let friction = [
            (
                "viscous_friction_nm_s_per_rad",
                self.viscous_friction_nm_s_per_rad,
                f64::INFINITY,
                "a finite number, 0 or above",
            ),
            (
                "coulomb_friction_nm",
                self.coulomb_friction_nm,
                greatest_torque_nm,
                "a finite number, 0 or above, and below the motor's greatest torque (torque_constant_nm_per_a × \
                 current_limit_a)",
            ),
        ];
        for (field, value, greatest, limit) in friction {
            if let Some(value) = value {
                let remedy = "give it at the motor, not at the joint, in the unit the key names, or leave the key out if \
                              it is not known";
                check(field, value, (0.0..greatest).contains(&value), limit, remedy)?;
            }
        }
        check(
            "current_full_scale_a",
            self.current_full_scale_a,
            self.current_full_scale_a > 0.0,
            positive,
            "give the current at full scale of the converters",
        )?;
        let limits = &self.limits;
        let remedy = "give the joint's range in the joint's own unit";
        check("position_low_rad", limits.position_low_rad, true, "a finite number", remedy)?;
        let above = limits.position_high_rad > limits.position_low_rad;
        check("position_high_rad", limits.position_high_rad, above, "above position_low_rad", remedy)?;
        check("speed_limit_rad_s", limits.speed_rad_s, limits.speed_rad_s > 0.0, positive, remedy)?;
        check(
            "acceleration_limit_rad_s2",
            limits.acceleration_rad_s2,
            limits.acceleration_rad_s2 > 0.0,
            positive,
            remedy,
        )
    }
}

/// The paper's search range of f1..f9.
pub fn default_search() -> [[f64; 2]; 9] {
    std::array::from_fn(|index| [SEARCH_LOW[index], SEARCH_HIGH[index]])
}

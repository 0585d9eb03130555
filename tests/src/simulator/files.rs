//! The files beside a recording: what is known of the robot beforehand, and the sealed truth.

use std::fs;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

use super::base_parameters::BaseParameters;
use super::dynamics::Arm;
use super::robot::Robot;

/// Names of the PUMA joints in files.
const JOINT_NAMES: [&str; 2] = ["2", "3"];

/// The robot file of design.md §8: everything known before identification, and nothing of `f1..f9`.
#[must_use]
pub fn robot_toml(robot: &Robot) -> String {
    let mut text = format!(
        "name = {:?}\n\
         gravity_m_s2 = {:?}\n\
         record_period_s = {:?}\n\
         loop_period_s = {:?}\n\
         command_delay_s = {:?}\n",
        robot.name, robot.gravity_m_s2, robot.record_period_s, robot.loop_period_s, robot.command_delay_s
    );
    for (name, drive) in JOINT_NAMES.iter().zip(&robot.drives) {
        text += &format!(
            "\n[[joint]]\n\
             name = \"{name}\"\n\
             gear_ratio = {:?}\n\
             counts_per_rev = {}\n\
             torque_constant_nm_per_a = {:?}\n\
             position_gain_a_per_count = {:?}\n\
             lead = {:?}\n\
             current_limit_a = {:?}\n\
             viscous_friction_nm_s_per_rad = {:e}\n\
             coulomb_friction_nm = {:?}\n",
            drive.gear_ratio,
            drive.counts_per_rev,
            drive.torque_constant_nm_per_a,
            drive.position_gain_a_per_count,
            drive.lead,
            drive.current_limit_a,
            drive.viscous_friction_nm_s_per_rad,
            drive.coulomb_friction_nm,
        );
    }
    text
}

/// Writes [`robot_toml`] to a file.
///
/// # Errors
/// If the file cannot be written.
pub fn write_robot_toml(robot: &Robot, path: impl AsRef<Path>) -> Result<()> {
    fs::write(path, robot_toml(robot))
}

/// What an identification should have found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// The arm.
    pub base: BaseParameters,
    /// Viscous friction at the motors in N m s/rad.
    pub viscous_friction_nm_s_per_rad: [f64; 2],
    /// Coulomb friction at the motors in N m.
    pub coulomb_friction_nm: [f64; 2],
}

impl Truth {
    /// The true parameters of `robot`.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        Self {
            base: robot.arm.base_parameters(),
            viscous_friction_nm_s_per_rad: robot.drives.map(|drive| drive.viscous_friction_nm_s_per_rad),
            coulomb_friction_nm: robot.drives.map(|drive| drive.coulomb_friction_nm),
        }
    }

    /// The reference robot with these true parameters in place of its own.
    #[must_use]
    pub fn robot(&self) -> Robot {
        let mut robot = Robot::reference();
        robot.arm = Arm::Base(self.base);
        for (joint, drive) in robot.drives.iter_mut().enumerate() {
            drive.viscous_friction_nm_s_per_rad = self.viscous_friction_nm_s_per_rad[joint];
            drive.coulomb_friction_nm = self.coulomb_friction_nm[joint];
        }
        robot
    }
}

/// Writes the truth about `robot` in the form of `data/sample/*/truth.txt`, with `remark` as the last line.
///
/// # Errors
/// If the file cannot be written.
pub fn write_truth(robot: &Robot, remark: &str, path: impl AsRef<Path>) -> Result<()> {
    let truth = Truth::of(robot);
    let joined = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let text = format!(
        "f = {}\nviscous = {}\ncoulomb = {}\n{remark}\n",
        joined(&truth.base.0),
        joined(&truth.viscous_friction_nm_s_per_rad),
        joined(&truth.coulomb_friction_nm)
    );
    fs::write(path, text)
}

/// Reads a file written by [`write_truth`].
///
/// # Errors
/// If the file cannot be read, or a line `f`, `viscous` or `coulomb` is missing or has the wrong number of values.
pub fn read_truth(path: impl AsRef<Path>) -> Result<Truth> {
    let text = fs::read_to_string(path)?;
    Ok(Truth {
        base: BaseParameters(truth_values(&text, "f")?),
        viscous_friction_nm_s_per_rad: truth_values(&text, "viscous")?,
        coulomb_friction_nm: truth_values(&text, "coulomb")?,
    })
}

fn truth_values<const COUNT: usize>(text: &str, name: &str) -> Result<[f64; COUNT]> {
    text.lines()
        .filter_map(|line| line.split_once('='))
        .find(|(key, _)| key.trim() == name)
        .and_then(|(_, values)| values.split(',').map(|value| value.trim().parse().ok()).collect::<Option<Vec<f64>>>())
        .and_then(|values| values.try_into().ok())
        .ok_or_else(|| Error::new(ErrorKind::InvalidData, format!("truth: no line `{name}` with {COUNT} numbers")))
}

//! The robot file's text, as the tool writes it.

use std::fmt::Write as _;
use std::path::Path;

use shared::control::{ComputedTorqueSettings, PositionLoop};

use super::{Gripper, JointLimits, Kind, Law, Robot, Unit, default_search};
use crate::atomic;
use crate::file_error::FileError;

pub(super) fn write(robot: &Robot, path: &Path) -> Result<(), FileError> {
    atomic::write(path, to_toml(robot).as_bytes())
}

/// The file's text: every key, so that nothing depends on a later version's defaults; of a single axis none that it has no
/// use for, as long as nobody gave it.
pub(super) fn to_toml(robot: &Robot) -> String {
    let mut text = String::new();
    let quoted = |text: &str| toml::Value::String(text.into()).to_string();
    let mut line = |key: &str, value: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{key} = {value}");
    };
    let number = |value: f64| format!("{value:?}");
    line("name", quoted(&robot.name));
    if robot.kind == Kind::SingleAxis {
        line("kind", "\"single-axis\"".into());
    }
    if robot.unit == Unit::Metre {
        line("unit", "\"m\"".into());
    }
    line("gravity_m_s2", number(robot.gravity_m_s2));
    line("record_period_s", number(robot.record_period_s));
    line("loop_period_s", number(robot.loop_period_s));
    line("command_delay_s", number(robot.command_delay_s));
    if let Some(limit) = robot.counts_per_tick_limit {
        line("counts_per_tick_limit", number(limit));
    }
    if robot.kind == Kind::TwoLink {
        line("upper_arm_m", number(robot.upper_arm_m));
    }
    if let Some(limit) = robot.following_error_limit_counts {
        line("following_error_limit_counts", number(limit));
    }
    line("quantised", robot.quantised.to_string());
    line("current_is_command", robot.current_is_command.to_string());
    let uses_all = robot.kind == Kind::TwoLink;
    for (index, joint) in robot.joints.iter().enumerate() {
        line("\n[[joint]]\nname", quoted(&joint.name));
        line("gear_ratio", number(joint.gear_ratio));
        line("counts_per_rev", number(joint.counts_per_rev));
        line("torque_constant_nm_per_a", number(joint.torque_constant_nm_per_a));
        match joint.law {
            Law::Proportional(PositionLoop { gain_a_per_count, lead }) => {
                line("position_gain_a_per_count", number(gain_a_per_count));
                line("lead", number(lead));
            }
            Law::Cascade { position_gain_per_s, velocity_gain } => {
                line("law", "\"cascade\"".into());
                line("position_gain_per_s", number(position_gain_per_s));
                line("velocity_gain", number(velocity_gain));
            }
        }
        line("current_limit_a", number(joint.current_limit_a));
        if let Some(value) = joint.viscous_friction_nm_s_per_rad {
            line("viscous_friction_nm_s_per_rad", number(value));
        }
        if let Some(value) = joint.coulomb_friction_nm {
            line("coulomb_friction_nm", number(value));
        }
        line("current_full_scale_a", number(joint.current_full_scale_a));
        if uses_all || joint.limits != JointLimits::not_given(index, robot.unit) {
            line("position_low_rad", number(joint.limits.position_low_rad));
            line("position_high_rad", number(joint.limits.position_high_rad));
            line("speed_limit_rad_s", number(joint.limits.speed_rad_s));
            line("acceleration_limit_rad_s2", number(joint.limits.acceleration_rad_s2));
        }
    }
    if let Some(Gripper { maximum_load_kg, grasp_m: [x, y] }) = robot.gripper {
        line("\n[gripper]\nmaximum_load_kg", number(maximum_load_kg));
        line("grasp_m", format!("[{x:?}, {y:?}]"));
    }
    let torque = &robot.computed_torque;
    if uses_all || *torque != ComputedTorqueSettings::at_record_period() {
        line("\n[computed_torque]\nbandwidth_rad_s", number(torque.bandwidth_rad_s));
        line("damping_ratio", number(torque.damping_ratio));
        line("observer_bandwidth_rad_s", number(torque.observer_bandwidth_rad_s));
        line("friction_switch_motor_rad_s", number(torque.friction_switch_motor_rad_s));
    }
    let mut heading = "\n[search]\n";
    for (index, (range, usual)) in robot.search.iter().zip(default_search()).enumerate() {
        if uses_all || *range != usual {
            let [low, high] = range;
            line(&format!("{heading}f{}", index + 1), format!("[{low:?}, {high:?}]"));
            heading = "";
        }
    }
    text
}

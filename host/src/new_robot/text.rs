//! The robot file with a remark behind each value.

use crate::robot::{Robot, Unit};

/// What a key means, for whoever reads the file.
const REMARKS: &[(&str, &str)] = &[
    ("gravity_m_s2", "0 for an arm that does not feel it"),
    ("record_period_s", "between two recorded samples"),
    ("loop_period_s", "between two ticks of the position loop"),
    ("command_delay_s", "from reading the encoders to the new current"),
    ("upper_arm_m", "from joint to joint"),
    ("following_error_limit_counts", "tracking error at which the board stops the arm"),
    ("quantised", "references and errors are whole counts"),
    ("current_is_command", "cur is measured, not the controller's output"),
    ("gear_ratio", "motor turns per joint turn"),
    ("counts_per_rev", "per motor turn, quadrature included"),
    ("torque_constant_nm_per_a", "at the motor"),
    ("lead", "ticks that the error is looked at ahead"),
    ("current_limit_a", "the amplifier's peak"),
    ("viscous_friction_nm_s_per_rad", "at the motor; rather too small than too large"),
    ("coulomb_friction_nm", "at the motor"),
    ("current_full_scale_a", "of the board's converters"),
    ("bandwidth_rad_s", "of computed torque; armid info --margins shows others"),
    ("friction_switch_motor_rad_s", "motor speed over which friction is switched on"),
];

/// Remarks that differ where a count is per metre.
const SLIDING: &[(&str, &str)] = &[
    ("counts_per_rev", "2π times the counts per metre"),
    ("torque_constant_nm_per_a", "N per unit of the drive's command"),
    ("current_limit_a", "greatest command of the drive, in its unit"),
    ("current_full_scale_a", "in the unit of the command"),
];

/// The text of `robot`'s file with remarks.
pub(super) fn with_remarks(robot: &Robot) -> String {
    let slides = robot.unit == Unit::Metre;
    let remark = |key: &str| {
        let of_sliding = SLIDING.iter().filter(|_| slides);
        of_sliding.chain(REMARKS).find(|(known, _)| *known == key).map(|(_, remark)| *remark)
    };
    let mut text = format!("# Made by {} new-robot.\n", crate::TOOL_VERSION);
    for line in robot.to_toml().lines() {
        if line == "[search]" {
            text.push_str("# From guesses of masses, centres and inertias; the arm to expect is in the middle.\n");
        }
        text.push_str(line);
        let key = line.split(" = ").next().unwrap_or_default();
        if let Some(remark) = remark(key).filter(|_| line.contains(" = ")) {
            text.push_str(&format!("{}  # {remark}", " ".repeat(40_usize.saturating_sub(line.chars().count()))));
        }
        text.push('\n');
    }
    text
}

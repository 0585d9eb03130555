//! What the bandwidths of computed torque may be, whatever the arm. Whether they are stable on one: [`crate::margins`].

use shared::control::ComputedTorqueSettings;

use super::RobotError;

/// Accepts only what a controller can be made of.
pub(super) fn check(settings: &ComputedTorqueSettings<f64>) -> Result<(), RobotError> {
    let ComputedTorqueSettings {
        bandwidth_rad_s,
        damping_ratio,
        observer_bandwidth_rad_s,
        friction_switch_motor_rad_s,
    } = *settings;
    let rate = ("a finite number above 0", "give it in rad/s, or leave it out for the default");
    let fields = [
        ("bandwidth_rad_s", bandwidth_rad_s, f64::INFINITY, rate),
        ("damping_ratio", damping_ratio, f64::INFINITY, ("a finite number above 0", "1 does not overshoot")),
        ("observer_bandwidth_rad_s", observer_bandwidth_rad_s, f64::INFINITY, rate),
        (
            "friction_switch_motor_rad_s",
            friction_switch_motor_rad_s,
            1.0,
            ("above 0 and at most 1", "wider, friction is not met where the motion turns"),
        ),
    ];
    for (field, value, greatest, (limit, remedy)) in fields {
        if !(value.is_finite() && value > 0.0 && value <= greatest) {
            return Err(RobotError { joint: None, field, value: format!("{value}"), limit, remedy });
        }
    }
    Ok(())
}

//! `armid info --margins`.

use armid::margins::{ArmLoop, JointMargins, LEAST_GAIN_MARGIN, LEAST_PHASE_MARGIN_DEG, Margins};
use armid::robot::Robot;
use rayon::prelude::*;
use serde_json::{Value, json};
use shared::control::ComputedTorqueSettings;

use super::super::CommandError;
use super::super::common::{print, print_json, read_model};
use super::Info;

/// The bandwidths that are shown beside the robot file's, rad/s.
const BANDWIDTHS_RAD_S: [f64; 5] = [100.0, 150.0, 200.0, 250.0, 300.0];
const OBSERVERS_RAD_S: [f64; 4] = [400.0, 600.0, 800.0, 1200.0];

/// Greater numbers say nothing more.
const LARGEST_SHOWN: f64 = 999.0;

impl Info {
    pub(super) fn show_margins(&self) -> Result<(), CommandError> {
        let robot = self.robot.read()?;
        // The robot must be one that a board can drive, or there is no computed torque.
        let _ = armid::board_setup::configuration(&robot)?;
        let (arm, whose) = match &self.model {
            Some(path) => (ArmLoop::of_model(&robot, &read_model(path, &robot)?)?, path.display().to_string()),
            None => {
                let mut client = self.board.connect(&robot)?;
                let model = client.active_model()?.ok_or_else(|| {
                    CommandError::Failed("the board has no active model; pass --model FILE, or upload one".into())
                })?;
                (ArmLoop::of_board(&robot, &model), format!("the active model of the board at {}", client.address()))
            }
        };
        let settings = robot.computed_torque;
        let own = arm.margins(&settings);
        let others: Vec<(ComputedTorqueSettings<f64>, Margins)> = BANDWIDTHS_RAD_S
            .into_iter()
            .flat_map(|bandwidth_rad_s| {
                OBSERVERS_RAD_S.map(|observer_bandwidth_rad_s| ComputedTorqueSettings {
                    bandwidth_rad_s,
                    observer_bandwidth_rad_s,
                    ..settings
                })
            })
            .collect::<Vec<_>>()
            .into_par_iter()
            .map(|settings| (settings, arm.margins(&settings)))
            .collect();
        let verdict = arm.check(&robot);
        if self.json {
            let mut object = to_json(&settings, &own);
            object["accepted"] = json!(verdict.is_ok());
            object["reason"] = json!(verdict.err().map(|error| error.to_string()));
            object["least_gain_margin"] = json!(LEAST_GAIN_MARGIN);
            object["least_phase_margin_deg"] = json!(LEAST_PHASE_MARGIN_DEG);
            object["compliance_rad_per_nm"] = json!(arm.compliance_rad_per_nm);
            object["current_lag_s"] = json!(arm.current_lag_s);
            object["grid"] = others.iter().map(|(settings, margins)| to_json(settings, margins)).collect();
            return print_json(&object);
        }
        let verdict = match verdict {
            Ok(_) => "accepted".to_string(),
            Err(error) => format!("refused: {error}"),
        };
        print(format!("computed torque on {whose}\n{}\n{}\n{verdict}", table(&robot, &arm, &own), grid(&others)))
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn to_json(settings: &ComputedTorqueSettings<f64>, margins: &Margins) -> Value {
    let list =
        |value: fn(&JointMargins) -> f64| margins.joints.iter().map(|joint| finite(value(joint))).collect::<Vec<_>>();
    json!({
        "bandwidth_rad_s": settings.bandwidth_rad_s,
        "observer_bandwidth_rad_s": settings.observer_bandwidth_rad_s,
        "damping_ratio": settings.damping_ratio,
        "friction_switch_motor_rad_s": settings.friction_switch_motor_rad_s,
        "spectral_radius": margins.spectral_radius,
        "least_inertia_share": margins.least_inertia_share,
        // null where any gain or delay is stable.
        "gain_margin": list(|joint| joint.gain_margin),
        "gain_reduction": list(|joint| joint.gain_reduction),
        "phase_margin_deg": list(|joint| joint.phase_margin_deg),
        "delay_margin_s": list(|joint| joint.delay_margin_s),
        "crossover_rad_s": list(|joint| joint.crossover_rad_s),
    })
}

fn table(robot: &Robot, arm: &ArmLoop, own: &Margins) -> String {
    let settings = &robot.computed_torque;
    let mut lines = vec![
        format!(
            "ω {} rad/s, damping {}, observer {} rad/s, friction switches over {} rad/s at the motor; loop of {:.3} ms, \
             torque {:.0} µs after sampling",
            settings.bandwidth_rad_s,
            settings.damping_ratio,
            settings.observer_bandwidth_rad_s,
            settings.friction_switch_motor_rad_s,
            robot.loop_period_s * 1e3,
            robot.command_delay_s * 1e6,
        ),
        String::new(),
        format!(
            "{:>5}  {:>12}  {:>11}  {:>12}  {:>12}  {:>16}  {:>14}",
            "joint", "shaft", "gain margin", "phase margin", "delay margin", "crossover, rad/s", "amplifiers lag"
        ),
    ];
    for (index, margins) in own.joints.iter().enumerate() {
        let compliance = arm.compliance_rad_per_nm[index];
        let shaft = if compliance > 0.0 { format!("{:.0} N m/rad", 1.0 / compliance) } else { "rigid".into() };
        lines.push(format!(
            "{:>5}  {shaft:>12}  {:>11.2}  {:>11.1}°  {:>9.0} µs  {:>16.0}  {:>11.0} µs",
            robot.joints[index].name,
            margins.gain_margin.min(LARGEST_SHOWN),
            margins.phase_margin_deg,
            (margins.delay_margin_s * 1e6).min(99_999.0),
            margins.crossover_rad_s,
            arm.current_lag_s[index] * 1e6,
        ));
    }
    lines.extend([
        format!(
            "least of all poses; closed loop's largest pole {:.4}; stable down to {:.0} % of the model's inertia",
            own.spectral_radius,
            100.0 * own.least_inertia_share
        ),
        format!(
            "at least a gain margin of {LEAST_GAIN_MARGIN} and a phase margin of {LEAST_PHASE_MARGIN_DEG}° are needed"
        ),
    ]);
    lines.join("\n")
}

/// Worse joint's gain and phase margins over bandwidths.
fn grid(others: &[(ComputedTorqueSettings<f64>, Margins)]) -> String {
    let mut lines = vec![
        "\ngain and phase margin of the worse joint over ω (down) and observer bandwidth (across), rad/s".to_string(),
        format!("{:>6}{}", "", OBSERVERS_RAD_S.map(|observer| format!("{observer:>16}")).concat()),
    ];
    for row in others.chunks(OBSERVERS_RAD_S.len()) {
        let cell = |margins: &Margins| {
            if margins.spectral_radius >= 1.0 {
                return format!("{:>16}", "unstable");
            }
            let least =
                |value: fn(&JointMargins) -> f64| margins.joints.iter().map(value).fold(f64::INFINITY, f64::min);
            let gain = least(|joint| joint.gain_margin).min(LARGEST_SHOWN);
            let mark = if margins.check().is_ok() { ' ' } else { '!' };
            format!("{:>15}{mark}", format!("{gain:.2} / {:.0}°", least(|joint| joint.phase_margin_deg)))
        };
        let cells: String = row.iter().map(|(_, margins)| cell(margins)).collect();
        lines.push(format!("{:>6}{cells}", row[0].0.bandwidth_rad_s));
    }
    lines.push("!: refused".into());
    lines.join("\n")
}

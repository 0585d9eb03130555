//! `armid calibrate`.

use std::path::PathBuf;

use armid::calibrate::{JointCalibration, Source, calibrate};
use armid::report::FileRole;
use armid::robot::{Law, Robot};
use clap::Args;
use serde_json::json;
use shared::control::PositionLoop;

use super::CommandError;
use super::common::{RobotArguments, advise, check_distinct, print, print_json, read_recordings, with_sidecars};
use super::outputs::{FileKind, check_outputs};
use super::page::{self, ReportArguments};

const EXAMPLES: &str = "Examples:
  armid calibrate slow.csv fast.csv
  armid calibrate slow.csv --robot robot.toml --out calibrated.toml";

/// Arguments of `calibrate`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Calibrate {
    /// Recordings made under the position loop
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    robot: RobotArguments,
    /// Accept recordings with gaps
    #[arg(long)]
    allow_gaps: bool,
    /// Write a robot file with the gains found
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Calibrate {
    pub fn run(&self) -> Result<(), CommandError> {
        check_distinct(&self.recordings)?;
        let robot = self.robot.read()?;
        let recordings = read_recordings(&self.recordings, &robot, self.allow_gaps)?;
        for recording in &recordings {
            recording.check_periods(&robot)?;
        }
        let inputs = with_sidecars(&self.recordings);
        let inputs = || inputs.iter().chain(&self.robot.robot).map(PathBuf::as_path);
        check_outputs(self.out.as_deref().map(|out| (out, FileKind::Robot)), inputs())?;
        self.report.check(self.out.as_deref(), inputs())?;
        let found = calibrate(&robot, &recordings)?;
        for joint in found.iter().filter(|joint| !joint.agrees) {
            advise(disagreement(joint));
        }
        if let Some(path) = &self.out {
            calibrated(&robot, &found).write(path)?;
        }
        if self.json { print_json(&json!({"joints": found})) } else { print(table(&found)) }?;
        self.report.write(|| {
            let provenance = page::provenance()
                .robot(&robot)
                .files(FileRole::Read, self.robot.robot.as_deref())
                .files(FileRole::Written, self.out.as_deref());
            Ok(page::calibrate::page(&robot, &recordings, &found, provenance))
        })
    }
}

/// The robot with the gains found.
pub fn calibrated(robot: &Robot, found: &[JointCalibration]) -> Robot {
    let mut robot = robot.clone();
    for (joint, found) in robot.joints.iter_mut().zip(found) {
        joint.law = Law::Proportional(PositionLoop {
            gain_a_per_count: found.position_gain_a_per_count.value,
            lead: found.lead.map_or(0.0, |lead| lead.value),
        });
    }
    robot
}

fn disagreement(joint: &JointCalibration) -> String {
    let gain = joint.position_gain_a_per_count;
    let lead = joint.lead.map_or_else(|| "0".into(), |lead| format!("{:.3}", lead.value));
    format!(
        "joint {}: the robot file says {} A/count and lead {}, the recordings say {:.6} ± {:.6} A/count and lead {lead}: \
         correct the robot file (calibrate --out FILE writes one), or check which gains were in force",
        joint.joint, joint.file_gain_a_per_count, joint.file_lead, gain.value, gain.standard_error
    )
}

/// The calibration as a table.
pub fn table(found: &[JointCalibration]) -> String {
    let mut lines = vec![format!(
        "{:>5}  {:>24}  {:>18}  {:>12}  {:>12}  {}",
        "joint", "gain, A/count", "lead, ticks", "offset, mA", "residual, mA", "robot file"
    )];
    for joint in found {
        let gain = joint.position_gain_a_per_count;
        let lead =
            joint.lead.map_or_else(|| "0".into(), |lead| format!("{:.4} ± {:.4}", lead.value, lead.standard_error));
        lines.push(format!(
            "{:>5}  {:>24}  {lead:>18}  {:>12}  {:>12.1}  {}",
            joint.joint,
            format!("{:.6} ± {:.6}", gain.value, gain.standard_error),
            format!("{:.1} ± {:.1}", 1e3 * joint.offset_a.value, 1e3 * joint.offset_a.standard_error),
            1e3 * joint.residual_a_rms,
            if joint.agrees { "agrees".into() } else { format!("disagrees ({})", joint.file_gain_a_per_count) }
        ));
    }
    for joint in found {
        let source = match joint.source {
            Source::Command => "commanded current",
            Source::Measured => "measured current",
        };
        let measured = joint.measured_gain_a_per_count.map_or_else(String::new, |gain| {
            format!("; measured current gives {:.6} ± {:.6} A/count", gain.value, gain.standard_error)
        });
        lines.push(format!(
            "joint {}: {source}, {} samples, {} at the current limit left out{measured}",
            joint.joint, joint.samples, joint.saturated
        ));
    }
    lines.join("\n")
}

//! `armid track`.

use std::path::PathBuf;

use armid::capture::{TrackingQuality, tracking_quality};
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use clap::Args;
use serde_json::{Value, json};

use super::CommandError;
use super::common::{
    BoardArguments, Existing, RobotArguments, TrajectoryArguments, advise, check_recording_outputs, print, print_json,
    read_model,
};
use super::run::Run;

const WITHIN_ONE_COUNT: &str = "\"Within ±1 count\" (within_one_count in JSON) is the percentage of samples whose \
    recorded error is −1, 0 or 1. The recorded error is the reference less the actual count, both truncated toward zero: \
    an integer.";

/// Arguments of `track`.
#[derive(Debug, Args)]
#[command(after_help = WITHIN_ONE_COUNT)]
pub struct Track {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    #[command(flatten)]
    trajectory: TrajectoryArguments,
    /// Model to upload first; without it, the board's active model is used
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Folder to write the two recordings p.csv and ctc.csv into
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Replace recordings that are there already
    #[arg(long)]
    force: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Track {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read_for_motion()?;
        let model = self.model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
        let movement = self.trajectory.prepare(&robot)?;
        let path = |mode: Mode| self.out.clone().unwrap_or_default().join(format!("{mode}.csv"));
        if self.out.is_some() {
            let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
            let existing = if self.force { Existing::Replace } else { Existing::Keep };
            for mode in [Mode::P, Mode::Ctc] {
                check_recording_outputs(&path(mode), existing, inputs.into_iter().flatten())?;
            }
        }
        movement.advise_margins();
        let mut client = self.board.connect_ready(&robot)?;
        match &model {
            Some(model) => {
                let receipt = client.upload(&armid::board_setup::board_model(&robot, model)?)?;
                advise(format!("now active: model {:08x}", receipt.crc));
            }
            None if client.active_model()?.is_none() => {
                return Err(CommandError::Failed(
                    "the board has no model for computed torque; upload one, or pass --model FILE".into(),
                ));
            }
            None => {}
        }
        let mut recordings = Vec::new();
        for mode in [Mode::P, Mode::Ctc] {
            let run =
                Run { robot: &robot, movement: &movement, mode, seed: self.board.simulated_seed(), path: path(mode) };
            let ran = run.on(&mut client)?;
            if self.out.is_some() {
                ran.write(&robot)?;
            }
            recordings.push(ran.whole()?);
        }
        let [p, ctc] = recordings.as_slice() else { return Ok(()) };
        if self.json { print_json(&to_json(p, ctc)) } else { print(table(&robot, p, ctc)) }
    }
}

/// The comparison as JSON.
pub fn to_json(p: &Recording, ctc: &Recording) -> Value {
    let of = |recording: &Recording| {
        let quality = tracking_quality(recording);
        let list = |value: fn(&TrackingQuality) -> f64| quality.iter().map(value).collect::<Vec<f64>>();
        json!({
            "max_abs_error_counts": list(|joint| joint.max_abs_error_counts),
            "rms_error_counts": list(|joint| joint.rms_error_counts),
            "within_one_count": list(|joint| joint.within_one_count_percent),
            "samples": recording.samples(),
        })
    };
    json!({"p": of(p), "ctc": of(ctc), "within_one_count_unit": "percent of samples"})
}

/// The comparison as a table.
pub fn table(robot: &Robot, p: &Recording, ctc: &Recording) -> String {
    let mut lines = vec![format!(
        "{:>5}  {:>16}  {:>24}  {:>24}",
        "joint", "controller", "max / rms error, counts", "samples within ±1 count"
    )];
    let both = tracking_quality(p).into_iter().zip(tracking_quality(ctc));
    for (joint, (before, after)) in robot.joints.iter().zip(both) {
        for (controller, quality) in [("position loop", before), ("computed torque", after)] {
            lines.push(format!(
                "{:>5}  {controller:>16}  {:>24}  {:>22.2} %",
                joint.name,
                format!("{:.0} / {:.2}", quality.max_abs_error_counts, quality.rms_error_counts),
                quality.within_one_count_percent
            ));
        }
    }
    lines.push("errors as recorded: reference less actual count, both truncated toward zero".into());
    lines.join("\n")
}

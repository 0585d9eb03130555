//! `armid track`.

use std::path::PathBuf;

use armid::capture::{Effort, TrackingQuality, efforts, tracking_quality};
use armid::client::{Client, Unwatched};
use armid::compensation::without_effects;
use armid::margins::ArmLoop;
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::report::FileRole;
use armid::robot::Robot;
use clap::Args;
use serde_json::{Value, json};

use super::CommandError;
use super::common::{
    BoardArguments, Prepared, RobotArguments, TrajectoryArguments, advise, for_board, print, print_json, read_model,
    with_sidecars,
};
use super::outputs::{Existing, check_recording_outputs, check_unfinished};
use super::own_model;
use super::page::{self, ReportArguments};
use super::run::Run;

const NOTES: &str = "Without --model the board's active model is used; where it has none, two movements are recorded \
    under the position loop (T = 3.65 and 5 s, or where the robot's limits do not hold those the given one and one designed \
    within the limits), the arm is identified from them, and the model found is uploaded and used.

Refused (exit code 5) where computed torque would be too near to instability: see info --margins.

\"Within ±1 count\" (within_one_count in JSON) is the percentage of samples whose \
    recorded error is −1, 0 or 1. The recorded error is the reference less the actual count, both truncated toward zero: \
    an integer. torque_rms_nm is the motors' torque as commanded, time_in_limits_s how long the command was at the \
    amplifier's limit.

A --model with effects that computed torque compensates is run twice under it: without them (ctc_without_effects in JSON) \
    and with them (ctc); the board keeps the whole model.

Examples, the last on a simulated board whose arm has an effect:
  armid track --board sim --seed 7
  armid track --board sim --effect cogging:joint=3,amplitude_nm=0.03,order=3 --model extended.toml";

/// Arguments of `track`.
#[derive(Debug, Args)]
#[command(after_help = NOTES)]
pub struct Track {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    #[command(flatten)]
    trajectory: TrajectoryArguments,
    /// Model to upload first; without it, the board's active model is used, or one is identified on the spot
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Folder to write the recordings into: p.csv, ctc.csv and, with effects, ctc-without-effects.csv
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Replace recordings that are there already
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Track {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = self.robot.read_for_motion()?;
        let model = self.model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
        let movement = self.trajectory.prepare(&robot)?;
        let plain = model.as_ref().and_then(without_effects);
        let path = |name: &str| self.out.clone().unwrap_or_default().join(format!("{name}.csv"));
        let names = ["p", "ctc"].into_iter().chain(plain.as_ref().map(|_| "ctc-without-effects"));
        let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
        let recordings: Vec<PathBuf> = names.clone().map(path).collect();
        let outputs = with_sidecars(if self.out.is_some() { &recordings } else { &[] });
        self.report.check(outputs.iter().map(PathBuf::as_path), inputs.into_iter().flatten())?;
        if self.out.is_some() {
            let existing = Existing::with_force(self.force);
            for name in names {
                check_recording_outputs(&path(name), existing, inputs.into_iter().flatten())?;
                check_unfinished(&path(name))?;
            }
        }
        if let Some(model) = &model {
            // Before anything moves.
            ArmLoop::of_model(&robot, model)?.check(&robot)?;
        }
        movement.advise_margins();
        let mut client = self.board.connect_ready(&robot)?;
        let run = |client: &mut Client, mode: Mode, name: &str| {
            let seed = self.board.simulated_seed();
            let run = Run { robot: &robot, movement: &movement, mode, seed, path: path(name) };
            if self.out.is_none() {
                return run.on(client)?.whole();
            }
            let mut ran = run.recorded(client, &mut Unwatched)?;
            ran.write(&robot)?;
            ran.whole()
        };
        match &plain {
            Some(plain) => upload(&mut client, &robot, plain)?,
            None => self.ready_model(&mut client, &robot, model.as_ref(), &movement)?,
        }
        let p = run(&mut client, Mode::P, "p")?;
        let mut compared = vec![Compared { label: POSITION_LOOP, field: "p", recording: p }];
        if plain.is_some() {
            let recording = run(&mut client, Mode::Ctc, "ctc-without-effects")?;
            compared.push(Compared { label: WITHOUT_EFFECTS, field: "ctc_without_effects", recording });
            self.ready_model(&mut client, &robot, model.as_ref(), &movement)?;
        }
        let recording = run(&mut client, Mode::Ctc, "ctc")?;
        let label = if plain.is_some() { WITH_EFFECTS } else { COMPUTED_TORQUE };
        compared.push(Compared { label, field: "ctc", recording });
        if self.json { print_json(&to_json(&robot, &compared)) } else { print(table(&robot, &compared)) }?;
        self.report.write(|| {
            let model = match model {
                Some(model) => Some(model),
                None => client.active_model()?.as_ref().map(own_model::of_board),
            };
            let provenance = page::provenance().robot(&robot).files(FileRole::Read, inputs.into_iter().flatten());
            Ok(page::track::page(&robot, &compared, model.as_ref(), self.out.is_some(), provenance))
        })
    }

    /// Makes `model` the active one; without one, makes sure that the board has one.
    fn ready_model(
        &self,
        client: &mut Client,
        robot: &Robot,
        model: Option<&Model>,
        movement: &Prepared,
    ) -> Result<(), CommandError> {
        if let Some(model) = model {
            return upload(client, robot, model);
        }
        let Some(active) = client.active_model()? else {
            let seed = self.board.simulated_seed().unwrap_or(self.board.seed);
            let model = own_model::identified(client, robot, movement, seed)?;
            return upload(client, robot, &model);
        };
        ArmLoop::of_board(robot, &active).check(robot)?;
        if self.board.pose.is_some() && active.compensation.iter().any(|joint| joint.has_phases()) {
            advise(
                "the board's model has ripple or cogging, which it does not compensate after a pose was declared anew; pass \
                 --model FILE to vouch for their phases",
            );
        }
        Ok(())
    }
}

fn upload(client: &mut Client, robot: &Robot, model: &Model) -> Result<(), CommandError> {
    let receipt = client.upload(&for_board(robot, model)?)?;
    advise(format!("now active: model {:08x}", receipt.crc));
    Ok(())
}

pub const POSITION_LOOP: &str = "position loop";
pub const COMPUTED_TORQUE: &str = "computed torque";
const WITHOUT_EFFECTS: &str = "computed torque, effects left out";
const WITH_EFFECTS: &str = "computed torque, with effects";

/// One of the movements compared.
pub struct Compared {
    /// What controlled it, in words.
    pub label: &'static str,
    /// Its name in JSON.
    pub field: &'static str,
    pub recording: Recording,
}

/// A movement under the position loop and one under computed torque, to be compared.
pub fn pair(p: Recording, ctc: Recording) -> [Compared; 2] {
    [
        Compared { label: POSITION_LOOP, field: "p", recording: p },
        Compared { label: COMPUTED_TORQUE, field: "ctc", recording: ctc },
    ]
}

/// The comparison as JSON.
pub fn to_json(robot: &Robot, compared: &[Compared]) -> Value {
    let of = |recording: &Recording| {
        let quality = tracking_quality(recording);
        let list = |value: fn(&TrackingQuality) -> f64| quality.iter().map(value).collect::<Vec<f64>>();
        let efforts = efforts(recording, robot);
        let taken = |value: fn(&Effort) -> f64| efforts.iter().map(value).collect::<Vec<f64>>();
        json!({
            "max_abs_error_counts": list(|joint| joint.max_abs_error_counts),
            "rms_error_counts": list(|joint| joint.rms_error_counts),
            "within_one_count": list(|joint| joint.within_one_count_percent),
            "torque_rms_nm": taken(|joint| joint.torque_rms_nm),
            "time_in_limits_s": taken(|joint| joint.time_in_limits_s),
            "samples": recording.samples(),
        })
    };
    let mut object = json!({"within_one_count_unit": "percent of samples"});
    for one in compared {
        object[one.field] = of(&one.recording);
    }
    object
}

/// The comparison as a table.
pub fn table(robot: &Robot, compared: &[Compared]) -> String {
    let width = compared.iter().map(|one| one.label.len()).fold(16, usize::max);
    let mut lines = vec![format!(
        "{:>5}  {:>width$}  {:>24}  {:>24}  {:>17}  {:>12}",
        "joint", "controller", "max / rms error, counts", "samples within ±1 count", "torque rms, N m", "in limits, s"
    )];
    for (index, joint) in robot.joints.iter().enumerate().take(2) {
        for one in compared {
            let quality = &tracking_quality(&one.recording)[index];
            let effort = efforts(&one.recording, robot).get(index).copied();
            let taken = |value: fn(&Effort) -> f64, digits: usize| {
                effort.as_ref().map_or_else(|| "–".into(), |effort| format!("{:.digits$}", value(effort)))
            };
            lines.push(format!(
                "{:>5}  {:>width$}  {:>24}  {:>22.2} %  {:>17}  {:>12}",
                joint.name,
                one.label,
                format!("{:.0} / {:.2}", quality.max_abs_error_counts, quality.rms_error_counts),
                quality.within_one_count_percent,
                taken(|effort| effort.torque_rms_nm, 4),
                taken(|effort| effort.time_in_limits_s, 3),
            ));
        }
    }
    lines.push(
        "errors as recorded: reference less actual count, both truncated toward zero; torque at the motor, as commanded"
            .into(),
    );
    lines.join("\n")
}

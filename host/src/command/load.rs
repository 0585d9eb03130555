//! `armid load`.

mod outcome;
mod words;

use std::path::PathBuf;

use armid::board_setup;
use armid::client::{Client, MovementWatcher};
use armid::load::{self, HostIdentifier, Listener, Told};
use armid::model::Model;
use armid::number_text::significant;
use armid::recording::{Mode, Recording};
use armid::report::{self, FileRole};
use armid::robot::{Gripper, Robot};
use clap::{Args, ValueEnum};
use shared::load::{LONGEST_COLLECTION_ROWS, LoadSettings, SHORTEST_COLLECTION_ROWS};

use super::common::{
    BoardArguments, Prepared, RobotArguments, TrajectoryArguments, advise, for_board, print, print_json, read_model,
    with_sidecars,
};
use super::outputs::{Existing, check_recording_outputs, check_unfinished};
use super::page::{self, ReportArguments};
use super::run::Run;
use super::{CommandError, own_model};

use outcome::Outcome;
pub use words::sentence;
use words::{active, why_not};

const NOTES: &str = "The arm moves under computed torque, which assumes half the largest load, and the load is found \
    from 0.2 s of rows: its mass where the grasp is known (--grasp), its centre and inertia too where at least 1 s with \
    reversals is collected and they are not known (--collect 1 --centre-error 0.1). The standard error includes that of \
    the model's parameters. Changes of the load are noticed from then on, and identified anew. Every tick of the loop has to \
    be recorded: loop_period_s of the robot file equal to its record_period_s.

Without --model, the board's active model is used; without one, and on a simulated board always, two movements of the \
    empty arm are recorded and identified first. On a real board the gripper must be empty for that; take up the load and \
    run the command again.

Examples:
  armid load --board sim --load-kg 1.72
  armid load --board sim --load-kg 1.2 --collect 1 --centre-error 0.1 --where host --json
  armid load --board sim --load-kg 1.72 --differential";

/// Arguments of `load`.
#[derive(Debug, Args)]
#[command(after_help = NOTES)]
pub struct LoadCommand {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    #[command(flatten)]
    trajectory: TrajectoryArguments,
    #[command(flatten)]
    load: LoadArguments,
    /// Model of the empty arm to upload first
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Where the search runs: on the board, or on this computer from the stream
    #[arg(long = "where", value_enum, default_value_t = Place::Board)]
    place: Place,
    /// File to write the recording into
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace a recording that is there already
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What is known of the load.
#[derive(Clone, Debug, Args)]
pub struct LoadArguments {
    /// Largest mass the arm may carry, kg, if not maximum_load_kg of the robot file's [gripper]
    #[arg(long, value_name = "KG")]
    maximum_kg: Option<f64>,
    /// Centre of mass of a load in the gripper, X,Y in frame 3, m, if not grasp_m of the robot file's [gripper]
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    grasp: Option<Point>,
    /// Standard error of that centre, m; 0 where it is known
    #[arg(long, value_name = "METRES", default_value_t = 0.0)]
    centre_error: f64,
    /// Standard error of the load's own inertia, kg m²; 0 where it is known to be small
    #[arg(long, value_name = "KGM2", default_value_t = 0.0)]
    inertia_error: f64,
    /// How long to collect rows, s: 143 to 1500 rows, which are 0.1 to 1.05 s at 0.7 ms each
    #[arg(long, value_name = "SECONDS", default_value_t = 0.2)]
    collect: f64,
    /// The gripper is empty when the movement begins: rows of the empty arm first show what is wrong with the model, and the
    /// load taken up in motion is found by its difference. A simulated arm takes it up 1.3 s after the rows
    #[arg(long)]
    differential: bool,
}

/// When a simulated arm takes up its load where that is found by its difference from the empty arm, s after the rows of that
/// are collected.
const TAKEN_UP_AFTER_S: f64 = 1.3;

/// Two lengths in m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point([f64; 2]);

impl std::str::FromStr for Point {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = || format!("\"{text}\" is not two lengths in m, such as -0.02,-0.53");
        let (x, y) = text.split_once(',').ok_or_else(refuse)?;
        let length = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(refuse);
        Ok(Self([length(x)?, length(y)?]))
    }
}

impl LoadArguments {
    /// The gripper of the options, or else of the robot file.
    fn gripper(&self, robot: &Robot) -> Result<Gripper, CommandError> {
        let maximum = self.maximum_kg.or(robot.gripper.map(|gripper| gripper.maximum_load_kg));
        let grasp = self.grasp.map(|grasp| grasp.0).or(robot.gripper.map(|gripper| gripper.grasp_m));
        let (missing, options) = match (maximum, grasp) {
            (Some(maximum_load_kg), Some(grasp_m)) => return Ok(Gripper { maximum_load_kg, grasp_m }),
            (Some(_), None) => ("where the arm holds a load", "--grasp"),
            (None, Some(_)) => ("what the arm may carry", "--maximum-kg"),
            (None, None) => ("what the arm may carry and where", "--maximum-kg and --grasp"),
        };
        Err(CommandError::Usage(format!(
            "the robot file of \"{}\" does not say {missing}: give {options}, or {}",
            robot.name,
            Gripper::lines_to_add(robot)
        )))
    }

    /// The settings for the board, checked.
    fn settings(&self, robot: &Robot, model: &Model, place: Place) -> Result<LoadSettings, CommandError> {
        let period_s = robot.record_period_s;
        let rows = (self.collect / period_s).round();
        let [least, most] = [f64::from(SHORTEST_COLLECTION_ROWS), LONGEST_COLLECTION_ROWS as f64];
        if !(least..=most).contains(&rows) {
            let [low_s, high_s] = [least, most].map(|rows| significant(rows * period_s, 3));
            return Err(CommandError::Usage(format!(
                "--collect {} s is {rows} rows of {period_s} s, but must be {least} to {most} rows: {low_s} to {high_s} s",
                self.collect
            )));
        }
        let settings = LoadSettings {
            by_host: place == Place::Host,
            differential: self.differential,
            collect_rows: rows as u16,
            centre_standard_error_m: self.centre_error as f32,
            inertia_standard_error_kg_m2: self.inertia_error as f32,
            ..load::settings(robot, model, &self.gripper(robot)?)
        };
        settings.check().map_err(|error| CommandError::Usage(error.to_string()))?;
        Ok(settings)
    }
}

/// Refuses a robot whose loop ticks between the recorded rows: before it moves, and so before the board would.
fn check_every_tick_is_recorded(robot: &Robot) -> Result<(), CommandError> {
    if robot.loop_ticks_per_record() == 1 {
        return Ok(());
    }
    let (loop_s, record_s) = (robot.loop_period_s, robot.record_period_s);
    Err(CommandError::Usage(format!(
        "a load is identified only where every tick of the loop is recorded, because the commands of the others are not \
         known; the robot file has loop_period_s = {loop_s} and record_period_s = {record_s}: set record_period_s = {loop_s} \
         with a movement short enough to be recorded, or loop_period_s = {record_s} with gains for it (armid info --margins)"
    )))
}

/// Where the search runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Place {
    /// On the board.
    Board,
    /// On this computer.
    Host,
}

impl LoadCommand {
    pub fn run(&self) -> Result<(), CommandError> {
        let mut robot = self.robot.read_for_motion()?;
        // A single axis has no gripper to be told about.
        board_setup::configuration(&robot)?;
        check_every_tick_is_recorded(&robot)?;
        let gripper = self.load.gripper(&robot)?;
        // A simulated arm whose file does not say where it holds its load holds it where the options say.
        robot.gripper.get_or_insert(gripper);
        let movement = self.trajectory.prepare(&robot)?;
        let inputs = [self.robot.robot.as_deref(), self.model.as_deref(), self.trajectory.file()];
        let outputs = with_sidecars(self.out.as_slice());
        self.report.check(outputs.iter().map(PathBuf::as_path), inputs.into_iter().flatten())?;
        if let Some(path) = &self.out {
            check_recording_outputs(path, Existing::with_force(self.force), inputs.into_iter().flatten())?;
            check_unfinished(path)?;
        }
        let model = match &self.model {
            Some(path) => read_model(path, &robot)?,
            None if self.board.is_simulated() => {
                let mut empty = self.board.empty_handed().connect_ready(&robot)?;
                own_model::identified(&mut empty, &robot, &movement, self.board.seed)?
            }
            None => self.model_of_board(&robot, &movement)?,
        };
        let settings = self.load.settings(&robot, &model, self.place)?;
        let board_model = for_board(&robot, &model)?;
        movement.advise_margins();
        let mut client = if self.load.differential {
            self.board.connect_ready_to_take_up(&robot, self.load.collect + TAKEN_UP_AFTER_S)?
        } else {
            self.board.connect_ready(&robot)?
        };
        client.upload(&board_model)?;
        client.identify_load(&settings)?;
        let seed = self.board.simulated_seed();
        let path = self.out.clone().unwrap_or_default();
        let run = Run { robot: &robot, movement: &movement, mode: Mode::Ctc, seed, path };
        let mut show = |told: &Told| advise(sentence(&robot, &told.news));
        let moved = |client: &mut Client, watcher: &mut dyn MovementWatcher| {
            if self.out.is_some() { run.recorded(client, watcher) } else { run.watched(client, watcher) }
        };
        let (mut ran, told, searched_s) = match self.place {
            Place::Board => {
                let mut listener = Listener::new(&robot, &mut show);
                let ran = moved(&mut client, &mut listener)?;
                (ran, listener.told, None)
            }
            Place::Host => {
                let mut identifier = HostIdentifier::new(&load::setup(&robot, &model, &settings), &mut show);
                let ran = moved(&mut client, &mut identifier)?;
                let searched_s = identifier.searched.last().map(|duration| duration.as_secs_f64());
                (ran, identifier.told, searched_s)
            }
        };
        if self.out.is_some() {
            ran.write(&robot)?;
        }
        let recording = ran.whole()?;
        let report = client.load_report()?;
        let board_s = report.found_tick.saturating_sub(report.searching_tick) as f64 * robot.loop_period_s;
        let result = report.found.map(|found| {
            let collect_s = f64::from(settings.collect_rows) * robot.record_period_s;
            Outcome::new(&found, self.place, [collect_s, searched_s.unwrap_or(board_s)], &settings, &told)
        });
        result.iter().flat_map(Outcome::doubts).for_each(advise);
        match &result {
            Some(result) if self.json => print_json(&result.to_json(&robot, &told, &recording)),
            Some(result) => print(result.text(&recording)),
            None => Ok(()),
        }?;
        // What was told and tracked until then is of more use where nothing was found.
        let verdict = match &result {
            Some(result) => active(result.found()),
            None => why_not(&robot, &settings, &told, self.trajectory.file().is_some()),
        };
        self.report.write(|| {
            let runs = [(&recording, "with the load")];
            let carried = page::load::Carried {
                robot: &robot,
                told: &page::load::from_first_row(&told),
                maximum_kg: f64::from(settings.maximum_kg),
                carried: None,
                runs: &runs,
                errors: report::tracking_pictures(&robot, &runs),
            };
            let kept = if self.out.is_some() {
                recording.clone()
            } else {
                Recording { path: PathBuf::new(), ..recording.clone() }
            };
            let provenance = page::provenance()
                .robot(&robot)
                .model(&robot, &model)
                .files(FileRole::Read, inputs.into_iter().flatten())
                .recordings(FileRole::Written, [&kept]);
            let rest = vec![
                report::currents(&robot, &[Recording { path: "with the load".into(), ..recording.clone() }]),
                report::parameters(&robot, "empty arm", &report::of_model(&robot, &model)),
                provenance.section(),
            ];
            Ok(carried.page(verdict.clone(), result.as_ref().map(Outcome::section), rest))
        })?;
        if result.is_some() { Ok(()) } else { Err(CommandError::Failed(verdict)) }
    }

    /// A real board's model cannot be told to be without a load, and has no standard errors; so its movements are recorded
    /// where it has none, and then the load has to be taken up.
    fn model_of_board(&self, robot: &Robot, movement: &Prepared) -> Result<Model, CommandError> {
        let mut client: Client = self.board.connect_ready(robot)?;
        if let Some(active) = client.active_model()? {
            advise(
                "no model was given: using the board's, every parameter known to 1 %; pass --model for its standard errors",
            );
            return Ok(own_model::of_board(&active));
        }
        let model = own_model::identified(&mut client, robot, movement, self.board.seed)?;
        client.upload(&for_board(robot, &model)?)?;
        Err(CommandError::Failed(
            "the board had no model; it has one of the arm as it is now, which should be empty: take up the load and run \
             the command again"
                .into(),
        ))
    }
}

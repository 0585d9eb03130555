//! `armid load`.

use std::path::PathBuf;

use armid::capture::tracking_quality;
use armid::client::{Client, MovementWatcher};
use armid::load::{self, HostIdentifier, Listener, Told};
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::report::{self, Cell, FileRole, Section, Table};
use armid::robot::{Gripper, Robot};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use shared::load::{LONGEST_COLLECTION_ROWS, LoadEstimate, LoadNews, LoadSettings, Rejected, Waiting};

use super::common::{
    BoardArguments, Prepared, RobotArguments, TrajectoryArguments, advise, for_board, print, print_json, read_model,
    with_sidecars,
};
use super::outputs::{Existing, check_recording_outputs, check_unfinished};
use super::page::{self, ReportArguments};
use super::run::Run;
use super::{CommandError, own_model};

const NOTES: &str = "The arm moves under computed torque, which assumes half the largest load, and the load is found \
    from 0.2 s of rows: its mass where the grasp is known (--grasp), its centre and inertia too where at least 1 s with \
    reversals is collected and they are not known (--collect 1 --centre-error 0.1). The standard error includes that of \
    the model's parameters. Changes of the load are noticed from then on, and identified anew.

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
    /// How long to collect rows, s: 0.1 to 1.05
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
        match (maximum, grasp) {
            (Some(maximum_load_kg), Some(grasp_m)) => Ok(Gripper { maximum_load_kg, grasp_m }),
            _ => Err(CommandError::Usage(format!(
                "the robot file of \"{}\" does not say what the arm may carry: add [gripper] with maximum_load_kg and grasp_m, \
                 or give --maximum-kg and --grasp",
                robot.name
            ))),
        }
    }

    /// The settings for the board, checked.
    fn settings(&self, robot: &Robot, model: &Model, place: Place) -> Result<LoadSettings, CommandError> {
        let rows = (self.collect / robot.record_period_s).round();
        if !(0.0..=LONGEST_COLLECTION_ROWS as f64).contains(&rows) {
            return Err(CommandError::Usage(format!(
                "--collect {} s is {rows} rows, but must be at most {LONGEST_COLLECTION_ROWS}",
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
        let robot = self.robot.read_for_motion()?;
        self.load.gripper(&robot)?;
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
        let result = report.found.map(|found| Outcome {
            found,
            place: self.place,
            collect_s: f64::from(settings.collect_rows) * robot.record_period_s,
            identify_s: searched_s.unwrap_or(board_s),
            settings,
        });
        match &result {
            Some(result) if self.json => print_json(&result.to_json(&robot, &told, &recording)),
            Some(result) => print(result.text(&recording)),
            None => Ok(()),
        }?;
        // What was told and tracked until then is of more use where nothing was found.
        let verdict = result.as_ref().map_or_else(|| why_not(&robot, &told), |result| active(&result.found));
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

/// What was found, to be told.
struct Outcome {
    found: LoadEstimate,
    place: Place,
    collect_s: f64,
    identify_s: f64,
    settings: LoadSettings,
}

impl Outcome {
    fn place_name(&self) -> &'static str {
        match self.place {
            Place::Board => "board",
            Place::Host => "host",
        }
    }

    /// What the rows tell of centre and inertia: their names, and whether the data halved the prior's standard error.
    fn told(&self) -> [(&'static str, bool); 3] {
        let [x, y] = self.found.centre_standard_error_m;
        let prior = self.settings.centre_standard_error_m;
        let inertia = self.found.inertia_standard_error_kg_m2 < 0.5 * self.settings.inertia_standard_error_kg_m2;
        [("centre x", x < 0.5 * prior), ("centre y", y < 0.5 * prior), ("inertia", inertia)]
    }

    fn to_json(&self, robot: &Robot, told: &[Told], recording: &Recording) -> Value {
        let found = &self.found;
        let from_data: Vec<&str> = self.told().iter().filter(|(_, told)| *told).map(|(name, _)| *name).collect();
        let list: Vec<Value> =
            told.iter().map(|told| json!({"at_s": told.at_s, "news": sentence(robot, &told.news)})).collect();
        json!({
            "mass_kg": found.mass_kg,
            "standard_error_kg": found.standard_error_kg,
            "where": self.place_name(),
            "collect_s": self.collect_s,
            "identify_s": self.identify_s,
            "active": true,
            "centre_m": found.centre_m,
            "centre_standard_error_m": found.centre_standard_error_m,
            "inertia_kg_m2": found.inertia_kg_m2,
            "inertia_standard_error_kg_m2": found.inertia_standard_error_kg_m2,
            "found_in_data": from_data,
            "noise_ratio": found.noise_ratio,
            "max_abs_error_counts":
                tracking_quality(recording).iter().map(|joint| joint.max_abs_error_counts).collect::<Vec<_>>(),
            "events": list,
        })
    }

    /// What was found, for the page.
    fn section(&self) -> Section {
        let found = &self.found;
        let [x, y] = [0, 1].map(|axis| (found.centre_m[axis], found.centre_standard_error_m[axis]));
        let inertia = (found.inertia_kg_m2, found.inertia_standard_error_kg_m2);
        let mut table = Table::new(["", "value", "± standard error", "unit", "told by the rows"]);
        let mass = (found.mass_kg, found.standard_error_kg);
        let told = self.told().into_iter().zip([x, y, inertia]).zip(["m", "m", "kg m²"]);
        let all = told.map(|(((name, told), estimate), unit)| (name, told, estimate, unit));
        for (name, told, (value, error), unit) in std::iter::once(("mass", true, mass, "kg")).chain(all) {
            table = table.row([
                Cell::from(name),
                Cell::significant(f64::from(value)),
                Cell::scientific(f64::from(error)),
                Cell::from(unit),
                Cell::from(if told { "yes" } else { "no more than what was given" }),
            ]);
        }
        Section::new("Load").table(table).text(format!(
            "Found on the {} from {:.2} s of rows; what the model leaves of the rows is {:.2} of the encoder's noise.",
            self.place_name(),
            self.collect_s,
            found.noise_ratio
        ))
    }

    fn text(&self, recording: &Recording) -> String {
        let found = &self.found;
        let mut lines = vec![
            active(found),
            format!(
                "found on the {} from {:.2} s of rows, in use {:.3} s after the last of them; what the model leaves of the \
                 rows is {:.2} of the encoder's noise",
                self.place_name(),
                self.collect_s,
                self.identify_s,
                found.noise_ratio
            ),
        ];
        for (name, (value, error, unit)) in self.told().into_iter().zip([
            (found.centre_m[0], found.centre_standard_error_m[0], "m"),
            (found.centre_m[1], found.centre_standard_error_m[1], "m"),
            (found.inertia_kg_m2, found.inertia_standard_error_kg_m2, "kg m²"),
        ]) {
            let (name, from_data) = name;
            lines.push(if from_data {
                format!("{name}: {} {unit}", with_error(value, error))
            } else {
                format!("{name}: {} {unit}; these rows tell no more than what was given", with_error(value, error))
            });
        }
        let largest: Vec<String> =
            tracking_quality(recording).iter().map(|joint| format!("{:.0}", joint.max_abs_error_counts)).collect();
        lines.push(format!("largest tracking error of the whole movement: {} counts", largest.join(" / ")));
        lines.join("\n")
    }
}

/// The load in use, in one line.
pub fn active(found: &LoadEstimate) -> String {
    format!("now active: {} kg", with_error(found.mass_kg, found.standard_error_kg))
}

/// A value and its standard error to the same digit: hundredths, or as fine as two digits of the error need.
fn with_error(value: f32, error: f32) -> String {
    let first = if error > 0.0 { -f64::from(error).log10().floor() } else { 2.0 };
    // Two digits say nothing of an error of grams.
    let digits = if error >= 0.01 { 2 } else { (first + 1.0).clamp(3.0, 9.0) as usize };
    format!("{value:.digits$} ± {error:.digits$}")
}

/// What is told of a load in the gripper of `robot`, in words.
pub fn sentence(robot: &Robot, news: &LoadNews) -> String {
    match news {
        LoadNews::Waiting(Waiting::Slow { joint }) => {
            let name = robot.joints.get(usize::from(*joint)).map_or("?", |joint| &joint.name);
            format!("waiting: joint {name} stands or is about to turn, and its friction hides the load")
        }
        LoadNews::Waiting(Waiting::RowsLost) => "waiting: rows were lost on the way to the identification".into(),
        LoadNews::Collecting => "collecting rows".into(),
        LoadNews::Searching => "searching for the load".into(),
        LoadNews::Learned { noise_ratio } => format!(
            "the empty arm has shown its model's errors (rows left {noise_ratio:.1} times the noise): take up the load"
        ),
        LoadNews::Found(found) => active(found),
        LoadNews::Rejected(why, found) => format!(
            "not used: {} kg, because {}; collecting again",
            with_error(found.mass_kg, found.standard_error_kg),
            match why {
                Rejected::TooHeavy => "the rows want more than the largest load (--maximum-kg)",
                Rejected::Negative => "the rows want less than no load: the model of the empty arm is wrong",
                Rejected::Uncertain => "it is known too poorly: the movement is too slow, or the model too uncertain",
                Rejected::OutOfReach => "its centre is out of reach",
                Rejected::Inconsistent => {
                    "the rows are not of one arm with one load: it changed among them, or the model is wrong"
                }
                Rejected::NotFinite => "it is not a number",
            }
        ),
        LoadNews::Changed { by_kg, assumed_kg } => {
            format!(
                "the load has changed, by {by_kg:+.2} kg or more: assuming {assumed_kg:.2} kg, and identifying anew"
            )
        }
    }
}

/// Why nothing is active at the end.
fn why_not(robot: &Robot, told: &[Told]) -> String {
    match told.last() {
        Some(last) => {
            let shorter = matches!(last.news, LoadNews::Waiting(_) | LoadNews::Collecting | LoadNews::Searching);
            let remedy = if shorter { "; a longer movement (--period) gives it time" } else { "" };
            format!("no load is active at the end of the movement; last: {}{remedy}", sentence(robot, &last.news))
        }
        None => "no load is active at the end of the movement, and the identification said nothing".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::with_error;

    #[test]
    fn a_load_of_a_small_robot_has_its_digits() {
        assert_eq!(with_error(1.7234, 0.031), "1.72 ± 0.03");
        assert_eq!(with_error(0.3, 0.000_042), "0.300000 ± 0.000042");
        assert_eq!(with_error(0.3, 0.0), "0.300 ± 0.000");
    }
}

//! `armid demo`: the whole chain on a simulated robot whose parameters the tool does not know.

mod explain;
mod load;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use armid::calibrate::{JointCalibration, calibrate};
use armid::capture::tracking_quality;
use armid::client::{Client, Pose};
use armid::file_error::FileError;
use armid::hidden_robot::HiddenRobot;
use armid::identify::Options;
use armid::link::SimulatedBoard;
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::report::{self, Picture};
use armid::robot::Robot;
use clap::{Args, Subcommand};
use serde_json::json;

use super::calibrate::{calibrated, table as calibration_table};
use super::common::{TrajectoryArguments, advise, print, print_json};
use super::own_model::TRAINING_PERIODS_S;
use super::page::{self, ReportArguments};
use super::run::Run;
use super::{CommandError, identify, track};

/// The file in the output folder that lists what demonstrations wrote there and may replace.
const OWN_FILES: &str = "demo-files.txt";

/// The picture among [`FILES`].
const PICTURE: &str = "demo.svg";

/// What the whole chain writes into the output folder.
const FILES: [&str; 8] =
    ["robot.toml", "train1.csv", "train2.csv", "model.toml", "truth.toml", "track-p.csv", "track-ctc.csv", PICTURE];

/// Period of the movement to track, in s: the paper's.
const TRACKING_PERIOD_S: f64 = 3.65;

const EXAMPLES: &str = "Examples:
  armid demo                    identify a hidden robot, then track with what was found
  armid demo explain --seed 3   find what the model lacks, name it, add it, track better
  armid demo load               pick up a load and drop it mid-motion; the board finds its mass";

/// Arguments of `demo`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, after_help = EXAMPLES)]
pub struct Demo {
    #[command(subcommand)]
    story: Option<Story>,
    #[command(flatten)]
    common: Common,
}

/// What every demonstration is told.
#[derive(Debug, Args)]
struct Common {
    /// Seed of the hidden robot, of what is hidden in it, of the noise and of everything that searches
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for robot file, recordings, models, truth and pictures; replaces there only what a demonstration wrote
    #[arg(long, value_name = "FOLDER", default_value = "armid-out")]
    out: PathBuf,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Common {
    /// Makes sure that the report page takes the place of none of `files` in the output folder, and that none of them takes
    /// the place of a file that no demonstration wrote; notes there that they are this one's.
    fn begin(&self, files: &[&str]) -> Result<(), CommandError> {
        let paths: Vec<PathBuf> = files.iter().map(|name| self.out.join(name)).collect();
        self.report.check(paths.iter().map(PathBuf::as_path), [])?;
        let own = self.out.join(OWN_FILES);
        armid::check_output(&own)?;
        let mut names: BTreeSet<String> =
            std::fs::read_to_string(&own).unwrap_or_default().lines().map(str::to_string).collect();
        let sidecars = files.iter().filter_map(|name| Some(format!("{}.toml", name.strip_suffix(".csv")?)));
        for name in files.iter().map(|name| name.to_string()).chain(sidecars) {
            let path = self.out.join(&name);
            // Each until it is written: two demonstrations in one folder would mix their files.
            armid::check_output(&path)?;
            if names.insert(name) && path.exists() {
                return Err(CommandError::Usage(format!(
                    "{} exists and was written by no demonstration; choose another --out, or move it away",
                    path.display()
                )));
            }
        }
        let text: String = names.into_iter().map(|name| name + "\n").collect();
        Ok(armid::write_file(&own, text.as_bytes())?)
    }

    /// Runs one of the paper's movements and keeps the recording in the output folder.
    fn movement(
        &self,
        client: &mut Client,
        robot: &Robot,
        period_s: f64,
        mode: Mode,
        file: &str,
    ) -> Result<Recording, CommandError> {
        let movement = TrajectoryArguments::paper(period_s).prepare(robot)?;
        let run = Run { robot, movement: &movement, mode, seed: Some(self.seed), path: self.out.join(file) };
        let mut ran = run.on(client)?;
        ran.write(robot)?;
        ran.whole()
    }
}

/// What else can be shown.
#[derive(Debug, Subcommand)]
enum Story {
    /// Show how an effect that the model lacks is found, named, added and compensated.
    Explain(explain::ExplainDemo),
    /// Show how a load that is picked up and dropped while the arm moves is noticed, identified and carried.
    Load(load::LoadDemo),
}

impl Demo {
    pub fn run(&self) -> Result<(), CommandError> {
        match &self.story {
            Some(Story::Explain(story)) => return story.run(),
            Some(Story::Load(story)) => return story.run(),
            None => {}
        }
        self.common.begin(&FILES)?;
        let robot = Robot::paper();
        let truth = HiddenRobot::draw(&robot, self.common.seed);
        let configuration = armid::board_setup::configuration(&robot)?;
        let mut client = Client::connect(Box::new(SimulatedBoard::new(&robot, truth.clone(), self.common.seed)))?;
        client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
        robot.write(&self.common.out.join("robot.toml"))?;

        advise("1/5 recording two movements under the position loop");
        let mut training = Vec::new();
        for (index, period_s) in TRAINING_PERIODS_S.into_iter().enumerate() {
            let name = format!("train{}.csv", index + 1);
            training.push(self.common.movement(&mut client, &robot, period_s, Mode::P, &name)?);
        }

        advise("2/5 calibrating the position loop");
        let calibration = calibrate(&robot, &training)?;
        let robot_as_calibrated = calibrated(&robot, &calibration);

        advise("3/5 identifying the arm");
        let options = Options { seed: self.common.seed, ..Options::default() };
        let found = identify::with_progress(&robot_as_calibrated, &training, &[], &options)?;
        let model = identify::to_model(&robot, &training, &found, &options);
        model.write(&self.common.out.join("model.toml"))?;
        truth.to_model(toml::Table::new()).write(&self.common.out.join("truth.toml"))?;

        advise("4/5 uploading the model");
        let receipt = client.upload(&armid::compensation::board_model(&robot, &model)?)?;
        advise(format!("    now active: model {:08x}, read back from the board", receipt.crc));

        advise("5/5 tracking the paper's movement under the position loop and under computed torque");
        let p = self.common.movement(&mut client, &robot, TRACKING_PERIOD_S, Mode::P, "track-p.csv")?;
        let ctc = self.common.movement(&mut client, &robot, TRACKING_PERIOD_S, Mode::Ctc, "track-ctc.csv")?;
        let picture = self.common.out.join(PICTURE);
        self.draw(&picture, &robot, &p, &ctc)?;

        let summary = summary(&p, &ctc);
        let compared = track::pair(p, ctc);
        self.tell(&robot, &truth, &model, &calibration, &compared, &summary)?;
        self.common.report.write(|| {
            let identified = page::identify::Identified {
                robot: &robot_as_calibrated,
                recordings: &training,
                held_out: &[],
                as_recorded: false,
                found: &found,
                remarks: Vec::new(),
            };
            let provenance = page::provenance().seed(self.common.seed).robot(&robot);
            let provenance = page::demo::written(provenance, &self.common.out, &FILES);
            page::demo::chain(&identified, &truth, &model, &compared, provenance)
        })
    }

    fn tell(
        &self,
        robot: &Robot,
        truth: &HiddenRobot,
        model: &Model,
        calibration: &[JointCalibration],
        compared: &[track::Compared],
        summary: &str,
    ) -> Result<(), CommandError> {
        let picture = self.common.out.join(PICTURE);
        if self.common.json {
            let mut object = track::to_json(robot, compared);
            object["seed"] = json!(self.common.seed);
            object["true_f"] = json!(truth.f);
            object["f"] = json!(model.f);
            object["standard_error"] = json!(model.f_standard_error);
            object["true_friction"] =
                json!({"viscous_nm_s_per_rad": truth.viscous_nm_s_per_rad, "coulomb_nm": truth.coulomb_nm});
            object["friction"] =
                json!({"viscous_nm_s_per_rad": model.viscous_nm_s_per_rad, "coulomb_nm": model.coulomb_nm});
            object["calibration"] = json!(calibration);
            object["picture"] = json!(picture);
            return print_json(&object);
        }
        print(format!(
            "\nCalibration\n{}\n\nIdentification of a hidden robot (seed {})\n{}\n\nTracking the paper's movement, T = {} \
             s\n{}\n\n{}\n\nFiles in {}: {}",
            calibration_table(calibration),
            self.common.seed,
            comparison(truth, model),
            TRACKING_PERIOD_S,
            track::table(robot, compared),
            summary,
            self.common.out.display(),
            FILES.join(", ")
        ))
    }

    fn draw(&self, path: &Path, robot: &Robot, p: &Recording, ctc: &Recording) -> Result<(), CommandError> {
        let runs = [(p, track::POSITION_LOOP), (ctc, "computed torque with the identified model")];
        draw_tracking(path, robot, &runs)
    }
}

/// Draws the tracking errors of one movement run twice, one panel a joint and controller, to `path`.
fn draw_tracking(path: &Path, robot: &Robot, runs: &[(&Recording, &str); 2]) -> Result<(), CommandError> {
    let pictures: Vec<Picture> = report::tracking_pictures(robot, runs).into_iter().map(Picture::unnamed).collect();
    draw(path, "Tracking error on the paper's movement (green: ±1 encoder count)", &pictures, 2, (500, 300))
}

/// Draws `pictures`, so many beside each other, each of `size` points, to `path`.
fn draw(path: &Path, title: &str, pictures: &[Picture], columns: usize, size: (u32, u32)) -> Result<(), CommandError> {
    let picture =
        report::sheet(title, pictures, columns, size).map_err(|error| CommandError::Failed(error.to_string()))?;
    armid::write_file(path, picture.as_bytes()).map_err(FileError::into)
}

/// True and found parameters side by side.
fn comparison(truth: &HiddenRobot, model: &Model) -> String {
    let mut lines =
        vec![format!("{:<18} {:>12} {:>12} {:>12} {:>15}", "parameter", "true", "found", "error", "standard error")];
    let mut row = |name: String, truth: f64, found: f64, standard_error: Option<f64>| {
        let standard_error = standard_error.map_or_else(|| "–".into(), |error| format!("{error:.6}"));
        lines.push(format!("{name:<18} {truth:>12.6} {found:>12.6} {:>12.6} {standard_error:>15}", found - truth));
    };
    for (index, (truth, found)) in truth.f.iter().zip(model.f).enumerate() {
        row(format!("f{}", index + 1), *truth, found, model.f_standard_error.map(|errors| errors[index]));
    }
    for joint in 0..2 {
        let error = |errors: &Option<Vec<f64>>| errors.as_ref().and_then(|errors| errors.get(joint)).copied();
        let (truth, found) = (truth.viscous_nm_s_per_rad[joint], model.viscous_nm_s_per_rad[joint]);
        row(format!("viscous, joint {}", joint + 2), truth, found, error(&model.viscous_standard_error));
    }
    for joint in 0..2 {
        let error = |errors: &Option<Vec<f64>>| errors.as_ref().and_then(|errors| errors.get(joint)).copied();
        let (truth, found) = (truth.coulomb_nm[joint], model.coulomb_nm[joint]);
        row(format!("Coulomb, joint {}", joint + 2), truth, found, error(&model.coulomb_standard_error));
    }
    lines
        .push("f1, f2, f3, f4, f7 in kg m², f5, f6, f8, f9 in kg m; friction at the motor in N m s/rad and N m".into());
    lines.join("\n")
}

/// Before and after in one sentence.
fn summary(p: &Recording, ctc: &Recording) -> String {
    let max = |recording: &Recording| {
        let max: Vec<String> =
            tracking_quality(recording).iter().map(|joint| format!("{:.0}", joint.max_abs_error_counts)).collect();
        max.join(" / ")
    };
    let within: Vec<String> =
        tracking_quality(ctc).iter().map(|joint| format!("{:.2}", joint.within_one_count_percent)).collect();
    format!(
        "Largest tracking error before (position loop): {} counts; after (computed torque): {} counts.\nSamples within \
         ±1 count after: {} %.",
        max(p),
        max(ctc),
        within.join(" / ")
    )
}

//! `armid report`.

use std::path::PathBuf;

use armid::capture::tracking_quality;
use armid::compensation;
use armid::identified_model;
use armid::identify::Experiment;
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::report::{self, FileRole, Page, Section};
use armid::rerun;
use armid::robot::Robot;
use clap::Args;
use serde_json::{Value, json};

use super::CommandError;
use super::common::{RobotArguments, advise, print, print_json, read_model, read_recordings, with_sidecars};
use super::page::{self, check_page, per_joint, write_page};

const NOTES: &str = "Makes one page of what is on disk; nothing is identified, nothing moves. With a model, its simulated \
    arm repeats every recording made under the position loop: tracking errors and currents measured and simulated, their \
    difference, and maps of the torque that the model lacks. A movement recorded under computed torque it makes once more on \
    a simulated board, whose controller has the same model, or --controller-model; what cannot be made again, such as a \
    movement cut short, is shown as it was measured, and why is said.

The page is one HTML file that fetches nothing and runs no script. identify, explain, track, load, compare, record, \
    excite, calibrate, demo and bench write pages of their own results with --report FILE.

Examples:
  armid report slow.csv fast.csv --out report.html
  armid report --model model.toml slow.csv fast.csv track/ctc.csv --out report.html";

/// Arguments of `report`.
#[derive(Debug, Args)]
#[command(after_help = NOTES)]
pub struct Report {
    /// Recordings to show
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    robot: RobotArguments,
    /// Model to show, and to repeat the recordings with
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Model that computed torque ran with in the recordings, where it is not --model
    #[arg(long, value_name = "FILE", requires = "model")]
    controller_model: Option<PathBuf>,
    /// Accept recordings with gaps
    #[arg(long)]
    allow_gaps: bool,
    /// Page to write
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// A movement under computed torque, measured and simulated.
type MadeAgain<'a> = (&'a Recording, Recording);

/// How a model repeats the recordings under the position loop, per joint in counts rms.
struct Repeated {
    closed_loop_rms_counts: Vec<f64>,
    innovation_rms_counts: Vec<f64>,
}

impl Report {
    pub fn run(&self) -> Result<(), CommandError> {
        let robot = if self.model.is_some() { self.robot.read_for_simulation()? } else { self.robot.read()? };
        let model = self.model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
        let recordings = read_recordings(&self.recordings, &robot, self.allow_gaps)?;
        let inputs = with_sidecars(&self.recordings);
        let inputs = || {
            inputs
                .iter()
                .chain(&self.robot.robot)
                .chain(&self.model)
                .chain(&self.controller_model)
                .map(PathBuf::as_path)
        };
        check_page(&self.out, [], inputs())?;
        let (tracked, slow): (Vec<&Recording>, Vec<&Recording>) =
            recordings.iter().partition(|recording| recording.mode() == Mode::Ctc);
        let (mut sections, mut repeated, mut made_again) = (Vec::new(), None, Vec::new());
        let mut as_measured: Vec<Recording> = recordings.clone();
        if let Some(model) = &model {
            sections.push(report::parameters(&robot, "model", &report::of_model(&robot, model)));
            let slow: Vec<Recording> = slow.into_iter().cloned().collect();
            for recording in &slow {
                recording.check_conditions(&robot)?;
            }
            if !slow.is_empty() {
                let values = identified_model::values(&robot, model);
                let experiment = Experiment::new(&robot, &slow)?;
                repeated = Some(Repeated {
                    closed_loop_rms_counts: experiment.closed_loop_rms_counts(&values),
                    innovation_rms_counts: experiment.innovation_rms_counts(&values),
                });
                sections.extend(page::identify::repeated(&robot, &slow, &values, true)?);
            }
            let controller = self.controller_model.as_deref().map(|path| read_model(path, &robot)).transpose()?;
            let controller = controller.as_ref().unwrap_or(model);
            let mut remarks = Vec::from_iter(left_out(model).filter(|_| repeated.is_some()));
            let mut other_controllers = Vec::new();
            as_measured.clear();
            for recording in tracked {
                match rerun::under_computed_torque(&robot, model, controller, recording) {
                    Ok(again) => {
                        other_controllers.extend(other_controller(&robot, controller, recording));
                        made_again.push((recording, again));
                    }
                    Err(error) => {
                        remarks.push(format!("{} is shown as measured: {error}.", recording.path.display()));
                        as_measured.push(recording.clone());
                    }
                }
            }
            if !made_again.is_empty() {
                other_controllers.iter().for_each(advise);
                let [errors, currents] = report::made_again(&robot, &made_again);
                sections.extend([errors.list(other_controllers), currents]);
            }
            if !remarks.is_empty() {
                remarks.iter().for_each(advise);
                sections.push(Section::new("Not simulated").list(remarks));
            }
        }
        if !as_measured.is_empty() {
            sections.extend(page::record::sections(&robot, &as_measured));
        }
        let mut provenance = page::provenance().robot(&robot).recordings(FileRole::Read, &recordings);
        if let Some(model) = &model {
            provenance = provenance.model(&robot, model);
        }
        sections.push(provenance.files(FileRole::Read, inputs()).section());
        let verdict = verdict(&recordings, repeated.as_ref(), &made_again);
        let page = Page { command: "report".into(), title: robot.name.clone(), verdict: verdict.clone(), sections };
        if self.json {
            print_json(&self.to_json(&recordings, repeated.as_ref(), &made_again))
        } else {
            print(verdict)
        }?;
        write_page(&self.out, &page)
    }

    fn to_json(&self, recordings: &[Recording], repeated: Option<&Repeated>, made_again: &[MadeAgain]) -> Value {
        let of = |recording: &Recording| {
            let quality = tracking_quality(recording);
            json!({
                "recording": recording.path,
                "samples": recording.samples(),
                "max_abs_error_counts": quality.iter().map(|joint| joint.max_abs_error_counts).collect::<Vec<_>>(),
                "rms_error_counts": quality.iter().map(|joint| joint.rms_error_counts).collect::<Vec<_>>(),
            })
        };
        json!({
            "report": self.out,
            "recordings": recordings.iter().map(of).collect::<Vec<_>>(),
            "closed_loop_rms_counts": repeated.map(|repeated| &repeated.closed_loop_rms_counts),
            "innovation_rms_counts": repeated.map(|repeated| &repeated.innovation_rms_counts),
            "simulated_under_computed_torque": made_again.iter().map(|(_, simulated)| of(simulated)).collect::<Vec<_>>(),
        })
    }
}

/// What of a model the simulations of a page leave out.
fn left_out(model: &Model) -> Option<String> {
    let names: Vec<String> = model
        .effects
        .iter()
        .filter(|effect| !identified_model::is_simulated(effect))
        .map(|effect| format!("{} ({})", effect.name, page::explain::place(&effect.joint)))
        .collect();
    let sentence = format!(
        "Under the position loop the simulated arm has f, friction and torque offsets of the model, not its {}; explain \
         judges those.",
        names.join(", ")
    );
    (!names.is_empty()).then_some(sentence)
}

/// Whether computed torque ran with another model than the simulated one did.
fn other_controller(robot: &Robot, controller: &Model, recording: &Recording) -> Option<String> {
    let noted = recording.manifest.as_ref()?.model_crc.as_ref()?;
    let simulated = format!("{:08x}", compensation::board_model(robot, controller).ok()?.crc());
    (*noted != simulated).then(|| {
        format!(
            "{}: computed torque ran with the model {noted}, and is simulated with {simulated}; give the one it ran with as \
             --controller-model.",
            recording.path.display()
        )
    })
}

fn verdict(recordings: &[Recording], repeated: Option<&Repeated>, made_again: &[MadeAgain]) -> String {
    let repeated = repeated.map(|repeated| {
        format!(
            "The model repeats the recordings under the position loop to {} counts rms per joint; what it does not foresee \
             is {} counts rms.",
            per_joint(&repeated.closed_loop_rms_counts, 3),
            per_joint(&repeated.innovation_rms_counts, 3)
        )
    });
    let rms = |recording: &Recording| {
        let rms: Vec<f64> = tracking_quality(recording).iter().map(|joint| joint.rms_error_counts).collect();
        per_joint(&rms, 2)
    };
    let made_again = made_again.iter().map(|(measured, simulated)| {
        let (path, measured, simulated) = (measured.path.display(), rms(measured), rms(simulated));
        format!("{path}: tracking error under computed torque {measured} counts rms measured, {simulated} simulated.")
    });
    let sentences: Vec<String> = repeated.into_iter().chain(made_again).collect();
    if sentences.is_empty() { page::record::verdict(recordings) } else { sentences.join(" ") }
}

//! `armid report`.

use std::path::PathBuf;

use armid::capture::tracking_quality;
use armid::identified_model;
use armid::identify::Experiment;
use armid::recording::{Mode, Recording};
use armid::report::{self, FileRole, Page, Section};
use clap::Args;
use serde_json::{Value, json};

use super::CommandError;
use super::common::{RobotArguments, advise, print, print_json, read_model, read_recordings, with_sidecars};
use super::page::{self, check_page, per_joint, write_page};

const NOTES: &str = "Makes one page of what is on disk; nothing is identified, nothing moves. With a model, its simulated \
    arm repeats every recording made under the position loop: tracking errors and currents measured and simulated, their \
    difference, and maps of the torque that the model lacks. Recordings made under computed torque are shown as they were \
    measured.

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
        let inputs = || inputs.iter().chain(&self.robot.robot).chain(&self.model).map(PathBuf::as_path);
        check_page(&self.out, [], inputs())?;
        let is_computed_torque =
            |recording: &&Recording| recording.manifest.as_ref().is_some_and(|noted| noted.mode == Mode::Ctc);
        let (tracked, slow): (Vec<&Recording>, Vec<&Recording>) = recordings.iter().partition(is_computed_torque);
        let (mut sections, mut repeated) = (Vec::new(), None);
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
            if let Some(left_out) = left_out(model) {
                advise(&left_out);
                sections.push(Section::new("Not simulated").text(left_out));
            }
        }
        let tracked: Vec<Recording> = tracked.into_iter().cloned().collect();
        let measured = if repeated.is_some() { &tracked } else { &recordings };
        if !measured.is_empty() {
            sections.extend(page::record::sections(&robot, measured));
        }
        let mut provenance = page::provenance().robot(&robot).recordings(FileRole::Read, &recordings);
        if let Some(model) = &model {
            provenance = provenance.model(&robot, model);
        }
        sections.push(provenance.files(FileRole::Read, inputs()).section());
        let verdict = verdict(&recordings, repeated.as_ref());
        let page = Page { command: "report".into(), title: robot.name.clone(), verdict: verdict.clone(), sections };
        if self.json { print_json(&self.to_json(&recordings, repeated.as_ref())) } else { print(verdict) }?;
        write_page(&self.out, &page)
    }

    fn to_json(&self, recordings: &[Recording], repeated: Option<&Repeated>) -> Value {
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
        })
    }
}

/// What of a model the simulations of a page leave out.
fn left_out(model: &armid::model::Model) -> Option<String> {
    let names: Vec<String> = model
        .effects
        .iter()
        .filter(|effect| !identified_model::is_simulated(effect))
        .map(|effect| format!("{} ({})", effect.name, page::explain::place(&effect.joint)))
        .collect();
    let sentence = format!(
        "The simulations of this page have f, friction and torque offsets of the model, not its {}; explain judges those.",
        names.join(", ")
    );
    (!names.is_empty()).then_some(sentence)
}

fn verdict(recordings: &[Recording], repeated: Option<&Repeated>) -> String {
    match repeated {
        Some(repeated) => format!(
            "The model repeats the recordings under the position loop to {} counts rms per joint; what it does not foresee \
             is {} counts rms.",
            per_joint(&repeated.closed_loop_rms_counts, 3),
            per_joint(&repeated.innovation_rms_counts, 3)
        ),
        None => page::record::verdict(recordings),
    }
}

//! `armid explain`.

use std::ffi::OsString;
use std::path::PathBuf;

use armid::explain::{Explanation, Options, explain};
use armid::model::Model;
use armid::report::FileRole;
use clap::Args;

use super::common::{
    RobotArguments, advise, cache_folder, check_distinct, print, print_json, read_recordings, with_sidecars,
};
use super::outputs::{FileKind, check_outputs};
use super::page::{self, ReportArguments};
use super::{CommandError, progress};

const EXAMPLES: &str = "Examples:
  armid explain --model model.toml slow.csv fast.csv --check new.csv --report gap.html
  armid explain slow.csv fast.csv new.csv --out extended.toml --next movement.toml";

/// Arguments of `explain`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Explain {
    /// Recordings to explain, made under the position loop; without --check the last of several is kept back
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    robot: RobotArguments,
    /// Baseline model with standard errors, as `identify` writes it; without one it is identified first
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Recording kept out of every fit, to judge by; may be given several times
    #[arg(long, value_name = "FILE")]
    check: Vec<PathBuf>,
    /// Seed of the null simulations, and of the search of a baseline
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Accept recordings with gaps
    #[arg(long)]
    allow_gaps: bool,
    /// Model file to write: the baseline refitted, with the named effects
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Movement file to write: the movement that best tells apart what these recordings cannot
    #[arg(long, value_name = "FILE")]
    next: Option<PathBuf>,
    #[command(flatten)]
    report: ReportArguments,
    /// Folder to keep the scores of null simulations in, so that the same recordings under the same model are explained
    /// faster the next time; by default armid's own among the user's caches, and none if this is empty
    #[arg(long, value_name = "FOLDER", env = "ARMID_CACHE")]
    cache: Option<OsString>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Explain {
    pub fn run(&self) -> Result<(), CommandError> {
        check_distinct(self.recordings.iter().chain(&self.check))?;
        let robot = self.robot.read_for_simulation()?;
        let mut fitted = self.recordings.clone();
        let mut kept_back = self.check.clone();
        if kept_back.is_empty() && fitted.len() > 1 {
            kept_back.extend(fitted.pop());
        }
        let recordings = read_recordings(&fitted, &robot, self.allow_gaps)?;
        let check = read_recordings(&kept_back, &robot, self.allow_gaps)?;
        for recording in recordings.iter().chain(&check) {
            recording.check_conditions(&robot)?;
        }
        let model = self.model.as_ref().map(|path| Model::read(path, &robot)).transpose()?;
        let inputs = [with_sidecars(&fitted), with_sidecars(&kept_back)].concat();
        let inputs = || inputs.iter().chain(&self.robot.robot).chain(&self.model).map(PathBuf::as_path);
        let outputs = || self.out.iter().chain(&self.next).map(PathBuf::as_path);
        let out = self.out.iter().map(|path| (path.as_path(), FileKind::Model));
        let next = self.next.iter().map(|path| (path.as_path(), FileKind::Movement));
        check_outputs(out.chain(next), inputs())?;
        self.report.check(outputs(), inputs())?;
        if check.is_empty() {
            advise(
                "no recording was kept back; give several, or --check, to judge the result on one that was not fitted",
            );
        }
        let bar = progress::bar("explain", 0);
        let options = Options {
            seed: self.seed,
            design_next: self.next.is_some(),
            kept_thresholds: cache_folder(self.cache.as_deref()),
        };
        let explanation = explain(&robot, &recordings, &check, model.as_ref(), &options, &|stage| {
            bar.set_message(stage);
            bar.tick();
        })?;
        bar.finish_and_clear();
        if let Some(out) = &self.out {
            explanation.model.write(out)?;
        }
        match (&self.next, &explanation.next_trajectory) {
            (Some(path), Some(next)) => armid::write_file(path, next.toml.as_bytes())?,
            (Some(_), None) => advise("there is no class to tell apart: no movement was written"),
            _ => {}
        }
        if self.json { print_json(&explanation.to_json()) } else { print(report(&explanation)) }?;
        self.report.write(|| {
            let provenance = page::provenance()
                .seed(self.seed)
                .robot(&robot)
                .recordings(FileRole::Read, recordings.iter().chain(&check))
                .files(FileRole::Read, inputs())
                .files(FileRole::Written, outputs());
            Ok(page::explain::page(&robot, &explanation, &provenance))
        })
    }
}

fn report(explanation: &Explanation) -> String {
    let mut lines = vec![format!("verdict: {}", explanation.verdict.word())];
    lines.extend(explanation.sentences.iter().cloned());
    if !explanation.candidates.is_empty() {
        lines.push(String::new());
        lines.push(format!("{:<30} {:>5} {:>12} {:>14}", "tried", "joint", "ΔBIC", "held-out gap"));
        for candidate in &explanation.candidates {
            lines.push(format!(
                "{:<30} {:>5} {:>12.1} {:>14.4}",
                candidate.name, candidate.joint, candidate.delta_bic, candidate.held_out_gap
            ));
        }
        lines.push(format!(
            "named from ΔBIC {:.0} on; robots that lack nothing reach {:.0} in this experiment",
            explanation.threshold[1], explanation.threshold[0]
        ));
    }
    lines.join("\n")
}

//! `armid bench`: the figures the documentation quotes, measured anew.

mod certainty;
mod explain;
mod ga;
mod identify;
mod load;
mod paper;
mod track;

use armid::report::{Page, Provenance, Section};
use clap::{Args, Subcommand};
use serde_json::Value;

use super::CommandError;
use super::common::{print, print_json};
use super::page::ReportArguments;

const EXAMPLES: &str = "Examples:
  armid bench paper                                 the paper's experiment, a minute
  armid bench track --robots 10                     tracking on arms never seen
  armid bench ga --seeds 50 --report searches.html  the same as a page with pictures";

/// Arguments of `bench`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, mut_arg("report", |report| report.global(true)))]
pub struct Bench {
    #[command(subcommand)]
    what: What,
    #[command(flatten)]
    report: ReportArguments,
    /// Print one JSON object
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum What {
    /// `explain` and its rivals on recordings with hidden effects.
    Explain(explain::Explain),
    /// The paper's identification beside ours: objective and scatter over seeds.
    Paper(paper::Paper),
    /// How many candidates a second identification judges, and how exactly.
    Identify(identify::Identify),
    /// The genetic algorithm beside differential evolution and CMA-ES: success rate and evaluations over seeds.
    Ga(ga::Ga),
    /// Loads taken up by arms whose model is wrong: mass error, whether its stated error holds, false triggers.
    Load(load::Load),
    /// How near f comes to the truth on robots never seen, and whether its standard errors hold.
    Certainty(certainty::Certainty),
    /// Tracking with identified models on arms never seen, what limits it, and the bandwidths beside others.
    Track(track::TrackStudy),
}

/// What was measured: printed, as JSON or as a page.
struct Measured {
    title: String,
    verdict: String,
    sections: Vec<Section>,
    json: Value,
    provenance: Provenance,
}

impl Bench {
    pub fn run(&self) -> Result<(), CommandError> {
        self.report.check([], [])?;
        let (name, measured) = match &self.what {
            What::Explain(explain) => ("explain", explain.measure()),
            What::Paper(paper) => ("paper", paper.measure()),
            What::Identify(identify) => ("identify", identify.measure()),
            What::Ga(ga) => ("ga", ga.measure()),
            What::Load(load) => ("load", load.measure()),
            What::Certainty(certainty) => ("certainty", certainty.measure()),
            What::Track(study) => ("track", study.measure()),
        };
        let Measured { title, verdict, mut sections, json, provenance } = measured?;
        if self.json {
            print_json(&json)?;
        } else {
            let sections = sections.iter().map(Section::to_text);
            print(std::iter::once(verdict.clone()).chain(sections).collect::<Vec<_>>().join("\n\n"))?;
        }
        self.report.write(|| {
            sections.push(provenance.section());
            Ok(Page { command: format!("bench {name}"), title, verdict, sections })
        })
    }
}

/// So many seeds from the first on, in words.
fn seeds(first: u64, count: u64) -> String {
    if count == 1 { first.to_string() } else { format!("{first} to {}", first + count - 1) }
}

//! `armid bench`: the figures the documentation quotes, measured anew.

mod certainty;
mod explain;
mod ga;
mod identify;
mod load;
mod paper;
mod track;

use clap::{Args, Subcommand};

use super::CommandError;

const EXAMPLES: &str = "Examples:
  armid bench paper                                 the paper's experiment, a minute
  armid bench track --robots 10                     tracking on arms never seen";

/// Arguments of `bench`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
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

impl Bench {
    pub fn run(&self) -> Result<(), CommandError> {
        match &self.what {
            What::Explain(explain) => explain.run(),
            What::Paper(paper) => paper.run(),
            What::Identify(identify) => identify.run(),
            What::Ga(ga) => ga.run(),
            What::Load(load) => load.run(),
            What::Certainty(certainty) => certainty.run(),
            What::Track(study) => study.run(),
        }
    }
}

//! `armid bench`: the figures the documentation quotes, measured anew.

mod certainty;
mod explain;
mod identify;
mod paper;

use clap::{Args, Subcommand};

use super::CommandError;

/// Arguments of `bench`.
#[derive(Debug, Args)]
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
    /// How near f comes to the truth on robots never seen, and whether its standard errors hold.
    Certainty(certainty::Certainty),
    /// How many candidates a second identification judges, and how exactly.
    Identify(identify::Identify),
}

impl Bench {
    pub fn run(&self) -> Result<(), CommandError> {
        match &self.what {
            What::Explain(explain) => explain.run(),
            What::Paper(paper) => paper.run(),
            What::Certainty(certainty) => certainty.run(),
            What::Identify(identify) => identify.run(),
        }
    }
}

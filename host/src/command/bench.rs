//! `armid bench`: the figures the documentation quotes, measured anew.

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
    /// The paper's identification beside ours: objective and scatter over seeds.
    Paper(paper::Paper),
    /// How many candidates a second identification judges, and how exactly.
    Identify(identify::Identify),
}

impl Bench {
    pub fn run(&self) -> Result<(), CommandError> {
        match &self.what {
            What::Paper(paper) => paper.run(),
            What::Identify(identify) => identify.run(),
        }
    }
}

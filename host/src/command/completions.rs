//! `armid completions`.

use clap::{Args, CommandFactory as _};
use clap_complete::{Shell, generate};

use super::common::print;
use super::{Arguments, CommandError};

const EXAMPLES: &str = "Examples:
  armid completions bash > ~/.local/share/bash-completion/completions/armid
  armid completions zsh > ~/.zfunc/_armid           with ~/.zfunc in fpath
  armid completions fish > ~/.config/fish/completions/armid.fish";

/// Arguments of `completions`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Completions {
    /// Shell to write the script for
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    pub fn run(&self) -> Result<(), CommandError> {
        let mut script = Vec::new();
        generate(self.shell, &mut Arguments::command(), "armid", &mut script);
        print(String::from_utf8_lossy(&script))
    }
}

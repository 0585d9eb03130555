//! The commands of `armid`, one file each, and what they share.

mod bench;
mod calibrate;
mod common;
mod compare;
mod completions;
mod demo;
mod doctor;
mod error;
mod excite;
mod explain;
mod export;
#[cfg(feature = "flash")]
mod flash;
mod identify;
mod info;
mod interrupt;
mod load;
mod man;
mod monitor;
mod new_robot;
mod outputs;
mod own_model;
mod page;
mod progress;
mod ranges;
mod record;
mod report;
mod run;
mod simulate;
mod track;
mod upload;
mod wording;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

pub use error::CommandError;

/// Identifies the dynamics of a robot arm's joints 2 and 3 from its tracking errors, uploads them to the controller
/// board and tracks within one encoder count.
#[derive(Debug, Parser)]
#[command(name = "armid", version, after_help = EXIT_CODES, arg_required_else_help = true)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes:
  0  done
  1  failed
  2  wrong usage
  3  bad input file
  4  board unreachable
  5  refused as unsafe
  129, 130, 143  ended by SIGHUP, Ctrl-C or SIGTERM with nothing of a movement to keep
  101, 134  a fault of the program itself

Results go to stdout, progress and advice to stderr. Every command has its own --help.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Show the whole chain on a simulated robot: record, calibrate, identify, upload, track.
    Demo(demo::Demo),
    /// Write the firmware to the board through its debug probe, and verify it.
    #[cfg(feature = "flash")]
    Flash(flash::Flash),
    /// Check what on this computer is in the way of using a board, and say what to do about it.
    Doctor(doctor::Doctor),
    /// Write a robot file from questions and answers, or an example of one.
    NewRobot(new_robot::NewRobot),
    /// Show who the board is, what it is doing, and its counters.
    Info(info::Info),
    /// Watch the errors and currents of both joints.
    Monitor(monitor::Monitor),
    /// Run a movement and record it.
    Record(record::Record),
    /// Find the position loop's A/count and lead from recordings.
    Calibrate(calibrate::Calibrate),
    /// Find f1..f9 and friction from recordings.
    Identify(identify::Identify),
    /// Compare models with each other and with recordings, or recordings with each other.
    Compare(compare::Compare),
    /// Design the movement that determines f1..f9 best within the robot's limits.
    Excite(excite::Excite),
    /// Compute search ranges of f from bounds on masses, centres and inertias, or check a model against them.
    Ranges(ranges::Ranges),
    /// Find what a model lacks: name the effect, add it, show the gap shrink.
    Explain(explain::Explain),
    /// Write a recording as MCAP or CSV in SI units, or a model as URDF or JSON.
    Export(export::Export),
    /// Put a model onto the board, in two phases with read-back.
    Upload(upload::Upload),
    /// Run a movement under the position loop and under computed torque, and compare the tracking errors.
    Track(track::Track),
    /// Find the mass in the gripper while the arm moves, on the board, and track with it.
    Load(load::LoadCommand),
    /// Measure the figures that the documentation quotes.
    Bench(bench::Bench),
    /// Make one page of recordings and a model: measured against simulated, parameters, residual maps, provenance.
    Report(report::Report),
    /// Make recordings of a given or drawn robot with the simulated board.
    Simulate(simulate::Simulate),
    /// Write what completes commands and options in a shell.
    Completions(completions::Completions),
    /// Write manual pages, or tables of every option.
    Man(man::Manual),
}

/// The variable that names the board where no option does.
const BOARD_VARIABLE: &str = "ARMID_BOARD";

/// The arguments of this process; wrong usage, and what asks for help, ends it.
pub fn arguments() -> Arguments {
    let mut parser = without_empty_board(values_may_be_negative(Arguments::command()));
    let matches = parser.get_matches_mut();
    Arguments::from_arg_matches(&matches).unwrap_or_else(|error| error.format(&mut parser).exit())
}

/// A number below zero is the value of the option before it, and refused by that option's name, rather than an option that
/// does not exist.
fn values_may_be_negative(command: clap::Command) -> clap::Command {
    let option = |argument: &clap::Arg| !argument.is_positional() && argument.get_action().takes_values();
    command
        .mut_args(|argument| if option(&argument) { argument.allow_negative_numbers(true) } else { argument })
        .mut_subcommands(values_may_be_negative)
}

/// An empty variable names no board: it is as good as unset.
fn without_empty_board(command: clap::Command) -> clap::Command {
    if std::env::var_os(BOARD_VARIABLE).is_none_or(|board| !board.is_empty()) {
        return command;
    }
    command
        .mut_args(|argument| {
            let names_board = argument.get_env() == Some(BOARD_VARIABLE.as_ref());
            if names_board { argument.env(None::<&str>) } else { argument }
        })
        .mut_subcommands(without_empty_board)
}

/// Tells why a command ended without its result.
pub fn tell(error: &CommandError) {
    let text = format!("error: {}", error.message());
    // What a file says has no say in where a line ends.
    let is_of_a_file = matches!(error, CommandError::File(_) | CommandError::Repeating(_));
    if is_of_a_file { common::advise(text) } else { common::advise_lines(text) }
}

/// Carries out what the command line asks for.
pub fn run(arguments: Arguments) -> Result<(), CommandError> {
    match arguments.command {
        Command::Demo(command) => command.run(),
        #[cfg(feature = "flash")]
        Command::Flash(command) => command.run(),
        Command::Doctor(command) => command.run(),
        Command::NewRobot(command) => command.run(),
        Command::Info(command) => command.run(),
        Command::Monitor(command) => command.run(),
        Command::Record(command) => command.run(),
        Command::Bench(command) => command.run(),
        Command::Calibrate(command) => command.run(),
        Command::Identify(command) => command.run(),
        Command::Compare(command) => command.run(),
        Command::Excite(command) => command.run(),
        Command::Ranges(command) => command.run(),
        Command::Explain(command) => command.run(),
        Command::Export(command) => command.run(),
        Command::Upload(command) => command.run(),
        Command::Track(command) => command.run(),
        Command::Load(command) => command.run(),
        Command::Report(command) => command.run(),
        Command::Simulate(command) => command.run(),
        Command::Completions(command) => command.run(),
        Command::Man(command) => command.run(),
    }
}

#[cfg(test)]
mod tests {
    use clap::{Command, CommandFactory as _};

    use super::*;

    fn all(command: &Command) -> Vec<&Command> {
        std::iter::once(command).chain(command.get_subcommands().flat_map(all)).collect()
    }

    /// Every command shows how it is used, and what it shows is accepted by the parser.
    #[test]
    fn examples_in_help_are_command_lines() {
        let mut armid = Arguments::command();
        armid.build();
        for command in all(&armid) {
            // The program itself, and what clap adds.
            if command.get_name() == "armid" || command.get_bin_name().is_some_and(|name| name.contains("help")) {
                continue;
            }
            let help = command.get_after_long_help().or(command.get_after_help()).map(ToString::to_string);
            let help = help.unwrap_or_default();
            let examples: Vec<&str> = help.lines().filter(|line| line.starts_with("  armid ")).collect();
            assert!(!examples.is_empty(), "{:?} has no example", command.get_bin_name());
            for example in examples {
                // A remark stands behind two spaces, and what comes after > is the shell's.
                let line = example.trim().split("  ").next().unwrap_or_default().split(" >").next().unwrap_or_default();
                let parsed = Arguments::try_parse_from(line.split_whitespace());
                assert!(parsed.is_ok(), "{line}: {}", parsed.err().map(|error| error.to_string()).unwrap_or_default());
            }
        }
    }
}

//! `armid`: the command line. Everything it does is in the library; here are arguments, tables and exit codes.
//!
//! ```text
//! arguments ── command ─┬─ demo, identify, explain, …    one file each: reads, asks the library, prints
//!                       ├─ common, run, page             what they share: files and boards, movements, report pages
//!                       ├─ wording, progress, interrupt  names of joints in messages, bars, Ctrl-C
//!                       └─ error                         what went wrong, as message and exit code
//! ```
//!
//! Results go to standard output, progress and advice to standard error.
#![forbid(unsafe_code)]
#![deny(clippy::print_stderr, reason = "eprintln! panics where stderr is closed or full")]
#![expect(clippy::result_large_err, reason = "an error ends the command; none is on a path that is often taken")]

mod command;

use std::process::ExitCode;

fn main() -> ExitCode {
    // clap itself ends with exit code 2 on wrong usage.
    let done = command::run(command::arguments());
    armid::release_outputs();
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            command::tell(&error);
            ExitCode::from(error.exit_code())
        }
    }
}

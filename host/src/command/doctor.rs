//! `armid doctor`.

use std::ffi::OsString;
use std::path::PathBuf;

use armid::client::{Client, ClientError};
use armid::doctor::{Computer, Finding, State};
use armid::link::{self, Address};
use armid::robot::Robot;
use clap::Args;
use serde_json::json;
use shared::protocol::PROTOCOL_VERSION;

use super::CommandError;
use super::common::{RobotArguments, cache_folder, print, print_json};

const NOTES: &str =
    "Each line is ok, warn (something will not work, but not everything needs it) or fail, with what to do \
    about it. Exit code 0 without a fail, 1 with one.

Examples:
  armid doctor
  armid doctor --board serial:/dev/ttyACM0 --robot robot.toml
  armid doctor --json";

/// Arguments of `doctor`.
#[derive(Debug, Args)]
#[command(after_help = NOTES)]
pub struct Doctor {
    #[command(flatten)]
    robot: RobotArguments,
    /// Board to ask for its firmware, named as in `info`; without it, the one found on USB, if there is one
    #[arg(long, value_name = "BOARD", env = super::BOARD_VARIABLE)]
    board: Option<Address>,
    /// Folder for scores of null simulations, as in `explain`
    #[arg(long, value_name = "FOLDER", env = "ARMID_CACHE")]
    cache: Option<OsString>,
    /// Look at the file system that begins here
    #[arg(long, value_name = "FOLDER", hide = true)]
    root: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Doctor {
    pub fn run(&self) -> Result<(), CommandError> {
        let computer = self.root.clone().map_or_else(Computer::this, Computer::at);
        let mut findings =
            vec![Finding::ok("version", format!("{}, protocol {PROTOCOL_VERSION}", armid::TOOL_VERSION))];
        findings.extend(computer.check(cache_folder(self.cache.as_deref()).as_deref()));
        findings.extend(abandoned_outputs());
        findings.extend(self.robot_file());
        let board = self.board.clone().or_else(|| (computer.usable_boards() > 0).then_some(Address::ANY_USB));
        if let Some(address) = board {
            findings.push(firmware(&address));
        }
        if self.json {
            print_json(&json!({"findings": findings}))?;
        } else {
            print(findings.iter().map(line).collect::<Vec<_>>().join("\n"))?;
        }
        let failed = findings.iter().filter(|finding| finding.state == State::Fail).count();
        if failed == 0 {
            Ok(())
        } else {
            Err(CommandError::Failed(format!("{failed} of {} checks failed", findings.len())))
        }
    }

    fn robot_file(&self) -> Option<Finding> {
        let path = self.robot.robot.as_ref()?;
        Some(match Robot::read_for_motion(path) {
            Ok(robot) => Finding::ok("robot file", format!("{}: {:?} can be moved", path.display(), robot.name)),
            Err(error) => Finding::not_ok(State::Fail, "robot file", error.to_string(), "correct the robot file"),
        })
    }
}

/// What programs left in the current folder that were ended before they had written their result.
fn abandoned_outputs() -> Option<Finding> {
    let left: Vec<String> = armid::abandoned_outputs(".".as_ref())
        .iter()
        .filter_map(|path| Some(path.file_name()?.display().to_string()))
        .collect();
    let remedy = "delete them; a program that writes the file of that name takes its leftover away as well";
    let found = || format!("left in this folder by programs that were ended: {}", left.join(", "));
    (!left.is_empty()).then(|| Finding::not_ok(State::Warn, "unfinished results", found(), remedy))
}

fn line(finding: &Finding) -> String {
    let Finding { check, state, found, remedy } = finding;
    let remedy = remedy.as_ref().map(|remedy| format!("\n      → {remedy}")).unwrap_or_default();
    format!("{state:<5} {check}: {found}{remedy}")
}

fn firmware(address: &Address) -> Finding {
    const CHECK: &str = "firmware";
    let asked = link::open(address, &Robot::paper(), 1).map_err(ClientError::from);
    let info = asked.and_then(Client::connect).and_then(|mut client| client.hello());
    let flash = "flash the firmware of this version: armid flash";
    match info {
        Ok(info) if armid::TOOL_VERSION.ends_with(&format!(" {}", info.identity.firmware_version)) => {
            Finding::ok(CHECK, format!("{} {}", info.identity.board, info.identity.firmware_version))
        }
        Ok(info) => {
            let found = format!("{} on the board, {} here", info.identity.firmware_version, armid::TOOL_VERSION);
            Finding::not_ok(State::Warn, CHECK, found, flash)
        }
        Err(error @ ClientError::WrongVersion { .. }) => Finding::not_ok(State::Fail, CHECK, error.to_string(), flash),
        Err(error) => {
            let remedy =
                "check that the board has power and runs (armid flash), and that no other program has its port open";
            Finding::not_ok(State::Fail, CHECK, error.to_string(), remedy)
        }
    }
}

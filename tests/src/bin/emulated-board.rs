//! Runs the firmware's image on the emulated board, with the simulated arm, and serves its serial line on a local TCP
//! port, so that every command of armid works against it: `--board tcp:127.0.0.1:PORT`.
#![forbid(unsafe_code)]

use std::net::TcpListener;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use armid::hidden_robot::HiddenRobot;
use armid::link::MemoryFlash;
use armid::robot::Robot;
use armid_tests::board_server::{Pace, ServerEvent, serve};
use armid_tests::emulated_board::{EmulatedBoard, EmulationError, FIRMWARE_VARIABLE};
use clap::Parser;

/// Exit codes as armid has them.
const FAILED: u8 = 1;
const BAD_FILE: u8 = 3;

/// Runs the firmware's image on an emulated board with a simulated arm, and serves it on a local TCP port.
///
/// The arm starts at zero angles: tell armid with --pose 0,0. One host at a time; Ctrl-C ends.
#[derive(Debug, Parser)]
struct Arguments {
    /// Image to run, as `tests/run firmware` builds it
    #[arg(long, value_name = "ELF", env = FIRMWARE_VARIABLE)]
    firmware: PathBuf,
    /// Port on 127.0.0.1; 0 takes any that is free
    #[arg(long, default_value_t = 7429)]
    port: u16,
    /// Port on 127.0.0.1 for a debug probe, a Black Magic Probe to `armid flash` and probe-rs; 0 takes any that is free
    #[arg(long, value_name = "PORT")]
    probe_port: Option<u16>,
    /// Seed of the arm's hidden parameters
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Robot file with the drives; without one, the paper's PUMA 560
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Let the host set the pace instead of the clock: faster or slower than real time, whichever this computer can do
    #[arg(long)]
    unpaced: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err((code, message)) => {
            eprintln!("error: {message}");
            ExitCode::from(code)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), (u8, String)> {
    let bad_file = |error: &dyn std::fmt::Display| (BAD_FILE, error.to_string());
    let failed = |error: &dyn std::fmt::Display| (FAILED, error.to_string());
    let robot = match &arguments.robot {
        Some(path) => Robot::read_for_motion(path).map_err(|error| bad_file(&error))?,
        None => Robot::paper(),
    };
    let hidden = HiddenRobot::draw(&robot, arguments.seed);
    let (firmware, blank) = (&arguments.firmware, MemoryFlash::default());
    let board = match arguments.probe_port {
        Some(port) => EmulatedBoard::start_with_probe(firmware, &robot, &hidden, &blank, port),
        None => EmulatedBoard::start(firmware, &robot, &hidden),
    };
    let board = board.map_err(|error| match error {
        EmulationError::Probe(_) => failed(&error),
        _ => bad_file(&format!("{}: {error}", firmware.display())),
    })?;
    let listener = TcpListener::bind(("127.0.0.1", arguments.port))
        .map_err(|error| failed(&format!("port {} cannot be had: {error}; choose another --port", arguments.port)))?;
    let address = listener.local_addr().map_err(|error| failed(&error))?;
    println!("tcp:{address}");
    if let Some(probe) = board.probe() {
        println!("{}", probe.selector());
    }
    eprintln!("try: armid record --board tcp:{address} --pose 0,0");
    let pace = if arguments.unpaced { Pace::Host } else { Pace::RealTime };
    let mut lag = Duration::ZERO;
    let ended = serve(&listener, &board, pace, &mut |event| match event {
        ServerEvent::Connected(host) => eprintln!("host {host} connected"),
        ServerEvent::Gone => eprintln!("the host has gone"),
        ServerEvent::Refused(host) => eprintln!("host {host} refused: one at a time"),
        ServerEvent::Lagging(more) => {
            lag += more;
            eprintln!(
                "this computer is too slow for real time: the board is {:.1} s behind, armid sees it run slowly",
                lag.as_secs_f64()
            );
        }
    });
    match ended {
        Err(error) => Err(failed(&error)),
    }
}

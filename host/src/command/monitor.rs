//! `armid monitor`.

mod plot;
mod row;

use std::io::{ErrorKind, IsTerminal as _, Write as _};
use std::time::Duration;

use armid::client::Client;
use armid::link::Address;
use clap::Args;

use super::common::{BoardArguments, RobotArguments};
use super::{CommandError, interrupt};
use plot::Screen;
use row::Row;

/// How often the board is asked.
const PERIOD: Duration = Duration::from_millis(50);
/// How often it is asked for its counters, which are not in every answer.
const COUNTERS_PERIOD: Duration = Duration::from_secs(1);

const WHAT_IS_ASKED: &str =
    "Asks the board twenty times a second and changes nothing, so it may run beside `armid record` on another link of \
    the same board. Errors are 0 while the amplifiers are off. On a terminal q, Esc or Ctrl-C leaves.

Examples:
  armid monitor
  armid monitor --board serial:/dev/ttyACM0";

/// Arguments of `monitor`.
#[derive(Debug, Args)]
#[command(after_help = WHAT_IS_ASKED)]
pub struct Monitor {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    /// End after so many seconds
    #[arg(long = "for", value_name = "SECONDS")]
    duration_s: Option<f64>,
    /// Print one JSON object a line instead of a plot
    #[arg(long)]
    json: bool,
}

/// Where the rows go.
enum Output {
    Screen(Box<Screen>),
    Lines,
    Json,
}

/// Whether to go on.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Next {
    Go,
    Leave,
}

impl Monitor {
    pub fn run(&self) -> Result<(), CommandError> {
        let duration = self.duration()?;
        let robot = self.robot.read()?;
        let mut client = self.board.connect(&robot)?;
        let mut output = match (self.json, std::io::stdout().is_terminal()) {
            (true, _) => Output::Json,
            (false, true) => Output::Screen(Box::new(Screen::open(client.address()).map_err(CommandError::Output)?)),
            (false, false) => Output::Lines,
        };
        if matches!(output, Output::Lines) && write_line(&Row::header())? == Next::Leave {
            return Ok(());
        }
        // A simulated board's time passes as fast as it is computed: slow enough to be watched, unless an end is set.
        let simulated = self.board.board == Some(Address::Simulated);
        let paced = simulated && (duration.is_none() || matches!(output, Output::Screen(_)));
        self.follow(&mut client, &mut output, duration, paced)
    }

    fn duration(&self) -> Result<Option<Duration>, CommandError> {
        let positive = |seconds: f64| Duration::try_from_secs_f64(seconds).ok().filter(|duration| !duration.is_zero());
        match self.duration_s {
            None => Ok(None),
            Some(seconds) => positive(seconds)
                .map(Some)
                .ok_or_else(|| CommandError::Usage(format!("--for {seconds} is not a positive time in s"))),
        }
    }

    fn follow(
        &self,
        client: &mut Client,
        output: &mut Output,
        duration: Option<Duration>,
        paced: bool,
    ) -> Result<(), CommandError> {
        let interrupted = interrupt::watch(&[]);
        let start = client.now();
        let mut info = client.info().clone();
        let mut info_at = start;
        loop {
            let now = client.now();
            if interrupted.asked() > 0 || duration.is_some_and(|duration| now - start >= duration) {
                return Ok(());
            }
            if now - info_at >= COUNTERS_PERIOD {
                info = client.hello()?;
                info_at = now;
            }
            let row = Row::new(now - start, client.status()?, &info);
            let next = match output {
                Output::Json => write_line(&row.to_json().to_string())?,
                Output::Lines => write_line(&row.to_line())?,
                Output::Screen(screen) => screen.show(row).map_err(CommandError::Output)?,
            };
            if next == Next::Leave {
                return Ok(());
            }
            // Rows and events that come unasked are another command's.
            while client.next_unasked(now + PERIOD)?.is_some() {}
            if paced {
                std::thread::sleep(PERIOD);
            }
        }
    }
}

/// Writes a line to stdout; a reader that closed the pipe has seen enough.
fn write_line(line: &str) -> Result<Next, CommandError> {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
        Ok(()) => Ok(Next::Go),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(Next::Leave),
        Err(error) => Err(CommandError::Output(error)),
    }
}

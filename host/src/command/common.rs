//! Arguments and output that several commands share.

use std::io::Write as _;
use std::path::PathBuf;
use std::str::FromStr;

use armid::board_setup;
use armid::client::{Client, Pose};
use armid::link::{self, Address};
use armid::model::Model;
use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use armid::trajectory_file;
use clap::Args;
use shared::protocol::Configuration;
use shared::trajectory::{Margins, Trajectory};

use super::CommandError;

/// Which robot.
#[derive(Clone, Debug, Args)]
pub struct RobotArguments {
    /// Robot file; without one, the paper's PUMA 560 with the default loop
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
}

impl RobotArguments {
    /// The robot, to compute with.
    pub fn read(&self) -> Result<Robot, CommandError> {
        Ok(self.robot.as_deref().map_or_else(|| Ok(Robot::paper()), Robot::read)?)
    }

    /// The robot, to move: its gains must be stable.
    pub fn read_for_motion(&self) -> Result<Robot, CommandError> {
        Ok(self.robot.as_deref().map_or_else(|| Ok(Robot::paper()), Robot::read_for_motion)?)
    }

    /// The robot, to repeat recordings of its loop with: an unstable loop has none.
    pub fn read_for_simulation(&self) -> Result<Robot, CommandError> {
        let robot = self.read()?;
        robot.check_gains().map_err(|error| CommandError::Gains {
            path: self.robot.as_ref().map_or_else(|| "robot".into(), |path| path.display().to_string()),
            error,
        })?;
        Ok(robot)
    }
}

/// Which board, and what may be done to get it going.
#[derive(Clone, Debug, Args)]
pub struct BoardArguments {
    /// Board: usb, tcp:HOST:PORT, serial:PATH[@BAUD] or sim; without it, one found on USB
    #[arg(long, value_name = "BOARD", env = "ARMID_BOARD")]
    pub board: Option<Address>,
    /// Seed of the simulated board's hidden robot and noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Declare the pose the arm has now: joint angles Q2,Q3 in rad
    #[arg(long, value_name = "Q2,Q3", allow_hyphen_values = true)]
    pub pose: Option<JointAngles>,
    /// Clear a fault of the board before starting
    #[arg(long)]
    pub clear_fault: bool,
}

/// Two joint angles in rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointAngles([f64; 2]);

impl FromStr for JointAngles {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = || format!("\"{text}\" is not two joint angles in rad, such as 0,1.57");
        let (second, third) = text.split_once(',').ok_or_else(refuse)?;
        let angle = |text: &str| text.trim().parse().ok().filter(|angle: &f64| angle.is_finite()).ok_or_else(refuse);
        Ok(Self([angle(second)?, angle(third)?]))
    }
}

impl BoardArguments {
    /// Connects to the board.
    pub fn connect(&self, robot: &Robot) -> Result<Client, CommandError> {
        let address = self.board.clone().unwrap_or(Address::Usb);
        Ok(Client::connect(link::open(&address, robot, self.seed)?)?)
    }

    /// Connects, and makes the board ready to move `robot`.
    pub fn connect_ready(&self, robot: &Robot) -> Result<(Client, Configuration), CommandError> {
        let configuration = board_setup::configuration(robot)?;
        let mut client = self.connect(robot)?;
        client.prepare(&configuration, self.pose(), self.clear_fault)?;
        Ok((client, configuration))
    }

    /// The seed, where it means something.
    pub fn simulated_seed(&self) -> Option<u64> {
        (self.board == Some(Address::Simulated)).then_some(self.seed)
    }

    fn pose(&self) -> Pose {
        match self.pose {
            Some(JointAngles(angles)) => Pose::Declared(angles),
            // A simulated arm starts at zero angles; a real one is wherever it was left.
            None if self.board == Some(Address::Simulated) => Pose::DefaultsTo([0.0; 2]),
            None => Pose::Known,
        }
    }
}

/// Which movement.
#[derive(Clone, Debug, Args)]
pub struct TrajectoryArguments {
    /// Movement: paper, or a file with [fourier] or [points]
    #[arg(long, value_name = "paper|FILE", default_value = "paper")]
    pub trajectory: String,
    /// Period T of the paper's movement in s
    #[arg(long, value_name = "SECONDS", default_value_t = 3.65, allow_negative_numbers = true)]
    pub period: f64,
    /// How long to stand at the start before recording, in s
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, allow_negative_numbers = true)]
    pub settle: f64,
}

impl TrajectoryArguments {
    /// The movement, and its name in words.
    pub fn read(&self) -> Result<(Trajectory, String), CommandError> {
        if self.trajectory == "paper" {
            let period_s = self.period;
            let trajectory = trajectory_file::paper(period_s)
                .ok_or_else(|| CommandError::Usage(format!("--period {period_s} is not a positive time in s")))?;
            return Ok((trajectory, paper_name(period_s)));
        }
        Ok((trajectory_file::read(self.trajectory.as_ref())?, self.trajectory.clone()))
    }

    /// How long to stand at the start, in ns.
    pub fn settle_ns(&self) -> Result<u64, CommandError> {
        if (0.0..=60.0).contains(&self.settle) {
            return Ok((self.settle * 1e9) as u64);
        }
        Err(CommandError::Usage(format!("--settle {} is not from 0 to 60 s", self.settle)))
    }
}

/// The paper's movement in words.
pub fn paper_name(period_s: f64) -> String {
    format!("paper, T = {period_s} s")
}

/// How near a movement comes to the robot's limits, or the limit it breaks.
pub fn check_limits(trajectory: &Trajectory, robot: &Robot, limits: &Configuration) -> Result<Margins, CommandError> {
    let counts_per_rad = [0, 1].map(|joint| robot.joints[joint].counts_per_rad() as f32);
    let record_period_ns = u64::from(limits.common.record_period_ns);
    shared::trajectory::check(trajectory, &limits.motion_limits, counts_per_rad, record_period_ns)
        .map_err(CommandError::Limit)
}

/// Reads recordings, and passes on what the reader noticed.
pub fn read_recordings(paths: &[PathBuf], robot: &Robot, allow_gaps: bool) -> Result<Vec<Recording>, CommandError> {
    let mut recordings = Vec::new();
    for path in paths {
        let recording = Recording::read(path, robot, ReadOptions { allow_gaps })?;
        for note in &recording.notes {
            advise(format!("{}: {note}", path.display()));
        }
        if let Some(reason) = recording.manifest.as_ref().and_then(|manifest| manifest.partial.as_ref()) {
            advise(format!("{}: only part of the movement ({reason})", path.display()));
        }
        recordings.push(recording);
    }
    Ok(recordings)
}

/// Reads the model file of a robot.
pub fn read_model(path: &std::path::Path, robot: &Robot) -> Result<Model, CommandError> {
    let model = Model::read(path, robot)?;
    if !model.effects.is_empty() {
        let names: Vec<&str> = model.effects.iter().map(|effect| effect.name.as_str()).collect();
        advise(format!("{}: effects the board does not use: {}", path.display(), names.join(", ")));
    }
    Ok(model)
}

/// Writes a result to stdout. A reader that closed the pipe has what it wanted.
pub fn print(text: impl AsRef<str>) -> Result<(), CommandError> {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{}", text.as_ref().trim_end()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(CommandError::Output(error)),
        _ => Ok(()),
    }
}

/// Writes one JSON object to stdout.
pub fn print_json(value: &serde_json::Value) -> Result<(), CommandError> {
    print(value.to_string())
}

/// Writes advice to stderr.
pub fn advise(text: impl AsRef<str>) {
    eprintln!("{}", text.as_ref());
}

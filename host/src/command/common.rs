//! Arguments and output that several commands share.

use std::ffi::OsStr;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use armid::board_setup;
use armid::client::{Client, Pose};
use armid::compensation;
use armid::effects::MotorInertiaBeyond;
use armid::hidden_robot::HiddenRobot;
use armid::link::{self, Address, LoadChange, SimulatedBoard};
use armid::margins::ArmLoop;
use armid::model::{Effect, Model};
use armid::number_text::significant;
use armid::recording::{ReadOptions, Recording};
use armid::robot::{Gripper, Robot};
use armid::shown;
use armid::trajectory_file;
use clap::Args;
use shared::protocol::Configuration;
use shared::trajectory::{LimitError, Margins, Quantity, Trajectory};

use super::{CommandError, wording};

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
        let robot = self.robot.as_deref().map_or_else(|| Ok(Robot::paper()), Robot::read)?;
        wording::of_robot(&robot);
        Ok(robot)
    }

    /// The robot, to move: its gains must be stable.
    pub fn read_for_motion(&self) -> Result<Robot, CommandError> {
        let robot = self.robot.as_deref().map_or_else(|| Ok(Robot::paper()), Robot::read_for_motion)?;
        wording::of_robot(&robot);
        Ok(robot)
    }

    /// The robot, to repeat recordings of its loop with: an unstable loop has none.
    pub fn read_for_simulation(&self) -> Result<Robot, CommandError> {
        let robot = self.robot.as_deref().map_or_else(|| Ok(Robot::paper()), Robot::read_for_repeating);
        robot.map_err(CommandError::Repeating)
    }
}

/// Which board, and what may be done to get it going.
#[derive(Clone, Debug, Args)]
pub struct BoardArguments {
    /// Board: usb, usb:SERIAL, tcp:HOST:PORT, serial:PATH[@BAUD] or sim; without it, the one found on USB
    #[arg(long, value_name = "BOARD", env = super::BOARD_VARIABLE)]
    pub board: Option<Address>,
    /// Seed of the simulated board's hidden robot and noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Effect of the simulated board's hidden robot, NAME:joint=JOINT,PARAMETER=VALUE,… (see simulate --help); may be
    /// repeated
    #[arg(long = "effect", value_name = "EFFECT")]
    pub effects: Vec<String>,
    /// Load in the gripper of the simulated board's hidden robot from the start, kg
    #[arg(long, value_name = "KG")]
    pub load_kg: Option<f64>,
    /// Declare the pose the arm has now: joint angles Q2,Q3 in rad
    #[arg(long, value_name = "Q2,Q3", allow_hyphen_values = true)]
    pub pose: Option<JointAngles>,
    /// Clear a fault of the board before starting
    #[arg(long)]
    pub clear_fault: bool,
}

/// Largest load of a simulated robot, kg: four times what the paper's robot carries.
const LARGEST_SIMULATED_LOAD_KG: f64 = 10.0;

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
        self.connect_to_arm(robot, None)
    }

    /// Connects to the board; a simulated arm takes up its load at that time after the start of a recording, or has it from
    /// the start.
    fn connect_to_arm(&self, robot: &Robot, taken_up_at_s: Option<f64>) -> Result<Client, CommandError> {
        let address = self.board.clone().unwrap_or(Address::ANY_USB);
        if self.load_kg.is_some() || !self.effects.is_empty() {
            let option = if self.load_kg.is_some() { "--load-kg" } else { "--effect" };
            if address != Address::Simulated {
                return Err(CommandError::Usage(format!("{option} is for a simulated board; add --board sim")));
            }
            let hidden = with_effects(HiddenRobot::draw(robot, self.seed), &self.effects, robot)?;
            let gripper = self.simulated_gripper(robot)?;
            let carried = gripper.holding(self.simulated_load_kg()?);
            let board = SimulatedBoard::new(robot, hidden, self.seed);
            let board = match taken_up_at_s {
                Some(at_s) => board.with_load(gripper.holding(0.0), &[LoadChange { at_s, load: carried }]),
                None => board.with_load(carried, &[]),
            };
            return Ok(Client::connect(Box::new(board))?);
        }
        Ok(Client::connect(link::open(&address, robot, self.seed)?)?)
    }

    fn simulated_gripper(&self, robot: &Robot) -> Result<Gripper, CommandError> {
        if self.load_kg.is_some() && robot.gripper.is_none() {
            return Err(CommandError::Usage(format!(
                "--load-kg needs a robot file that says where a load is held: {}",
                Gripper::lines_to_add(robot)
            )));
        }
        Ok(robot.gripper.unwrap_or(Gripper::REFERENCE))
    }

    fn simulated_load_kg(&self) -> Result<f64, CommandError> {
        let mass_kg = self.load_kg.unwrap_or(0.0);
        if (0.0..=LARGEST_SIMULATED_LOAD_KG).contains(&mass_kg) {
            return Ok(mass_kg);
        }
        Err(CommandError::Usage(format!("--load-kg {mass_kg} is not from 0 to {LARGEST_SIMULATED_LOAD_KG} kg")))
    }

    /// The same board with nothing in the gripper.
    pub fn empty_handed(&self) -> Self {
        Self { load_kg: None, ..self.clone() }
    }

    /// Whether the board is one in this process.
    pub fn is_simulated(&self) -> bool {
        self.board == Some(Address::Simulated)
    }

    /// Connects, and makes the board ready to move `robot`.
    pub fn connect_ready(&self, robot: &Robot) -> Result<Client, CommandError> {
        self.ready(robot, None)
    }

    /// The same, a simulated arm taking up its load only at that time after the start of a recording.
    pub fn connect_ready_to_take_up(&self, robot: &Robot, at_s: f64) -> Result<Client, CommandError> {
        self.ready(robot, Some(at_s))
    }

    fn ready(&self, robot: &Robot, taken_up_at_s: Option<f64>) -> Result<Client, CommandError> {
        let configuration = board_setup::configuration(robot)?;
        let mut client = self.connect_to_arm(robot, taken_up_at_s)?;
        client.prepare(&configuration, self.pose(), self.clear_fault)?;
        Ok(client)
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

/// The name of the paper's movement on the command line.
const PAPER: &str = "paper";

/// How long to stand before a movement where nothing is said: the start-up ringing has died away.
const DEFAULT_SETTLE_S: f64 = 2.0;

/// A movement that may be started.
#[derive(Clone)]
pub struct Prepared {
    pub trajectory: Trajectory,
    /// The movement in words.
    pub name: String,
    /// How long to stand at the start.
    pub settle_ns: u64,
    /// How near the movement comes to the robot's limits.
    margins: Margins,
}

impl Prepared {
    fn new(trajectory: Trajectory, name: String, settle_ns: u64, robot: &Robot) -> Result<Self, CommandError> {
        let margins = check_limits(&trajectory, robot, &board_setup::configuration(robot)?)?;
        Ok(Self { trajectory, name, settle_ns, margins })
    }

    /// A movement that was made for `robot`, to be run after standing as long as before this one.
    pub fn beside(&self, trajectory: Trajectory, name: String, robot: &Robot) -> Result<Self, CommandError> {
        Self::new(trajectory, name, self.settle_ns, robot)
    }

    /// Shows the margins left to the robot's limits.
    pub fn advise_margins(&self) {
        for row in &self.margins.rows {
            advise(wording::in_its_words(&row.to_string()));
        }
    }
}

/// Which movement.
#[derive(Clone, Debug, Args)]
pub struct TrajectoryArguments {
    /// Movement: paper, or a file with [fourier] or [points]
    #[arg(long, value_name = "paper|FILE", default_value = PAPER)]
    pub trajectory: String,
    /// Period T of the paper's movement in s
    #[arg(long, value_name = "SECONDS", default_value_t = 3.65)]
    pub period: f64,
    /// How long to stand at the start before recording, in s
    #[arg(long, value_name = "SECONDS", default_value_t = DEFAULT_SETTLE_S)]
    pub settle: f64,
}

impl TrajectoryArguments {
    /// The paper's movement of this period, as the command line's defaults have it.
    pub fn paper(period_s: f64) -> Self {
        Self { trajectory: PAPER.into(), period: period_s, settle: DEFAULT_SETTLE_S }
    }

    /// The movement, checked against the limits of `robot`.
    pub fn prepare(&self, robot: &Robot) -> Result<Prepared, CommandError> {
        let (trajectory, name) = self.read()?;
        let settle_ns = self.settle_ns()?;
        Prepared::new(trajectory, name, settle_ns, robot).map_err(|error| match error {
            CommandError::Limit(limit) if self.file().is_none() && is_about_position(&limit) => {
                CommandError::PaperMovement(limit)
            }
            error => error,
        })
    }

    /// The file the movement is read from, if any.
    pub fn file(&self) -> Option<&Path> {
        (self.trajectory != PAPER).then(|| Path::new(&self.trajectory))
    }

    fn read(&self) -> Result<(Trajectory, String), CommandError> {
        if self.trajectory == PAPER {
            let period_s = self.period;
            let trajectory = trajectory_file::paper(period_s)
                .ok_or_else(|| CommandError::Usage(format!("--period {period_s} is not a positive time in s")))?;
            return Ok((trajectory, trajectory_file::paper_name(period_s)));
        }
        Ok((trajectory_file::read(self.trajectory.as_ref())?, self.trajectory.clone()))
    }

    fn settle_ns(&self) -> Result<u64, CommandError> {
        if (0.0..=60.0).contains(&self.settle) {
            return Ok((self.settle * 1e9) as u64);
        }
        Err(CommandError::Usage(format!("--settle {} is not from 0 to 60 s", self.settle)))
    }
}

/// Whether a movement goes where the robot may not be, however slowly.
fn is_about_position(limit: &LimitError) -> bool {
    matches!(limit, LimitError::Exceeded(margin) if matches!(margin.quantity, Quantity::PositionLow | Quantity::PositionHigh))
}

/// How near a movement comes to the robot's limits, or the limit it breaks.
fn check_limits(trajectory: &Trajectory, robot: &Robot, limits: &Configuration) -> Result<Margins, CommandError> {
    let counts_per_rad = [0, 1].map(|joint| robot.joints[joint].counts_per_rad() as f32);
    let record_period_ns = u64::from(limits.common.record_period_ns);
    shared::trajectory::check(trajectory, &limits.motion_limits, counts_per_rad, record_period_ns)
        .map_err(CommandError::Limit)
}

/// Recordings with their sidecars.
pub fn with_sidecars(recordings: &[PathBuf]) -> Vec<PathBuf> {
    recordings.iter().flat_map(|path| [path.clone(), Recording::manifest_path(path)]).collect()
}

/// Reads recordings, and passes on what the reader noticed.
pub fn read_recordings(paths: &[PathBuf], robot: &Robot, allow_gaps: bool) -> Result<Vec<Recording>, CommandError> {
    let mut recordings = Vec::new();
    for path in paths {
        let recording = Recording::read(path, robot, ReadOptions { allow_gaps })?;
        for note in &recording.notes {
            advise(format!("{}: {note}", path.display()));
        }
        let made_with = recording.manifest.as_ref().map_or("", |manifest| &manifest.robot);
        advise_other_robot(&Recording::manifest_path(path), made_with, robot);
        if let Some(reason) = recording.manifest.as_ref().and_then(|manifest| manifest.partial.as_ref()) {
            advise(format!("{}: only part of the movement ({reason})", path.display()));
        }
        recordings.push(recording);
    }
    Ok(recordings)
}

/// Refuses a recording that is given twice: its noise would count as if it had been measured twice, and what was fitted
/// cannot be kept back to judge the result on.
pub fn check_distinct<'a>(recordings: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), CommandError> {
    let mut known = Vec::new();
    for path in recordings {
        let whole = path.canonicalize().unwrap_or_else(|_| path.clone());
        if known.contains(&whole) {
            return Err(CommandError::Usage(format!(
                "{} is given twice, and its noise would count as if it had been measured twice; give it once",
                path.display()
            )));
        }
        known.push(whole);
    }
    Ok(())
}

/// A simulated robot with the effects of the command line.
pub fn with_effects(hidden: HiddenRobot, effects: &[String], robot: &Robot) -> Result<HiddenRobot, CommandError> {
    let entries: Vec<Effect> = effects.iter().map(|text| armid::effects::parse(text)).collect::<Result<_, _>>()?;
    let hidden = hidden.with_effects(&entries, robot)?;
    for beyond in MotorInertiaBeyond::all(&entries, robot, hidden.f)? {
        let Effect { name, joint, .. } = &entries[beyond.entry];
        let bound = if beyond.taken_kg_m2 < beyond.wanted_kg_m2 { "at most" } else { "at least" };
        advise(format!(
            "joint {joint}: {name} has motor_inertia_kg_m2 = {}, but with this arm's f the motor has {bound} {:.3e} kg m², \
             and that is the limit of what is simulated",
            significant(beyond.wanted_kg_m2, 4),
            beyond.taken_kg_m2
        ));
    }
    Ok(hidden)
}

/// Reads the model file of a robot.
pub fn read_model(path: &Path, robot: &Robot) -> Result<Model, CommandError> {
    let model = Model::read(path, robot)?;
    let identified_on = model.provenance.get("robot").and_then(|name| name.as_str()).unwrap_or_default();
    advise_other_robot(path, identified_on, robot);
    Ok(model)
}

/// A model in the terms of a board that is about to run computed torque with it: refused where that would be too near to
/// instability. Tells what [`for_simulation`] tells.
pub fn for_board(robot: &Robot, model: &Model) -> Result<shared::protocol::Model, CommandError> {
    let board_model = for_simulation(robot, model)?;
    ArmLoop::of_model(robot, model)?.check(robot)?;
    Ok(board_model)
}

/// A model in the board's terms; tells on stderr which of its effects computed torque does not compensate, and what the
/// compensation of others rests on.
pub fn for_simulation(robot: &Robot, model: &Model) -> Result<shared::protocol::Model, CommandError> {
    for effect in &model.effects {
        let Effect { name, joint, .. } = effect;
        if let Some(reason) = compensation::why_not(name) {
            advise(format!("joint {joint}: computed torque does not compensate {name}: {reason}"));
        } else if compensation::has_phase(effect) {
            advise(format!(
                "joint {joint}: {name} is compensated at the phase it had in the recordings: where the encoder was \
                 switched on anew since, the pose must have been declared as it was then, to a few counts; the board drops \
                 it when a pose is declared after this upload"
            ));
        }
    }
    Ok(compensation::board_model(robot, model)?)
}

/// Tells that a file names another robot than the robot file. Names are free text: a doubt, not an error.
fn advise_other_robot(path: &Path, named: &str, robot: &Robot) {
    if !named.is_empty() && named != robot.name {
        advise(format!(
            "{}: is of the robot \"{named}\", but the robot file's name is \"{}\"; make sure that they belong together",
            path.display(),
            robot.name
        ));
    }
}

/// The folder that things are kept in to be faster the next time: the one given, armid's own among the user's caches, or
/// none where an empty name is given.
pub fn cache_folder(given: Option<&OsStr>) -> Option<PathBuf> {
    match given {
        Some(folder) => (!folder.is_empty()).then(|| PathBuf::from(folder)),
        None => dirs::cache_dir().map(|caches| caches.join("armid")),
    }
}

/// Writes a result to stdout, as [`shown`] lets it be seen. A reader that closed the pipe has what it wanted.
pub fn print(text: impl AsRef<str>) -> Result<(), CommandError> {
    print_as_it_is(&shown::lines(text.as_ref()))
}

fn print_as_it_is(text: &str) -> Result<(), CommandError> {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{}", text.trim_end()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(CommandError::Output(error)),
        _ => Ok(()),
    }
}

/// Writes one JSON object to stdout.
pub fn print_json(value: &serde_json::Value) -> Result<(), CommandError> {
    print_as_it_is(&shown::json(&value.to_string()))
}

/// Writes advice to stderr, on one line. Nothing ends because nobody can be told.
pub fn advise(text: impl AsRef<str>) {
    let _ = writeln!(std::io::stderr(), "{}", shown::line(text.as_ref()));
}

/// [`advise`] on as many lines as the text has.
pub fn advise_lines(text: impl AsRef<str>) {
    let _ = writeln!(std::io::stderr(), "{}", shown::lines(text.as_ref()));
}

//! The messages themselves.

use super::{
    ConfigurationPart, ControlLaw, Info, LoadReport, Mode, Model, RecordingInfo, RecordingRows, Refusal, Sample, Status,
};
use crate::load::{LoadEstimate, LoadNews, LoadSettings};
use crate::trajectory::{Fourier, LimitError, Margins, Paper};
use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

/// Points in one [`TrajectoryPart::Points`], so that it fits a frame.
pub const POINTS_PER_FRAME: usize = 24;

/// What a host sends: one request and its sequence number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HostMessage {
    /// Counts up by one or more from request to request, wrapping.
    pub sequence: u32,
    /// What is asked for.
    pub request: Request,
}

/// What a host may ask for. The reply to each is named; every request may be answered by [`Reply::Refused`] instead.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// First request over a link. → [`Reply::Info`], or [`Reply::WrongVersion`]. Layout frozen for ever.
    Hello {
        /// [`super::PROTOCOL_VERSION`] of the host.
        protocol_version: u8,
    },
    /// What is the board doing? → [`Reply::Status`].
    Status,
    /// Keeps the link alive while the amplifiers are on, as every other request does. → [`Reply::Done`].
    KeepAlive,
    /// Stages one part of the configuration; only in [`Mode::Idle`]. → [`Reply::Done`].
    Configure(ConfigurationPart),
    /// Checks the staged parts and makes them the configuration, whole; only in [`Mode::Idle`]. Forgets pose,
    /// trajectory and models if the robot's identity changes. The board then stores it by itself, as it does an
    /// activated model; [`Status::stored`] says when that is done. → [`Reply::Done`].
    ApplyConfiguration {
        /// [`super::Configuration::crc`] of what the host means.
        crc: u32,
    },
    /// Declares the pose the arm has now; only in [`Mode::Idle`]. Ripple and cogging of models uploaded before are not
    /// compensated any more, for their phases count from the pose before. → [`Reply::Done`].
    SetPosition {
        /// Joint angles in rad.
        position_rad: [f64; 2],
    },
    /// Switches the amplifiers on and holds the present pose; only from [`Mode::Idle`]. → [`Reply::Done`].
    Arm,
    /// Switches the amplifiers off, possible in every mode; a fault stays until it is cleared. → [`Reply::Done`].
    Disarm,
    /// Loads a trajectory, or a part of one; not during a movement. The check against the limits begins with the last
    /// part and takes many ticks. → [`Reply::Trajectory`].
    LoadTrajectory(TrajectoryPart),
    /// How far is the trajectory loaded and checked, with which margins? → [`Reply::Trajectory`].
    ReadTrajectory,
    /// Goes to the start of the trajectory, settles there, follows it, records it, and holds its end; only from
    /// [`Mode::Armed`] and [`Mode::Holding`]. → [`Reply::Started`].
    Run {
        /// The law in charge from the approach on.
        law: ControlLaw,
        /// Whether to send every row as it is recorded, over the link of this request.
        stream: bool,
        /// How long to stand at the start, in ns.
        settle_ns: u64,
    },
    /// Slows down along the path and then holds, in [`Mode::Armed`]; from [`Mode::Holding`] at once. → [`Reply::Done`].
    Stop,
    /// What does the recording hold? → [`Reply::Recording`].
    RecordingInfo,
    /// Reads rows of the recording. → [`Reply::Rows`], at most [`super::ROWS_PER_FRAME`] of them.
    ReadRecording {
        /// Index of the first row wanted.
        from: u32,
        /// How many are wanted.
        count: u16,
    },
    /// First phase of a model upload: checks the model and keeps it beside the active one. → [`Reply::Model`].
    StageModel {
        /// The model.
        model: Model,
        /// [`Model::crc`] as the host computes it.
        crc: u32,
    },
    /// Second phase: makes the staged model the active one, whole. Computed torque that is in charge goes on with
    /// it, without a jump of the current; a recording under way keeps the CRC of the model it began with.
    /// → [`Reply::Model`], now active.
    CommitModel {
        /// [`Model::crc`] of the model meant.
        crc: u32,
    },
    /// Reads a model back. → [`Reply::Model`].
    ReadModel(ModelSlot),
    /// Ends [`Mode::Fault`], to [`Mode::Idle`]; nothing in other modes. → [`Reply::Done`].
    ClearFault,
    /// Forgets what is kept over a restart; what is active stays active until then. Only in [`Mode::Idle`].
    /// → [`Reply::Done`] as soon as that is noted; [`Status::stored`] says when it is done.
    ForgetParameters,
    /// From the next movement under computed torque on a load is assumed and identified; not during a movement, and only
    /// where every loop tick is recorded. Forgotten with the configuration. → [`Reply::Load`].
    IdentifyLoad(LoadSettings),
    /// From the next movement on no load is assumed; not during a movement. → [`Reply::Load`].
    ForgetLoad,
    /// A host has found the load: it enters computed torque, in every mode and by degrees. Only after
    /// [`Self::IdentifyLoad`]. → [`Reply::Load`].
    UseLoad(LoadEstimate),
    /// What load is assumed and found? → [`Reply::Load`].
    ReadLoad,
}

/// One of the two models the board holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ModelSlot {
    /// Uploaded and checked, not in use.
    Staged,
    /// What computed torque runs with.
    Active,
}

/// A trajectory, or a part of one that does not fit a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TrajectoryPart {
    /// The paper's movement.
    Paper(Paper),
    /// A Fourier series.
    Fourier(Fourier),
    /// Begins a movement through points; only in [`Mode::Idle`], as are the points.
    BeginPoints {
        /// Time between points in ns.
        interval_ns: u64,
        /// How many points follow.
        points: u16,
    },
    /// The next points, in order; the trajectory is complete with the last.
    Points {
        /// Index of the first.
        from: u16,
        /// Joint angles in rad.
        points_rad: Vec<[f32; 2], POINTS_PER_FRAME>,
    },
}

/// How far a trajectory is loaded and checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "all fit a frame, and nothing here allocates")]
pub enum TrajectoryState {
    /// There is none.
    Empty,
    /// Points are missing.
    Loading {
        /// Points received.
        received: u16,
        /// Points announced.
        points: u16,
    },
    /// The check against the limits is going on.
    Checking {
        /// Record ticks checked.
        checked: u32,
        /// Record ticks of the movement.
        rows: u32,
    },
    /// It may be run.
    Accepted {
        /// How near it comes to each limit.
        margins: Margins,
        /// Rows its recording will have.
        rows: u32,
    },
    /// It breaks a limit and was thrown away.
    Refused(LimitError),
}

/// [`TrajectoryState`] without its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TrajectoryPhase {
    /// There is none.
    Empty,
    /// Points are missing.
    Loading,
    /// The check against the limits is going on.
    Checking,
    /// It may be run.
    Accepted,
    /// It breaks a limit and was thrown away.
    Refused,
}

/// What the board sends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "all fit a frame, and nothing here allocates")]
pub enum BoardMessage {
    /// The answer to a request.
    Reply {
        /// Sequence number of the request.
        sequence: u32,
        /// The answer.
        reply: Reply,
    },
    /// A row, as it was recorded. What is lost on the way is still in the recording.
    Telemetry {
        /// [`RecordingInfo::movement`] of the row.
        movement: u32,
        /// The row.
        sample: Sample,
    },
    /// Something happened that nobody asked for.
    Event(Event),
}

/// Answers. None is wider than a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply {
    /// Host and board speak different versions; update the older. Layout frozen for ever.
    WrongVersion {
        /// [`super::PROTOCOL_VERSION`] of the board.
        board: u8,
        /// Version the host named, or the header of the frame it sent.
        host: u8,
        /// Version of the firmware, for people.
        firmware_version: String<16>,
    },
    /// Who the board is.
    Info(Info),
    /// What it is doing.
    Status(Status),
    /// Done, and nothing to report.
    Done,
    /// The state of the trajectory.
    Trajectory(TrajectoryState),
    /// A movement has begun.
    Started {
        /// Its number, as in [`RecordingInfo::movement`].
        movement: u32,
        /// Time until the trajectory begins: approach and settling, in ns.
        approach_ns: u64,
        /// Rows it will have.
        rows: u32,
    },
    /// What the recording holds.
    Recording(RecordingInfo),
    /// Rows of the recording.
    Rows(RecordingRows),
    /// A model, as the board holds it now.
    Model {
        /// Where it is held.
        slot: ModelSlot,
        /// The model; `None` where the slot is empty.
        model: Option<Model>,
        /// Its CRC-32 as the board computes it from what it holds; 0 for none.
        crc: u32,
    },
    /// Not done.
    Refused(Refusal),
    /// What load the board assumes.
    Load(LoadReport),
}

/// What the board tells unasked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// The mode changed.
    Mode {
        /// Loop tick of the change.
        tick: u64,
        /// The new mode, with the fault if it is one.
        mode: Mode,
    },
    /// The identification of a load has come further.
    Load {
        /// Loop tick at which the board heard of it.
        tick: u64,
        /// How far.
        news: LoadNews,
    },
}

//! What the board is and what it is doing.

use super::{Fault, LimitsActive, RecordingInfo, StoredParameters, TrajectoryPhase};
use heapless::String;
use serde::{Deserialize, Serialize};

/// The wire a request came over, and over which its reply and telemetry go back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Link {
    /// USB CDC-ACM, or whatever carries the first link of a simulated board.
    Usb,
    /// The serial line.
    Serial,
}

impl Link {
    /// Every link, in the order of [`Info::links`].
    pub const ALL: [Self; 2] = [Self::Usb, Self::Serial];
}

/// The law that computes the motor currents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ControlLaw {
    /// The decentralised position loop with lead ([`crate::control::PositionLoop`]).
    Position,
    /// Computed torque with the active model ([`crate::control::ComputedTorque`]).
    ComputedTorque,
}

/// What the board is doing. Amplifiers are on in every mode but [`Mode::Idle`] and [`Mode::Fault`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
// Copied by words, like a refusal.
#[repr(u32)]
pub enum Mode {
    /// Amplifiers off, commands at mid-scale, the brakes hold the arm.
    Idle,
    /// Amplifiers on; the position loop holds the pose the arm had.
    Armed,
    /// On the way to the start of the trajectory, and settling there.
    Approaching(ControlLaw),
    /// On the trajectory, recording.
    Running(ControlLaw),
    /// Slowing down along the path after [`Request::Stop`](super::Request::Stop).
    Stopping(ControlLaw),
    /// Holding the end of the trajectory.
    Holding(ControlLaw),
    /// Amplifiers off, commands at mid-scale, until the fault is cleared.
    Fault(Fault),
}

impl Mode {
    /// Whether amplifiers are on and a loop is closed.
    pub fn is_powered(&self) -> bool {
        !matches!(self, Self::Idle | Self::Fault(_))
    }

    /// Whether the reference is moving, or about to.
    pub fn is_moving(&self) -> bool {
        matches!(self, Self::Approaching(_) | Self::Running(_) | Self::Stopping(_))
    }

    /// The law in charge, where a loop is closed.
    pub fn law(&self) -> Option<ControlLaw> {
        match *self {
            Self::Idle | Self::Fault(_) => None,
            Self::Armed => Some(ControlLaw::Position),
            Self::Approaching(law) | Self::Running(law) | Self::Stopping(law) | Self::Holding(law) => Some(law),
        }
    }

    /// The mode's name as shown to people.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Armed => "armed",
            Self::Approaching(_) => "approaching",
            Self::Running(ControlLaw::Position) => "running-p",
            Self::Running(ControlLaw::ComputedTorque) => "running-ctc",
            Self::Stopping(_) => "stopping",
            Self::Holding(_) => "holding",
            Self::Fault(_) => "fault",
        }
    }
}

/// Answer to [`Request::Status`](super::Request::Status): the state at the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// What the board is doing, with the fault if there is one.
    pub mode: Mode,
    /// Loop ticks since the board started.
    pub tick: u64,
    /// Motor positions in counts: `fix()` of the declared pose and what was counted since; before a pose was declared,
    /// what was counted since the start.
    pub position_counts: [i32; 2],
    /// Whether a pose was declared and the counters have been followed without a jump ever since.
    pub pose_known: bool,
    /// Reference less actual position in counts; 0 while the amplifiers are off.
    pub error_counts: [i32; 2],
    /// Measured armature currents in A.
    pub current_a: [f32; 2],
    /// Whether the emergency stop is pressed.
    pub emergency_stop: bool,
    /// Limits that have acted since arming.
    pub limits_active: LimitsActive,
    /// CRC-32 of the applied configuration; `None` where there is none.
    pub configuration_crc: Option<u32>,
    /// CRC-32 of the active model; `None` where there is none.
    pub active_model_crc: Option<u32>,
    /// CRC-32 of the staged model; `None` where there is none.
    pub staged_model_crc: Option<u32>,
    /// What is kept over a restart.
    pub stored: StoredParameters,
    /// How far the trajectory is loaded and checked.
    pub trajectory: TrajectoryPhase,
    /// What the recording holds.
    pub recording: RecordingInfo,
}

/// Why the processor last started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetCause {
    /// Power was switched on, or dipped.
    PowerOn,
    /// The reset pin or button.
    Pin,
    /// The watchdog: the control tick was not seen alive.
    Watchdog,
    /// The firmware restarted itself, after a panic or a hardware fault among other things.
    Software,
    /// None of these, or not a board.
    Other,
}

impl ResetCause {
    /// The cause's name as shown to people and programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::PowerOn => "power-on",
            Self::Pin => "reset-pin",
            Self::Watchdog => "watchdog",
            Self::Software => "software",
            Self::Other => "other",
        }
    }
}

/// What the firmware knows about itself and its chip; given to the board when it is built.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoardIdentity {
    /// Version of the firmware package.
    pub firmware_version: String<16>,
    /// Git revision the firmware was built from, with `-dirty` where it was.
    pub git_revision: String<24>,
    /// Name of the board, such as `nucleo-f429zi` or `simulated`.
    pub board: String<24>,
    /// The chip's unique number.
    pub chip_id: [u8; 12],
    /// The chip's revision code (REV_ID on an STM32).
    pub chip_revision: u16,
    /// Why the processor last started.
    pub reset_cause: ResetCause,
}

/// Times measured by the firmware; all 0 until it has measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Timing {
    /// Frequency of the cycle counter in Hz.
    pub cycles_per_second: u32,
    /// Longest control tick in cycles, requests included, since the amplifiers were last switched on.
    pub worst_tick_cycles: u32,
    /// Latest start of a control tick after its timer event, in cycles.
    pub worst_start_cycles: u32,
    /// Earliest start of a control tick after its timer event, in cycles; the jitter is the difference.
    pub best_start_cycles: u32,
    /// Ticks that were not finished when the next one was due.
    pub missed_deadlines: u32,
}

/// Traffic of one link since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkCounters {
    /// Frames received whole and valid.
    pub received: u32,
    /// Frames thrown away, of whatever kind ([`super::FrameCounters`] has them apart).
    pub bad_frames: u32,
    /// Telemetry frames not sent because the host did not take them; they stay in the recording.
    pub telemetry_dropped: u32,
    /// Replies and events not sent because the host did not take them.
    pub replies_dropped: u32,
}

/// Answer to [`Request::Hello`](super::Request::Hello) of a host of the same protocol version.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// [`super::PROTOCOL_VERSION`] of the board.
    pub protocol_version: u8,
    /// The firmware and its chip.
    pub identity: BoardIdentity,
    /// How many rows a recording can have.
    pub recording_capacity: u32,
    /// How many knots a trajectory of points can have.
    pub knot_capacity: u16,
    /// [`super::Configuration::robot_identity`] of the applied configuration; `None` where there is none.
    pub robot_identity: Option<u32>,
    /// The latest fault, cleared or not: since the start, or else the last one before it, of those that were kept over
    /// the reset ([`crate::board::KeptFault`]).
    pub last_fault: Option<Fault>,
    /// Times measured by the firmware.
    pub timing: Timing,
    /// Traffic of each link, in the order of [`Link::ALL`].
    pub links: [LinkCounters; 2],
}

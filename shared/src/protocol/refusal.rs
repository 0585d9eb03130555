//! Why a request was not carried out.

use super::{ConfigurationError, Mode, ModelError, PartName};
use crate::load::LoadSettingError;
use crate::trajectory::LimitError;
use serde::{Deserialize, Serialize};

/// A request that was not carried out, with the numbers that decided and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
// So that what a variant holds begins at a whole word, and the board copies it by words, not by bytes.
#[repr(u32)]
pub enum Refusal {
    /// The board has started since the last hello over this link, or there was none.
    #[error("no hello over this link since the board started; connect again")]
    NotGreeted,
    /// A request older than the last one over this link.
    #[error("request {sequence} is older than the last one, {last}; send requests in order")]
    StaleSequence {
        /// Its number.
        sequence: u32,
        /// Number of the last request over the link.
        last: u32,
    },
    /// Not possible in the present mode.
    #[error("not possible while {}; {}", mode.name(), wrong_mode_remedy(mode))]
    WrongMode {
        /// The present mode.
        mode: Mode,
    },
    /// The board has no configuration.
    #[error("the board has no robot constants; apply a robot file first")]
    NotConfigured,
    /// A part of the configuration was not sent.
    #[error("the configuration lacks its part {part:?}; send every part, then apply")]
    MissingPart {
        /// The first that is missing.
        part: PartName,
    },
    /// The configuration is not acceptable.
    #[error("{0}")]
    Configuration(ConfigurationError),
    /// The pose is not known.
    #[error("the pose of the arm is not known; bring it to a known pose and declare that (set the position)")]
    PoseUnknown,
    /// A declared pose is not a finite number, or not countable.
    #[error("the declared position of {joint} is {value} rad, which is not a position; declare a finite joint angle")]
    BadPosition {
        /// Which joint.
        joint: super::Joint,
        /// The angle declared.
        value: f64,
    },
    /// The emergency stop is pressed.
    #[error("the emergency stop is pressed; release it first")]
    EmergencyStop,
    /// The flash memory is being written to, which must not happen while the amplifiers are on.
    #[error(
        "the board is storing its parameters; arm again in some 20 ms, or up to 4 s when the memory has to be erased"
    )]
    Storing,
    /// No trajectory is loaded and accepted.
    #[error("no trajectory is loaded, checked and accepted; load one and wait for the check")]
    NoTrajectory,
    /// Points came out of order, more than announced, or without an announcement.
    #[error("points from {from} on do not follow the {received} of {points} received; send them again from the start")]
    PointsOutOfOrder {
        /// Index of the first point sent.
        from: u16,
        /// Points received before.
        received: u16,
        /// Points announced; 0 for no announcement.
        points: u16,
    },
    /// The trajectory, or the way to its start, breaks a limit.
    #[error("{0}")]
    Limit(LimitError),
    /// The movement has more rows than the recording.
    #[error("the movement has {rows} rows, the recording holds {capacity}; shorten the movement")]
    TooManyRows {
        /// Rows of the movement.
        rows: u64,
        /// Rows the recording holds.
        capacity: u32,
    },
    /// The movement changes too much from row to row to be recorded, or checked.
    #[error(
        "the shortest period, fade or interval of the movement is {shortest_ns} ns, at least {least_ns} ns are needed; \
         make it slower"
    )]
    TooFine {
        /// The shortest there is, in ns.
        shortest_ns: u64,
        /// The shortest allowed, in ns.
        least_ns: u64,
    },
    /// Settling longer than is allowed.
    #[error("settling for {settle_ns} ns is longer than {limit_ns} ns; settle for less")]
    SettleTooLong {
        /// Time asked for in ns.
        settle_ns: u64,
        /// Longest allowed in ns.
        limit_ns: u64,
    },
    /// There is no model.
    #[error("there is no model in that slot; upload one")]
    NoModel,
    /// The model is not acceptable.
    #[error("{0}")]
    Model(ModelError),
    /// What arrived, or what is staged, is not what was meant.
    #[error("CRC {board:08x} of what the board holds is not the {host:08x} meant; send it again")]
    CrcMismatch {
        /// CRC named in the request.
        host: u32,
        /// CRC of what the board received.
        board: u32,
    },
    /// A setting of the load identification is outside its limits.
    #[error("{0}")]
    Load(LoadSettingError),
    /// A load that cannot be, or none is to be identified.
    #[error(
        "no load can be used, or not this one: ask the board to identify loads first, with a largest mass above this one"
    )]
    BadLoad,
    /// Not every loop tick is recorded, so the commands in between are not known.
    #[error(
        "a load is identified only where every loop tick is recorded: the loop runs every {loop_ns} ns, rows come every \
         {record_ns} ns; make loop_period_s and record_period_s of the robot file equal"
    )]
    LoadNeedsEveryTick {
        /// Loop period in ns.
        loop_ns: u64,
        /// Record period in ns.
        record_ns: u64,
    },
}

fn wrong_mode_remedy(mode: &Mode) -> &'static str {
    match mode {
        Mode::Idle => "arm first",
        Mode::Fault(_) => "clear the fault first",
        Mode::Armed | Mode::Holding(_) => "disarm first, or stop computed torque",
        Mode::Approaching(_) | Mode::Running(_) | Mode::Stopping(_) => "wait for the end of the movement, or stop it",
    }
}

//! What travels between board and host: requests, replies, telemetry, and the frames they travel in.
//!
//! One message is one frame: `COBS(header, postcard(message), CRC-32 little endian), 0x00`. The CRC is on every frame,
//! because two halves of cut frames can decode as a valid wrong command. The header byte is the protocol version, or
//! [`HANDSHAKE_HEADER`] for the two messages whose layout never changes, so a host and a board of different versions
//! still understand each other's refusal.
//!
//! # Sequence numbers
//! Every request carries a sequence number and its reply echoes it. A host starts with [`Request::Hello`], which sets
//! the link's number; each further request counts it up by one or more, wrapping. A request that arrives again with
//! the number of the link's last one is not carried out again: the board repeats the reply it gave. An older number is
//! refused ([`Refusal::StaleSequence`]). So a host may repeat any request until it is answered, and a frame that was
//! delayed on the way can do nothing.
//!
//! # Chunks
//! No frame is longer than [`MAX_FRAME`] bytes, so the board's buffers stay small: constants, trajectory points and
//! recordings go in parts.

mod compensation;
mod configuration;
mod fault;
mod frame;
mod limits;
mod load;
mod messages;
mod model;
mod recording;
mod refusal;
mod status;
mod stored;
pub mod usb;

pub use compensation::JointCompensation;
pub use configuration::{
    ComputedTorqueConstants, Configuration, ConfigurationError, ConfigurationPart, CurrentScale, Field, GainLimitCause,
    Joint, JointConstants, LOOP_PERIODS_NS, LoopConstants, PartName,
};
pub use fault::{Fault, SourcePlace};
pub(crate) use frame::{Checksum, crc_32};
pub use frame::{Decoder, EncodeError, FrameCounters, FrameError, encode_board_message, encode_host_message};
pub use limits::{ActiveLimit, LimitsActive};
pub use load::LoadReport;
pub use messages::{
    BoardMessage, Event, HostMessage, ModelSlot, POINTS_PER_FRAME, Reply, Request, TrajectoryPart, TrajectoryPhase,
    TrajectoryState,
};
pub use model::{Model, ModelError, ModelRange};
pub use recording::{EndedBy, PACKED_SAMPLE_BYTES, PackedSample, ROWS_PER_FRAME, RecordingInfo, RecordingRows, Sample};
pub use refusal::Refusal;
pub use status::{BoardIdentity, ControlLaw, Info, Link, LinkCounters, Mode, ResetCause, Status, Timing};
pub use stored::{StoreFailure, StoreState, StoredParameters};

/// Version of everything in this module but the handshake; raised with every change of a message's layout.
pub const PROTOCOL_VERSION: u8 = 5;

/// Header byte of the messages whose layout is frozen for ever: [`Request::Hello`] and [`Reply::WrongVersion`].
pub const HANDSHAKE_HEADER: u8 = 0;

/// Longest frame on the wire, in bytes, COBS overhead and the closing 0 included.
pub const MAX_FRAME: usize = 320;

/// Longest frame content before COBS: header byte, message and CRC.
pub const MAX_CONTENT: usize = MAX_FRAME - 3;

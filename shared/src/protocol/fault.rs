//! Why the board switched the amplifiers off, or restarted.

use super::Joint;
use core::fmt::{self, Write as _};
use serde::{Deserialize, Serialize};

/// A reason to switch off. Every fault puts both commands at mid-scale and takes the amplifier-enable away in the tick
/// that sees it; on a PUMA the brakes then engage, because they are released by power. Those that stop the firmware
/// itself ([`Fault::halts`], [`Fault::Watchdog`]) do the same, and are known only after the restart that follows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum Fault {
    /// The emergency stop was pressed while the amplifiers were on.
    #[error("emergency-stop: the emergency stop is pressed; {}", self.remedy())]
    EmergencyStop,
    /// A joint strayed too far from its reference.
    #[error("following-error: {joint} is {error_counts} counts from its reference, limit {limit_counts}; {}", self.remedy())]
    FollowingError {
        /// Which joint.
        joint: Joint,
        /// Its error in counts.
        error_counts: i32,
        /// `following_error_limit_counts` of the configuration.
        limit_counts: i32,
    },
    /// A measured current was too large.
    #[error("over-current: {joint} draws {current_a:.2} A, limit {limit_a:.2} A; {}", self.remedy())]
    OverCurrent {
        /// Which joint.
        joint: Joint,
        /// The measured current in A.
        current_a: f32,
        /// `over_current_limit_a` of the configuration.
        limit_a: f32,
    },
    /// A command stayed at the amplifier's limit for too long.
    #[error("current-limit: the command of {joint} was at its limit of {limit_a:.2} A for {held_ns} ns; {}", self.remedy())]
    CurrentLimit {
        /// Which joint.
        joint: Joint,
        /// `current_limit_a` of the configuration.
        limit_a: f32,
        /// How long it stayed there, in ns.
        held_ns: u64,
    },
    /// A motor turned too fast.
    #[error("over-speed: {joint} turns at {speed_rad_s:.2} rad/s, limit {limit_rad_s:.2} rad/s; {}", self.remedy())]
    OverSpeed {
        /// Which joint.
        joint: Joint,
        /// Joint speed over the last record period in rad/s.
        speed_rad_s: f32,
        /// `speed_limit_rad_s` of the configuration.
        limit_rad_s: f32,
    },
    /// The host that switched on, or began the last movement, fell silent while the amplifiers were on.
    #[error("link-lost: no valid request for {silent_ns} ns with the amplifiers on, limit {limit_ns} ns; {}", self.remedy())]
    LinkLost {
        /// Time since the last valid request over the link that started the movement, in ns.
        silent_ns: u64,
        /// `link_timeout_ns` of the configuration.
        limit_ns: u64,
    },
    /// A control tick came too late or was left out.
    #[error("deadline-missed: a control tick was late or left out; {}", self.remedy())]
    DeadlineMissed,
    /// An encoder counted more than a motor can turn in one tick; the pose is unknown from then on.
    #[error("encoder-jump: {joint} jumped by {jump_counts} counts in one tick, plausible are {limit_counts}; {}", self.remedy())]
    EncoderJump {
        /// Which joint.
        joint: Joint,
        /// Change of the counter in one loop tick.
        jump_counts: i32,
        /// Four times what the speed limit allows, plus a margin.
        limit_counts: i32,
    },
    /// A value kept twice no longer agrees with its copy: something changed the memory.
    #[error("memory-corrupted: the pose to hold no longer agrees with its copy; {}", self.remedy())]
    MemoryCorrupted,
    /// Computed torque gave a command that is not a number.
    #[error("bad-model: the model gave no finite command for {joint}; {}", self.remedy())]
    BadModel {
        /// Which joint.
        joint: Joint,
    },
    /// The firmware found itself in a state it was not written for, and stopped.
    #[error("panic: the firmware stopped at {place}; {}", self.remedy())]
    Panic {
        /// Where in the firmware.
        place: SourcePlace,
    },
    /// The processor could not go on: an instruction it does not know, a memory it may not touch, and the like.
    #[error("hard-fault: the processor stopped at {program_counter:#010x}, status {status:#010x}; {}", self.remedy())]
    HardFault {
        /// Address of the instruction; 0 where the stack had overflowed.
        program_counter: u32,
        /// The processor's CFSR register (ARMv7-M B3.2.15).
        status: u32,
    },
    /// An address did not answer.
    #[error("bus-error: {address:#010x} did not answer the instruction at {program_counter:#010x}; {}", self.remedy())]
    BusError {
        /// Address of the instruction, or of one shortly after it; 0 where the stack had overflowed.
        program_counter: u32,
        /// The address, 0 where it is not known.
        address: u32,
    },
    /// An interrupt came that nobody expects, such as the one of a failed clock.
    #[error("unexpected-interrupt: interrupt {number} came, which nobody expects; {}", self.remedy())]
    UnexpectedInterrupt {
        /// Its number; −14 for the NMI.
        number: i16,
    },
    /// The watchdog restarted the board, because control ticks or tasks stopped.
    #[error("watchdog: the control ticks or the tasks stopped, and the watchdog restarted the board; {}", self.remedy())]
    Watchdog,
}

/// A line of source code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourcePlace {
    /// The last bytes of the file's path, zeros before them.
    file: [u8; SourcePlace::FILE_BYTES],
    /// Number of the line, from 1; 0 where the place is not known.
    line: u32,
}

impl SourcePlace {
    /// How much of the path is kept.
    const FILE_BYTES: usize = 20;

    /// A place that is not known.
    pub const UNKNOWN: Self = Self { file: [0; Self::FILE_BYTES], line: 0 };

    /// A line of the file at `path`.
    pub fn new(path: &str, line: u32) -> Self {
        let mut place = Self { line, ..Self::UNKNOWN };
        for (kept, byte) in place.file.iter_mut().rev().zip(path.bytes().rev()) {
            *kept = byte;
        }
        place
    }
}

/// `link.rs:57`: the end of the path, whole names where one fits.
impl fmt::Display for SourcePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line == 0 {
            return f.write_str("a place that is not known");
        }
        let start = self.file.iter().position(|&byte| byte == b'/').map_or(0, |separator| separator + 1);
        for &byte in self.file.iter().skip(start).filter(|&&byte| byte != 0) {
            f.write_char(if byte.is_ascii_graphic() { char::from(byte) } else { '?' })?;
        }
        write!(f, ":{}", self.line)
    }
}

impl Fault {
    /// What the processor's fault registers say: CFSR in `status` and BFAR in `address` (ARMv7-M B3.2.15, B3.2.18).
    pub fn of_processor(program_counter: u32, status: u32, address: u32) -> Self {
        /// Every kind of bus fault.
        const BUS_FAULTS: u32 = 0x7F00;
        /// Whether the address register holds the address.
        const ADDRESS_VALID: u32 = 1 << 15;
        if status & BUS_FAULTS == 0 {
            return Self::HardFault { program_counter, status };
        }
        let address = if status & ADDRESS_VALID == 0 { 0 } else { address };
        Self::BusError { program_counter, address }
    }

    /// Whether nothing runs any more after it until the watchdog restarts the board.
    pub fn halts(&self) -> bool {
        matches!(
            self,
            Self::Panic { .. } | Self::HardFault { .. } | Self::BusError { .. } | Self::UnexpectedInterrupt { .. }
        )
    }

    /// The fault's name: what `info`, logs and reports show.
    pub fn name(&self) -> &'static str {
        match self {
            Self::EmergencyStop => "emergency-stop",
            Self::FollowingError { .. } => "following-error",
            Self::OverCurrent { .. } => "over-current",
            Self::CurrentLimit { .. } => "current-limit",
            Self::OverSpeed { .. } => "over-speed",
            Self::LinkLost { .. } => "link-lost",
            Self::DeadlineMissed => "deadline-missed",
            Self::EncoderJump { .. } => "encoder-jump",
            Self::MemoryCorrupted => "memory-corrupted",
            Self::BadModel { .. } => "bad-model",
            Self::Panic { .. } => "panic",
            Self::HardFault { .. } => "hard-fault",
            Self::BusError { .. } => "bus-error",
            Self::UnexpectedInterrupt { .. } => "unexpected-interrupt",
            Self::Watchdog => "watchdog",
        }
    }

    /// What to do about it.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::EmergencyStop => "release it, then clear the fault",
            Self::FollowingError { .. } => {
                "look for an obstacle, a wrong encoder direction or a gain too low; or raise following_error_limit_counts"
            }
            Self::OverCurrent { .. } => "check the motor's wiring and the current scale",
            Self::CurrentLimit { .. } => "look for a blocked joint, or choose a slower trajectory",
            Self::OverSpeed { .. } => "choose a slower trajectory, or check the encoder",
            Self::LinkLost { .. } => "check the cable; while the amplifiers are on, send keep-alives or other requests",
            Self::DeadlineMissed => "choose a longer loop period, and report the timing shown by info",
            Self::EncoderJump { .. } => "check the encoder's wiring and shielding, then declare the pose again",
            Self::MemoryCorrupted => "restart the board, and replace it if this happens again",
            Self::BadModel { .. } => "identify the arm again and upload the new model",
            Self::Panic { .. }
            | Self::HardFault { .. }
            | Self::BusError { .. }
            | Self::UnexpectedInterrupt { .. }
            | Self::Watchdog => "report this with what info shows; the board has restarted, idle and without a pose",
        }
    }
}

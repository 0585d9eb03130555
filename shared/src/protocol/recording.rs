//! Recorded rows: whole, and packed into 14 bytes for the board's RAM and the wire.

use super::{Fault, LimitsActive};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Bytes of a packed row: 10 500 rows are 147 000 bytes.
pub const PACKED_SAMPLE_BYTES: usize = 14;

/// Rows in one [`RecordingRows`], so that it fits a frame.
pub const ROWS_PER_FRAME: usize = 15;

/// One row of a recording: reference, error and current at one instant, and the command computed from that error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sample {
    /// Record periods since the start of the movement.
    pub index: u32,
    /// Reference in counts after `fix()`.
    pub reference_counts: [i32; 2],
    /// Reference minus actual position, in counts.
    pub error_counts: [i16; 2],
    /// Measured armature currents as converter codes; taken at the same instant, so they show the command of the tick
    /// before. [`super::CurrentScale::measured_a`] turns them into amperes.
    pub current_code: [u16; 2],
    /// The codes sent to the amplifiers, computed from this row's error.
    /// [`super::CurrentScale::command_a`] turns them into amperes.
    pub command_code: [u16; 2],
}

/// A [`Sample`] in 14 bytes: two errors of 16 bits, four codes of 12 bits, and the low 16 bits of both references.
///
/// The reference changes by less than 2¹⁵ counts a row (checked before motion), so its low 16 bits give it back
/// exactly from the row before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PackedSample(pub [u8; PACKED_SAMPLE_BYTES]);

impl PackedSample {
    /// A row of zeros: what an empty recording is made of.
    pub const EMPTY: Self = Self([0; PACKED_SAMPLE_BYTES]);

    /// Packs a row; codes must be of 12 bits, higher bits are lost.
    pub fn pack(sample: &Sample) -> Self {
        let [e0, e1] = sample.error_counts.map(i16::to_le_bytes);
        let [r0, r1] = sample.reference_counts.map(|counts| (counts as u16).to_le_bytes());
        let [c0, c1, c2] = pack_codes(sample.current_code);
        let [u0, u1, u2] = pack_codes(sample.command_code);
        Self([e0[0], e0[1], e1[0], e1[1], r0[0], r0[1], r1[0], r1[1], c0, c1, c2, u0, u1, u2])
    }

    /// The row of number `index`, given a reference less than 2¹⁵ counts from its own: that of the row before, or its
    /// own.
    pub fn unpack(&self, index: u32, near_reference_counts: [i32; 2]) -> Sample {
        let [e0, e1, e2, e3, _, _, _, _, c0, c1, c2, u0, u1, u2] = self.0;
        Sample {
            index,
            reference_counts: self.reference_counts(near_reference_counts),
            error_counts: [i16::from_le_bytes([e0, e1]), i16::from_le_bytes([e2, e3])],
            current_code: unpack_codes([c0, c1, c2]),
            command_code: unpack_codes([u0, u1, u2]),
        }
    }

    /// The row's reference alone, given one less than 2¹⁵ counts from it.
    pub fn reference_counts(&self, near_reference_counts: [i32; 2]) -> [i32; 2] {
        let [_, _, _, _, r0, r1, r2, r3, ..] = self.0;
        let [near0, near1] = near_reference_counts;
        [
            continue_reference(near0, u16::from_le_bytes([r0, r1])),
            continue_reference(near1, u16::from_le_bytes([r2, r3])),
        ]
    }
}

/// The number nearest `near` whose low 16 bits are `low`.
fn continue_reference(near: i32, low: u16) -> i32 {
    near.wrapping_add(i32::from(low.wrapping_sub(near as u16) as i16))
}

fn pack_codes([first, second]: [u16; 2]) -> [u8; 3] {
    [first as u8, (first >> 8 & 0xF) as u8 | (second << 4) as u8, (second >> 4) as u8]
}

fn unpack_codes([low, middle, high]: [u8; 3]) -> [u16; 2] {
    let [low, middle, high] = [u16::from(low), u16::from(middle), u16::from(high)];
    [low | (middle & 0xF) << 8, middle >> 4 | high << 4]
}

/// Consecutive rows of a recording, one frame of them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingRows {
    /// Which movement they belong to: [`RecordingInfo::movement`].
    pub movement: u32,
    /// Index of the first row.
    pub from: u32,
    /// References of the first row in full.
    pub first_reference_counts: [i32; 2],
    /// The rows; empty past the end of what is recorded.
    pub rows: Vec<PackedSample, ROWS_PER_FRAME>,
}

impl RecordingRows {
    /// The rows unpacked, in order.
    pub fn samples(&self) -> impl Iterator<Item = Sample> {
        let mut reference = self.first_reference_counts;
        let mut index = self.from;
        self.rows.iter().map(move |row| {
            let sample = row.unpack(index, reference);
            reference = sample.reference_counts;
            index = index.wrapping_add(1);
            sample
        })
    }
}

/// How a movement ended.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum EndedBy {
    /// The whole trajectory was recorded.
    Completed,
    /// A host asked for a stop or a disarm.
    Stopped,
    /// A fault.
    Fault(Fault),
}

/// What the recording in RAM holds. It stays readable, any number of times, until the next movement is started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordingInfo {
    /// Number of the movement since the board started, from 1; 0 where there was none.
    pub movement: u32,
    /// Rows recorded so far.
    pub rows: u32,
    /// Rows the movement has when completed.
    pub planned_rows: u32,
    /// How it ended; `None` while it runs, or where there was none.
    pub ended: Option<EndedBy>,
    /// Limits that acted during this movement, approach included.
    pub limits_active: LimitsActive,
    /// CRC-32 of the configuration the movement ran with.
    pub configuration_crc: u32,
    /// CRC-32 of the model the movement ran with; `None` under the position loop.
    pub model_crc: Option<u32>,
}

//! The recording in RAM.

use crate::protocol::{
    EndedBy, LimitsActive, PackedSample, ROWS_PER_FRAME, RecordingInfo, RecordingRows, Reply, Sample,
};
use heapless::Vec;

/// How many references are kept in full, evenly over the recording, so that any row is read without unpacking all
/// before it.
const CHECKPOINTS: usize = 256;

/// The rows of the last movement.
#[derive(Clone, Debug)]
pub(super) struct Recording<R> {
    rows: R,
    info: RecordingInfo,
    /// References of rows 0, stride, 2·stride …
    checkpoints: [[i32; 2]; CHECKPOINTS],
    stride: usize,
}

impl<R: AsRef<[PackedSample]> + AsMut<[PackedSample]>> Recording<R> {
    pub(super) fn new(rows: R) -> Self {
        let stride = rows.as_ref().len().div_ceil(CHECKPOINTS).max(1);
        Self { rows, info: RecordingInfo::default(), checkpoints: [[0; 2]; CHECKPOINTS], stride }
    }

    /// How many rows fit.
    pub(super) fn capacity(&self) -> u32 {
        self.rows.as_ref().len().try_into().unwrap_or(u32::MAX)
    }

    pub(super) fn info(&self) -> RecordingInfo {
        self.info
    }

    /// Forgets the last movement and begins the next.
    pub(super) fn begin(&mut self, planned_rows: u32, configuration_crc: u32, model_crc: Option<u32>) {
        let movement = self.info.movement.wrapping_add(1);
        self.info = RecordingInfo { movement, planned_rows, configuration_crc, model_crc, ..RecordingInfo::default() };
    }

    /// Adds the next row, whose index is the number of rows so far. A row beyond the room is dropped; a movement of
    /// too many rows is refused before it runs, so there is none.
    pub(super) fn push(&mut self, sample: &Sample) {
        let index = self.info.rows as usize;
        if let Some(place) = self.rows.as_mut().get_mut(index) {
            *place = PackedSample::pack(sample);
            self.info.rows += 1;
            if index.is_multiple_of(self.stride)
                && let Some(checkpoint) = self.checkpoints.get_mut(index / self.stride)
            {
                *checkpoint = sample.reference_counts;
            }
        }
    }

    /// Adds limits that acted during this movement.
    pub(super) fn note_limits(&mut self, limits: LimitsActive) {
        self.info.limits_active.merge(limits);
    }

    /// Ends the movement, if it has not ended yet.
    pub(super) fn end(&mut self, how: EndedBy) {
        if self.info.movement != 0 && self.info.ended.is_none() {
            self.info.ended = Some(how);
        }
    }

    /// Answers with rows from `from` on, at most `count` and at most a frame of them. Looks at half of `stride` rows
    /// more at most.
    pub(super) fn report(&self, from: u32, count: u16, reply: &mut Reply) {
        let recorded = self.rows.as_ref().get(..self.info.rows as usize).unwrap_or(&[]);
        report(&self.info, recorded, (&self.checkpoints, self.stride), from, count, reply);
    }
}

/// Not generic and not inlined, so that it is compiled here, for speed, and not for size with the firmware.
#[inline(never)]
fn report(
    info: &RecordingInfo,
    recorded: &[PackedSample],
    (checkpoints, stride): (&[[i32; 2]], usize),
    from: u32,
    count: u16,
    reply: &mut Reply,
) {
    let first = from as usize;
    let wanted = recorded.get(first..).unwrap_or(&[]);
    let mut reference_counts = [0; 2];
    if !wanted.is_empty() {
        // From the nearest checkpoint, whichever side it is on: a reference is found from either neighbour's.
        let near = (first + stride / 2) / stride;
        let checkpoint = if near * stride < recorded.len() { near } else { first / stride };
        let start = checkpoint * stride;
        reference_counts = checkpoints.get(checkpoint).copied().unwrap_or_default();
        let mut pass = |row: &PackedSample| reference_counts = row.reference_counts(reference_counts);
        if start <= first {
            recorded.get(start..=first).unwrap_or(&[]).iter().for_each(&mut pass);
        } else {
            recorded.get(first..start).unwrap_or(&[]).iter().rev().for_each(&mut pass);
        }
    }
    let movement = info.movement;
    *reply = Reply::Rows(RecordingRows { movement, from, first_reference_counts: reference_counts, rows: Vec::new() });
    if let Reply::Rows(answer) = reply {
        let count = usize::from(count).min(ROWS_PER_FRAME).min(wanted.len());
        for row in wanted.iter().take(count) {
            // Always room: the answer holds as many as a frame.
            let _ = answer.rows.push(*row);
        }
    }
}

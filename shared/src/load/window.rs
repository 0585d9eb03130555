//! The rows collected, in eight bytes each.

/// Most rows of a collection: 1.05 s at 0.7 ms.
pub const LONGEST_COLLECTION_ROWS: usize = 1500;

/// What the identification sees of one recorded row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoadRow {
    /// Index in the recording.
    pub index: u32,
    /// Motor positions in counts.
    pub counts: [i32; 2],
    /// Codes of the commands computed from this row.
    pub command_code: [u16; 2],
}

/// Rows in order, without gaps.
#[derive(Clone, Debug)]
pub(super) struct Window {
    first_counts: [i32; 2],
    last_counts: [i32; 2],
    /// Change of the counts since the row before, and codes.
    rows: [([i16; 2], [u16; 2]); LONGEST_COLLECTION_ROWS],
    length: usize,
}

impl Window {
    pub(super) const fn new() -> Self {
        Self { first_counts: [0; 2], last_counts: [0; 2], rows: [([0; 2], [0; 2]); LONGEST_COLLECTION_ROWS], length: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.length = 0;
    }

    pub(super) fn len(&self) -> usize {
        self.length
    }

    /// Adds a row; beyond the room it is dropped. A motor that turns by more than 2¹⁵ counts a row is a fault elsewhere.
    pub(super) fn push(&mut self, row: &LoadRow) {
        if self.length == 0 {
            self.first_counts = row.counts;
            self.last_counts = row.counts;
        }
        if let Some(place) = self.rows.get_mut(self.length) {
            let change = |joint: usize| row.counts[joint].wrapping_sub(self.last_counts[joint]) as i16;
            *place = ([change(0), change(1)], row.command_code);
            self.last_counts = row.counts;
            self.length += 1;
        }
    }

    pub(super) fn first_counts(&self) -> [i32; 2] {
        self.first_counts
    }

    /// The row at `index`, given the counts of the one before.
    pub(super) fn row(&self, index: usize, counts_before: [i32; 2]) -> LoadRow {
        let (change, command_code) = self.rows.get(index).copied().unwrap_or_default();
        let counts = [0, 1].map(|joint: usize| counts_before[joint].wrapping_add(i32::from(change[joint])));
        LoadRow { index: index as u32, counts, command_code }
    }
}

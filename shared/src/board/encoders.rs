//! From wrapping hardware counters to motor positions.

/// Follows both counters.
///
/// The counters are relative: what they show when a pose is declared is taken for that pose, and every edge from there on
/// counts one. The paper's `fix()` truncates toward zero, so its cell of 0 is two counts wide, while a real encoder's cells
/// are all one count wide: the two on either side of zero are both counted as 0, and what everyone else sees is `fix()`.
/// Where inside its cell the arm stands when declared cannot be known: the declared pose is good to one count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encoders {
    /// Raw counters at the last tick; `None` before the first.
    raw: Option<[i32; 2]>,
    /// Cells of the encoders: one of number n is from n to n + 1 counts.
    cells: [i32; 2],
    pose_known: bool,
}

/// A counter that changed by more than a movement can explain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Jump {
    /// Index of the joint.
    pub(super) index: usize,
    /// Change in one tick.
    pub(super) counts: i32,
}

impl Encoders {
    pub(super) const fn new() -> Self {
        Self { raw: None, cells: [0; 2], pose_known: false }
    }

    /// Takes the counters of a tick. A change beyond `limit_counts` is reported and makes the pose unknown; so does a
    /// position beyond 32 bits.
    pub(super) fn update(&mut self, raw: [i32; 2], limit_counts: [i32; 2]) -> Option<Jump> {
        let before = self.raw.replace(raw).unwrap_or(raw);
        let mut jump = None;
        for index in 0..2 {
            // The counters wrap, so their difference is taken modulo 2^32.
            let change = raw[index].wrapping_sub(before[index]);
            if change.unsigned_abs() > limit_counts[index].unsigned_abs() {
                jump = jump.or(Some(Jump { index, counts: change }));
            }
            match self.cells[index].checked_add(change) {
                Some(cell) => self.cells[index] = cell,
                None => self.pose_known = false,
            }
        }
        if jump.is_some() {
            self.pose_known = false;
        }
        jump
    }

    /// Declares the present positions, in counts after `fix()`.
    pub(super) fn declare(&mut self, position_counts: [i32; 2]) {
        self.cells = position_counts.map(|counts| if counts < 0 { counts.saturating_sub(1) } else { counts });
        self.pose_known = true;
    }

    /// Positions go on being counted, but are relative to nothing.
    pub(super) fn forget_pose(&mut self) {
        self.pose_known = false;
    }

    /// Motor positions in counts: after `fix()` of the declared pose, or relative to the start.
    pub(super) fn position_counts(&self) -> [i32; 2] {
        self.cells.map(|cell| if cell < 0 { cell + 1 } else { cell })
    }

    /// Whether the positions are relative to a declared pose.
    pub(super) fn pose_known(&self) -> bool {
        self.pose_known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is seen of an encoder that turns from `declared` counts by this much, a tick for each quarter of a count.
    fn seen(declared: f64, by: f64) -> Vec<(f64, i32)> {
        let mut encoders = Encoders::new();
        let raw = |at: f64| [(at.floor() - 40_000.0) as i32; 2];
        assert_eq!(encoders.update(raw(declared), [2; 2]), None);
        encoders.declare([declared as i32; 2]);
        let ticks = (by.abs() * 4.0) as u32;
        let after = |tick: u32| declared + by * f64::from(tick) / f64::from(ticks);
        let each = (1..=ticks).map(|tick| {
            assert_eq!(encoders.update(raw(after(tick)), [2; 2]), None);
            (after(tick), encoders.position_counts()[0])
        });
        each.collect()
    }

    #[test]
    fn what_is_seen_of_a_real_encoder_is_truncated_on_both_sides_of_zero() {
        for (declared, by) in [(7.3, -15.0), (-7.3, 15.0), (0.2, 5.0), (0.2, -5.0), (-3.1, 2.0)] {
            for (position, counts) in seen(declared, by) {
                assert_eq!(counts, position.trunc() as i32, "at {position} from {declared}");
            }
        }
    }
}

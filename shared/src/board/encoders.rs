//! From wrapping hardware counters to motor positions.

/// Follows both counters.
///
/// The counters are relative: what they show when a pose is declared is taken for `fix()` of that pose in counts, and
/// every edge from there on counts one. The paper's `fix()` truncates toward zero, so its cell of 0 is two counts wide,
/// while a real encoder's cells are all one count wide. Both therefore agree on the side of zero on which the pose was
/// declared, and differ by one count on the other side. The paper's movement stays on one side at both joints. Where
/// inside its cell the arm stands when declared cannot be known: the declared pose is good to one count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encoders {
    /// Raw counters at the last tick; `None` before the first.
    raw: Option<[i32; 2]>,
    position_counts: [i32; 2],
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
        Self { raw: None, position_counts: [0; 2], pose_known: false }
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
            match self.position_counts[index].checked_add(change) {
                Some(position) => self.position_counts[index] = position,
                None => self.pose_known = false,
            }
        }
        if jump.is_some() {
            self.pose_known = false;
        }
        jump
    }

    /// Declares the present positions.
    pub(super) fn declare(&mut self, position_counts: [i32; 2]) {
        self.position_counts = position_counts;
        self.pose_known = true;
    }

    /// Positions go on being counted, but are relative to nothing.
    pub(super) fn forget_pose(&mut self) {
        self.pose_known = false;
    }

    /// Motor positions in counts: after `fix()` of the declared pose, or relative to the start.
    pub(super) fn position_counts(&self) -> [i32; 2] {
        self.position_counts
    }

    /// Whether the positions are relative to a declared pose.
    pub(super) fn pose_known(&self) -> bool {
        self.pose_known
    }
}

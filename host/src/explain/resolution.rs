//! Whether an encoder shows every count that the robot file says it has.

use crate::recording::Recording;
use crate::robot::Robot;

/// Different positions from which on a common step is no accident.
const ENOUGH_POSITIONS: usize = 30;

/// An encoder that moves in steps of several counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coarse {
    /// Which joint.
    pub joint: usize,
    /// Its step in counts.
    pub step_counts: i64,
}

impl Coarse {
    /// What to tell.
    pub fn sentence(&self, robot: &Robot) -> String {
        let joint = &robot.joints[self.joint];
        format!(
            "joint {}: its encoder moves in steps of {} counts, so no effect can be named before that is mended: check both \
             channels, how many edges the decoder counts, and counts_per_rev = {} in the robot file",
            joint.name, self.step_counts, joint.counts_per_rev
        )
    }
}

/// The joints of `recordings` whose positions all lie on a grid of more than one count: a decoder that counts too few
/// edges, a lost channel, or a robot file that gives too many counts a turn. Nothing where errors are not whole numbers.
pub fn coarse_encoders(robot: &Robot, recordings: &[&Recording]) -> Vec<Coarse> {
    if !robot.quantised {
        return Vec::new();
    }
    let of = |joint: usize| {
        let mut step_counts = 0;
        for recording in recordings {
            let rows = recording.reference_counts[joint].iter().zip(&recording.error_counts[joint]);
            let mut positions: Vec<i64> = rows.map(|(reference, error)| (reference - error).round() as i64).collect();
            positions.sort_unstable();
            positions.dedup();
            if positions.len() < ENOUGH_POSITIONS {
                return None;
            }
            step_counts = positions.windows(2).fold(step_counts, |step, pair| common_divisor(step, pair[1] - pair[0]));
        }
        (step_counts > 1).then_some(Coarse { joint, step_counts })
    };
    (0..robot.joints.len()).filter_map(of).collect()
}

fn common_divisor(a: i64, b: i64) -> i64 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

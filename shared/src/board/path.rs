//! Where the reference is on its way: what path, at what time on it, and how time slows down for a stop.

use super::constants::Constants;
use crate::control::JointReference;
use crate::trajectory::{Approach, Trajectory};

/// Counts to hold, kept twice: a bit of memory that flips while the arm stands must not move it.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldCounts {
    pub(super) counts: [i32; 2],
    inverted: [i32; 2],
}

impl HeldCounts {
    pub(super) const fn new(counts: [i32; 2]) -> Self {
        let [first, second] = counts;
        Self { counts, inverted: [!first, !second] }
    }

    /// Flips a bit of one of the two copies.
    #[cfg(test)]
    pub(super) fn flip(&mut self, copy: usize, joint: usize, bit: u32) {
        let copies = [&mut self.counts, &mut self.inverted];
        copies[copy][joint] ^= 1 << bit;
    }

    /// Whether the two copies agree.
    pub(super) fn is_whole(&self) -> bool {
        self.counts == self.inverted.map(|count| !count)
    }
}

/// What the reference follows.
#[derive(Clone, Copy, Debug)]
pub(super) enum Path {
    /// Stands at these counts: the position loop holding.
    Counts(HeldCounts),
    /// Stands at these joint angles in rad: computed torque holding.
    Pose([f32; 2]),
    /// Goes to the start of the trajectory and stands there.
    Approach(Approach),
    /// The accepted trajectory.
    Trajectory,
}

/// The reference at one instant: joint angles for computed torque, counts for errors and the position loop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reference {
    pub(super) joint: JointReference<f32>,
    pub(super) counts: [i32; 2],
}

/// Time along a path.
///
/// A stop keeps the arm on its path and lets the time along it run slower and slower: at time t after the request the
/// path is followed at the rate 1 − t/d, so d later it stands, half of d further along. Path and speed stay inside
/// what was checked; only the braking itself, speed/d, is added to the acceleration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// Time along the path when time began to slow down, or now.
    time_ns: u64,
    stop: Option<Stop>,
}

#[derive(Clone, Copy, Debug)]
struct Stop {
    elapsed_ns: u64,
    /// Above 0, at most 2 s so that its square fits 64 bits.
    duration_ns: u64,
}

/// Where a clock stands.
#[derive(Clone, Copy, Debug)]
struct Instant {
    time_ns: u64,
    /// Path time per time.
    rate: f32,
    /// Its derivative in 1/s.
    rate_per_s: f32,
}

impl Clock {
    /// At the start of a path.
    pub(super) const START: Self = Self { time_ns: 0, stop: None };

    /// Begins to slow down, for `duration_ns`.
    pub(super) fn stop(&mut self, duration_ns: u64) {
        if self.stop.is_none() {
            self.stop = Some(Stop { elapsed_ns: 0, duration_ns: duration_ns.max(1) });
        }
    }

    /// Whether a stop has come to its end.
    pub(super) fn has_stopped(&self) -> bool {
        self.stop.is_some_and(|stop| stop.elapsed_ns >= stop.duration_ns)
    }

    /// Time along the path in ns; meaningful while nothing slows down.
    pub(super) fn time_ns(&self) -> u64 {
        self.time_ns
    }

    /// One tick later.
    pub(super) fn advance(&mut self, period_ns: u64) {
        let running = match &mut self.stop {
            Some(stop) => &mut stop.elapsed_ns,
            None => &mut self.time_ns,
        };
        *running = running.saturating_add(period_ns);
    }

    fn at(&self, ahead_ns: u64) -> Instant {
        let Some(stop) = &self.stop else {
            return Instant { time_ns: self.time_ns.saturating_add(ahead_ns), rate: 1.0, rate_per_s: 0.0 };
        };
        let duration_ns = stop.duration_ns;
        let elapsed_ns = stop.elapsed_ns.saturating_add(ahead_ns);
        if elapsed_ns >= duration_ns {
            return Instant { time_ns: self.time_ns.saturating_add(duration_ns / 2), rate: 0.0, rate_per_s: 0.0 };
        }
        let lost_ns = elapsed_ns.saturating_mul(elapsed_ns) / (2 * duration_ns);
        Instant {
            time_ns: self.time_ns.saturating_add(elapsed_ns - lost_ns),
            rate: 1.0 - elapsed_ns as f32 / duration_ns as f32,
            rate_per_s: -1.0e9 / duration_ns as f32,
        }
    }
}

impl Path {
    /// The reference `ahead_ns` after the clock's present.
    pub(super) fn reference(
        &self,
        clock: &Clock,
        ahead_ns: u64,
        trajectory: Option<&Trajectory>,
        constants: &Constants,
    ) -> Reference {
        let instant = clock.at(ahead_ns);
        let [first, second] = &constants.joints;
        let mut joint = match (self, trajectory) {
            (Self::Approach(approach), _) => approach.reference(instant.time_ns),
            (Self::Trajectory, Some(trajectory)) => trajectory.reference(instant.time_ns),
            (&Self::Pose(position_rad), _) => at_rest(position_rad),
            (&Self::Counts(HeldCounts { counts, .. }), _) => {
                let [a, b] = counts;
                return Reference { joint: at_rest([first.position_rad(a), second.position_rad(b)]), counts };
            }
            // A movement cannot begin without a trajectory, and loading is refused while one is followed.
            (Self::Trajectory, None) => at_rest([f32::NAN; 2]),
        };
        for index in 0..2 {
            let velocity = joint.velocity_rad_s[index];
            joint.velocity_rad_s[index] = velocity * instant.rate;
            joint.acceleration_rad_s2[index] =
                joint.acceleration_rad_s2[index] * instant.rate * instant.rate + velocity * instant.rate_per_s;
        }
        let [a, b] = joint.position_rad;
        Reference { joint, counts: [first.reference_counts(a), second.reference_counts(b)] }
    }
}

fn at_rest(position_rad: [f32; 2]) -> JointReference<f32> {
    JointReference { position_rad, velocity_rad_s: [0.0; 2], acceleration_rad_s2: [0.0; 2] }
}

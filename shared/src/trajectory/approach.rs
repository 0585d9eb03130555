//! The way to the start of a movement.

use super::phase::{STEP_PEAKS, phase, seconds, smooth_step, unit};
use super::{LONGEST_MOVEMENT_NS, LimitError, MotionLimits, Part, Quantity};
use crate::control::JointReference;
use crate::scalar::Number;

/// A movement from one pose to another, from rest to rest, both joints starting and ending together.
///
/// Position follows the minimum-jerk step 10u³ − 15u⁴ + 6u⁵ (Flash & Hogan 1985): no step of acceleration, no
/// overshoot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    from_rad: [f32; 2],
    to_rad: [f32; 2],
    duration_ns: u64,
}

impl Approach {
    /// The fastest such movement within `limits` on speed, acceleration and counts per tick; zero long if already
    /// there. `counts_per_rad` is per joint, of either sign.
    ///
    /// The end must be inside the position limits. The start need not be: an arm found outside may come back in.
    /// Refuses unusable limits, a pose that is not finite and a movement longer than [`LONGEST_MOVEMENT_NS`].
    pub fn new(
        from_rad: [f32; 2],
        to_rad: [f32; 2],
        limits: &MotionLimits,
        counts_per_rad: [f32; 2],
        record_period_ns: u64,
    ) -> Result<Self, LimitError> {
        limits.usable(counts_per_rad, record_period_ns)?;
        Part::Start.finite(from_rad)?;
        Part::End.finite(to_rad)?;
        let mut duration_s = 0.0_f32;
        for joint in 0..2 {
            limits.row(Quantity::PositionLow, joint, to_rad[joint], 0).verdict()?;
            limits.row(Quantity::PositionHigh, joint, to_rad[joint], 0).verdict()?;
            let distance = (to_rad[joint] - from_rad[joint]).abs();
            let counting_limit =
                limits.counts_per_tick / (counts_per_rad[joint].abs() * seconds::<f32>(record_period_ns));
            let speed = limits.speed_rad_s[joint].min(counting_limit);
            let acceleration = limits.acceleration_rad_s2[joint];
            duration_s = duration_s
                .max(STEP_PEAKS[1] * distance / speed)
                .max(libm::sqrtf(STEP_PEAKS[2] * distance / acceleration));
        }
        // A little slower, so that rounding in f32 does not carry the peaks over the limits. The cast takes what is
        // too large for the largest integer.
        let duration_ns = (duration_s * ((1.0 + 2.0e-6) * 1.0e9)) as u64;
        if duration_ns > LONGEST_MOVEMENT_NS {
            return Err(LimitError::TooLong { duration_ns });
        }
        Ok(Self { from_rad, to_rad, duration_ns })
    }

    /// From the start to the end, in ns.
    pub fn duration_ns(&self) -> u64 {
        self.duration_ns
    }

    /// The pose it leaves, in rad.
    pub fn from_rad(&self) -> [f32; 2] {
        self.from_rad
    }

    /// The pose it reaches, in rad.
    pub fn to_rad(&self) -> [f32; 2] {
        self.to_rad
    }

    /// Position, velocity and acceleration `time_ns` after the start. At and after the end: exactly the end pose, at
    /// rest.
    pub fn reference<S: Number>(&self, time_ns: u64) -> JointReference<S> {
        let number = |value: f32| S::from_f64(f64::from(value));
        if time_ns >= self.duration_ns {
            return super::at_rest(self.to_rad.map(number));
        }
        let [step, slope, curvature] = smooth_step(unit::<S>(phase(time_ns, self.duration_ns)));
        let per_second = S::one() / seconds(self.duration_ns);
        let mut reference = super::at_rest(self.from_rad.map(number));
        for joint in 0..2 {
            let distance = number(self.to_rad[joint]) - reference.position_rad[joint];
            reference.position_rad[joint] += distance * step;
            reference.velocity_rad_s[joint] = distance * slope * per_second;
            reference.acceleration_rad_s2[joint] = distance * curvature * per_second * per_second;
        }
        reference
    }
}

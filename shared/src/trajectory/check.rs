//! The check of a movement before it runs.

use super::phase::seconds;
use super::{DerivativeBounds, LimitError, Margins, MotionLimits, Part, Quantity, Trajectory};
use crate::control::JointReference;

/// The longest movement accepted, in ns: one hour.
pub const LONGEST_MOVEMENT_NS: u64 = 3_600_000_000_000;

/// About the most samples a check evaluates, 46 s at 0.7 ms. A longer movement is sampled more coarsely, and the
/// bounds on what happens between samples grow accordingly. Up to two more samples per piece of the movement are
/// added, so at most 66 046 are evaluated.
pub const MOST_CHECK_SAMPLES: u64 = 65_536;

/// Accepts a movement only if it is well formed, stays within every limit, and starts and ends at rest; tells how
/// close it comes to each limit.
///
/// `counts_per_rad` is per joint, of either sign. Computed in `f32` wherever it runs, so board and host come to the
/// same verdict. Cost: one [`Trajectory::reference`] per record period of the movement, at most about
/// [`MOST_CHECK_SAMPLES`]; of a Fourier series only the fades and one period are looked at.
pub fn check(
    trajectory: &Trajectory,
    limits: &MotionLimits,
    counts_per_rad: [f32; 2],
    record_period_ns: u64,
) -> Result<Margins, LimitError> {
    let margins = margins(trajectory, limits, counts_per_rad, record_period_ns)?;
    margins.verdict()?;
    Ok(margins)
}

/// How close a movement comes to each limit, whether or not it exceeds one. Refuses only a malformed movement and
/// unusable limits. Cost as [`check`].
pub fn margins(
    trajectory: &Trajectory,
    limits: &MotionLimits,
    counts_per_rad: [f32; 2],
    record_period_ns: u64,
) -> Result<Margins, LimitError> {
    limits.usable(counts_per_rad, record_period_ns)?;
    trajectory.well_formed()?;
    let duration_ns = trajectory.duration_ns();
    if duration_ns > LONGEST_MOVEMENT_NS {
        return Err(LimitError::TooLong { duration_ns });
    }

    let pieces = || (0..).map_while(|index| trajectory.piece_ns(index));
    let sampled_ns: u64 = pieces().map(|(start, end)| end - start).sum();
    let step_ns = record_period_ns.max(sampled_ns.div_ceil(MOST_CHECK_SAMPLES));
    let mut extremes = [Extremes::default(); 2];
    for (start_ns, end_ns) in pieces() {
        let mut time_ns = start_ns;
        loop {
            let reference = trajectory.moving::<f32>(time_ns);
            for (joint, extremes) in extremes.iter_mut().enumerate() {
                extremes.include(&reference, joint, time_ns)?;
            }
            if time_ns == end_ns {
                break;
            }
            time_ns = end_ns.min(time_ns.saturating_add(step_ns));
        }
    }

    // Between two samples `step` apart a function leaves the chord by at most step²/8 times its second derivative.
    let between = seconds::<f32>(step_ns.min(duration_ns)) * seconds::<f32>(step_ns.min(duration_ns)) / 8.0;
    let bounds = trajectory.derivative_bounds();
    let start = trajectory.moving::<f32>(0);
    let end = trajectory.moving::<f32>(duration_ns);
    let row = |joint: usize, quantity: Quantity| {
        let extremes = &extremes[joint];
        let [position, speed, acceleration] = bounds[joint].map(|bound| bound * between);
        let (peak, time_ns) = match quantity {
            Quantity::PositionLow => (extremes.low.value - position, extremes.low.time_ns),
            Quantity::PositionHigh => (extremes.high.value + position, extremes.high.time_ns),
            Quantity::Speed => (extremes.speed.value + speed, extremes.speed.time_ns),
            Quantity::Acceleration => (extremes.acceleration.value + acceleration, extremes.acceleration.time_ns),
            Quantity::CountsPerTick => {
                let counts = counts_per_rad[joint].abs() * seconds::<f32>(record_period_ns);
                ((extremes.speed.value + speed) * counts, extremes.speed.time_ns)
            }
            Quantity::StartSpeed => (start.velocity_rad_s[joint].abs(), 0),
            Quantity::EndSpeed => (end.velocity_rad_s[joint].abs(), duration_ns),
        };
        limits.row(quantity, joint, peak, time_ns)
    };
    let quantities = Quantity::ALL.len();
    Ok(Margins { rows: core::array::from_fn(|index| row(index / quantities, Quantity::ALL[index % quantities])) })
}

/// A sampled extreme and the time of its first occurrence.
#[derive(Clone, Copy)]
struct Extreme {
    value: f32,
    time_ns: u64,
}

/// The extremes of one joint.
#[derive(Clone, Copy)]
struct Extremes {
    low: Extreme,
    high: Extreme,
    speed: Extreme,
    acceleration: Extreme,
}

impl Default for Extremes {
    fn default() -> Self {
        let none = Extreme { value: f32::NEG_INFINITY, time_ns: 0 };
        Self { low: Extreme { value: f32::INFINITY, time_ns: 0 }, high: none, speed: none, acceleration: none }
    }
}

impl Extremes {
    fn include(&mut self, reference: &JointReference<f32>, joint: usize, time_ns: u64) -> Result<(), LimitError> {
        let position = reference.position_rad[joint];
        let speed = reference.velocity_rad_s[joint].abs();
        let acceleration = reference.acceleration_rad_s2[joint].abs();
        if !(position.is_finite() && speed.is_finite() && acceleration.is_finite()) {
            return Err(LimitError::Overflow { joint: joint as u8, time_ns });
        }
        if position < self.low.value {
            self.low = Extreme { value: position, time_ns };
        }
        for (extreme, value) in
            [(&mut self.high, position), (&mut self.speed, speed), (&mut self.acceleration, acceleration)]
        {
            if value > extreme.value {
                *extreme = Extreme { value, time_ns };
            }
        }
        Ok(())
    }
}

impl Trajectory {
    /// Refuses what has no meaning as a movement: an empty period, numbers that are not finite and the like.
    pub(crate) fn well_formed(&self) -> Result<(), LimitError> {
        match self {
            Self::Paper(paper) if paper.period_ns == 0 => Err(LimitError::Zero { part: Part::Period }),
            Self::Paper(_) => Ok(()),
            Self::Fourier(fourier) => fourier.well_formed(),
            Self::Points(points) => points.well_formed(),
        }
    }

    /// The smooth pieces to look at, each with both its ends.
    fn piece_ns(&self, index: usize) -> Option<(u64, u64)> {
        match self {
            Self::Paper(paper) => (index == 0).then_some((0, paper.period_ns)),
            Self::Fourier(fourier) => fourier.piece_ns(index),
            Self::Points(points) => points.piece_ns(index),
        }
    }

    fn derivative_bounds(&self) -> DerivativeBounds {
        match self {
            Self::Paper(paper) => paper.derivative_bounds(),
            Self::Fourier(fourier) => fourier.derivative_bounds(),
            Self::Points(points) => points.derivative_bounds(),
        }
    }
}

//! Where the arm is told to go.

use std::f64::consts::{FRAC_PI_4, TAU};

use super::fourier::FourierSeries;
use super::recording::Recording;
use super::robot::Robot;

/// A movement given to the position loop.
#[derive(Clone, Debug, PartialEq)]
pub enum Reference {
    /// The paper's trajectory (6): `q2 = -π/4 + π/4 cos(2πt/T)`, `q3 = π/4 - π/4 cos(4πt/T)`.
    Paper {
        /// The period T in seconds; the paper's is 3.65 s.
        period_s: f64,
    },
    /// A finite Fourier series.
    Fourier(FourierSeries),
    /// Counts at the record ticks, as a recording holds them; straight lines between them for faster loops.
    Counts([Vec<i32>; 2]),
}

impl Reference {
    /// The movement that was commanded in a recording.
    #[must_use]
    pub fn of_recording(recording: &Recording) -> Self {
        Self::Counts(recording.reference_counts.clone())
    }

    /// Recorded samples in the movement.
    #[must_use]
    pub fn ticks(&self, record_period_s: f64) -> usize {
        let of_period = |period_s: f64| (period_s / record_period_s).round() as usize;
        match self {
            Self::Paper { period_s } => of_period(*period_s),
            Self::Fourier(series) => of_period(series.period_s()),
            Self::Counts(counts) => counts[0].len(),
        }
    }

    /// The reference in encoder counts of `robot`, not yet rounded, `part` of `parts` after record tick `tick`.
    ///
    /// Time is given in whole ticks and parts so that a recorded reference comes back exactly.
    ///
    /// # Panics
    /// If a reference in counts has no such tick.
    #[must_use]
    pub fn counts(&self, robot: &Robot, tick: usize, part: usize, parts: usize) -> [f64; 2] {
        let fraction = part as f64 / parts as f64;
        let time_s = (tick as f64 + fraction) * robot.record_period_s;
        let from_angle = |angle_rad: [f64; 2]| -> [f64; 2] {
            std::array::from_fn(|joint| angle_rad[joint] * robot.drives[joint].counts_per_joint_rad())
        };
        match self {
            Self::Paper { period_s } => {
                let phase = TAU * time_s / period_s;
                from_angle([-FRAC_PI_4 + FRAC_PI_4 * phase.cos(), FRAC_PI_4 - FRAC_PI_4 * (2.0 * phase).cos()])
            }
            Self::Fourier(series) => from_angle(series.angle_rad(time_s)),
            Self::Counts(counts) => std::array::from_fn(|joint| {
                let now = f64::from(counts[joint][tick]);
                let next = counts[joint].get(tick + 1).map_or(now, |&next| f64::from(next));
                now + fraction * (next - now)
            }),
        }
    }
}

//! Where the arm should be at any time: the paper's movement, Fourier series, splines through points, and the
//! approach to the start of a movement.
//!
//! Time is a whole number of nanoseconds, so that 0.7 ms and 3.65 s are exact and a sample late in a long movement is
//! as exact as the first. Periodic terms take their phase from integer arithmetic ([`phase`]) and only then become
//! floating point.
//!
//! Error budget of the position in `f32`, against exact arithmetic on the same coefficients: 0.0025 count at joint 2
//! and 0.0015 count at joint 3 on the paper's movement, 21 560 counts long (`tests/trajectory` measures it); of
//! this 0.0008 count is the last bit of an `f32` near π/2. Below 0.01 count for every kind within ±π/2: 0.002
//! measured for Fourier series, 0.0025 for splines, 0.0055 for approaches 3 rad long. A sine with the error of
//! `micromath` (1e-3) would be 27 counts wrong.
//!
//! Cost where only `f32` is in hardware: one evaluation uses no `f64` arithmetic. It takes at most two phases of
//! two integer divisions of 32 bits, two divisions of 64 bits, and one sine-cosine pair by polynomial for each harmonic (two for the
//! paper's movement, none for splines and approaches). No loop depends on time.
//!
//! ```
//! use shared::trajectory::{Paper, Trajectory};
//! let movement = Trajectory::Paper(Paper { period_ns: 3_650_000_000 });
//! let middle = movement.reference::<f64>(1_825_000_000);
//! assert!((middle.position_rad[0] + core::f64::consts::FRAC_PI_2).abs() < 1e-9);
//! assert_eq!(movement.record_periods(700_000), 5214);
//! ```

mod approach;
mod check;
mod fourier;
mod limits;
mod paper;
mod phase;
mod points;
mod refusal;

pub use approach::Approach;
pub use check::{LONGEST_MOVEMENT_NS, MOST_CHECK_SAMPLES, check, margins};
pub use fourier::{Fourier, Harmonic, MAX_HARMONICS};
pub use limits::{Margin, Margins, MotionLimits, Quantity, REST_SPEED_RAD_S};
pub use paper::Paper;
pub use phase::{phase, sin_cos_of_phase};
pub use points::{MAX_POINTS, Points};
pub use refusal::{LimitError, Part};

use crate::control::JointReference;
use crate::scalar::Number;
use serde::{Deserialize, Serialize};

/// A movement of both joints, in joint radians.
///
/// The coefficients are `f32`, so that board and host hold the same movement to the bit. A value read from outside
/// may be malformed or dangerous: every value is safe to evaluate (nothing panics, a movement without duration holds
/// its start), but only [`check`] says whether it may be run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "4 KiB of spline, and nothing here allocates")]
pub enum Trajectory {
    /// The paper's movement.
    Paper(Paper),
    /// A finite Fourier series.
    Fourier(Fourier),
    /// A spline through equally spaced points.
    Points(Points),
}

impl Trajectory {
    /// From the start to the end, in ns; `u64::MAX` where it would not fit. [`check`] refuses more than
    /// [`LONGEST_MOVEMENT_NS`].
    pub fn duration_ns(&self) -> u64 {
        match self {
            Self::Paper(paper) => paper.duration_ns(),
            Self::Fourier(fourier) => fourier.duration_ns(),
            Self::Points(points) => points.duration_ns(),
        }
    }

    /// Position, velocity and acceleration `time_ns` after the start. At and after the end: the end position, with
    /// zero velocity and acceleration.
    ///
    /// The velocity and acceleration are the derivatives of the position. The acceleration may step at the start and
    /// at the end (the paper's movement does); position and velocity do not step where [`check`] is satisfied.
    pub fn reference<S: Number>(&self, time_ns: u64) -> JointReference<S> {
        let duration_ns = self.duration_ns();
        if time_ns < duration_ns {
            return self.moving(time_ns);
        }
        at_rest(self.moving::<S>(duration_ns).position_rad)
    }

    /// Joint angles at the start, in rad: where an [`Approach`] must end.
    pub fn start_rad(&self) -> [f32; 2] {
        self.reference::<f32>(0).position_rad
    }

    /// Joint angles at the end, in rad.
    pub fn end_rad(&self) -> [f32; 2] {
        self.reference::<f32>(self.duration_ns()).position_rad
    }

    /// How many whole record periods the movement lasts: 5214 for the paper's T = 3.65 s and 0.7 ms. Zero if
    /// `record_period_ns` is zero.
    pub fn record_periods(&self, record_period_ns: u64) -> u64 {
        self.duration_ns().checked_div(record_period_ns).unwrap_or(0)
    }

    /// The movement itself, for `time_ns` from zero to the duration, both included: at the end it still has the
    /// velocity and acceleration it arrives with.
    fn moving<S: Number>(&self, time_ns: u64) -> JointReference<S> {
        match self {
            Self::Paper(paper) => paper.moving(time_ns),
            Self::Fourier(fourier) => fourier.moving(time_ns),
            Self::Points(points) => points.moving(time_ns),
        }
    }
}

/// Standing still at `position_rad`.
fn at_rest<S: Number>(position_rad: [S; 2]) -> JointReference<S> {
    JointReference { position_rad, velocity_rad_s: [S::zero(); 2], acceleration_rad_s2: [S::zero(); 2] }
}

/// Upper bounds of the second, third and fourth derivative of each joint's position with respect to time in s, away
/// from the ends of the smooth pieces: what [`margins`] needs to bound a peak between two samples.
type DerivativeBounds = [[f32; 3]; 2];

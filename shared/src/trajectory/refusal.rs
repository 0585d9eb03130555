//! Why a movement is refused.

use super::phase::seconds;
use super::{LONGEST_MOVEMENT_NS, Margin, Quantity};
use core::fmt;
use serde::{Deserialize, Serialize};

/// The part of a movement an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Part {
    /// The period of a periodic movement.
    Period,
    /// How often it is repeated.
    Repeats,
    /// The time between points.
    Interval,
    /// The record period.
    RecordPeriod,
    /// The centre of a Fourier series.
    Centre,
    /// A harmonic of a Fourier series, from 1.
    Harmonic(u8),
    /// A point of a spline, from 0.
    Point(u16),
    /// The start of an approach.
    Start,
    /// The end of an approach.
    End,
}

impl Part {
    /// Refuses a value for either joint that is NaN or infinite.
    pub(super) fn finite(self, values: [f32; 2]) -> Result<(), LimitError> {
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(()),
            Some(joint) => Err(LimitError::NotFinite { part: self, joint: joint as u8, value: values[joint] }),
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Period => f.write_str("the period"),
            Self::Repeats => f.write_str("the number of repeats"),
            Self::Interval => f.write_str("the interval between points"),
            Self::RecordPeriod => f.write_str("the record period"),
            Self::Centre => f.write_str("the centre"),
            Self::Harmonic(order) => write!(f, "harmonic {order}"),
            Self::Point(index) => write!(f, "point {index} (counted from 0)"),
            Self::Start => f.write_str("the start"),
            Self::End => f.write_str("the end"),
        }
    }
}

/// Why a movement may not be run. `joint` is 0 or 1; messages call them joint 2 and 3, as on the PUMA 560.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error, Serialize, Deserialize)]
pub enum LimitError {
    /// A quantity goes beyond its limit.
    #[error(
        "the {} of joint {} reaches {:.4} {unit} at {:.4} s, beyond its limit of {:.4} {unit}; {}",
        .0.quantity.name(), u32::from(.0.joint) + 2, .0.peak, seconds::<f32>(.0.time_ns), .0.limit,
        .0.quantity.remedy(),
        unit = .0.quantity.unit()
    )]
    Exceeded(Margin),
    /// A coefficient is NaN or infinite.
    #[error("{part} of the movement is {value} for joint {}, not a finite number; correct it", u32::from(*.joint) + 2)]
    NotFinite {
        /// Which coefficient.
        part: Part,
        /// Which joint.
        joint: u8,
        /// Its value.
        value: f32,
    },
    /// Finite coefficients, but too great to compute with.
    #[error("the movement of joint {} overflows at {:.4} s; make its amplitudes smaller or its period longer",
        u32::from(*.joint) + 2, seconds::<f32>(*.time_ns))]
    Overflow {
        /// Which joint.
        joint: u8,
        /// When, in ns from the start.
        time_ns: u64,
    },
    /// A duration or a count is zero.
    #[error("{part} of the movement is 0, but must be above 0; set it")]
    Zero {
        /// Which one.
        part: Part,
    },
    /// A spline needs two points.
    #[error("the movement has {points} points, but a spline needs at least 2; add points")]
    TooFewPoints {
        /// How many there are.
        points: u16,
    },
    /// More points than fit.
    #[error("the movement has {points} points, but at most {} fit; space them wider", super::MAX_POINTS)]
    TooManyPoints {
        /// How many there are.
        points: u32,
    },
    /// Fade-in and fade-out overlap.
    #[error(
        "a fade of {:.4} s does not fit twice into the movement, the limit is {:.4} s; shorten the fade or repeat the \
         movement more often",
        seconds::<f32>(*.fade_ns), seconds::<f32>(*.longest_ns)
    )]
    FadeTooLong {
        /// The fade in ns.
        fade_ns: u64,
        /// The longest that fits, in ns.
        longest_ns: u64,
    },
    /// The movement lasts longer than [`LONGEST_MOVEMENT_NS`].
    #[error(
        "the movement lasts {:.0} s, beyond the limit of {:.0} s; split it or repeat it less often",
        seconds::<f32>(*.duration_ns), seconds::<f32>(LONGEST_MOVEMENT_NS)
    )]
    TooLong {
        /// Its duration in ns.
        duration_ns: u64,
    },
    /// A limit is not finite or leaves no room.
    #[error(
        "the limit on the {} of joint {} is {limit} {}, which is not finite or leaves no room to move; correct the \
         motion limits",
        .quantity.name(), u32::from(*.joint) + 2, .quantity.unit()
    )]
    UnusableLimit {
        /// Whose limit.
        quantity: Quantity,
        /// Which joint.
        joint: u8,
        /// Its value.
        limit: f32,
    },
    /// The encoder's scale is zero or not finite.
    #[error(
        "joint {} has {counts_per_rad} encoder counts per radian, which must be finite and not 0; correct the gear \
         ratio or the counts per revolution",
        u32::from(*.joint) + 2
    )]
    CountsPerRad {
        /// Which joint.
        joint: u8,
        /// Its value.
        counts_per_rad: f32,
    },
}

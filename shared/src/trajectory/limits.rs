//! What a movement may ask of the arm, and how close it comes to that.

use super::phase::seconds;
use super::{LimitError, Part};
use core::fmt;
use serde::{Deserialize, Serialize};

/// How fast a joint may be at the start and the end of a movement and still count as at rest, in rad/s: a hundredth
/// of a count per 0.7 ms on the reference robot, and a hundred times the rounding of `f32` amplitudes.
pub const REST_SPEED_RAD_S: f32 = 1.0e-3;

/// What a movement may ask of the arm. Arrays are per joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionLimits {
    /// Least joint angle, rad.
    pub position_low_rad: [f32; 2],
    /// Greatest joint angle, rad; above the least.
    pub position_high_rad: [f32; 2],
    /// Greatest absolute joint velocity, rad/s; above 0.
    pub speed_rad_s: [f32; 2],
    /// Greatest absolute joint acceleration, rad/s²; above 0.
    pub acceleration_rad_s2: [f32; 2],
    /// The most encoder counts the reference of either joint may move in one record period; above 0.
    pub counts_per_tick: f32,
}

impl MotionLimits {
    /// Limits for the reference robot where nothing better is known \[assumed, not from the paper\]: 0.35 rad around
    /// the paper's movement and about twice its speed and 2.5 times its acceleration at T = 3.65 s (1.35 and
    /// 2.70 rad/s, 2.3 and 9.3 rad/s², 13.0 and 16.2 counts per 0.7 ms).
    pub fn reference_robot() -> Self {
        Self {
            position_low_rad: [-1.92, -0.35],
            position_high_rad: [0.35, 1.92],
            speed_rad_s: [2.7, 5.4],
            acceleration_rad_s2: [12.0, 24.0],
            counts_per_tick: 33.0,
        }
    }

    /// Accepts limits only if all are finite numbers that leave room to move, `counts_per_rad` if finite and not
    /// zero, and a record period other than zero.
    pub fn usable(&self, counts_per_rad: [f32; 2], record_period_ns: u64) -> Result<(), LimitError> {
        if record_period_ns == 0 {
            return Err(LimitError::Zero { part: Part::RecordPeriod });
        }
        for joint in 0..2 {
            let counts_per_rad = counts_per_rad[joint];
            if !counts_per_rad.is_finite() || counts_per_rad == 0.0 {
                return Err(LimitError::CountsPerRad { joint: joint as u8, counts_per_rad });
            }
            for quantity in Quantity::ALL {
                let limit = self.of(quantity, joint);
                let room = match quantity {
                    Quantity::PositionLow => true,
                    Quantity::PositionHigh => limit > self.position_low_rad[joint],
                    _ => limit > 0.0,
                };
                if !limit.is_finite() || !room {
                    return Err(LimitError::UnusableLimit { quantity, joint: joint as u8, limit });
                }
            }
        }
        Ok(())
    }

    /// The limit of a quantity for joint 0 or 1.
    pub fn of(&self, quantity: Quantity, joint: usize) -> f32 {
        match quantity {
            Quantity::PositionLow => self.position_low_rad[joint],
            Quantity::PositionHigh => self.position_high_rad[joint],
            Quantity::Speed => self.speed_rad_s[joint],
            Quantity::Acceleration => self.acceleration_rad_s2[joint],
            Quantity::CountsPerTick => self.counts_per_tick,
            Quantity::StartSpeed | Quantity::EndSpeed => REST_SPEED_RAD_S,
        }
    }

    pub(super) fn row(&self, quantity: Quantity, joint: usize, peak: f32, time_ns: u64) -> Margin {
        Margin { quantity, joint: joint as u8, peak, limit: self.of(quantity, joint), time_ns }
    }
}

/// A quantity a movement is limited in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// The least joint angle, rad.
    PositionLow,
    /// The greatest joint angle, rad.
    PositionHigh,
    /// The greatest absolute joint velocity, rad/s.
    Speed,
    /// The greatest absolute joint acceleration, rad/s².
    Acceleration,
    /// The most encoder counts in one record period: speed × counts per radian × period.
    CountsPerTick,
    /// The absolute joint velocity at the start, rad/s: a movement must start at rest.
    StartSpeed,
    /// The absolute joint velocity on arriving at the end, rad/s: a movement must end at rest.
    EndSpeed,
}

impl Quantity {
    /// Every quantity, in the order of [`Margins::rows`].
    pub const ALL: [Self; 7] = [
        Self::PositionLow,
        Self::PositionHigh,
        Self::Speed,
        Self::Acceleration,
        Self::CountsPerTick,
        Self::StartSpeed,
        Self::EndSpeed,
    ];

    /// The quantity in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::PositionLow => "lowest position",
            Self::PositionHigh => "highest position",
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::CountsPerTick => "movement per record period",
            Self::StartSpeed => "speed at the start",
            Self::EndSpeed => "speed at the end",
        }
    }

    /// Its unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::PositionLow | Self::PositionHigh => "rad",
            Self::Speed | Self::StartSpeed | Self::EndSpeed => "rad/s",
            Self::Acceleration => "rad/s²",
            Self::CountsPerTick => "counts",
        }
    }

    /// What to change when its limit is exceeded.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::PositionLow | Self::PositionHigh => "move the centre or make the movement smaller",
            Self::Speed | Self::Acceleration | Self::CountsPerTick => "make the movement slower or smaller",
            Self::StartSpeed | Self::EndSpeed => {
                "a movement must start and end at rest: give it a fade or cosine amplitudes only"
            }
        }
    }
}

/// How close a movement comes to one limit of one joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Margin {
    /// What is limited.
    pub quantity: Quantity,
    /// Joint 0 or 1: joint 2 or 3 of the PUMA 560, and so called in messages.
    pub joint: u8,
    /// The extreme the movement reaches, an upper bound (lower for [`Quantity::PositionLow`]): the extreme of the
    /// samples plus the most it may be exceeded by between them.
    pub peak: f32,
    /// The limit.
    pub limit: f32,
    /// When it is reached, in ns from the start.
    pub time_ns: u64,
}

impl Margin {
    /// What is left to the limit, in the quantity's unit; negative beyond it.
    pub fn left(&self) -> f32 {
        if self.quantity == Quantity::PositionLow { self.peak - self.limit } else { self.limit - self.peak }
    }

    /// Refuses a peak beyond the limit, or one that is not a number.
    pub fn verdict(&self) -> Result<(), LimitError> {
        if self.left() >= 0.0 { Ok(()) } else { Err(LimitError::Exceeded(*self)) }
    }
}

/// One line for people: `joint 2 speed: 1.352 rad/s at 0.912 s, limit 2.700, left 1.348`.
impl fmt::Display for Margin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // What rounds to zero has no sign.
        let peak = if self.peak.abs() < 0.5e-4 { 0.0 } else { self.peak };
        write!(
            f,
            "joint {} {}: {:.4} {} at {:.4} s, limit {:.4}, left {:.4}",
            u32::from(self.joint) + 2,
            self.quantity.name(),
            peak,
            self.quantity.unit(),
            seconds::<f32>(self.time_ns),
            self.limit,
            self.left(),
        )
    }
}

/// How close a movement comes to each limit of each joint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Margins {
    /// All of [`Quantity::ALL`] for joint 0, then for joint 1.
    pub rows: [Margin; 14],
}

impl Margins {
    /// The row of a quantity for joint 0 or 1.
    pub fn of(&self, quantity: Quantity, joint: usize) -> &Margin {
        &self.rows[joint * Quantity::ALL.len() + quantity as usize]
    }

    /// Whether both joints stand still at the start.
    pub fn starts_at_rest(&self) -> bool {
        (0..2).all(|joint| self.of(Quantity::StartSpeed, joint).verdict().is_ok())
    }

    /// Whether both joints stand still on arriving at the end.
    pub fn ends_at_rest(&self) -> bool {
        (0..2).all(|joint| self.of(Quantity::EndSpeed, joint).verdict().is_ok())
    }

    /// Refuses the first row beyond its limit.
    pub fn verdict(&self) -> Result<(), LimitError> {
        self.rows.iter().try_for_each(Margin::verdict)
    }
}

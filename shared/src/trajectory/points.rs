//! A smooth movement through equally spaced points.

use super::phase::{phase, seconds};
use super::{DerivativeBounds, LimitError, Part};
use crate::control::JointReference;
use crate::scalar::Number;
use serde::{Deserialize, Serialize};

/// The most points a [`Points`] has.
pub const MAX_POINTS: usize = 256;

/// The clamped cubic spline through equally spaced points: position, velocity and acceleration are continuous (C²)
/// and the velocity is zero at the first and the last point, so it starts and ends at rest; the acceleration steps
/// there. Every point is passed exactly at its time. Between points a spline may overshoot them: [`super::check`]
/// looks at what is between.
///
/// The slopes at the points are solved once, on construction, and are not sent: the receiver solves them again and
/// gets the same to the bit. In `f32` the acceleration is as good as points rounded to `f32` allow: the rounding of
/// about 6e-8 rad near π/2 makes up to 1.5e-6 rad / interval².
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "PointsOnWire", into = "PointsOnWire")]
pub struct Points {
    interval_ns: u64,
    points_rad: heapless::Vec<[f32; 2], MAX_POINTS>,
    /// Slopes at the points in rad per interval.
    slopes_rad: heapless::Vec<[f32; 2], MAX_POINTS>,
}

/// What travels of [`Points`].
#[derive(Serialize, Deserialize)]
struct PointsOnWire {
    interval_ns: u64,
    points_rad: heapless::Vec<[f32; 2], MAX_POINTS>,
}

impl From<Points> for PointsOnWire {
    fn from(points: Points) -> Self {
        Self { interval_ns: points.interval_ns, points_rad: points.points_rad }
    }
}

impl From<PointsOnWire> for Points {
    fn from(wire: PointsOnWire) -> Self {
        Self {
            interval_ns: wire.interval_ns,
            slopes_rad: clamped_slopes(&wire.points_rad),
            points_rad: wire.points_rad,
        }
    }
}

impl Points {
    /// The spline through `points_rad`, joint angles in rad, `interval_ns` apart.
    ///
    /// Refuses fewer than 2 or more than [`MAX_POINTS`] points, an interval of zero, and a point that is not finite.
    /// Costs some 70 `f64` operations a point.
    pub fn new(interval_ns: u64, points_rad: &[[f32; 2]]) -> Result<Self, LimitError> {
        let points_rad = heapless::Vec::from_slice(points_rad)
            .map_err(|_| LimitError::TooManyPoints { points: points_rad.len().try_into().unwrap_or(u32::MAX) })?;
        let points = Self::from(PointsOnWire { interval_ns, points_rad });
        points.well_formed()?;
        Ok(points)
    }

    /// Time between points in ns.
    pub fn interval_ns(&self) -> u64 {
        self.interval_ns
    }

    /// The points: joint angles in rad.
    pub fn points_rad(&self) -> &[[f32; 2]] {
        &self.points_rad
    }

    pub(crate) fn duration_ns(&self) -> u64 {
        self.interval_ns.saturating_mul(self.points_rad.len().saturating_sub(1) as u64)
    }

    pub(super) fn moving<S: Number>(&self, time_ns: u64) -> JointReference<S> {
        let number = |value: f32| S::from_f64(f64::from(value));
        if self.duration_ns() == 0 {
            return super::at_rest(self.points_rad.first().copied().unwrap_or_default().map(number));
        }
        // Along the segment from whichever of its ends is nearer, −½ ≤ u < ½: that halves what f32 loses.
        let time_ns = time_ns.min(self.duration_ns());
        let fraction = phase(time_ns, self.interval_ns).cast_signed();
        let u = S::from_f64(f64::from(fraction)) * S::from_f64(1.0 / 4_294_967_296.0);
        let passed = (time_ns / self.interval_ns) as usize;
        let segment = passed.min(self.points_rad.len() - 2);
        let from_end = fraction < 0 || passed > segment;
        let per_second = S::one() / seconds(self.interval_ns);
        let mut reference = super::at_rest([S::zero(); 2]);
        for joint in 0..2 {
            let [mut point, mut slope, mut quadratic, cubic] = self.cubic::<S>(segment, joint);
            let three_cubic = cubic + cubic + cubic;
            if from_end {
                point = number(self.points_rad[segment + 1][joint]);
                slope = number(self.slopes_rad[segment + 1][joint]);
                quadratic += three_cubic;
            }
            let bend = quadratic + u * three_cubic;
            reference.position_rad[joint] = point + u * (slope + u * (quadratic + u * cubic));
            reference.velocity_rad_s[joint] = per_second * (slope + u * (quadratic + bend));
            reference.acceleration_rad_s2[joint] = per_second * per_second * (bend + bend);
        }
        reference
    }

    /// Coefficients of `start + slope u + quadratic u² + cubic u³`, 0 ≤ u ≤ 1 along the segment; rad.
    fn cubic<S: Number>(&self, segment: usize, joint: usize) -> [S; 4] {
        let number = |value: f32| S::from_f64(f64::from(value));
        let start = number(self.points_rad[segment][joint]);
        let rise = number(self.points_rad[segment + 1][joint]) - start;
        let slope = number(self.slopes_rad[segment][joint]);
        // What the two slopes lack of the rise: differences of like numbers first, so that little is lost.
        let from_slope = rise - slope;
        let to_slope = number(self.slopes_rad[segment + 1][joint]) - rise;
        [start, slope, from_slope + from_slope - to_slope, to_slope - from_slope]
    }

    pub(crate) fn well_formed(&self) -> Result<(), LimitError> {
        if self.interval_ns == 0 {
            return Err(LimitError::Zero { part: Part::Interval });
        }
        let points = self.points_rad.len() as u16;
        if points < 2 {
            return Err(LimitError::TooFewPoints { points });
        }
        (0_u16..).zip(&self.points_rad).try_for_each(|(index, &point)| Part::Point(index).finite(point))
    }

    /// The smooth pieces: the segments between points.
    pub(super) fn piece_ns(&self, index: usize) -> Option<(u64, u64)> {
        let start = self.interval_ns.saturating_mul(index as u64);
        (index + 1 < self.points_rad.len()).then_some((start, start.saturating_add(self.interval_ns)))
    }

    pub(super) fn derivative_bounds(&self) -> DerivativeBounds {
        let per_second = 1.0 / seconds::<f32>(self.interval_ns);
        [0, 1].map(|joint| {
            let mut bounds = [0.0; 3];
            for segment in 0..self.points_rad.len() - 1 {
                let [_, _, quadratic, cubic] = self.cubic::<f32>(segment, joint);
                let bend = quadratic.abs().max((quadratic + 3.0 * cubic).abs());
                bounds[0] = bend.max(bounds[0]);
                bounds[1] = cubic.abs().max(bounds[1]);
            }
            let scale = 2.0 * per_second * per_second;
            [bounds[0] * scale, 3.0 * bounds[1] * scale * per_second, 0.0]
        })
    }
}

/// Slopes in rad per interval that make the cubics through `points_rad` C² and stand still at both ends.
///
/// Solves `m[i−1] + 4 m[i] + m[i+1] = 3 (p[i+1] − p[i−1])` by elimination (de Boor, A Practical Guide to Splines,
/// chapter IV). The factors of elimination do not depend on the points and reach 2 − √3 to the last bit of an `f64`
/// within 16 rows, so a short table serves all rows.
fn clamped_slopes(points_rad: &heapless::Vec<[f32; 2], MAX_POINTS>) -> heapless::Vec<[f32; 2], MAX_POINTS> {
    const ROWS: usize = 20;
    let mut factors = [0.0; ROWS];
    for row in 1..ROWS {
        factors[row] = 1.0 / (4.0 - factors[row - 1]);
    }
    let factor = |row: usize| factors[row.min(ROWS - 1)];

    let mut slopes = heapless::Vec::new();
    let mut eliminated = [0.0_f64; 2];
    for row in 0..points_rad.len() {
        // The first and the last slope stay zero.
        if row == 0 || row + 1 == points_rad.len() {
            eliminated = [0.0; 2];
        } else {
            for joint in 0..2 {
                let rise = f64::from(points_rad[row + 1][joint]) - f64::from(points_rad[row - 1][joint]);
                eliminated[joint] = (3.0 * rise - eliminated[joint]) * factor(row);
            }
        }
        if slopes.push(eliminated.map(|slope| slope as f32)).is_err() {
            break; // Cannot happen: as many slopes as points.
        }
    }
    for row in (1..slopes.len().saturating_sub(1)).rev() {
        for joint in 0..2 {
            let next = f64::from(slopes[row + 1][joint]);
            slopes[row][joint] = (f64::from(slopes[row][joint]) - factor(row) * next) as f32;
        }
    }
    slopes
}

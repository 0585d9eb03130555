//! The check of a trajectory against the limits, spread over ticks.
//!
//! [`crate::trajectory::check`] looks at the whole movement at once, which takes the board a hundred ticks. Here a few
//! record ticks are looked at each tick. Between two of them a quantity may be higher by interval²/8 times its second
//! derivative; that is taken from differences of samples, which is sound because only movements that change slowly
//! from sample to sample are admitted ([`MovementFindings::rows_to_record`]). Both checks agree to 3e-4 of each peak, and on the paper's
//! movement to the last bits (`tests/board`).

use super::constants::Constants;
use crate::control::JointReference;
use crate::protocol::Refusal;
use crate::trajectory::{
    Fourier, LONGEST_MOVEMENT_NS, LimitError, Margin, Margins, Paper, Points, Quantity, Trajectory,
};

/// Fewest record periods in the shortest period or fade of a movement: a sine sampled so often is between samples at
/// most 1.3 % above its largest sample, and the correction for that is good to a hundredth of it.
const RECORDS_PER_PERIOD: u64 = 20;

/// Fewest record periods between the points of a spline. Its acceleration is straight between points, and every point
/// is looked at, so none of it is missed.
const RECORDS_PER_INTERVAL: u64 = 2;

/// What of a movement decides whether it may be checked at all, whatever the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MovementFindings {
    duration_ns: u64,
    /// The shortest time in which it changes.
    shortest_ns: u64,
    /// Fewest record periods in that.
    least_records: u64,
    /// Whether it means anything as a movement.
    well_formed: Result<(), LimitError>,
}

impl MovementFindings {
    pub(super) fn of_paper(paper: &Paper) -> Self {
        Self {
            duration_ns: paper.period_ns,
            shortest_ns: paper.period_ns / 2,
            least_records: RECORDS_PER_PERIOD,
            // No period is too short already.
            well_formed: Ok(()),
        }
    }

    #[inline]
    pub(super) fn of_fourier(fourier: &Fourier) -> Self {
        let harmonic_ns = fourier.period_ns / (fourier.harmonics.len().max(1) as u64);
        let fade_ns = if fourier.fade_ns == 0 { u64::MAX } else { fourier.fade_ns };
        Self {
            duration_ns: fourier.duration_ns(),
            shortest_ns: harmonic_ns.min(fade_ns),
            least_records: RECORDS_PER_PERIOD,
            well_formed: fourier.well_formed(),
        }
    }

    pub(super) fn of_points(points: &Points) -> Self {
        Self {
            duration_ns: points.duration_ns(),
            shortest_ns: points.interval_ns(),
            least_records: RECORDS_PER_INTERVAL,
            well_formed: points.well_formed(),
        }
    }

    /// How many rows the recording of the movement has. Refuses one that is malformed, does not fit the recording, or
    /// changes too much from one record tick to the next to be judged by its record ticks.
    #[inline(never)]
    pub(super) fn rows_to_record(&self, constants: &Constants, capacity: u32) -> Result<u32, Refusal> {
        let record_ns = constants.record_period_ns;
        let rows = self.duration_ns.checked_div(record_ns).unwrap_or(0);
        let fits = u32::try_from(rows).ok().filter(|&rows| rows <= capacity);
        let rows = fits.ok_or(Refusal::TooManyRows { rows, capacity })?;
        let least_ns = self.least_records * record_ns;
        if self.shortest_ns < least_ns {
            return Err(Refusal::TooFine { shortest_ns: self.shortest_ns, least_ns });
        }
        self.well_formed.map_err(Refusal::Limit)?;
        if self.duration_ns > LONGEST_MOVEMENT_NS {
            return Err(Refusal::Limit(LimitError::TooLong { duration_ns: self.duration_ns }));
        }
        Ok(rows)
    }
}

/// A sampled extreme and when it was reached.
#[derive(Clone, Copy, Debug)]
struct Extreme {
    value: f32,
    time_ns: u64,
}

impl Extreme {
    const NONE: Self = Self { value: f32::NEG_INFINITY, time_ns: 0 };

    fn include(&mut self, value: f32, time_ns: u64) {
        if value > self.value {
            *self = Self { value, time_ns };
        }
    }
}

/// What was seen of one joint.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Of the negative position, so that every extreme is a greatest.
    low: Extreme,
    high: Extreme,
    speed: Extreme,
    acceleration: Extreme,
    /// Greatest change of acceleration between two samples.
    acceleration_step: f32,
    /// Greatest change of that change from one sample to the next.
    acceleration_bend: f32,
    /// The last change of acceleration.
    last_step: Option<f32>,
}

impl Seen {
    const NOTHING: Self = Self {
        low: Extreme::NONE,
        high: Extreme::NONE,
        speed: Extreme::NONE,
        acceleration: Extreme::NONE,
        acceleration_step: 0.0,
        acceleration_bend: 0.0,
        last_step: None,
    };
}

/// A check under way.
#[derive(Clone, Debug)]
pub(super) struct TrajectoryCheck {
    time_ns: u64,
    checked: u32,
    /// The last sample looked at.
    before: Option<JointReference<f32>>,
    seen: [Seen; 2],
    start_rad: [f32; 2],
    start_speed: [f32; 2],
    end_rad: [f32; 2],
    stage: Stage,
}

/// What a check does next.
#[derive(Clone, Copy, Debug)]
enum Stage {
    /// Looks at a sample.
    Samples,
    /// Works out where the movement ends, having looked at the last sample.
    End,
    /// Compares with the limits, from this margin on.
    Margins(usize),
}

/// Margins compared in one step.
const MARGINS_PER_STEP: usize = 2;

/// What a step of a check came to.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// It is not over.
    Goes,
    /// The movement may be run.
    Passed,
    /// It breaks a limit, the first one found.
    Failed(LimitError),
}

impl TrajectoryCheck {
    pub(super) const fn new() -> Self {
        Self {
            time_ns: 0,
            checked: 0,
            before: None,
            seen: [Seen::NOTHING; 2],
            start_rad: [0.0; 2],
            start_speed: [0.0; 2],
            end_rad: [0.0; 2],
            stage: Stage::Samples,
        }
    }

    /// Begins the check of another movement. What else there is of the last one is overwritten before it is read.
    pub(super) fn restart(&mut self) {
        self.time_ns = 0;
        self.checked = 0;
        self.before = None;
        self.seen = [Seen::NOTHING; 2];
        self.stage = Stage::Samples;
    }

    /// Samples looked at.
    pub(super) fn checked(&self) -> u32 {
        self.checked
    }

    /// Joint angles at the start and the end of the movement, in rad, once it has passed.
    pub(super) fn ends_rad(&self) -> [[f32; 2]; 2] {
        [self.start_rad, self.end_rad]
    }

    /// Looks at one more sample; after the last, a few more steps come to the verdict. What the movement leaves of each
    /// limit is written to `margins`, and is whole once it has passed.
    pub(super) fn advance(&mut self, trajectory: &Trajectory, constants: &Constants, margins: &mut Margins) -> Step {
        match self.stage {
            Stage::Samples => self.sample(trajectory, constants),
            Stage::End => {
                self.end_rad = trajectory.end_rad();
                self.stage = Stage::Margins(0);
                Step::Goes
            }
            Stage::Margins(first) => {
                let bends = !matches!(trajectory, Trajectory::Points(_));
                for (place, row) in margins.rows.iter_mut().enumerate().skip(first).take(MARGINS_PER_STEP) {
                    *row = self.margin(place, bends, constants);
                    if let Err(error) = row.verdict() {
                        return Step::Failed(error);
                    }
                }
                let next = first + MARGINS_PER_STEP;
                self.stage = Stage::Margins(next);
                if next < margins.rows.len() { Step::Goes } else { Step::Passed }
            }
        }
    }

    fn sample(&mut self, trajectory: &Trajectory, constants: &Constants) -> Step {
        // At the end itself the reference stands still; a nanosecond before, it has the velocity it arrives with.
        let last_ns = trajectory.duration_ns().saturating_sub(1);
        let reference = trajectory.reference::<f32>(self.time_ns);
        if let Err(error) = self.include(&reference) {
            return Step::Failed(error);
        }
        if self.time_ns >= last_ns {
            self.stage = Stage::End;
            return Step::Goes;
        }
        let mut next_ns = self.time_ns + constants.record_period_ns;
        if let Trajectory::Points(points) = trajectory {
            next_ns = next_ns.min((self.time_ns / points.interval_ns() + 1) * points.interval_ns());
        }
        self.time_ns = next_ns.min(last_ns);
        Step::Goes
    }

    fn include(&mut self, reference: &JointReference<f32>) -> Result<(), LimitError> {
        let time_ns = self.time_ns;
        for (index, seen) in self.seen.iter_mut().enumerate() {
            let position = reference.position_rad[index];
            let speed = reference.velocity_rad_s[index].abs();
            let acceleration = reference.acceleration_rad_s2[index];
            if !(position.is_finite() && speed.is_finite() && acceleration.is_finite()) {
                return Err(LimitError::Overflow { joint: index as u8, time_ns });
            }
            seen.low.include(-position, time_ns);
            seen.high.include(position, time_ns);
            seen.speed.include(speed, time_ns);
            seen.acceleration.include(acceleration.abs(), time_ns);
            if let Some(before) = &self.before {
                let step = acceleration - before.acceleration_rad_s2[index];
                seen.acceleration_step = seen.acceleration_step.max(step.abs());
                let bend = seen.last_step.replace(step).map_or(0.0, |last| step - last);
                seen.acceleration_bend = seen.acceleration_bend.max(bend.abs());
            } else {
                self.start_rad[index] = position;
                self.start_speed[index] = speed;
            }
        }
        self.before = Some(*reference);
        self.checked = self.checked.saturating_add(1);
        Ok(())
    }

    /// A row of [`Margins`]. A movement that `bends` may be beyond its samples between them in acceleration too.
    fn margin(&self, place: usize, bends: bool, constants: &Constants) -> Margin {
        let quantities = Quantity::ALL.len();
        let index = place / quantities;
        let quantity = Quantity::ALL.get(place % quantities).copied().unwrap_or(Quantity::Speed);
        let period_s = constants.record_period_ns as f32 * 1.0e-9;
        // The acceleration of a spline bends at its points alone, and these are among the samples.
        let bends = if bends { 1.0 / 8.0 } else { 0.0 };
        let seen = self.seen.get(index).unwrap_or(&Seen::NOTHING);
        // Chord error: interval²/8 times the second derivative of the quantity.
        let position = seen.acceleration.value * period_s * period_s / 8.0;
        let speed = seen.speed.value + seen.acceleration_step * period_s / 8.0;
        let acceleration = seen.acceleration.value + seen.acceleration_bend * bends;
        let counts_per_rad = constants.joints.get(index).map_or(0.0, |joint| joint.counts_per_rad.abs());
        let end_speed = self.before.as_ref().and_then(|end| end.velocity_rad_s.get(index));
        let (peak, time_ns) = match quantity {
            Quantity::PositionLow => (-(seen.low.value + position), seen.low.time_ns),
            Quantity::PositionHigh => (seen.high.value + position, seen.high.time_ns),
            Quantity::Speed => (speed, seen.speed.time_ns),
            Quantity::Acceleration => (acceleration, seen.acceleration.time_ns),
            Quantity::CountsPerTick => (speed * period_s * counts_per_rad, seen.speed.time_ns),
            Quantity::StartSpeed => (self.start_speed.get(index).copied().unwrap_or(f32::NAN), 0),
            Quantity::EndSpeed => (end_speed.map_or(f32::NAN, |speed| speed.abs()), self.time_ns),
        };
        let limit = constants.motion_limits.of(quantity, index);
        Margin { quantity, joint: index as u8, peak, limit, time_ns }
    }
}

//! The check of a trajectory against the limits, spread over ticks.
//!
//! [`crate::trajectory::check`] looks at the whole movement at once, which takes the board a hundred ticks. Here a few
//! record ticks are looked at each tick. Between two of them a quantity may be higher by interval²/8 times its second
//! derivative; that is taken from differences of samples, which is sound because only movements that change slowly
//! from sample to sample are admitted ([`admissible`]). Both checks agree to 3e-4 of each peak, and on the paper's
//! movement to the last bits (`tests/board`).

use super::constants::Constants;
use crate::control::JointReference;
use crate::protocol::Refusal;
use crate::trajectory::{LONGEST_MOVEMENT_NS, LimitError, Margin, Margins, Quantity, Trajectory};

/// Fewest record periods in the shortest period or fade of a movement: a sine sampled so often is between samples at
/// most 1.3 % above its largest sample, and the correction for that is good to a hundredth of it.
const RECORDS_PER_PERIOD: u64 = 20;

/// Fewest record periods between the points of a spline. Its acceleration is straight between points, and every point
/// is looked at, so none of it is missed.
const RECORDS_PER_INTERVAL: u64 = 2;

/// Refuses a movement that is malformed, or changes too much from one record tick to the next to be judged by its
/// record ticks.
pub(super) fn admissible(trajectory: &Trajectory, constants: &Constants) -> Result<(), Refusal> {
    let record_ns = constants.record_period_ns;
    let (shortest_ns, records) = match trajectory {
        Trajectory::Paper(paper) => (paper.period_ns / 2, RECORDS_PER_PERIOD),
        Trajectory::Fourier(fourier) => {
            let harmonic_ns = fourier.period_ns / (fourier.harmonics.len().max(1) as u64);
            let fade_ns = if fourier.fade_ns == 0 { u64::MAX } else { fourier.fade_ns };
            (harmonic_ns.min(fade_ns), RECORDS_PER_PERIOD)
        }
        Trajectory::Points(points) => (points.interval_ns(), RECORDS_PER_INTERVAL),
    };
    let least_ns = records * record_ns;
    if shortest_ns < least_ns {
        return Err(Refusal::TooFine { shortest_ns, least_ns });
    }
    trajectory.well_formed().map_err(Refusal::Limit)?;
    let duration_ns = trajectory.duration_ns();
    if duration_ns > LONGEST_MOVEMENT_NS {
        return Err(Refusal::Limit(LimitError::TooLong { duration_ns }));
    }
    Ok(())
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
    before: Option<JointReference<f32>>,
    seen: [Seen; 2],
    start_rad: [f32; 2],
    start_speed: [f32; 2],
    stage: Stage,
}

/// What a check does next.
#[derive(Clone, Copy, Debug)]
enum Stage {
    /// Looks at a sample.
    Samples,
    /// Works out where the movement ends, having looked at the last sample, this one.
    End(JointReference<f32>),
    /// Compares with the limits: the last sample, and where the movement ends.
    Margins(JointReference<f32>, [f32; 2]),
}

/// What a step of a check came to.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "returned once a tick, and nothing here allocates")]
pub(super) enum Step {
    /// It is not over.
    Goes,
    /// The movement may be run.
    Passed {
        margins: Margins,
        /// Joint angles at its start and its end, in rad.
        ends_rad: [[f32; 2]; 2],
    },
    /// It breaks a limit, the first one found.
    Failed(LimitError),
}

impl TrajectoryCheck {
    pub(super) fn new() -> Self {
        Self {
            time_ns: 0,
            checked: 0,
            before: None,
            seen: [Seen::NOTHING; 2],
            start_rad: [0.0; 2],
            start_speed: [0.0; 2],
            stage: Stage::Samples,
        }
    }

    /// Samples looked at.
    pub(super) fn checked(&self) -> u32 {
        self.checked
    }

    /// Looks at one more sample; after the last, two more steps come to the verdict.
    pub(super) fn advance(&mut self, trajectory: &Trajectory, constants: &Constants) -> Step {
        match self.stage {
            Stage::Samples => self.sample(trajectory, constants),
            Stage::End(last) => {
                self.stage = Stage::Margins(last, trajectory.end_rad());
                Step::Goes
            }
            Stage::Margins(last, end_rad) => {
                let margins = self.margins(&last, trajectory, constants);
                match margins.verdict() {
                    Ok(()) => Step::Passed { margins, ends_rad: [self.start_rad, end_rad] },
                    Err(error) => Step::Failed(error),
                }
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
            self.stage = Stage::End(reference);
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

    fn margins(&self, end: &JointReference<f32>, trajectory: &Trajectory, constants: &Constants) -> Margins {
        let limits = &constants.motion_limits;
        let period_s = constants.record_period_ns as f32 * 1.0e-9;
        // The acceleration of a spline bends at its points alone, and these are among the samples.
        let bends = if matches!(trajectory, Trajectory::Points(_)) { 0.0 } else { 1.0 / 8.0 };
        let row = |index: usize, quantity: Quantity| {
            let seen = self.seen.get(index).unwrap_or(&Seen::NOTHING);
            // Chord error: interval²/8 times the second derivative of the quantity.
            let position = seen.acceleration.value * period_s * period_s / 8.0;
            let speed = seen.speed.value + seen.acceleration_step * period_s / 8.0;
            let acceleration = seen.acceleration.value + seen.acceleration_bend * bends;
            let counts_per_rad = constants.joints.get(index).map_or(0.0, |joint| joint.counts_per_rad.abs());
            let (peak, time_ns) = match quantity {
                Quantity::PositionLow => (-(seen.low.value + position), seen.low.time_ns),
                Quantity::PositionHigh => (seen.high.value + position, seen.high.time_ns),
                Quantity::Speed => (speed, seen.speed.time_ns),
                Quantity::Acceleration => (acceleration, seen.acceleration.time_ns),
                Quantity::CountsPerTick => (speed * period_s * counts_per_rad, seen.speed.time_ns),
                Quantity::StartSpeed => (self.start_speed.get(index).copied().unwrap_or(f32::NAN), 0),
                Quantity::EndSpeed => (end.velocity_rad_s.get(index).map_or(f32::NAN, |v| v.abs()), self.time_ns),
            };
            Margin { quantity, joint: index as u8, peak, limit: limits.of(quantity, index), time_ns }
        };
        let quantities = Quantity::ALL.len();
        Margins {
            rows: core::array::from_fn(|place| {
                let quantity = Quantity::ALL.get(place % quantities).copied().unwrap_or(Quantity::Speed);
                row(place / quantities, quantity)
            }),
        }
    }
}

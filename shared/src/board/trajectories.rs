//! Loading a trajectory in parts, and having it checked before it may run.

use super::constants::Constants;
use super::trajectory_check::{TrajectoryCheck, resolved};
use crate::protocol::{Refusal, TrajectoryPart, TrajectoryState};
use crate::trajectory::{LimitError, MAX_POINTS, Margins, Points, Trajectory};
use heapless::Vec;

/// Time for one sample of the check, in ns: a Fourier series of eight harmonics takes the board about 15 µs. So many
/// samples are looked at in a tick that this takes at most about a fifth of it.
const SAMPLE_NS: u64 = 70_000;

/// How far the trajectory has come.
#[derive(Clone, Debug)]
enum Stage {
    Empty,
    Loading { interval_ns: u64, points: u16 },
    Checking(TrajectoryCheck),
    Accepted(Margins),
    Refused(LimitError),
}

/// The trajectory and the points on their way to becoming one.
#[derive(Clone, Debug)]
pub(super) struct Trajectories {
    stage: Stage,
    trajectory: Option<Trajectory>,
    rows: u32,
    points_rad: Vec<[f32; 2], MAX_POINTS>,
}

impl Trajectories {
    pub(super) const fn new() -> Self {
        Self { stage: Stage::Empty, trajectory: None, rows: 0, points_rad: Vec::new() }
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.stage = Stage::Empty;
        self.trajectory = None;
        self.points_rad.clear();
    }

    /// Takes a part. What was loaded before is given up with the first part of a new trajectory. `capacity` is how
    /// many rows a recording holds.
    pub(super) fn load(&mut self, part: &TrajectoryPart, constants: &Constants, capacity: u32) -> Result<(), Refusal> {
        match part {
            TrajectoryPart::Paper(paper) => self.begin_check(Trajectory::Paper(*paper), constants, capacity),
            TrajectoryPart::Fourier(fourier) => {
                self.begin_check(Trajectory::Fourier(fourier.clone()), constants, capacity)
            }
            &TrajectoryPart::BeginPoints { interval_ns, points } => {
                self.clear();
                if usize::from(points) > MAX_POINTS {
                    return Err(Refusal::Limit(LimitError::TooManyPoints { points: u32::from(points) }));
                }
                if points < 2 {
                    return Err(Refusal::Limit(LimitError::TooFewPoints { points }));
                }
                self.stage = Stage::Loading { interval_ns, points };
                Ok(())
            }
            TrajectoryPart::Points { from, points_rad } => self.add_points(*from, points_rad, constants, capacity),
        }
    }

    fn add_points(
        &mut self,
        from: u16,
        points_rad: &[[f32; 2]],
        constants: &Constants,
        capacity: u32,
    ) -> Result<(), Refusal> {
        let received = self.points_rad.len() as u16;
        let (interval_ns, points) = match self.stage {
            Stage::Loading { interval_ns, points } => (interval_ns, points),
            _ => (0, 0),
        };
        let out_of_order = Refusal::PointsOutOfOrder { from, received, points };
        if from != received || points_rad.len() > usize::from(points.saturating_sub(received)) {
            return Err(out_of_order);
        }
        self.points_rad.extend_from_slice(points_rad).map_err(|_| out_of_order)?;
        if self.points_rad.len() < usize::from(points) {
            return Ok(());
        }
        match Points::new(interval_ns, &self.points_rad) {
            Ok(spline) => self.begin_check(Trajectory::Points(spline), constants, capacity),
            Err(error) => {
                self.clear();
                Err(Refusal::Limit(error))
            }
        }
    }

    fn begin_check(&mut self, trajectory: Trajectory, constants: &Constants, capacity: u32) -> Result<(), Refusal> {
        self.clear();
        let rows = trajectory.record_periods(constants.record_period_ns);
        let fits = u32::try_from(rows).ok().filter(|&rows| rows <= capacity);
        let rows = fits.ok_or(Refusal::TooManyRows { rows, capacity })?;
        resolved(&trajectory, constants)?;
        self.rows = rows;
        self.trajectory = Some(trajectory);
        self.stage = Stage::Checking(TrajectoryCheck::new());
        Ok(())
    }

    /// Goes on with a check, for a small part of a loop period.
    pub(super) fn advance_check(&mut self, constants: &Constants) {
        let (Stage::Checking(check), Some(trajectory)) = (&mut self.stage, &self.trajectory) else {
            return;
        };
        for _ in 0..(constants.loop_period_ns / SAMPLE_NS).max(1) {
            match check.advance(trajectory, constants) {
                None => {}
                Some(Ok(margins)) => {
                    self.stage = Stage::Accepted(margins);
                    return;
                }
                Some(Err(error)) => {
                    self.clear();
                    self.stage = Stage::Refused(error);
                    return;
                }
            }
        }
    }

    /// The trajectory, if it may be run, and how many rows its recording has.
    pub(super) fn accepted(&self) -> Option<(&Trajectory, u32)> {
        match (&self.stage, &self.trajectory) {
            (Stage::Accepted(_), Some(trajectory)) => Some((trajectory, self.rows)),
            _ => None,
        }
    }

    pub(super) fn state(&self) -> TrajectoryState {
        match &self.stage {
            Stage::Empty => TrajectoryState::Empty,
            Stage::Loading { points, .. } => {
                TrajectoryState::Loading { received: self.points_rad.len() as u16, points: *points }
            }
            Stage::Checking(check) => TrajectoryState::Checking { checked: check.checked(), rows: self.rows },
            Stage::Accepted(margins) => TrajectoryState::Accepted { margins: *margins, rows: self.rows },
            Stage::Refused(error) => TrajectoryState::Refused(*error),
        }
    }
}

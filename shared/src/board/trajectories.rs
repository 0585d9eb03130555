//! Loading a trajectory in parts, and having it checked before it may run.

use super::Findings;
use super::constants::Constants;
use super::trajectory_check::{MovementFindings, Step, TrajectoryCheck};
use crate::protocol::{Refusal, Reply, TrajectoryPart, TrajectoryPhase, TrajectoryState};
use crate::trajectory::{LimitError, MAX_POINTS, Margin, Margins, Points, Quantity, Trajectory};
use heapless::Vec;

/// Time for one sample of the check, in ns: a Fourier series of eight harmonics takes the board about 15 µs. So many
/// samples are looked at in a tick that this takes at most about a fifth of it.
const SAMPLE_NS: u32 = 70_000;

/// How far the trajectory has come.
#[derive(Clone, Debug)]
enum Stage {
    Empty,
    Loading { interval_ns: u64, points: u16 },
    Checking,
    Accepted,
    Refused(LimitError),
}

/// No margin, before any is known.
const NO_MARGIN: Margin = Margin { quantity: Quantity::Speed, joint: 0, peak: f32::NAN, limit: f32::NAN, time_ns: 0 };

/// A trajectory that may be run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Accepted<'a> {
    pub(super) trajectory: &'a Trajectory,
    /// Joint angles at its start, in rad.
    pub(super) start_rad: [f32; 2],
    /// Joint angles at its end, in rad.
    pub(super) end_rad: [f32; 2],
    /// Rows its recording has.
    pub(super) rows: u32,
}

/// The trajectory and the points on their way to becoming one.
///
/// The check and its margins have places of their own instead of being part of the stage, because a stage is moved
/// when it is entered, which would take as long as a law of control.
#[derive(Clone, Debug)]
pub(super) struct Trajectories {
    stage: Stage,
    trajectory: Option<Trajectory>,
    rows: u32,
    check: TrajectoryCheck,
    /// Whole once the trajectory is accepted.
    margins: Margins,
    points_rad: Vec<[f32; 2], MAX_POINTS>,
}

impl Trajectories {
    pub(super) const fn new() -> Self {
        Self {
            stage: Stage::Empty,
            trajectory: None,
            rows: 0,
            check: TrajectoryCheck::new(),
            margins: Margins { rows: [NO_MARGIN; 14] },
            points_rad: Vec::new(),
        }
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.stage = Stage::Empty;
        self.trajectory = None;
        self.points_rad.clear();
    }

    /// Takes a part. What was loaded before is given up with the first part of a new trajectory. `capacity` is how
    /// many rows a recording holds.
    pub(super) fn load(
        &mut self,
        part: &TrajectoryPart,
        findings: &Findings,
        constants: &Constants,
        capacity: u32,
    ) -> Result<(), Refusal> {
        match part {
            TrajectoryPart::Paper(paper) => {
                self.clear();
                let examined = findings.movement().copied().unwrap_or_else(|| MovementFindings::of_paper(paper));
                self.trajectory = Some(Trajectory::Paper(*paper));
                self.begin_check(examined.rows_to_record(constants, capacity))
            }
            TrajectoryPart::Fourier(fourier) => {
                self.clear();
                let examined = findings.movement().copied().unwrap_or_else(|| MovementFindings::of_fourier(fourier));
                self.trajectory = Some(Trajectory::Fourier(fourier.clone()));
                self.begin_check(examined.rows_to_record(constants, capacity))
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
            Ok(spline) => {
                self.clear();
                let rows = MovementFindings::of_points(&spline).rows_to_record(constants, capacity);
                self.trajectory = Some(Trajectory::Points(spline));
                self.begin_check(rows)
            }
            Err(error) => {
                self.clear();
                Err(Refusal::Limit(error))
            }
        }
    }

    /// Begins to check the trajectory, or forgets it. It is put in place before: four kilobytes of spline are not to be
    /// copied to and fro.
    #[inline(never)]
    fn begin_check(&mut self, rows: Result<u32, Refusal>) -> Result<(), Refusal> {
        match rows {
            Ok(rows) => {
                self.rows = rows;
                self.check.restart();
                self.stage = Stage::Checking;
                Ok(())
            }
            Err(refusal) => {
                self.clear();
                Err(refusal)
            }
        }
    }

    /// Goes on with a check, for a small part of a loop period: one sample while `powered`, when every tick has a law
    /// to compute as well.
    pub(super) fn advance_check(&mut self, constants: &Constants, powered: bool) {
        let (Stage::Checking, Some(trajectory)) = (&self.stage, &self.trajectory) else {
            return;
        };
        let samples = if powered { 1 } else { (constants.loop_period_ns as u32 / SAMPLE_NS).max(1) };
        for _ in 0..samples {
            match self.check.advance(trajectory, constants, &mut self.margins) {
                Step::Goes => {}
                Step::Passed => {
                    self.stage = Stage::Accepted;
                    return;
                }
                Step::Failed(error) => {
                    self.clear();
                    self.stage = Stage::Refused(error);
                    return;
                }
            }
        }
    }

    /// The trajectory, if it may be run.
    pub(super) fn accepted(&self) -> Option<Accepted<'_>> {
        match (&self.stage, &self.trajectory) {
            (Stage::Accepted, Some(trajectory)) => {
                let [start_rad, end_rad] = self.check.ends_rad();
                Some(Accepted { trajectory, start_rad, end_rad, rows: self.rows })
            }
            _ => None,
        }
    }

    /// The state without its numbers.
    pub(super) fn phase(&self) -> TrajectoryPhase {
        match &self.stage {
            Stage::Empty => TrajectoryPhase::Empty,
            Stage::Loading { .. } => TrajectoryPhase::Loading,
            Stage::Checking => TrajectoryPhase::Checking,
            Stage::Accepted => TrajectoryPhase::Accepted,
            Stage::Refused(_) => TrajectoryPhase::Refused,
        }
    }

    /// Answers with the state.
    pub(super) fn report(&self, reply: &mut Reply) {
        *reply = match &self.stage {
            Stage::Empty => Reply::Trajectory(TrajectoryState::Empty),
            Stage::Loading { points, .. } => {
                Reply::Trajectory(TrajectoryState::Loading { received: self.points_rad.len() as u16, points: *points })
            }
            Stage::Checking => {
                Reply::Trajectory(TrajectoryState::Checking { checked: self.check.checked(), rows: self.rows })
            }
            Stage::Accepted => {
                *reply = Reply::Trajectory(TrajectoryState::Accepted { margins: self.margins, rows: self.rows });
                return;
            }
            Stage::Refused(error) => Reply::Trajectory(TrajectoryState::Refused(*error)),
        };
    }
}

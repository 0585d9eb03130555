//! One movement: load, check, run, collect the stream, and compare it with the board's own recording.

use std::collections::BTreeMap;
use std::time::Duration;

use shared::load::LoadNews;
use shared::protocol::{
    BoardMessage, ControlLaw, EndedBy, Event, Mode, POINTS_PER_FRAME, ROWS_PER_FRAME, RecordingInfo, Reply, Request,
    Sample, TrajectoryPart, TrajectoryState,
};
use shared::trajectory::{Margins, Points, Trajectory};

use super::{Client, ClientError};

/// How often the host shows that it is there while a movement runs.
const KEEP_ALIVE: Duration = Duration::from_millis(100);
/// How long the check of a trajectory may stand still. Not how long it may take: an emulated board's clock and the
/// host's need not go at the same pace.
const CHECK_STALL: Duration = Duration::from_secs(3);

/// What is to be run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovementPlan {
    /// The law in charge.
    pub law: ControlLaw,
    /// How long to stand at the start, in ns, so that every movement begins settled.
    pub settle_ns: u64,
}

/// Where a movement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MovementProgress {
    /// On the way to the start, or settling there.
    Approaching,
    /// Recording.
    Running {
        /// Rows seen so far.
        rows: u32,
        /// Rows it will have.
        planned: u32,
    },
    /// Reading the board's recording.
    Reading {
        /// Rows read so far.
        rows: u32,
        /// Rows there are.
        planned: u32,
    },
}

/// What a movement brought.
#[derive(Clone, Debug, PartialEq)]
pub struct Movement {
    /// The rows, in order; without gaps unless the board went away.
    pub samples: Vec<Sample>,
    /// Rows it should have had.
    pub planned_rows: u32,
    /// What the board says about its recording; nothing where it went away.
    pub recording: Option<RecordingInfo>,
    /// Rows that came with the stream.
    pub streamed_rows: u32,
    /// Rows that were lost on the way and read from the board's memory.
    pub reread_rows: u32,
    /// Rows that came differently over the stream than they stand in the board's memory: none on a sound link.
    pub differing_rows: u32,
    /// Why the movement is not whole, where it is not.
    pub partial: Option<String>,
}

/// Looks on while a movement runs, and may have its say.
pub trait MovementWatcher {
    /// A row came with the stream; what is returned is asked of the board at once.
    fn row(&mut self, sample: &Sample) -> Option<Request> {
        let _ = sample;
        None
    }

    /// The board's identification of the load has come further.
    fn load(&mut self, tick: u64, news: &LoadNews) {
        let _ = (tick, news);
    }
}

/// Nobody looks on.
pub struct Unwatched;

impl MovementWatcher for Unwatched {}

impl Client {
    /// Loads a trajectory and waits for the board's verdict.
    pub fn load_trajectory(&mut self, trajectory: &Trajectory) -> Result<(Margins, u32), ClientError> {
        match trajectory {
            Trajectory::Paper(paper) => self.load_part(TrajectoryPart::Paper(*paper))?,
            Trajectory::Fourier(fourier) => self.load_part(TrajectoryPart::Fourier(fourier.clone()))?,
            Trajectory::Points(points) => self.load_points(points)?,
        };
        let mut last_progress = (0, self.now());
        loop {
            let state = match self.request(Request::ReadTrajectory)? {
                Reply::Trajectory(state) => state,
                _ => return Err(ClientError::Unexpected { request: "the question for the trajectory" }),
            };
            match state {
                TrajectoryState::Accepted { margins, rows } => return Ok((margins, rows)),
                TrajectoryState::Refused(error) => {
                    let refusal = shared::protocol::Refusal::Limit(error);
                    return Err(ClientError::Refused { request: "the trajectory", refusal });
                }
                TrajectoryState::Checking { checked, .. } if checked > last_progress.0 => {
                    last_progress = (checked, self.now());
                    self.wait(Duration::from_millis(20))?;
                }
                TrajectoryState::Checking { .. } if self.now() < last_progress.1 + CHECK_STALL => {
                    self.wait(Duration::from_millis(20))?;
                }
                _ => return Err(ClientError::Unexpected { request: "the trajectory" }),
            }
        }
    }

    fn load_part(&mut self, part: TrajectoryPart) -> Result<(), ClientError> {
        match self.request(Request::LoadTrajectory(part))? {
            Reply::Trajectory(_) => Ok(()),
            _ => Err(ClientError::Unexpected { request: "the trajectory" }),
        }
    }

    fn load_points(&mut self, points: &Points) -> Result<(), ClientError> {
        let all = points.points_rad();
        self.load_part(TrajectoryPart::BeginPoints { interval_ns: points.interval_ns(), points: all.len() as u16 })?;
        for (chunk, points) in all.chunks(POINTS_PER_FRAME).enumerate() {
            let from = (chunk * POINTS_PER_FRAME) as u16;
            let points_rad = heapless::Vec::from_slice(points).unwrap_or_default();
            self.load_part(TrajectoryPart::Points { from, points_rad })?;
        }
        Ok(())
    }

    /// Arms, runs the loaded trajectory to its end, disarms, and reads the recording.
    ///
    /// An error before the start is an error; afterwards what was recorded is returned with the reason in
    /// [`Movement::partial`].
    pub fn run(
        &mut self,
        plan: &MovementPlan,
        progress: &mut dyn FnMut(MovementProgress),
    ) -> Result<Movement, ClientError> {
        self.run_watched(plan, progress, &mut Unwatched)
    }

    /// [`Self::run`] with somebody looking on.
    pub fn run_watched(
        &mut self,
        plan: &MovementPlan,
        progress: &mut dyn FnMut(MovementProgress),
        watcher: &mut dyn MovementWatcher,
    ) -> Result<Movement, ClientError> {
        self.arm()?;
        let request = Request::Run { law: plan.law, stream: true, settle_ns: plan.settle_ns };
        let started = match self.request(request) {
            Ok(Reply::Started { movement, rows, .. }) => (movement, rows),
            Ok(_) => return self.give_up(ClientError::Unexpected { request: "running" }),
            Err(error) => return self.give_up(error),
        };
        let (movement, planned_rows) = started;
        let mut stream = BTreeMap::new();
        progress(MovementProgress::Approaching);
        let collected = self.collect(movement, planned_rows, &mut stream, progress, watcher);
        let recorded = collected.and_then(|info| {
            // The arm stands at the end of the movement: switch off, the brakes hold it.
            if !matches!(info.ended, Some(EndedBy::Fault(_))) {
                self.command(Request::Disarm)?;
            }
            Ok((info, self.read_recording(&info, progress)?))
        });
        let interrupted = self.interrupt.asked_by();
        Ok(match recorded {
            Ok((info, samples)) => {
                let mut movement = compare(info, samples, &stream);
                if let Some(by) = interrupted
                    && info.ended == Some(EndedBy::Stopped)
                {
                    movement.partial = Some(format!("it was interrupted at the computer ({})", by.name()));
                }
                movement
            }
            Err(error) => Movement {
                streamed_rows: stream.len() as u32,
                samples: stream.into_values().collect(),
                planned_rows,
                recording: None,
                reread_rows: 0,
                differing_rows: 0,
                partial: Some(error.to_string()),
            },
        })
    }

    /// Switches off after a failed start; the first error is the one that matters.
    fn give_up<T>(&mut self, error: ClientError) -> Result<T, ClientError> {
        let _ = self.command(Request::Disarm);
        Err(error)
    }

    /// Gathers the stream until the board says that the movement is over.
    fn collect(
        &mut self,
        movement: u32,
        planned_rows: u32,
        stream: &mut BTreeMap<u32, Sample>,
        progress: &mut dyn FnMut(MovementProgress),
        watcher: &mut dyn MovementWatcher,
    ) -> Result<RecordingInfo, ClientError> {
        let mut heeded = 0;
        loop {
            let asked = self.interrupt.asked();
            if asked > heeded {
                heeded = asked;
                self.command(if asked == 1 { Request::Stop } else { Request::Disarm })?;
            }
            let until = self.now() + KEEP_ALIVE;
            let mut over = false;
            while let Some(message) = self.next_unasked(until)? {
                match message {
                    BoardMessage::Telemetry { movement: of, sample } if of == movement => {
                        stream.insert(sample.index, sample);
                        if let Some(request) = watcher.row(&sample) {
                            self.request(request)?;
                        }
                        progress(MovementProgress::Running { rows: stream.len() as u32, planned: planned_rows });
                    }
                    BoardMessage::Event(Event::Mode { mode, .. }) => {
                        over = matches!(mode, Mode::Holding(_) | Mode::Fault(_) | Mode::Idle);
                    }
                    BoardMessage::Event(Event::Load { tick, news }) => watcher.load(tick, &news),
                    _ => {}
                }
                // A steady stream must not keep the host from showing that it is there.
                if over || self.now() >= until {
                    break;
                }
            }
            // Any request keeps the link alive; this one also tells the end where its event was lost. The board's own
            // limits see to it that a movement ends.
            let status = self.status()?;
            let info = status.recording;
            // Stopped, the arm is still slowing down: switched off now, it would be caught by the brakes.
            if info.movement == movement && info.ended.is_some() && !status.mode.is_moving() {
                // Rows that were on the way when the end was told have arrived before this answer.
                for message in self.unasked.drain(..) {
                    match message {
                        BoardMessage::Telemetry { movement: of, sample } if of == movement => {
                            stream.insert(sample.index, sample);
                        }
                        BoardMessage::Event(Event::Load { tick, news }) => watcher.load(tick, &news),
                        _ => {}
                    }
                }
                return Ok(info);
            }
            if !status.mode.is_moving() {
                return Err(ClientError::Unexpected { request: "running" });
            }
        }
    }

    /// The last movement, from the board's memory; nothing where the board has recorded none since its start.
    pub fn last_movement(
        &mut self,
        progress: &mut dyn FnMut(MovementProgress),
    ) -> Result<Option<Movement>, ClientError> {
        let info = match self.request(Request::RecordingInfo)? {
            Reply::Recording(info) => info,
            _ => return Err(ClientError::Unexpected { request: "the question for the recording" }),
        };
        if info.rows == 0 {
            return Ok(None);
        }
        let samples = self.read_recording(&info, progress)?;
        Ok(Some(compare(info, samples, &BTreeMap::new())))
    }

    /// Reads the whole recording from the board's memory. Where the line damages long frames, rows are asked for in
    /// shorter ones; given up is only when a single row does not come.
    pub fn read_recording(
        &mut self,
        info: &RecordingInfo,
        progress: &mut dyn FnMut(MovementProgress),
    ) -> Result<Vec<Sample>, ClientError> {
        let mut samples: Vec<Sample> = Vec::new();
        let mut rows_at_once = ROWS_PER_FRAME as u32;
        while (samples.len() as u32) < info.rows {
            let from = samples.len() as u32;
            let count = (info.rows - from).min(rows_at_once) as u16;
            let repeats = self.repeats;
            let reply = self.request(Request::ReadRecording { from, count });
            if self.repeats - repeats > 1 {
                // Half the bytes are damaged half as often.
                rows_at_once = (rows_at_once / 2).max(1);
            }
            let rows = match reply {
                Err(ClientError::NoAnswer { .. }) if count > 1 => continue,
                reply => reply?,
            };
            let rows = match rows {
                Reply::Rows(rows) if rows.movement == info.movement && rows.from == from && !rows.rows.is_empty() => {
                    rows
                }
                _ => return Err(ClientError::Unexpected { request: "reading the recording" }),
            };
            samples.extend(rows.samples());
            progress(MovementProgress::Reading { rows: samples.len() as u32, planned: info.rows });
        }
        Ok(samples)
    }
}

/// Puts the board's recording and the stream side by side.
fn compare(info: RecordingInfo, samples: Vec<Sample>, stream: &BTreeMap<u32, Sample>) -> Movement {
    let mut reread_rows = 0;
    let mut differing_rows = 0;
    for sample in &samples {
        match stream.get(&sample.index) {
            None => reread_rows += 1,
            Some(streamed) if streamed != sample => differing_rows += 1,
            Some(_) => {}
        }
    }
    let partial = match info.ended {
        Some(EndedBy::Completed) => None,
        Some(EndedBy::Stopped) => Some("the movement was stopped before its end".into()),
        Some(EndedBy::Fault(fault)) => Some(fault.to_string()),
        None => Some("the movement has not ended".into()),
    };
    Movement {
        samples,
        planned_rows: info.planned_rows,
        recording: Some(info),
        streamed_rows: stream.len() as u32,
        reread_rows,
        differing_rows,
        partial,
    }
}

//! Recordings made ready for simulation, and the two residuals every stage works with.

use std::borrow::Cow;

use shared::control::{Cascade, Law, LawState, PositionLaw, SampledTiming};
use shared::drive::{centre_of_count, mean_count};
use shared::plant::{Plant, State};
use shared::replay::{ClosedLoopTick, ReplaySettings};

use super::IdentifyError;
use super::followed::Followed;
use super::low_pass::low_pass;
use super::parameters::{Parameter, Values};
use super::simulation::Simulation;
use super::step;
use crate::recording::{Manifest, Recording};
use crate::robot::{self, Robot};

/// The longest integration step of a closed loop that is judged or fitted finely.
const FINE_STEP_S: f64 = 5e-5;

/// No reference that an arm can follow has anything above this; the rounding of its samples has.
const REFERENCE_CUTOFF_HZ: f64 = 40.0;

/// How finely the closed loop is integrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fineness {
    /// One step per record period: exact to the encoder's rounding at 0.7 ms, for searches.
    Coarse,
    /// Steps of at most 0.05 ms: for the result itself.
    Fine,
}

/// The first moments carry the unknown start, not the parameters: four time constants of the
/// 4 Hz state correction.
const SETTLING_S: f64 = 0.2;

/// The shortest stretch without gaps that is worth simulating.
const SHORTEST_SEGMENT_S: f64 = 0.35;

/// A stretch of a recording without gaps, as the model takes it.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Reference in counts, one pair a sample; the second joint of a single axis is zero throughout.
    pub reference_counts: Vec<[f64; 2]>,
    /// The reference as the model's loop takes it: the recorded one where the loop runs once a sample. A faster loop
    /// sees the reference between the samples too, so there it is freed from the rounding of its samples.
    pub(crate) model_reference_counts: Vec<[f64; 2]>,
    /// Recorded motor position in counts, as truncated.
    pub(crate) actual_counts: Vec<[f64; 2]>,
    /// Recorded tracking error in counts.
    pub error_counts: Vec<[f64; 2]>,
    /// Motor position in counts: middle of the cell of the truncated count.
    pub measured_counts: Vec<[f64; 2]>,
    /// Command computed at each sample in A.
    pub command_a: Vec<[f64; 2]>,
    /// Known motor torque beside the command in N m.
    pub added_torque_nm: Vec<[f64; 2]>,
    /// Current as recorded in A.
    pub current_a: Vec<[f64; 2]>,
    /// When it begins, in s after the start of the recording.
    pub start_s: f64,
    pub(crate) start: State<f64>,
    /// The laws the recording was made under.
    pub(crate) laws: [Law<f64>; 2],
    /// Which of the experiment's recordings it is part of.
    pub recording: usize,
    /// The segment as a model takes it that is counted from the robot's own motion.
    pub(super) followed: Followed,
}

impl Segment {
    /// The reference that the model's loop has at the sample after the `k`-th; behind the last it goes on as it went.
    pub(crate) fn next_model_reference(&self, k: usize) -> [f64; 2] {
        following(&self.model_reference_counts, k)
    }
}

/// The reference at the sample after the `k`-th of `references`; behind the last it goes on as it went.
pub(crate) fn following(references: &[[f64; 2]], k: usize) -> [f64; 2] {
    let here = references[k];
    let before = references[k.saturating_sub(1)];
    references.get(k + 1).copied().unwrap_or([0, 1].map(|joint: usize| 2.0 * here[joint] - before[joint]))
}

/// A robot, the recordings made on it, and how a model repeats them.
#[derive(Clone, Debug)]
pub struct Experiment<'a> {
    /// The robot the recordings were made on.
    pub robot: &'a Robot,
    /// Its recordings, cut at gaps.
    pub segments: Vec<Segment>,
    timing: SampledTiming,
    /// Integration steps per record period of the innovations, the same for every candidate.
    pub(crate) innovation_substeps: u32,
}

impl<'a> Experiment<'a> {
    /// An experiment without a recording.
    pub(super) fn empty(robot: &'a Robot) -> Self {
        let timing = SampledTiming {
            record_period_s: robot.record_period_s,
            loop_period_s: robot.loop_period_s,
            command_delay_s: robot.command_delay_s,
        };
        Self { robot, segments: Vec::new(), timing, innovation_substeps: step::FEWEST_SUBSTEPS }
    }

    /// Prepares `recordings`. The commands are those recorded, or the law's on the recorded errors.
    pub fn new(robot: &'a Robot, recordings: &[Recording]) -> Result<Self, IdentifyError> {
        let mut experiment = Self::empty(robot);
        let shortest = (SHORTEST_SEGMENT_S / robot.record_period_s) as usize;
        for (index, recording) in recordings.iter().enumerate() {
            let before = experiment.segments.len();
            for range in contiguous(&recording.tick) {
                if range.len() >= shortest {
                    let segment = experiment.segment(recording, index, range);
                    experiment.segments.push(segment);
                }
            }
            if experiment.segments.len() == before {
                return Err(IdentifyError::TooShort {
                    path: recording.path.clone(),
                    samples: recording.tick.len(),
                    needed: shortest,
                });
            }
        }
        experiment.innovation_substeps = experiment.substeps_needed();
        Ok(experiment)
    }

    fn segment(&self, recording: &Recording, index: usize, range: std::ops::Range<usize>) -> Segment {
        let laws = laws(self.robot, recording.manifest.as_ref());
        let joints = self.robot.joints.len();
        let pairs = |columns: &[Vec<f64>]| -> Vec<[f64; 2]> {
            range.clone().map(|k| [columns[0][k], if joints > 1 { columns[1][k] } else { 0.0 }]).collect()
        };
        let reference_counts = pairs(&recording.reference_counts);
        let error_counts = pairs(&recording.error_counts);
        let actual: Vec<[f64; 2]> =
            reference_counts.iter().zip(&error_counts).map(|(r, e)| [r[0] - e[0], r[1] - e[1]]).collect();
        let measured_counts: Vec<[f64; 2]> =
            if self.robot.quantised { actual.iter().map(|a| a.map(centre_of_count)).collect() } else { actual.clone() };
        let command_a = match (&recording.command_a, self.robot.current_is_command) {
            (Some(columns), _) => pairs(columns),
            (None, true) => pairs(&recording.current_a),
            (None, false) => {
                let mut states = laws.map(LawState::new);
                reference_counts
                    .iter()
                    .zip(&actual)
                    .map(|(r, a)| [states[0].command_a(r[0], a[0]), states[1].command_a(r[1], a[1])])
                    .collect()
            }
        };
        let added_torque_nm = match &recording.added_torque {
            // Added commands are in the command's unit, like every current.
            Some(columns) => pairs(columns)
                .into_iter()
                .map(|pair| std::array::from_fn(|j| pair[j] * self.torque_constant(j)))
                .collect(),
            None => vec![[0.0; 2]; reference_counts.len()],
        };
        let start = self.start(&measured_counts);
        let model_reference_counts = self.model_reference(&reference_counts);
        let followed = Followed::new(self, &reference_counts, &actual, &measured_counts, &added_torque_nm);
        Segment {
            followed,
            reference_counts,
            model_reference_counts,
            actual_counts: actual,
            error_counts,
            measured_counts,
            command_a,
            added_torque_nm,
            current_a: pairs(&recording.current_a),
            start_s: f64::from(recording.tick[range.start].wrapping_sub(recording.tick[0]))
                * self.timing.record_period_s,
            start,
            laws,
            recording: index,
        }
    }

    /// A recorded reference as the model's loop takes it ([`Segment::model_reference_counts`]).
    pub(crate) fn model_reference(&self, reference_counts: &[[f64; 2]]) -> Vec<[f64; 2]> {
        if !(self.robot.quantised && self.timing.loop_is_faster_than_recording()) {
            return reference_counts.to_vec();
        }
        let smooth: [Vec<f64>; 2] = std::array::from_fn(|joint| {
            let centres: Vec<f64> = reference_counts.iter().map(|pair| centre_of_count(pair[joint])).collect();
            low_pass(&centres, self.robot.record_period_s, REFERENCE_CUTOFF_HZ)
        });
        (0..reference_counts.len()).map(|k| [mean_count(smooth[0][k]), mean_count(smooth[1][k])]).collect()
    }

    fn torque_constant(&self, joint: usize) -> f64 {
        self.robot.joints.get(joint).map_or(0.0, |j| j.torque_constant_nm_per_a)
    }

    /// Counts per radian (or metre) of a joint; 1 for the idle joint of a single axis.
    pub fn counts_per_rad(&self, joint: usize) -> f64 {
        self.robot
            .joints
            .get(joint)
            .map_or(1.0 / std::f64::consts::TAU, |j| j.gear_ratio * j.counts_per_rev / std::f64::consts::TAU)
    }

    /// The state at the first sample: a parabola through the first 15 ms; at rest if that travels under two counts.
    pub(super) fn start(&self, measured_counts: &[[f64; 2]]) -> State<f64> {
        let period_s = self.robot.record_period_s;
        let samples = ((0.015 / period_s) as usize).clamp(4, measured_counts.len());
        let mut state = State::at_rest([0.0; 2]);
        for joint in 0..2 {
            let counts: Vec<f64> = measured_counts[..samples].iter().map(|pair| pair[joint]).collect();
            state.position_rad[joint] = counts[0] / self.counts_per_rad(joint);
            if (counts[samples - 1] - counts[0]).abs() >= 2.0 {
                state.velocity_rad_s[joint] = initial_slope(&counts) / period_s / self.counts_per_rad(joint);
            }
        }
        state
    }

    pub(crate) fn settings(&self, substeps: u32) -> ReplaySettings {
        ReplaySettings { timing: self.timing, quantised: self.robot.quantised, substeps }
    }

    /// Whether the loop ran faster than the recording, so that most of its commands fell between the samples.
    pub fn commands_are_missing(&self) -> bool {
        self.timing.loop_is_faster_than_recording()
    }

    /// Ticks of the loop from one sample to the next.
    pub(crate) fn ticks_per_record(&self) -> u32 {
        if self.commands_are_missing() { self.timing.ticks_per_record() } else { 1 }
    }

    /// Samples in all segments.
    pub fn samples(&self) -> usize {
        self.segments.iter().map(|s| s.error_counts.len()).sum()
    }

    /// The samples of a segment that carry innovations worth fitting: all but the first moments.
    pub fn settled(&self, segment: &Segment) -> std::ops::Range<usize> {
        let skip = (SETTLING_S / self.robot.record_period_s) as usize;
        skip.min(segment.error_counts.len())..segment.error_counts.len()
    }

    pub(super) fn closed_loop_substeps(&self, fineness: Fineness) -> u32 {
        match fineness {
            Fineness::Coarse => 1,
            Fineness::Fine => (self.robot.record_period_s / FINE_STEP_S - 1e-9).ceil() as u32,
        }
    }

    /// This experiment with the leads of `values` in the place of those that the recordings were made with, for what
    /// judges many candidates of the same leads.
    pub(super) fn led(&self, values: &Values) -> Cow<'_, Self> {
        if values.lead == [None; 2] {
            return Cow::Borrowed(self);
        }
        let mut experiment = self.clone();
        for segment in &mut experiment.segments {
            for (law, lead) in segment.laws.iter_mut().zip(values.lead) {
                if let (Law::Proportional(position_loop), Some(lead)) = (law, lead) {
                    position_loop.lead = lead;
                }
            }
        }
        Cow::Owned(experiment)
    }

    /// The leads that the first recording was made with, of the joints whose lead is in `free`.
    pub(super) fn recorded_leads(&self, free: &[Parameter]) -> [Option<f64>; 2] {
        [0, 1].map(|joint| match self.segments.first()?.laws[joint] {
            Law::Proportional(position_loop) if free.contains(&Parameter::Lead(joint)) => Some(position_loop.lead),
            _ => None,
        })
    }

    fn simulation(&self, values: &Values) -> Simulation<'_, Plant<f64>> {
        Simulation { experiment: self, plant: values.plant(self.robot) }
    }

    /// The model's closed-loop tracking error and command on a segment.
    pub fn closed_loop(&self, values: &Values, segment: &Segment, fineness: Fineness) -> Vec<ClosedLoopTick<f64>> {
        let settings = self.settings(self.closed_loop_substeps(fineness));
        let mut ticks = Vec::with_capacity(segment.error_counts.len());
        self.simulation(values).closed_loop_led(segment, &settings, &values.lead, |_, tick, _| ticks.push(*tick));
        ticks
    }

    /// The paper's objective Y on all segments: the sum of squared differences between the recorded and the model's
    /// tracking errors, both joints, counts². NaN or infinite for a model that blows up.
    pub fn objective_counts2(&self, values: &Values) -> f64 {
        let simulation = self.simulation(values);
        let settings = self.settings(self.closed_loop_substeps(Fineness::Coarse));
        let mut sum = 0.0;
        for segment in &self.segments {
            simulation.closed_loop_led(segment, &settings, &values.lead, |_, _, difference| {
                sum += difference.iter().take(self.robot.joints.len()).map(|x| x * x).sum::<f64>();
            });
        }
        sum
    }

    /// Closed-loop differences, recorded minus modelled error in counts, per segment and joint.
    pub fn closed_loop_differences(&self, values: &Values, fineness: Fineness) -> Vec<[Vec<f64>; 2]> {
        let simulation = self.simulation(values);
        let settings = self.settings(self.closed_loop_substeps(fineness));
        let of = |segment: &Segment| {
            columns(segment, |push| {
                simulation.closed_loop_led(segment, &settings, &values.lead, |_, _, difference| push(difference))
            })
        };
        self.segments.iter().map(of).collect()
    }

    /// Root mean square of the closed-loop differences per joint of the robot, in counts.
    pub fn closed_loop_rms_counts(&self, values: &Values) -> Vec<f64> {
        self.rms_counts(values, Fineness::Fine)
    }

    /// The same, integrated as finely as said.
    pub(super) fn rms_counts(&self, values: &Values, fineness: Fineness) -> Vec<f64> {
        self.rms(&self.closed_loop_differences(values, fineness), |segment| 0..segment.error_counts.len())
    }

    /// Innovations in counts, per segment and joint, at every sample.
    pub fn innovations(&self, values: &Values) -> Vec<[Vec<f64>; 2]> {
        self.innovations_in(values, self.innovation_substeps)
    }

    /// The same in so many integration steps per record period.
    pub(super) fn innovations_in(&self, values: &Values, substeps: u32) -> Vec<[Vec<f64>; 2]> {
        let simulation = self.simulation(values);
        let settings = self.settings(substeps);
        let of = |segment: &Segment| {
            columns(segment, |push| {
                simulation.innovations_led(segment, &settings, &values.lead, |_, innovation| push(innovation))
            })
        };
        self.segments.iter().map(of).collect()
    }

    /// Root mean square of the settled innovations per joint of the robot, in counts.
    pub fn innovation_rms_counts(&self, values: &Values) -> Vec<f64> {
        self.rms(&self.innovations(values), |segment| self.settled(segment))
    }

    fn rms(&self, columns: &[[Vec<f64>; 2]], range: impl Fn(&Segment) -> std::ops::Range<usize>) -> Vec<f64> {
        (0..self.robot.joints.len())
            .map(|joint| {
                let (mut sum, mut count) = (0.0, 0);
                for (segment, columns) in self.segments.iter().zip(columns) {
                    let part = &columns[joint][range(segment)];
                    sum += part.iter().map(|x| x * x).sum::<f64>();
                    count += part.len();
                }
                (sum / count.max(1) as f64).sqrt()
            })
            .collect()
    }

    /// Recorded minus modelled torque (or force) of the closed loop at the drive in N m (or N), root mean square per
    /// joint over the settled samples: the state and the law's memory before the first sample are not known.
    pub fn force_gap_rms(&self, values: &Values) -> Vec<f64> {
        let difference = |segment: &Segment| {
            let model = self.closed_loop(values, segment, Fineness::Fine);
            std::array::from_fn(|joint| {
                let constant = self.torque_constant(joint);
                segment.command_a.iter().zip(&model).map(|(c, m)| (c[joint] - m.command_a[joint]) * constant).collect()
            })
        };
        let differences: Vec<[Vec<f64>; 2]> = self.segments.iter().map(difference).collect();
        self.rms(&differences, |segment| self.settled(segment))
    }
}

/// Two columns as long as `segment`, filled by `fill` a pair at a time.
fn columns(segment: &Segment, fill: impl FnOnce(&mut dyn FnMut([f64; 2]))) -> [Vec<f64>; 2] {
    let samples = segment.error_counts.len();
    let mut columns = [Vec::with_capacity(samples), Vec::with_capacity(samples)];
    fill(&mut |pair| {
        columns[0].push(pair[0]);
        columns[1].push(pair[1]);
    });
    columns
}

/// The slope at the first of equally spaced `values` of the least-squares parabola through them, per sample.
fn initial_slope(values: &[f64]) -> f64 {
    let rows = values.len();
    let design = nalgebra::DMatrix::from_fn(rows, 3, |k, power| (k as f64).powi(power as i32));
    let solution = design.svd(true, true).solve(&nalgebra::DVector::from_column_slice(values), 1e-12);
    solution.map_or(0.0, |coefficients| coefficients[1])
}

/// The laws a recording was made under: its manifest's gains, else the robot file's.
pub(super) fn laws(robot: &Robot, manifest: Option<&Manifest>) -> [Law<f64>; 2] {
    let noted = |index: usize| manifest.and_then(|manifest| manifest.joint.get(index));
    let law = |index: usize| match robot.joints.get(index) {
        Some(joint) => match joint.law {
            robot::Law::Proportional(position_loop) => {
                Law::Proportional(noted(index).map_or(position_loop, |noted| noted.in_force(&position_loop)))
            }
            robot::Law::Cascade { position_gain_per_s, velocity_gain } => Law::Cascade(Cascade {
                position_gain_per_s,
                velocity_gain,
                counts_per_unit: joint.gear_ratio * joint.counts_per_rev / std::f64::consts::TAU,
                period_s: robot.loop_period_s,
            }),
        },
        None => Law::Proportional(shared::control::PositionLoop { gain_a_per_count: 0.0, lead: 0.0 }),
    };
    [law(0), law(1)]
}

/// The ranges of samples whose ticks follow each other without a gap.
fn contiguous(tick: &[u32]) -> Vec<std::ops::Range<usize>> {
    let mut ranges = Vec::new();
    let mut from = 0;
    for k in 1..=tick.len() {
        if k == tick.len() || tick[k] != tick[k - 1].wrapping_add(1) {
            ranges.push(from..k);
            from = k;
        }
    }
    ranges
}

//! Identification: from recordings of a robot under its position loop to f1..f9, friction, and how well each is known.
//!
//! ```text
//! recordings → experiment ─→ linear (8 Hz) ─→ ladder 8, 12, 15 Hz ─→ innovations ─→ search around (on Y) ─→ result
//!                            linear.rs        least_squares.rs       least_squares.rs search.rs
//! ```
//!
//! `full` goes the whole way; `paper` is the genetic algorithm alone, over the whole search range; `linear` and `didim`
//! (baselines.rs) are what others do, to compare with.

mod baselines;
mod batch;
mod certainty;
mod consistency;
mod covariance;
pub(crate) mod experiment;
mod followed;
mod foreseen;
mod least_squares;
mod linear;
mod low_pass;
mod noise;
mod parameters;
mod search;
mod sensitivity;
pub(crate) mod simulation;
mod smoothed;
mod stages;
mod step;

use std::path::PathBuf;
use std::time::Instant;

use nalgebra::DMatrix;
use shared::arm::{ArmError, PARAMETERS};
use shared::genetic::Coding;

pub use batch::{SEARCH_LANES, instructions};
pub use certainty::{Direction, LeftOut, Repeats, weak_directions};
pub use experiment::{Experiment, Fineness, Segment};
pub use low_pass::low_pass;
pub(crate) use parameters::MOMENTS;
pub use parameters::{FrictionMode, Parameter, Prior, Sought, Values, free_parameters, unseen_parameters};
pub use search::{Found, Generation, Judge, SearchBox, Searcher, acceptable, search};
pub use sensitivity::{Columns, Residual};
pub use stages::LADDER_HZ;

use crate::recording::{Finding, Recording, SoundPart};
use crate::robot::{Kind, Robot};
use stages::Run;

/// A standard error above this share of its search range means that the data do not determine the parameter.
const IDENTIFIABLE_SHARE: f64 = 0.005;

/// A lead known worse than to this many ticks counts as undetermined.
const IDENTIFIABLE_LEAD_TICKS: f64 = 0.1;

/// How f1..f9 are sought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Linear start, filter ladder, Levenberg–Marquardt on the innovations, a search around what they give.
    #[default]
    Full,
    /// The paper's genetic algorithm alone, on the whole search range.
    Paper,
    /// Plain least squares of the inverse dynamics on zero-phase low-passed signals (IDIM-LS): a baseline to compare
    /// with.
    Linear,
    /// The same on the simulated loop's motion instead of the measured one, repeated (DIDIM): a baseline to compare
    /// with.
    Didim,
}

/// What to do.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The method.
    pub method: Method,
    /// Which parameters are sought.
    pub sought: Sought,
    /// Seed of the searches.
    pub seed: u64,
    /// Recorded and simulated signals pass the same zero-phase low-pass of this cut-off frequency in Hz before they are
    /// compared, so that oscillations the model does not have are left out. For `linear` and `didim` the cut-off of
    /// their own filter.
    pub filter_hz: Option<f64>,
    /// How the genetic algorithm of the method `paper` reads the bits of a gene: plain binary, as in the paper, if nothing
    /// else is said.
    pub coding: Option<Coding>,
    /// Takes every sample as recorded: nothing is mended, nothing cut, no torque offset sought.
    pub as_recorded: bool,
    /// What is known beforehand; parameters that are not sought are left as they are.
    pub priors: Vec<Prior>,
}

/// Where an identification is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// What is going on.
    pub stage: &'static str,
    /// Steps done of [`Progress::total`], over all stages.
    pub done: usize,
    /// Steps in all; stages that converge early skip ahead.
    pub total: usize,
}

/// What stops an identification.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The paper's method knows no filter.
    #[error("the genetic algorithm alone compares unfiltered signals; use --filter with another --method")]
    NoFilter,
    /// A cut-off frequency that no filter can have.
    #[error(
        "--filter is {cutoff_hz} Hz, but must be from {low_hz} to {high_hz:.0} Hz: the motion is below, half the sampling rate above"
    )]
    Filter {
        /// The cut-off frequency.
        cutoff_hz: f64,
        /// The least.
        low_hz: f64,
        /// The greatest.
        high_hz: f64,
    },
    /// Of a recording hardly anything can be used.
    #[error(
        "{path}: after what had to be left out no stretch of {needed} samples is left ({reasons}); record again, or use every \
         sample with --as-recorded"
    )]
    NothingSound {
        /// The recording.
        path: PathBuf,
        /// Samples needed in one stretch.
        needed: usize,
        /// What was left out and why.
        reasons: String,
    },
    /// No recording was given.
    #[error("no recording to identify from; give at least one")]
    NoRecording,
    /// A recording has no stretch long enough.
    #[error("{path}: {samples} samples without a stretch of {needed} samples free of gaps; record a longer movement")]
    TooShort {
        /// The recording.
        path: PathBuf,
        /// Its samples.
        samples: usize,
        /// Samples needed in one stretch.
        needed: usize,
    },
    /// The motors hardly moved.
    #[error(
        "joint {joint} travels only {travel_counts:.0} counts in these recordings, too little to identify anything \
         (at least {needed_counts:.0} are needed); record a larger movement"
    )]
    NoMotion {
        /// The joint's name.
        joint: String,
        /// Its travel over all recordings in counts.
        travel_counts: f64,
        /// The least travel that makes sense.
        needed_counts: f64,
    },
    /// The genetic algorithm's settings or ranges are wrong.
    #[error(transparent)]
    Search(#[from] shared::genetic::Error),
    /// The result is no arm.
    #[error("the identified parameters describe no possible arm: {0}")]
    Impossible(#[from] ArmError),
    /// No candidate repeats the recordings at all.
    #[error(
        "no set of parameters repeats these recordings: the best differs by {rms_counts:.1} counts rms; check that the \
         recordings belong to this robot file (gear ratios, counts per turn, gains, joint order)"
    )]
    NothingFits {
        /// Root mean square closed-loop difference in counts.
        rms_counts: f64,
    },
}

/// What was found, and how well it is known.
#[derive(Clone, Debug)]
pub struct Identification {
    /// The model.
    pub values: Values,
    /// The parameters that were sought.
    pub free: Vec<Parameter>,
    /// Standard error of each sought parameter, from sensitivities and scatter; none from the paper's method.
    pub standard_errors: Option<Vec<f64>>,
    /// Correlation of the sought parameters' errors.
    pub correlations: Option<Vec<Vec<f64>>>,
    /// Covariance of the sought parameters' errors, row by row.
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Condition number of the information matrix, scaled to a unit diagonal: 1 where every parameter shows by itself.
    pub condition_number: Option<f64>,
    /// Combinations of the sought parameters that these recordings do not determine.
    pub weak_directions: Vec<Direction>,
    /// Bounds that a real machine keeps to and that the values lie on: the recordings alone would have crossed them.
    pub touched_bounds: Vec<String>,
    /// Each recording judged by a fit to the others, in the order of the recordings; empty for a single one.
    pub left_out: Vec<LeftOut>,
    /// Movements that were recorded more than once, with how far their estimates scatter.
    pub repeats: Vec<Repeats>,
    /// Whether the model leaves far more than noise: something is missing from it, and standard errors tell only how
    /// far the best fit is determined, not how far it is true.
    pub lack_of_fit: bool,
    /// Sought parameters that these recordings do not determine.
    pub not_identifiable: Vec<Parameter>,
    /// The paper's Y: sum of squared closed-loop differences over the recordings fitted, counts².
    pub objective_counts2: f64,
    /// Closed-loop difference per joint, counts rms, on the recordings fitted.
    pub rms_counts: Vec<f64>,
    /// The same on the recordings held out; empty without any.
    pub held_out_rms_counts: Vec<f64>,
    /// Innovations per joint, counts rms, on the recordings fitted: 0.29 is the rounding of the encoder.
    pub innovation_rms_counts: Vec<f64>,
    /// Innovations per joint on the recordings held out.
    pub held_out_innovation_rms_counts: Vec<f64>,
    /// Measured against modelled force at the drive, N m (or N) rms per joint, on the recordings fitted; only where
    /// the recording holds the command itself.
    pub force_gap_rms: Option<Vec<f64>>,
    /// Simulations of all recordings, Jacobians included.
    pub evaluations: usize,
    /// Time taken in s.
    pub seconds: f64,
    /// The course of the search: over the whole search range with the method `paper`, around the result with `full`.
    pub generations: Vec<Generation>,
    /// Samples fitted.
    pub samples: usize,
    /// What was found in the recordings and done about it, in words, each with its file.
    pub findings: Vec<String>,
}

impl Identification {
    /// The least Y that the search came upon, counts²; none where nothing was searched. Where `full` searched around its
    /// result it shows by how much luck with the ringing of the loop could have lowered Y.
    pub fn least_objective_counts2(&self) -> Option<f64> {
        self.generations.last().map(|last| last.best_counts2)
    }

    /// The standard error of one parameter, if it was sought or follows from one that was.
    pub fn standard_error(&self, parameter: Parameter) -> Option<f64> {
        let of = |parameter: Parameter| {
            let index = self.free.iter().position(|&p| p == parameter)?;
            Some(self.standard_errors.as_ref()?[index])
        };
        match (self.values.upper_arm_m, parameter) {
            (Some(length), Parameter::F(index @ (2 | 3))) => of(Parameter::F(index + 2)).map(|error| length * error),
            _ => of(parameter),
        }
    }
}

impl Identification {
    /// The inverse covariance of f1..f9, whatever else was sought: the metric in which one f is near another. An f that
    /// was not sought, or follows from others, counts as known to a thousandth of its own size; so does everything where
    /// the method gives no standard errors.
    pub fn f_information(&self) -> DMatrix<f64> {
        let sought: Vec<Option<usize>> =
            (0..PARAMETERS).map(|index| self.free.iter().position(|&free| free == Parameter::F(index))).collect();
        let covariance =
            DMatrix::from_fn(PARAMETERS, PARAMETERS, |i, j| match (&self.covariance, sought[i], sought[j]) {
                (Some(covariance), Some(i), Some(j)) => covariance[i][j],
                _ if i == j => (1e-3 * self.values.f[i].abs().max(1e-2)).powi(2),
                _ => 0.0,
            });
        covariance::inverse(&covariance)
    }
}

/// Identifies a robot from `recordings` and judges the result on `held_out`.
///
/// `progress` is told of every step; a run is repeatable to the bit for a seed, whatever the number of threads.
pub fn identify(
    robot: &Robot,
    recordings: &[Recording],
    held_out: &[Recording],
    options: &Options,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Identification, IdentifyError> {
    // On a thread of the pool: a search hands work to the others many times, and need not wait for them to begin.
    rayon::scope(|_| identify_here(robot, recordings, held_out, options, progress))
}

fn identify_here(
    robot: &Robot,
    recordings: &[Recording],
    held_out: &[Recording],
    options: &Options,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Identification, IdentifyError> {
    let started = Instant::now();
    if recordings.is_empty() {
        return Err(IdentifyError::NoRecording);
    }
    check_filter(robot, options)?;
    let fitted = Usable::of(robot, recordings, options);
    let experiment = fitted.experiment(robot)?;
    check_motion(&experiment)?;
    // Only a simulation of the loop says how much lead there was; the other methods believe what they are told.
    let sought = Sought { lead: options.sought.lead && options.method == Method::Full, ..options.sought };
    let mut free = free_parameters(robot, &sought);
    free.extend(fitted.offsets.iter().copied().filter(|offset| !free.contains(offset)).collect::<Vec<_>>());
    let priors: Vec<Prior> = options.priors.iter().copied().filter(|prior| free.contains(&prior.parameter)).collect();
    let run = Run {
        experiment: &experiment,
        free: &free,
        priors: &priors,
        upper_arm_m: options.sought.upper_arm_m,
        seed: options.seed,
        filter_hz: options.filter_hz,
        coding: options.coding,
        progress,
    };
    let outcome = match options.method {
        Method::Full => run.full()?,
        Method::Paper => run.paper()?,
        Method::Linear => run.linear(),
        Method::Didim => run.didim(),
    };
    let values = outcome.values;
    if robot.kind == Kind::TwoLink {
        values.arm(robot).check_inertia()?;
    }
    // The paper's method ends with the values that its own simulation, one step a period, likes best.
    let fineness = if options.method == Method::Paper { Fineness::Coarse } else { Fineness::Fine };
    let (rms_counts, (innovation_rms_counts, objective_counts2)) = rayon::join(
        || experiment.rms_counts(&values, fineness),
        || (experiment.innovation_rms_counts(&values), experiment.objective_counts2(&values)),
    );
    let worst = rms_counts.iter().copied().fold(0.0, f64::max);
    if options.method == Method::Full && (worst.is_nan() || worst >= largest_error(&experiment)) {
        return Err(IdentifyError::NothingFits { rms_counts: worst });
    }
    let mut findings = fitted.findings.clone();
    let (mut held_out_rms_counts, mut held_out_innovation_rms_counts) = (Vec::new(), Vec::new());
    if !held_out.is_empty() {
        let check = Usable::of(robot, held_out, options);
        findings.extend(check.findings.iter().cloned());
        let check = check.experiment(robot)?;
        held_out_rms_counts = check.closed_loop_rms_counts(&values);
        held_out_innovation_rms_counts = check.innovation_rms_counts(&values);
    }
    let tolerances: Vec<f64> = free.iter().map(|&parameter| identifiable_below(robot, &values, parameter)).collect();
    let standard_errors = outcome.certainty.as_ref().map(|certainty| certainty::standard_errors(&certainty.covariance));
    let not_identifiable = standard_errors
        .iter()
        .flat_map(|errors| free.iter().zip(errors).zip(&tolerances))
        .filter(|&((_, &error), &tolerance)| error.is_nan() || error >= tolerance)
        .map(|((&parameter, _), _)| parameter)
        .chain(unseen_parameters(robot, &sought))
        .collect();
    let certainty = outcome.certainty.as_ref();
    Ok(Identification {
        objective_counts2,
        rms_counts,
        held_out_rms_counts,
        innovation_rms_counts,
        held_out_innovation_rms_counts,
        force_gap_rms: robot.current_is_command.then(|| experiment.force_gap_rms(&values)),
        correlations: certainty.map(|certainty| certainty::correlations(&certainty.covariance)),
        covariance: certainty.map(|certainty| certainty::rows(&certainty.covariance)),
        condition_number: certainty.map(|certainty| certainty::condition_number(&certainty.scaled_information)),
        weak_directions: certainty
            .map_or(Vec::new(), |certainty| weak_directions(&values, &free, &certainty.covariance, &tolerances)),
        touched_bounds: consistency::touched_bounds(robot, &values),
        left_out: certainty
            .map_or(Vec::new(), |certainty| certainty::left_out(robot, recordings, &values, &free, certainty)),
        repeats: certainty.map_or(Vec::new(), |certainty| certainty::repeats(recordings, certainty)),
        values,
        free,
        standard_errors,
        not_identifiable,
        lack_of_fit: outcome.lack_of_fit,
        evaluations: outcome.evaluations,
        seconds: started.elapsed().as_secs_f64(),
        generations: outcome.generations,
        samples: experiment.samples(),
        findings,
    })
}

/// Recordings as far as they can be used, and what was found in them.
struct Usable {
    recordings: Vec<Recording>,
    findings: Vec<String>,
    /// What was left out of each recording and why.
    cuts: Vec<Vec<String>>,
    /// The torque offsets that a bias of the current makes worth seeking.
    offsets: Vec<Parameter>,
}

impl Usable {
    fn of(robot: &Robot, recordings: &[Recording], options: &Options) -> Self {
        let mut usable = Self { recordings: Vec::new(), findings: Vec::new(), cuts: Vec::new(), offsets: Vec::new() };
        for recording in recordings {
            if options.as_recorded {
                usable.recordings.push(recording.clone());
                usable.cuts.push(Vec::new());
                continue;
            }
            let SoundPart { recording, findings, current_offset_a } = recording.sound_part(robot);
            let path = recording.path.display();
            usable.findings.extend(findings.iter().map(|finding| format!("{path}: {finding}")));
            let is_cut = |finding: &&Finding| matches!(finding, Finding::Cut { .. });
            usable.cuts.push(findings.iter().filter(is_cut).map(ToString::to_string).collect());
            for (joint, offset) in current_offset_a.iter().enumerate() {
                let parameter = Parameter::TorqueOffset(joint);
                if offset.is_some() && !usable.offsets.contains(&parameter) {
                    usable.offsets.push(parameter);
                }
            }
            usable.recordings.push(recording);
        }
        usable
    }

    fn experiment<'a>(&self, robot: &'a Robot) -> Result<Experiment<'a>, IdentifyError> {
        Experiment::new(robot, &self.recordings).map_err(|error| match error {
            IdentifyError::TooShort { path, samples, needed } => {
                let cuts = self.recordings.iter().zip(&self.cuts).find(|(recording, _)| recording.path == path);
                match cuts {
                    Some((_, cuts)) if !cuts.is_empty() => {
                        IdentifyError::NothingSound { path, needed, reasons: cuts.join("; ") }
                    }
                    _ => IdentifyError::TooShort { path, samples, needed },
                }
            }
            error => error,
        })
    }
}

/// No movement of an arm is below this frequency altogether.
const LOWEST_FILTER_HZ: f64 = 2.0;

fn check_filter(robot: &Robot, options: &Options) -> Result<(), IdentifyError> {
    let Some(cutoff_hz) = options.filter_hz else { return Ok(()) };
    if options.method == Method::Paper {
        return Err(IdentifyError::NoFilter);
    }
    let high_hz = 0.5 / robot.record_period_s;
    if (LOWEST_FILTER_HZ..=high_hz).contains(&cutoff_hz) {
        return Ok(());
    }
    Err(IdentifyError::Filter { cutoff_hz, low_hz: LOWEST_FILTER_HZ, high_hz })
}

/// The standard error from which a parameter counts as undetermined: a share of the search range for f, half the
/// value for friction, which has no range, a tenth of a tick for a lead.
fn identifiable_below(robot: &Robot, values: &Values, parameter: Parameter) -> f64 {
    match (robot.kind, parameter) {
        (Kind::TwoLink, Parameter::F(index)) => {
            let [low, high] = robot.search[index];
            IDENTIFIABLE_SHARE * (high - low)
        }
        (_, Parameter::TorqueOffset(_)) => f64::INFINITY,
        (_, Parameter::Lead(_)) => IDENTIFIABLE_LEAD_TICKS,
        _ => 0.5 * values.get(parameter).abs(),
    }
}

/// A joint must travel at least this many counts for its inertia and friction to show.
const LEAST_TRAVEL_COUNTS: f64 = 200.0;

fn check_motion(experiment: &Experiment) -> Result<(), IdentifyError> {
    for (joint, named) in experiment.robot.joints.iter().enumerate() {
        let travel = |segment: &Segment| {
            let counts = segment.measured_counts.iter().map(|pair| pair[joint]);
            counts.clone().fold(f64::MIN, f64::max) - counts.fold(f64::MAX, f64::min)
        };
        let travel_counts = experiment.segments.iter().map(travel).fold(0.0, f64::max);
        if travel_counts < LEAST_TRAVEL_COUNTS {
            return Err(IdentifyError::NoMotion {
                joint: named.name.clone(),
                travel_counts,
                needed_counts: LEAST_TRAVEL_COUNTS,
            });
        }
    }
    Ok(())
}

/// A model whose closed-loop difference is as large as the tracking error itself explains nothing.
fn largest_error(experiment: &Experiment) -> f64 {
    let errors = experiment.segments.iter().flat_map(|s| s.error_counts.iter().flatten());
    errors.fold(0.0, |largest: f64, error| largest.max(error.abs()))
}

//! Identification: from recordings of a robot under its position loop to f1..f9, friction, and how well each is known.
//!
//! ```text
//! recordings → experiment ─→ linear (8 Hz) ─→ ladder 8, 12, 15 Hz ─→ search (GA on Y) ─→ innovations ─→ result
//!                            linear.rs        least_squares.rs       search.rs           least_squares.rs
//! ```
//!
//! `full` goes the whole way; `paper` is the genetic algorithm alone, over the whole search range.

mod batch;
mod experiment;
mod followed;
mod least_squares;
mod linear;
mod low_pass;
mod noise;
mod parameters;
mod search;
mod sensitivity;
mod simulation;
mod stages;

use std::path::PathBuf;
use std::time::Instant;

use shared::arm::ArmError;

pub use batch::{SEARCH_LANES, instructions};
pub use experiment::{Experiment, Fineness, Segment};
pub use low_pass::low_pass;
pub use parameters::{FrictionMode, Parameter, Values, free_parameters};
pub use search::{Found, Generation, SearchBox, search};
pub use sensitivity::{Columns, Residual};

use crate::recording::Recording;
use crate::robot::{Kind, Robot};
use stages::Run;

/// A standard error above this share of its search range means that the data do not determine the parameter.
const IDENTIFIABLE_SHARE: f64 = 0.005;

/// How f1..f9 are sought.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Linear start, filter ladder, genetic algorithm, Levenberg–Marquardt on the innovations.
    #[default]
    Full,
    /// The paper's genetic algorithm alone, on the whole search range.
    Paper,
}

/// What to do.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// The method.
    pub method: Method,
    /// How friction enters.
    pub friction: FrictionMode,
    /// Seed of the genetic algorithm.
    pub seed: u64,
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
    /// The genetic algorithm's course.
    pub generations: Vec<Generation>,
    /// Samples fitted.
    pub samples: usize,
}

impl Identification {
    /// The standard error of one parameter, if it was sought.
    pub fn standard_error(&self, parameter: Parameter) -> Option<f64> {
        let index = self.free.iter().position(|&p| p == parameter)?;
        Some(self.standard_errors.as_ref()?[index])
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
    let started = Instant::now();
    if recordings.is_empty() {
        return Err(IdentifyError::NoRecording);
    }
    let experiment = Experiment::new(robot, recordings)?;
    check_motion(&experiment)?;
    let free = free_parameters(robot, options.friction);
    let run = Run { experiment: &experiment, free: &free, seed: options.seed, progress };
    let outcome = match options.method {
        Method::Full => run.full()?,
        Method::Paper => run.paper()?,
    };
    let values = outcome.values;
    if robot.kind == Kind::TwoLink {
        values.arm(robot).check_inertia()?;
    }
    let rms_counts = experiment.closed_loop_rms_counts(&values);
    let worst = rms_counts.iter().copied().fold(0.0, f64::max);
    if options.method == Method::Full && (worst.is_nan() || worst >= largest_error(&experiment)) {
        return Err(IdentifyError::NothingFits { rms_counts: worst });
    }
    let (mut held_out_rms_counts, mut held_out_innovation_rms_counts) = (Vec::new(), Vec::new());
    if !held_out.is_empty() {
        let check = Experiment::new(robot, held_out)?;
        held_out_rms_counts = check.closed_loop_rms_counts(&values);
        held_out_innovation_rms_counts = check.innovation_rms_counts(&values);
    }
    let not_identifiable = outcome
        .standard_errors
        .iter()
        .flat_map(|errors| free.iter().zip(errors))
        .filter(|&(&parameter, &error)| error.is_nan() || error >= identifiable_below(robot, &values, parameter))
        .map(|(&parameter, _)| parameter)
        .collect();
    Ok(Identification {
        objective_counts2: experiment.objective_counts2(&values),
        rms_counts,
        held_out_rms_counts,
        innovation_rms_counts: experiment.innovation_rms_counts(&values),
        held_out_innovation_rms_counts,
        force_gap_rms: robot.current_is_command.then(|| experiment.force_gap_rms(&values)),
        values,
        free,
        standard_errors: outcome.standard_errors,
        correlations: outcome.correlations,
        not_identifiable,
        lack_of_fit: outcome.lack_of_fit,
        evaluations: outcome.evaluations,
        seconds: started.elapsed().as_secs_f64(),
        generations: outcome.generations,
        samples: experiment.samples(),
    })
}

/// The standard error from which a parameter counts as undetermined: a share of the search range for f, half the
/// value for friction, which has no range.
fn identifiable_below(robot: &Robot, values: &Values, parameter: Parameter) -> f64 {
    match (robot.kind, parameter) {
        (Kind::TwoLink, Parameter::F(index)) => {
            let [low, high] = robot.search[index];
            IDENTIFIABLE_SHARE * (high - low)
        }
        (_, Parameter::TorqueOffset(_)) => f64::INFINITY,
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

//! Movements designed for identification: Fourier series that determine the parameters best within the robot's limits.
//!
//! ```text
//! numbers ─→ movement within the limits ─→ model in the robot's loop ─→ exact sensitivities ─→ covariance ─→ cost
//!            movement.rs                   identify::foreseen           identify::sensitivity   prediction.rs
//!     ↑─────────────────────────────── evolution.rs ───────────────────────────────────────────────────────┘
//! ```

mod evolution;
mod magnitude;
mod movement;
mod prediction;

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use shared::board::DEFAULT_SAMPLES;
use shared::trajectory::{self, LimitError, MAX_HARMONICS, Margins, MotionLimits, Trajectory};

use crate::board_setup::{self, SetupError};
use crate::identified_model;
use crate::identify::{Parameter, Sought, Values, free_parameters};
use crate::model::Model;
use crate::random::Random;
use crate::robot::Robot;
use evolution::Evolution;
use magnitude::magnitude;
pub use movement::references_rad;
use movement::{MovementSpace, tightest};
pub use prediction::Prediction;

/// What a movement is to make small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Criterion {
    /// The volume of the parameters' joint uncertainty (D-optimal).
    D,
    /// The condition number of the sensitivities: no direction much worse than another.
    Condition,
    /// The largest standard error of f1..f9, relative to the parameter's magnitude.
    #[default]
    Worst,
}

/// What to design.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How long the movement lasts, in s.
    pub duration_s: f64,
    /// How many periods of the series that is.
    pub repeats: u32,
    /// Harmonics of the series, 1 to [`MAX_HARMONICS`].
    pub harmonics: usize,
    /// What to make small.
    pub criterion: Criterion,
    /// Generations of the search.
    pub generations: usize,
    /// Seed of the search.
    pub seed: u64,
}

/// Share of the amplifier's current and of the following error that a movement may use by the model: the robot is
/// not exactly the model.
pub const USED_SHARE: f64 = 0.8;

/// A joint that travels less than this does not show its parameters: five times what identification asks for.
const LEAST_TRAVEL_COUNTS: f64 = 1000.0;

/// Starts that the search screens, and the generations each of them gets.
const STARTS: usize = 4;
const SCREENING_GENERATIONS: usize = 8;

/// Candidates a generation.
const OFFSPRING: usize = 16;

/// Why there is no movement.
#[derive(Debug, thiserror::Error)]
pub enum ExciteError {
    /// The robot cannot run on a board.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// A setting is out of its range.
    #[error("{what} is {value}, but must be {limit}")]
    Setting {
        /// The setting.
        what: &'static str,
        /// Its value.
        value: String,
        /// What would be accepted.
        limit: String,
    },
    /// The limits of the robot file cannot be used at all.
    #[error("the limits of the robot file leave no movement: {0}")]
    Limits(LimitError),
    /// A joint can hardly move.
    #[error(
        "the limits of the robot file leave joint {joint} only {travel_counts:.0} counts of travel in {duration_s} s, too \
         little to identify anything ({needed_counts:.0} are needed); what binds is its {binding}: widen that limit, or \
         give a longer --duration"
    )]
    NoTravel {
        /// The joint's name.
        joint: String,
        /// What it would travel, in counts.
        travel_counts: f64,
        /// What it should travel.
        needed_counts: f64,
        /// The limit in the way.
        binding: String,
        /// How long the movement was to last.
        duration_s: f64,
    },
    /// Even the best movement breaks a limit that the simulation watches.
    #[error(
        "no movement of {duration_s} s keeps the {quantity} of joint {joint} within {share:.0} % of its limit of {limit} \
         {unit}: the best needs {peak:.4} {unit}; {remedy}"
    )]
    Infeasible {
        /// The joint's name.
        joint: String,
        /// What is limited.
        quantity: &'static str,
        /// Its unit.
        unit: &'static str,
        /// What the best movement needs.
        peak: f64,
        /// The limit.
        limit: f64,
        /// Percentage of the limit that may be used.
        share: f64,
        /// How long the movement was to last.
        duration_s: f64,
        /// What to do.
        remedy: &'static str,
    },
}

/// A limit that the simulation of the loop watches.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LoopMargin {
    /// Name of the joint.
    pub joint: String,
    /// What is limited.
    pub quantity: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The extreme that the model reaches.
    pub peak: f64,
    /// The limit.
    pub limit: f64,
}

/// Predicted standard errors of the robot's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Expectation {
    /// Standard error of each parameter, in its unit.
    pub standard_errors: Vec<f64>,
    /// The largest of f1..f9 relative to its magnitude, and which.
    pub worst: (Parameter, f64),
    /// Geometric mean of the relative standard errors' volume: the D criterion, per parameter.
    pub volume_per_parameter: f64,
    /// Condition number of the sensitivities, each parameter in units of its magnitude.
    pub condition: f64,
}

/// A designed movement.
#[derive(Clone, Debug)]
pub struct Design {
    /// The movement.
    pub trajectory: Trajectory,
    /// The parameters that an identification would seek.
    pub free: Vec<Parameter>,
    /// The magnitude each is judged by.
    pub magnitudes: Vec<f64>,
    /// What is expected of the movement.
    pub designed: Expectation,
    /// The paper's movements of the same duration, in s each.
    pub paper_periods_s: Vec<f64>,
    /// What is expected of those; nothing where the robot cannot make them.
    pub paper: Option<Expectation>,
    /// How near the reference comes to the limits.
    pub margins: Margins,
    /// How near current and following error come to theirs.
    pub loop_margins: Vec<LoopMargin>,
    /// Movements simulated.
    pub evaluations: usize,
}

impl Settings {
    /// A movement of `duration_s` with the default number of repeats, harmonics and generations.
    pub fn of_duration(duration_s: f64) -> Self {
        Self {
            duration_s,
            repeats: default_repeats(duration_s),
            harmonics: 5,
            criterion: Criterion::default(),
            generations: 80,
            seed: 1,
        }
    }
}

/// How long a movement lasts where nothing is said, in s: two of the paper's, or what the board's memory holds.
pub fn usual_duration_s(robot: &Robot) -> f64 {
    (2.0 * 3.65_f64).min(longest_duration_s(robot))
}

/// What the board's memory holds, in s.
fn longest_duration_s(robot: &Robot) -> f64 {
    DEFAULT_SAMPLES as f64 * robot.record_period_s
}

/// Periods in a movement of `duration_s`: each about as long as the paper's, so that few harmonics reach the
/// frequencies where inertia shows.
pub fn default_repeats(duration_s: f64) -> u32 {
    ((duration_s / 4.5).ceil() as u32).max(1)
}

/// The values to design for: the model's, else those to expect, with the robot file's friction.
pub fn nominal(robot: &Robot, model: Option<&Model>) -> Values {
    if let Some(model) = model {
        return identified_model::values(robot, model);
    }
    let mut values = Values::of_robot(robot);
    values.f = robot.expected_f();
    values
}

/// The paper's movements that fill `duration_s`: one, or two in the proportion 3.65 : 5 where there is time.
fn paper_periods_s(duration_s: f64) -> Vec<f64> {
    const FIRST_S: f64 = 3.65;
    const SECOND_S: f64 = 5.0;
    if duration_s < 2.0 * FIRST_S {
        return vec![duration_s];
    }
    [FIRST_S, SECOND_S].map(|period_s| duration_s * period_s / (FIRST_S + SECOND_S)).to_vec()
}

struct Problem<'a> {
    robot: &'a Robot,
    values: Values,
    free: Vec<Parameter>,
    magnitudes: Vec<f64>,
    space: MovementSpace,
    current_limit_a: [f64; 2],
    error_limit_counts: [f64; 2],
    criterion: Criterion,
}

impl Problem<'_> {
    fn predict(&self, movements: &[&Trajectory]) -> Prediction {
        let references: Vec<_> =
            movements.iter().map(|movement| references_rad(movement, self.robot.record_period_s)).collect();
        Prediction::new(self.robot, &self.values, &self.free, &references)
    }

    fn expectation(&self, prediction: &Prediction) -> Expectation {
        let standard_errors = prediction.standard_errors();
        let relative = |i: usize| standard_errors[i] / self.magnitudes[i];
        let of_f = (0..self.free.len()).filter(|&i| matches!(self.free[i], Parameter::F(_)));
        let worst = of_f.max_by(|&a, &b| relative(a).total_cmp(&relative(b))).unwrap_or(0);
        let covariance = &prediction.covariance;
        let scaled = nalgebra::DMatrix::from_fn(self.free.len(), self.free.len(), |i, j| {
            covariance[(i, j)] / (self.magnitudes[i] * self.magnitudes[j])
        });
        let eigenvalues = scaled.symmetric_eigenvalues();
        let (smallest, largest) = (eigenvalues.min().max(f64::MIN_POSITIVE), eigenvalues.max());
        let logarithms: f64 = eigenvalues.iter().map(|value| value.max(f64::MIN_POSITIVE).ln()).sum();
        Expectation {
            worst: (self.free[worst], relative(worst)),
            volume_per_parameter: (0.5 * logarithms / self.free.len() as f64).exp(),
            condition: (largest / smallest).sqrt(),
            standard_errors,
        }
    }

    fn loop_margins(&self, prediction: &Prediction) -> Vec<LoopMargin> {
        let of_joint = |joint: usize| {
            let name = &self.robot.joints[joint].name;
            [
                LoopMargin {
                    joint: name.clone(),
                    quantity: "current",
                    unit: "A",
                    peak: prediction.peak_current_a[joint],
                    limit: self.current_limit_a[joint],
                },
                LoopMargin {
                    joint: name.clone(),
                    quantity: "following error",
                    unit: "counts",
                    peak: prediction.peak_error_counts[joint],
                    limit: self.error_limit_counts[joint],
                },
            ]
        };
        (0..self.robot.joints.len()).flat_map(of_joint).collect()
    }

    fn cost(&self, numbers: &[f64]) -> f64 {
        // One period stands for all of them.
        let prediction = self.predict(&[&self.space.period(numbers)]);
        let expectation = self.expectation(&prediction);
        let value = match self.criterion {
            Criterion::D => expectation.volume_per_parameter,
            Criterion::Condition => expectation.condition,
            Criterion::Worst => expectation.worst.1,
        };
        // Outside the loop's limits nothing else counts than coming back.
        let excess: f64 =
            self.loop_margins(&prediction).iter().map(|m| (m.peak / (USED_SHARE * m.limit) - 1.0).max(0.0)).sum();
        if excess > 0.0 { 1e6 * (1.0 + excess) } else { value }
    }
}

/// Designs a movement for `robot`, whose dynamics are about `model`'s.
///
/// `progress` is told of simulations done and planned. The same settings give the same movement, whatever the number of
/// threads.
pub fn design(
    robot: &Robot,
    model: Option<&Model>,
    settings: &Settings,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Design, ExciteError> {
    let configuration = board_setup::configuration(robot)?;
    check(settings, robot)?;
    let limits = configuration.motion_limits;
    let counts_per_rad = [0, 1].map(|joint| robot.joints[joint].counts_per_rad());
    let period_ns = (settings.duration_s * 1e9 / f64::from(settings.repeats)).round() as u64;
    let values = nominal(robot, model);
    let free = free_parameters(robot, &Sought::default());
    let magnitudes = free.iter().map(|&parameter| magnitude(robot, &values, parameter)).collect();
    let periods = (period_ns, settings.repeats);
    let problem = Problem {
        robot,
        values,
        free,
        magnitudes,
        space: MovementSpace::new(limits, counts_per_rad, robot.record_period_s, periods, settings.harmonics),
        current_limit_a: [0, 1].map(|joint| robot.joints[joint].current_limit_a),
        error_limit_counts: configuration.joints.each_ref().map(|joint| joint.following_error_limit_counts),
        criterion: settings.criterion,
    };

    let (numbers, evaluations) = search(&problem, settings, progress);
    let trajectory = problem.space.movement(&numbers);
    let record_period_ns = u64::from(configuration.common.record_period_ns);
    let margins = trajectory::margins(&trajectory, &limits, counts_per_rad.map(|c| c as f32), record_period_ns)
        .map_err(ExciteError::Limits)?;
    margins.verdict().map_err(ExciteError::Limits)?;
    let prediction = problem.predict(&[&trajectory]);
    let loop_margins = problem.loop_margins(&prediction);
    let broken = |margin: &&LoopMargin| margin.peak.is_nan() || margin.peak > USED_SHARE * margin.limit;
    if let Some(broken) = loop_margins.iter().find(broken) {
        return Err(ExciteError::Infeasible {
            joint: broken.joint.clone(),
            quantity: broken.quantity,
            unit: broken.unit,
            peak: broken.peak,
            limit: broken.limit,
            share: 100.0 * USED_SHARE,
            duration_s: settings.duration_s,
            remedy: if broken.quantity == "current" {
                "the amplifier can hardly hold this arm: check current_limit_a, torque_constant_nm_per_a and the model"
            } else {
                "the loop is too soft for this arm: raise position_gain_a_per_count as far as it is stable"
            },
        });
    }
    for (joint, counts_per_rad) in counts_per_rad.into_iter().enumerate() {
        let references = references_rad(&trajectory, robot.record_period_s);
        let angles = references.iter().map(|pair| pair[joint]);
        let travel_counts =
            (angles.clone().fold(f64::MIN, f64::max) - angles.fold(f64::MAX, f64::min)) * counts_per_rad.abs();
        if travel_counts < LEAST_TRAVEL_COUNTS {
            return Err(ExciteError::NoTravel {
                joint: robot.joints[joint].name.clone(),
                travel_counts,
                needed_counts: LEAST_TRAVEL_COUNTS,
                binding: binding(&margins, &limits, &loop_margins, joint),
                duration_s: settings.duration_s,
            });
        }
    }
    let paper_periods_s = paper_periods_s(settings.duration_s);
    let paper: Vec<Trajectory> =
        paper_periods_s.iter().filter_map(|&period_s| crate::trajectory_file::paper(period_s)).collect();
    let within = |trajectory: &Trajectory| {
        trajectory::check(trajectory, &limits, counts_per_rad.map(|c| c as f32), record_period_ns).is_ok()
    };
    let paper =
        paper.iter().all(within).then(|| problem.predict(&paper.iter().collect::<Vec<_>>())).and_then(|paper| {
            let within = problem.loop_margins(&paper).iter().all(|margin| margin.peak <= margin.limit);
            within.then(|| problem.expectation(&paper))
        });
    Ok(Design {
        designed: problem.expectation(&prediction),
        paper,
        paper_periods_s,
        trajectory,
        magnitudes: problem.magnitudes,
        free: problem.free,
        margins,
        loop_margins,
        evaluations: evaluations + 2,
    })
}

/// The limit of a joint with the least room, in words.
fn binding(margins: &Margins, limits: &MotionLimits, loop_margins: &[LoopMargin], joint: usize) -> String {
    let of_motion = tightest(&margins.rows, limits, joint).map(|(margin, left)| {
        (left, format!("{} limit of {} {}", margin.quantity.name(), margin.limit, margin.quantity.unit()))
    });
    let per_joint = loop_margins.len() / 2;
    let of_loop = loop_margins[joint * per_joint..][..per_joint].iter().map(|margin| {
        let left = USED_SHARE - margin.peak / margin.limit;
        (left, format!("{} limit of {} {}", margin.quantity, margin.limit, margin.unit))
    });
    let tightest = of_motion.into_iter().chain(of_loop).min_by(|a, b| a.0.total_cmp(&b.0));
    tightest.map_or_else(String::new, |(_, name)| name)
}

fn check(settings: &Settings, robot: &Robot) -> Result<(), ExciteError> {
    let refuse = |what, value: String, limit: String| Err(ExciteError::Setting { what, value, limit });
    // A hair more, so that 7.35 s is not refused for the last bit of 0.0007 s.
    let longest_s = longest_duration_s(robot) * (1.0 + 1e-9);
    if !(1.0..=longest_s).contains(&settings.duration_s) {
        let limit = format!("from 1 to {longest_s:.2} s: the board's memory holds {DEFAULT_SAMPLES} samples");
        return refuse("--duration", format!("{} s", settings.duration_s), limit);
    }
    if !(1..=MAX_HARMONICS).contains(&settings.harmonics) {
        return refuse("--harmonics", settings.harmonics.to_string(), format!("from 1 to {MAX_HARMONICS}"));
    }
    if !(1..=60).contains(&settings.repeats) || settings.duration_s / f64::from(settings.repeats) < 0.5 {
        return refuse("--repeats", settings.repeats.to_string(), "at least 1, with periods of at least 0.5 s".into());
    }
    Ok(())
}

/// Screens several starts, goes on with the best, and gives the best numbers and the simulations spent.
fn search(problem: &Problem, settings: &Settings, progress: &(dyn Fn(usize, usize) + Sync)) -> (Vec<f64>, usize) {
    let rest = settings.generations.saturating_sub(STARTS * SCREENING_GENERATIONS).max(1);
    let planned = OFFSPRING * (STARTS * SCREENING_GENERATIONS + rest);
    let done = AtomicUsize::new(0);
    let mut best = (f64::INFINITY, vec![0.0; problem.space.numbers()]);
    let mut generation = |evolution: &mut Evolution| {
        let candidates = evolution.ask();
        let costs: Vec<f64> = candidates
            .par_iter()
            .map(|numbers| {
                let cost = problem.cost(numbers);
                progress(done.fetch_add(1, Ordering::Relaxed) + 1, planned);
                cost
            })
            .collect();
        evolution.tell(&costs);
        for (cost, numbers) in costs.into_iter().zip(candidates) {
            if cost < best.0 {
                best = (cost, numbers);
            }
        }
        best.0
    };
    let mut chosen: Option<(f64, Evolution)> = None;
    for start in 0..STARTS {
        let mut random = Random::new(settings.seed, 100 + start as u64);
        let mean: Vec<f64> = (0..problem.space.numbers()).map(|_| 0.5 * random.normal()).collect();
        let mut evolution = Evolution::new(&mean, 0.3, OFFSPRING, random);
        let mut reached = f64::INFINITY;
        for _ in 0..SCREENING_GENERATIONS {
            reached = generation(&mut evolution);
        }
        if chosen.as_ref().is_none_or(|(best, _)| reached < *best) {
            chosen = Some((reached, evolution));
        }
    }
    if let Some((_, mut evolution)) = chosen {
        for _ in 0..rest {
            generation(&mut evolution);
        }
    }
    (best.1, done.into_inner())
}

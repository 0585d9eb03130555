//! The movement that best tells the members of a class apart.
//!
//! For each movement tried the robot is simulated with one member and fitted with the other, base parameters free: what
//! the best fit still leaves, in units of the noise, is how well the movement tells them apart (T-optimality; Atkinson &
//! Fedorov 1975). Both ways round, and the worse of both counts.

use rayon::prelude::*;
use shared::trajectory::{Fourier, Harmonic, Trajectory};

use super::engine::{Engine, Free};
use super::fit::Setting;
use super::hypothesis::{Baseline, Hypothesis};
use super::instance::Instance;
use super::noise::Noise;
use super::nulls::{NullNoise, closed_loop};
use super::rows::Rows;
use crate::board_setup;
use crate::identify::Experiment;
use crate::random::Random;
use crate::recording::Recording;
use crate::robot::Robot;

/// Movements that are tried.
const TRIED: usize = 24;

/// A movement that tells members of a class apart.
#[derive(Clone, Debug)]
pub struct NextTrajectory {
    /// The movement file's text.
    pub toml: String,
    /// The two members.
    pub between: [&'static str; 2],
    /// χ² that the wrong member would leave beside the right one.
    pub distance: f64,
}

/// The best of a set of random movements within the limits for telling `one` from `other`, both fitted beside the same
/// base.
pub fn next_trajectory(
    robot: &Robot,
    baseline: &Baseline,
    members: [&Hypothesis; 2],
    noise: &Noise,
    seed: u64,
) -> Option<NextTrajectory> {
    let configuration = board_setup::configuration(robot).ok()?;
    let counts_per_rad = [0, 1].map(|joint: usize| robot.joints[joint].counts_per_rad() as f32);
    let period_ns = u64::from(configuration.common.record_period_ns);
    let mut random = Random::new(seed, 0x6e65_7874);
    let mut movements: Vec<Fourier> = Vec::new();
    for _ in 0..60 * TRIED {
        if movements.len() == TRIED {
            break;
        }
        let movement = drawn(robot, &mut random);
        let trajectory = Trajectory::Fourier(movement.clone());
        if shared::trajectory::check(&trajectory, &configuration.motion_limits, counts_per_rad, period_ns).is_ok() {
            movements.push(movement);
        }
    }
    let judged = movements.into_par_iter().filter_map(|movement| {
        let distance = |truth: &Hypothesis, wrong: &Hypothesis| {
            let trajectory = Trajectory::Fourier(movement.clone());
            let recording = simulated(robot, baseline, truth, &trajectory, &SILENT, 1)?;
            left_by(robot, baseline, &recording, wrong, noise)
        };
        let both = [distance(members[0], members[1])?, distance(members[1], members[0])?];
        Some((both[0].min(both[1]), movement))
    });
    let (distance, movement) = judged.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(NextTrajectory { toml: text(&movement), between: ["", ""], distance })
}

/// Three harmonics about the middle of the range, with a fade.
fn drawn(robot: &Robot, random: &mut Random) -> Fourier {
    let centre_rad: [f32; 2] = std::array::from_fn(|joint| {
        let limits = &robot.joints[joint].limits;
        let share = random.between(0.3, 0.7);
        (limits.position_low_rad + share * (limits.position_high_rad - limits.position_low_rad)) as f32
    });
    let strength = random.between(0.2, 1.0);
    let harmonic = |order: f64, random: &mut Random| {
        let mut amplitude = || (strength * random.between(-1.0, 1.0) / order) as f32;
        Harmonic { cosine_rad: [amplitude(), amplitude()], sine_rad: [amplitude(), amplitude()] }
    };
    let harmonics = (1..=3).map(|order| harmonic(f64::from(order), random)).collect();
    Fourier {
        period_ns: (random.between(2.5, 6.0) * 1e9) as u64,
        repeats: 1,
        fade_ns: 800_000_000,
        centre_rad,
        harmonics,
    }
}

fn text(movement: &Fourier) -> String {
    let pair = |values: [f32; 2]| format!("[{}, {}]", values[0], values[1]);
    let harmonics: Vec<String> = movement
        .harmonics
        .iter()
        .map(|harmonic| {
            format!("  {{ cosine_rad = {}, sine_rad = {} }},\n", pair(harmonic.cosine_rad), pair(harmonic.sine_rad))
        })
        .collect();
    format!(
        "[fourier]\nperiod_s = {}\nrepeats = {}\nfade_s = {}\ncentre_rad = {}\nharmonic = [\n{}]\n",
        movement.period_ns as f64 * 1e-9,
        movement.repeats,
        movement.fade_ns as f64 * 1e-9,
        pair(movement.centre_rad),
        harmonics.concat()
    )
}

/// No noise at all.
const SILENT: NullNoise = NullNoise { torque_nm: [0.0; 2], correlation_time_s: [0.05; 2], position_counts: [0.0; 2] };

/// What the robot would record along a movement, were it exactly `truth`.
pub fn simulated(
    robot: &Robot,
    baseline: &Baseline,
    truth: &Hypothesis,
    trajectory: &Trajectory,
    noise: &NullNoise,
    seed: u64,
) -> Option<Recording> {
    let period_ns = (robot.record_period_s * 1e9).round() as u64;
    let samples = trajectory.record_periods(period_ns) as usize;
    let reference_counts: Vec<Vec<f64>> = (0..2)
        .map(|joint| {
            let counts = robot.joints[joint].counts_per_rad();
            (0..samples as u64)
                .map(|k| (trajectory.reference::<f64>(k * period_ns).position_rad[joint] * counts).trunc())
                .collect()
        })
        .collect();
    // A recording that stands still gives the loop its start; errors and currents come out of the simulation.
    let still = vec![vec![0.0; samples]; 2];
    let mut recording = Recording {
        path: "next".into(),
        tick: (0..samples as u32).collect(),
        reference_counts,
        error_counts: still.clone(),
        current_a: still,
        command_a: None,
        added_torque: None,
        manifest: None,
        notes: Vec::new(),
    };
    let experiment = Experiment::new(robot, std::slice::from_ref(&recording)).ok()?;
    let one = Hypothesis { base: truth.base.clone(), named: truth.named.iter().map(first_record).collect() };
    let candidate = one.candidate(baseline, &experiment)?;
    let run = closed_loop(&experiment, &candidate, 0, noise, &mut Random::new(seed, 2));
    recording.error_counts = run.error_counts.to_vec();
    recording.current_a = run.current_a.to_vec();
    Some(recording)
}

fn first_record(instance: &Instance) -> Instance {
    let mut one = instance.clone();
    one.records.truncate(1);
    one
}

/// χ² beyond the noise that the best fit of `wrong` leaves of a recording.
fn left_by(
    robot: &Robot,
    baseline: &Baseline,
    recording: &Recording,
    wrong: &Hypothesis,
    noise: &Noise,
) -> Option<f64> {
    let experiment = Experiment::new(robot, std::slice::from_ref(recording)).ok()?;
    let rows = Rows::new(&experiment);
    let engine = Engine::new(Setting { experiment: &experiment, rows: &rows, current_sigma_a: None }, baseline);
    let weights = engine.weights(noise);
    let one = Hypothesis { base: wrong.base.clone(), named: wrong.named.iter().map(first_record).collect() };
    let fitted = engine.refit(&one, &weights, &[], Free::All, 3)?;
    Some(fitted.cost)
}

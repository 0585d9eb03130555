//! The starting point: inverse dynamics is linear in every parameter, so least squares on low-passed signals finds
//! them at once, without a guess.
//!
//! Position and torque pass the same zero-phase filter. Velocity and acceleration are differences of the filtered
//! position: good for a start, biased by what the filter takes away (0.05 on f at 8 Hz), which is why the later stages
//! simulate instead.

use nalgebra::{DMatrix, DVector};
use shared::arm::{Arm, PARAMETERS};
use shared::plant::Plant;

use super::experiment::{Experiment, Segment};
use super::low_pass::low_pass;
use super::parameters::{Parameter, Prior, Values};

/// Samples this close to a reversal are left out: there the filtered velocity's sign says nothing about friction.
const REVERSAL_S: f64 = 0.05;

/// Filters forget the ends over about this long.
const ENDS_S: f64 = 0.1;

/// How far the torque is trusted, N m at the motor: weighs the data against the weak pull toward the middle of the
/// search range, which only decides directions the data leave open.
const TORQUE_NOISE_NM: f64 = 0.05;

/// The torque equations of one joint on one segment: `row · values of free = rest`, sample by sample.
pub struct Equations {
    /// What each free parameter adds to the motor torque, per unit of it.
    pub rows: Vec<Vec<f64>>,
    /// Motor torque less what the known parameters explain, in N m.
    pub rest: Vec<f64>,
}

/// Least-squares estimate of `free` with everything else as in `known`, from signals low-passed at `cutoff_hz`.
pub fn linear_start(
    experiment: &Experiment,
    known: &Values,
    free: &[Parameter],
    priors: &[Prior],
    cutoff_hz: f64,
) -> Values {
    let measured = |segment: &Segment| segment.measured_counts.clone();
    solve(experiment, known, free, priors, &equations(experiment, known, free, cutoff_hz, &measured))
}

/// The least-squares solution of `equations` and `priors`, drawn a little to the middle of the search ranges.
pub fn solve(
    experiment: &Experiment,
    known: &Values,
    free: &[Parameter],
    priors: &[Prior],
    equations: &[Equations],
) -> Values {
    let count = free.len();
    let mut normal = DMatrix::<f64>::zeros(count, count);
    let mut right = DVector::<f64>::zeros(count);
    let mut centre = vec![0.0; count];
    for (i, &parameter) in free.iter().enumerate() {
        let half_width = match parameter {
            Parameter::F(index) => {
                let [low, high] = experiment.robot.search[index];
                centre[i] = 0.5 * (low + high);
                0.5 * (high - low)
            }
            // A gain is nearly what it was set to. Without a prior this decides the common scale, if nothing else does.
            Parameter::Gain(_) => {
                centre[i] = 1.0;
                0.1
            }
            // Nothing is known beforehand about what the robot file leaves out.
            _ => f64::INFINITY,
        };
        let pull = 1.0 / (half_width * half_width);
        normal[(i, i)] += pull;
        right[i] += pull * centre[i];
        for prior in priors.iter().filter(|prior| prior.parameter == parameter) {
            let pull = 1.0 / (prior.standard_deviation * prior.standard_deviation);
            normal[(i, i)] += pull;
            right[i] += pull * prior.mean;
        }
    }
    let joints = experiment.robot.joints.len();
    for (index, Equations { rows, rest }) in equations.iter().enumerate() {
        let samples = experiment.segments[index / joints].error_counts.len();
        let weight = 1.0 / (TORQUE_NOISE_NM * TORQUE_NOISE_NM * (samples as f64));
        for (row, rest) in rows.iter().zip(rest) {
            for i in 0..count {
                if row[i] == 0.0 {
                    continue;
                }
                right[i] += weight * row[i] * rest;
                for j in 0..count {
                    normal[(i, j)] += weight * row[i] * row[j];
                }
            }
        }
    }
    let solution = normal.svd(true, true).solve(&right, 1e-14).unwrap_or_else(|_| DVector::from_vec(centre));
    let mut found = known.with(free, solution.as_slice());
    for joint in 0..2 {
        found.coulomb_nm[joint] = found.coulomb_nm[joint].max(0.0);
        found.viscous_nm_s_per_rad[joint] = found.viscous_nm_s_per_rad[joint].max(0.0);
    }
    found
}

/// The torque equations of every segment and joint along `motion`, which gives a segment's motor positions in counts;
/// motion and torque low-passed at `cutoff_hz`, without the ends and the samples near a reversal.
pub fn equations(
    experiment: &Experiment,
    known: &Values,
    free: &[Parameter],
    cutoff_hz: f64,
    motion: &dyn Fn(&Segment) -> Vec<[f64; 2]>,
) -> Vec<Equations> {
    let period_s = experiment.robot.record_period_s;
    // A command acts from its delay after one sample to its delay after the next: half a loop period plus the delay
    // late on average.
    let lateness = (0.5 * experiment.robot.loop_period_s + experiment.robot.command_delay_s) / period_s;
    let commanded = known.plant(experiment.robot);
    let known = &known.with(free, &vec![0.0; free.len()]);
    // A gain that is sought is zero here: its torque stands on the other side of the equation.
    let plant = known.plant(experiment.robot);
    let mut equations = Vec::new();
    for segment in &experiment.segments {
        let samples = segment.error_counts.len();
        let motion = motion(segment);
        let position: [Vec<f64>; 2] = std::array::from_fn(|joint| {
            let counts_per_rad = experiment.counts_per_rad(joint);
            let counts: Vec<f64> = motion.iter().map(|pair| pair[joint]).collect();
            low_pass(&counts, period_s, cutoff_hz).into_iter().map(|c| c / counts_per_rad).collect()
        });
        let acting = |plant: &Plant<f64>, joint: usize, added: f64| {
            let torque = |k: usize| plant.drives[joint].motor_torque_nm(segment.command_a[k][joint]);
            let late = |k: usize| {
                let (now, before) = (torque(k), torque(k.saturating_sub(1)));
                now + lateness.min(1.0) * (before - now) + added * segment.added_torque_nm[k][joint]
            };
            low_pass(&(0..samples).map(late).collect::<Vec<f64>>(), period_s, cutoff_hz)
        };
        let torque: [Vec<f64>; 2] = std::array::from_fn(|joint| acting(&plant, joint, 1.0));
        let torque_of_gain: [Vec<f64>; 2] = std::array::from_fn(|joint| match free.contains(&Parameter::Gain(joint)) {
            true => acting(&commanded, joint, 0.0),
            false => Vec::new(),
        });
        let velocity = |joint: usize, k: usize| (position[joint][k + 1] - position[joint][k - 1]) / (2.0 * period_s);
        let ends = ((ENDS_S / period_s) as usize).max(2);
        for joint in 0..experiment.robot.joints.len() {
            let usable = away_from_reversals(samples, (REVERSAL_S / period_s) as usize, |k| velocity(joint, k));
            let mut of_joint = Equations { rows: Vec::new(), rest: Vec::new() };
            for k in (ends..samples.saturating_sub(ends)).filter(|&k| usable[k]) {
                let q = [position[0][k], position[1][k]];
                let v = [velocity(0, k), velocity(1, k)];
                let a = std::array::from_fn(|joint| {
                    let p = &position[joint];
                    (p[k + 1] - 2.0 * p[k] + p[k - 1]) / (period_s * period_s)
                });
                let drive = &plant.drives[joint];
                let motor_velocity = drive.gear_ratio * v[joint];
                let row = |parameter: &Parameter| match *parameter {
                    Parameter::F(_) => {
                        let unit = Values { f: [0.0; PARAMETERS], ..*known }.with(&[*parameter], &[1.0]);
                        let arm = Arm { f: unit.f, gravity_m_s2: plant.arm.gravity_m_s2 };
                        arm.inverse_dynamics_nm(q, v, a)[joint] / drive.gear_ratio
                    }
                    Parameter::Viscous(of) if of == joint => motor_velocity,
                    Parameter::Coulomb(of) if of == joint => motor_velocity.signum(),
                    Parameter::TorqueOffset(of) if of == joint => 1.0,
                    Parameter::Gain(of) if of == joint => -torque_of_gain[joint][k],
                    _ => 0.0,
                };
                let explained_by_known = known.arm(experiment.robot).inverse_dynamics_nm(q, v, a)[joint]
                    / drive.gear_ratio
                    + drive.viscous_friction_nm_s_per_rad * motor_velocity
                    + drive.coulomb_friction_nm * motor_velocity.signum();
                of_joint.rows.push(free.iter().map(row).collect());
                of_joint.rest.push(torque[joint][k] - explained_by_known);
            }
            equations.push(of_joint);
        }
    }
    equations
}

/// Which samples are at least `distance` samples from a change of the velocity's sign.
fn away_from_reversals(samples: usize, distance: usize, velocity: impl Fn(usize) -> f64) -> Vec<bool> {
    let mut usable = vec![true; samples];
    for k in 2..samples.saturating_sub(1) {
        if velocity(k) * velocity(k - 1) <= 0.0 {
            for flag in &mut usable[k.saturating_sub(distance)..(k + distance).min(samples)] {
                *flag = false;
            }
        }
    }
    usable
}

//! The torque that a model leaves over, from positions and commands: what the rivals look at.
//!
//! `r = F{τ − ID(q)}` at the motors, with both sides low-passed alike and without phase, samples around reversals left
//! out, and thinned to what the filter leaves independent.

use shared::arm::{Arm, PARAMETERS};
use shared::drive::centre_of_count;

use crate::identify::low_pass;
use crate::model::Model;
use crate::recording::Recording;
use crate::robot::{Kind, Law, Robot};

/// Both sides are compared below this, in Hz.
const CUTOFF_HZ: f64 = 20.0;
/// Derivatives are taken of positions smoothed below this, in Hz.
const SMOOTHING_HZ: f64 = 60.0;
/// Samples nearer to a reversal than this, in s, are left out.
const AROUND_REVERSALS_S: f64 = 0.05;

/// Nominal viscous and Coulomb friction take these columns after f1..f9.
pub const BASE_COLUMNS: usize = PARAMETERS + 4;

/// One joint's signals in one recording, a value per sample, at the motor unless said otherwise.
#[derive(Clone, Debug)]
pub struct Signals {
    /// Joint, 0 or 1.
    pub joint: usize,
    /// Seconds since the start.
    pub time_s: Vec<f64>,
    /// Angle of the joint in rad.
    pub joint_rad: Vec<f64>,
    /// Angle of the motor in rad.
    pub motor_rad: Vec<f64>,
    /// Speed of the motor in rad/s.
    pub speed_rad_s: Vec<f64>,
    /// Torque that the link takes, at the motor, in N m.
    pub link_nm: Vec<f64>,
    /// Command in A.
    pub command_a: Vec<f64>,
    /// Inertia that the motor feels, at the motor, in kg m².
    pub inertia_kg_m2: f64,
    /// Columns of the base parameters: motor torque per unit of f1..f9, viscous and Coulomb friction of both joints.
    pub base: Vec<Vec<f64>>,
    /// Torque left over in N m, not filtered.
    pub left_nm: Vec<f64>,
    /// Torque constant in N m/A.
    pub torque_constant_nm_per_a: f64,
    /// Coulomb friction in N m: the unit of rows.
    pub coulomb_nm: f64,
    kept: Vec<usize>,
    period_s: f64,
}

impl Signals {
    /// A column of full rate as rows: filtered, thinned, in units of Coulomb friction.
    pub fn rows(&self, column: &[f64]) -> Vec<f64> {
        let smooth = low_pass(column, self.period_s, CUTOFF_HZ);
        self.kept.iter().map(|&sample| smooth[sample] / self.coulomb_nm).collect()
    }

    /// How many rows each column gives.
    pub fn count(&self) -> usize {
        self.kept.len()
    }

    /// Second difference of a series per s².
    pub fn acceleration_of(&self, series: &[f64]) -> Vec<f64> {
        let last = series.len().saturating_sub(1);
        let over = 1.0 / (self.period_s * self.period_s);
        (0..series.len())
            .map(|k| (series[k.saturating_sub(1)] - 2.0 * series[k] + series[(k + 1).min(last)]) * over)
            .collect()
    }
}

/// The signals of both joints in one recording; nothing where the robot is no two-link arm under a P loop.
///
/// Without a model `f` is the reference robot's and friction the robot file's: a start, for the base columns to
/// correct.
pub fn signals(robot: &Robot, model: Option<&Model>, recording: &Recording) -> Option<[Signals; 2]> {
    if robot.kind != Kind::TwoLink {
        return None;
    }
    let period_s = robot.record_period_s;
    let samples = recording.samples();
    let (mut angle, mut velocity, mut acceleration) = (Vec::new(), Vec::new(), Vec::new());
    for joint in 0..2 {
        let per_rad = robot.joints[joint].counts_per_rad();
        let counts: Vec<f64> = (0..samples)
            .map(|k| centre_of_count(recording.reference_counts[joint][k] - recording.error_counts[joint][k]) / per_rad)
            .collect();
        let smooth = low_pass(&counts, period_s, SMOOTHING_HZ);
        velocity.push(differences(&smooth, period_s));
        acceleration.push(differences(&velocity[joint], period_s));
        angle.push(smooth);
    }
    let f = model.map_or(shared::arm::REFERENCE_F, |model| model.f);
    let arm = |f: [f64; PARAMETERS]| Arm { f, gravity_m_s2: robot.gravity_m_s2 };
    let at = |k: usize| {
        let pair = |series: &[Vec<f64>]| [series[0][k], series[1][k]];
        (pair(&angle), pair(&velocity), pair(&acceleration))
    };
    let torque = |f: [f64; PARAMETERS]| -> Vec<[f64; 2]> {
        let arm = arm(f);
        (0..samples)
            .map(|k| {
                let (angle, velocity, acceleration) = at(k);
                arm.inverse_dynamics_nm(angle, velocity, acceleration)
            })
            .collect()
    };
    let units: Vec<Vec<[f64; 2]>> = (0..PARAMETERS)
        .map(|index| {
            let mut unit = [0.0; PARAMETERS];
            unit[index] = 1.0;
            torque(unit)
        })
        .collect();
    let of_model = torque(f);
    let mut both = Vec::new();
    for joint in 0..2 {
        let part = &robot.joints[joint];
        let Law::Proportional(law) = part.law else { return None };
        let gear = part.gear_ratio;
        let viscous =
            model.map_or(part.viscous_friction_nm_s_per_rad.unwrap_or(0.0), |model| model.viscous_nm_s_per_rad[joint]);
        let coulomb = model.map_or(part.coulomb_friction_nm.unwrap_or(0.1), |model| model.coulomb_nm[joint]);
        let command_a: Vec<f64> = match &recording.command_a {
            Some(command) => command[joint].clone(),
            None => (0..samples)
                .map(|k| {
                    let error = &recording.error_counts[joint];
                    law.command_a(error[k], error[k.saturating_sub(1)])
                        .clamp(-part.current_limit_a, part.current_limit_a)
                })
                .collect(),
        };
        // A command acts from its delay to that of the next; at the sample's instant half of each neighbour counts,
        // shifted by the delay.
        let of_last = 0.5 + robot.command_delay_s / period_s;
        let mean_a = |k: usize| of_last * command_a[k.saturating_sub(1)] + (1.0 - of_last) * command_a[k];
        let speed: Vec<f64> = velocity[joint].iter().map(|speed| gear * speed).collect();
        let link_nm: Vec<f64> = of_model.iter().map(|torque| torque[joint] / gear).collect();
        let left_nm = (0..samples)
            .map(|k| {
                part.torque_constant_nm_per_a * mean_a(k) - link_nm[k] - viscous * speed[k] - coulomb * sign(speed[k])
            })
            .collect();
        let mut base: Vec<Vec<f64>> =
            units.iter().map(|unit| unit.iter().map(|torque| torque[joint] / gear).collect()).collect();
        for of in 0..2 {
            let own = if of == joint { 1.0 } else { 0.0 };
            base.push(speed.iter().map(|speed| own * speed).collect());
            base.push(speed.iter().map(|speed| own * sign(*speed)).collect());
        }
        both.push(Signals {
            joint,
            time_s: recording.tick.iter().map(|tick| f64::from(*tick) * period_s).collect(),
            joint_rad: angle[joint].clone(),
            motor_rad: angle[joint].iter().map(|angle| gear * angle).collect(),
            kept: kept(&speed, period_s),
            speed_rad_s: speed,
            link_nm,
            command_a,
            inertia_kg_m2: f[if joint == 0 { 6 } else { 0 }] / (gear * gear),
            base,
            left_nm,
            torque_constant_nm_per_a: part.torque_constant_nm_per_a,
            coulomb_nm: coulomb.max(1e-6),
            period_s,
        });
    }
    both.try_into().ok()
}

/// 1 or -1 with the sign of `value`, 0 at 0.
pub fn sign(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.signum() }
}

fn differences(series: &[f64], period_s: f64) -> Vec<f64> {
    let last = series.len().saturating_sub(1);
    (0..series.len())
        .map(|k| {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
            (series[after] - series[before]) / (period_s * (after - before).max(1) as f64)
        })
        .collect()
}

/// Samples away from reversals and the ends, as far apart as the filter makes neighbours independent.
fn kept(speed: &[f64], period_s: f64) -> Vec<usize> {
    let margin = (AROUND_REVERSALS_S / period_s).round() as usize;
    let apart = (0.5 / (CUTOFF_HZ * period_s)).round().max(1.0) as usize;
    let mut near = vec![false; speed.len()];
    for k in 1..speed.len() {
        if speed[k] * speed[k - 1] <= 0.0 {
            let end = (k + margin).min(speed.len());
            near[k.saturating_sub(margin)..end].fill(true);
        }
    }
    (margin..speed.len().saturating_sub(margin)).step_by(apart).filter(|&k| !near[k]).collect()
}

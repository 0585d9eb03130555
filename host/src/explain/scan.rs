//! Where to begin: orders, limits and scales that the recordings themselves suggest.

use rayon::prelude::*;

use super::library::Kind;
use super::screen::Stage;
use crate::robot::Unit;

/// Orders of the motor's angle that are looked at.
const ORDERS: [f64; 2] = [0.4, 14.0];

/// Waves along the travel of a linear axis that are looked at.
const MOST_WAVES: f64 = 160.0;

/// How many orders are handed on.
const BEST_ORDERS: usize = 3;

/// Resistance that a voltage limit is reckoned with where nothing else is known, in ohm.
const WINDING_OHM: f64 = 1.6;

/// How many orders the strength of a unit wave is computed at; between them it is interpolated.
const STRENGTHS: usize = 24;

/// Every how many samples a scan looks: it looks for what moves an arm, not for what rounds.
const THINNING: usize = 2;

/// The orders of the motor's angle that explain most of the joint's innovations, best first.
///
/// A wave's product with the residual is taken in time: the residual, weighed, goes backward through the state
/// correction once, and what is left for each order is a sum of cosines and sines.
pub fn orders(stage: &Stage, kind: &Kind, joint: usize, weights: &[f64]) -> Vec<f64> {
    let ratio = stage.setting.experiment.robot.joints[joint].gear_ratio;
    let span = |trace: &super::trace::Trace| {
        let q = &trace.position_rad[joint];
        q.iter().copied().fold(f64::MIN, f64::max) - q.iter().copied().fold(f64::MAX, f64::min)
    };
    let turns = stage.traces.iter().map(span).fold(0.0, f64::max) * ratio.abs() / std::f64::consts::TAU;
    if turns <= 0.0 {
        return Vec::new();
    }
    // A linear axis has no motor angle of its own: a turn there is 2π m, and what counts are waves along its travel.
    let (low, high) = match stage.setting.experiment.robot.unit {
        Unit::Radian => (ORDERS[0].max(0.7 / turns), ORDERS[1].max(1.4 / turns)),
        Unit::Metre => (0.7 / turns, MOST_WAVES / turns),
    };
    let spacing = 0.4 / turns;
    let count = ((high - low) / spacing).max(0.0) as usize + 1;
    let rows = stage.setting.rows;
    let of_joint: Vec<_> = rows.series.iter().filter(|series| series.joint == joint).collect();
    // What each sample of a wave counts: the residual seen from the wave's side.
    let seen: Vec<Vec<f64>> = of_joint
        .iter()
        .map(|series| {
            let weighed =
                rows.weighed_back(series, &stage.residual.motion[series.rows.clone()], &weights[series.rows.clone()]);
            let trace = &stage.traces[series.segment];
            match kind.name {
                "transmission-error" => stage.response.back_to_position(&weighed),
                name => {
                    let mut seen = stage.response.back_to_torque(series.segment, joint, joint, &weighed);
                    if name == "torque-ripple" {
                        seen.iter_mut().zip(&trace.motor_torque_nm[joint]).for_each(|(x, torque)| *x *= torque);
                    }
                    seen
                }
            }
        })
        .collect();
    let strength_at = |order: f64| -> Vec<f64> {
        of_joint
            .iter()
            .map(|series| {
                let trace = &stage.traces[series.segment];
                let angle = |k: usize| order * ratio * trace.position_rad[joint][k];
                let strength = |quadrature: bool| -> f64 {
                    let at = |k: usize| if quadrature { angle(k).sin() } else { angle(k).cos() };
                    let response = match kind.name {
                        "torque-ripple" => stage
                            .response
                            .to_torque(series.segment, joint, joint, |k| at(k) * trace.motor_torque_nm[joint][k]),
                        "cogging" => stage.response.to_torque(series.segment, joint, joint, at),
                        _ => stage.response.to_position(series.segment, at),
                    };
                    let row = rows.one(series, &response);
                    row.iter().zip(&weights[series.rows.clone()]).map(|(x, w)| (x * w).powi(2)).sum()
                };
                0.5 * (strength(false) + strength(true))
            })
            .collect()
    };
    let strengths: Vec<Vec<f64>> = (0..STRENGTHS)
        .into_par_iter()
        .map(|step| strength_at(low + (high - low) * step as f64 / (STRENGTHS - 1) as f64))
        .collect();
    let gain = |index: usize| -> f64 {
        let order = low + index as f64 * spacing;
        let place = ((order - low) / (high - low) * (STRENGTHS - 1) as f64).min((STRENGTHS - 1) as f64 - 1e-9);
        let (left, share) = (place as usize, place.fract());
        of_joint
            .iter()
            .zip(&seen)
            .enumerate()
            .map(|(at, (series, seen))| {
                let q = &stage.traces[series.segment].position_rad[joint];
                let (mut cosine, mut sine) = (0.0, 0.0);
                for k in (0..seen.len()).step_by(THINNING) {
                    let (s, c) = (order * ratio * q[k]).sin_cos();
                    cosine += seen[k] * c;
                    sine += seen[k] * s;
                }
                let strength = strengths[left][at] * (1.0 - share) + strengths[left + 1][at] * share;
                if strength > 0.0 { (cosine * cosine + sine * sine) / strength } else { 0.0 }
            })
            .sum()
    };
    let gains: Vec<f64> = (0..count).into_par_iter().map(gain).collect();
    let mut peaks: Vec<usize> = (0..count)
        .filter(|&i| (i == 0 || gains[i] >= gains[i - 1]) && (i + 1 == count || gains[i] >= gains[i + 1]))
        .collect();
    peaks.sort_by(|&a, &b| gains[b].total_cmp(&gains[a]));
    peaks.truncate(BEST_ORDERS);
    peaks.into_iter().map(|index| low + index as f64 * spacing).collect()
}

/// Values of a limit at `share` of the largest demand in the recordings.
pub fn limit(stage: &Stage, kind: &Kind, joint: usize, share: f64) -> Vec<f64> {
    let experiment = stage.setting.experiment;
    let robot = &experiment.robot.joints[joint];
    let mut largest = 0.0_f64;
    for (segment, trace) in experiment.segments.iter().zip(stage.traces) {
        for k in 0..segment.command_a.len() {
            let current = segment.command_a[k][joint].clamp(-robot.current_limit_a, robot.current_limit_a);
            let demand = if kind.name == "voltage-saturation" {
                let speed = trace.velocity_rad_s[joint][k] * robot.gear_ratio;
                WINDING_OHM * current + robot.torque_constant_nm_per_a * speed
            } else {
                current
            };
            largest = largest.max(demand.abs());
        }
    }
    if kind.name == "voltage-saturation" { vec![share * largest, WINDING_OHM] } else { vec![share * largest] }
}

/// How the shape values of the library, made for the reference robot, are scaled for a joint: speeds by its fastest
/// motion, and waves over the joint by its travel on a linear axis, where a turn means nothing.
pub fn scale(stage: &Stage, kind: &Kind, joint: usize) -> f64 {
    /// Motor speed of the reference robot's movement in rad/s.
    const REFERENCE_SPEED_RAD_S: f64 = 145.0;
    /// Travel of the reference robot's movement in rad.
    const REFERENCE_TRAVEL_RAD: f64 = std::f64::consts::FRAC_PI_2;
    let ratio = stage.setting.experiment.robot.joints[joint].gear_ratio.abs();
    let linear = stage.setting.experiment.robot.unit == Unit::Metre;
    match kind.name {
        "stribeck-friction" if linear => {
            let speeds = stage.traces.iter().flat_map(|trace| &trace.velocity_rad_s[joint]);
            ratio * speeds.fold(0.0_f64, |most, v| most.max(v.abs())) / REFERENCE_SPEED_RAD_S
        }
        "position-dependent-friction" if linear => {
            let positions = || stage.traces.iter().flat_map(|trace| &trace.position_rad[joint]);
            let (low, high) = positions().fold((f64::MAX, f64::MIN), |(l, h), q| (l.min(*q), h.max(*q)));
            REFERENCE_TRAVEL_RAD / (high - low).max(1e-9)
        }
        _ => 1.0,
    }
}

//! Where to begin: orders, limits and instants that the residual itself suggests.

use rayon::prelude::*;

use super::library::{Instance, Kind};
use super::screen::Stage;

/// Orders of the motor's angle that are looked at.
const ORDERS: [f64; 2] = [0.4, 14.0];

/// How many orders are handed on.
const BEST_ORDERS: usize = 3;

/// Resistance that a voltage limit is reckoned with where nothing else is known, in ohm.
const WINDING_OHM: f64 = 1.6;

/// The orders of the motor's angle that explain most of the joint's innovations, best first.
pub fn orders(stage: &Stage, kind: &Kind, joint: usize, weights: &[f64]) -> Vec<f64> {
    let ratio = stage.setting.experiment.robot.joints[joint].gear_ratio;
    // On a linear axis the "motor angle" is the position itself, in metres: a turn is what the counts say.
    let span = |trace: &super::trace::Trace| {
        let q = &trace.position_rad[joint];
        q.iter().copied().fold(f64::MIN, f64::max) - q.iter().copied().fold(f64::MAX, f64::min)
    };
    let turns = stage.traces.iter().map(span).fold(0.0, f64::max) * ratio.abs() / std::f64::consts::TAU;
    if turns < 0.5 {
        return Vec::new();
    }
    let (low, high) = (ORDERS[0].max(0.7 / turns), ORDERS[1]);
    let spacing = 0.45 / turns;
    let count = ((high - low) / spacing).max(0.0) as usize + 1;
    let rows = stage.setting.rows;
    let gain = |index: usize| -> f64 {
        let order = (low + index as f64 * spacing) * ratio;
        rows.series
            .iter()
            .filter(|series| series.joint == joint)
            .map(|series| {
                let trace = &stage.traces[series.segment];
                let wave = |quadrature: bool| {
                    let at = |k: usize| {
                        let angle = order * trace.position_rad[joint][k];
                        if quadrature { angle.sin() } else { angle.cos() }
                    };
                    match kind.name {
                        "torque-ripple" => stage
                            .response
                            .to_torque(series.segment, joint, joint, |k| at(k) * trace.motor_torque_nm[joint][k]),
                        "cogging" => stage.response.to_torque(series.segment, joint, joint, at),
                        _ => stage.response.to_position(series.segment, at),
                    }
                };
                let weigh = |row: Vec<f64>| -> Vec<f64> {
                    row.iter().zip(&weights[series.rows.clone()]).map(|(x, w)| x * w).collect()
                };
                let (a, b) = (weigh(rows.one(series, &wave(false))), weigh(rows.one(series, &wave(true))));
                let r = weigh(stage.residual.motion[series.rows.clone()].to_vec());
                let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
                let (aa, ab, bb, ar, br) = (dot(&a, &a), dot(&a, &b), dot(&b, &b), dot(&a, &r), dot(&b, &r));
                let determinant = aa * bb - ab * ab;
                if determinant <= 1e-9 * aa * bb {
                    return 0.0;
                }
                (bb * ar * ar - 2.0 * ab * ar * br + aa * br * br) / determinant
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

/// The instants in every recording where the residual suggests a slip or a contact, for either sign.
pub fn instants(stage: &Stage, kind: &'static Kind, joint: usize) -> Vec<Instance> {
    match kind.name {
        "count-loss" => slips(stage, kind, joint),
        _ => contacts(stage, kind, joint),
    }
}

/// Samples on each side that a jump is judged by.
const JUMP_SAMPLES: usize = 10;

fn slips(stage: &Stage, kind: &'static Kind, joint: usize) -> Vec<Instance> {
    let experiment = stage.setting.experiment;
    let period_s = experiment.robot.record_period_s;
    [1.0, -1.0]
        .into_iter()
        .map(|sign| {
            let records: Vec<Vec<f64>> = stage
                .innovations
                .iter()
                .zip(&experiment.segments)
                .map(|(columns, segment)| {
                    let series = &columns[joint];
                    let settled = experiment.settled(segment);
                    let mean = |range: std::ops::Range<usize>| -> f64 {
                        series[range.clone()].iter().sum::<f64>() / range.len() as f64
                    };
                    let jump = |k: usize| mean(k..k + JUMP_SAMPLES) - mean(k - JUMP_SAMPLES..k);
                    // What grows steadily is no jump.
                    let trend = |k: usize| {
                        let far = 2 * JUMP_SAMPLES;
                        0.5 * (mean(k + JUMP_SAMPLES..k + far) - mean(k..k + JUMP_SAMPLES) + mean(k - JUMP_SAMPLES..k)
                            - mean(k - far..k - JUMP_SAMPLES))
                    };
                    let margin = 2 * JUMP_SAMPLES;
                    let best = (settled.start + margin..settled.end.saturating_sub(margin))
                        .max_by(|&a, &b| (sign * (jump(a) - trend(a))).total_cmp(&(sign * (jump(b) - trend(b)))));
                    vec![best.unwrap_or(0) as f64 * period_s - 0.5 * period_s]
                })
                .collect();
            Instance { kind, joint, common: vec![Some(sign), None], records }
        })
        .collect()
}

/// Durations that are tried, in s.
const DURATIONS_S: [f64; 8] = [0.08, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4];

fn contacts(stage: &Stage, kind: &'static Kind, joint: usize) -> Vec<Instance> {
    let experiment = stage.setting.experiment;
    let period_s = experiment.robot.record_period_s;
    let arm = stage.baseline.values.with(&stage.baseline.free, &stage.hypothesis.base).arm(experiment.robot);
    let torque = super::trace::residual_torque(experiment, stage.traces, &arm, stage.innovations);
    // Running sums of the residual torque of every record.
    let sums: Vec<Vec<f64>> = torque
        .iter()
        .zip(&experiment.segments)
        .map(|(columns, segment)| {
            let settled = experiment.settled(segment);
            let mean = columns[joint][settled.clone()].iter().sum::<f64>() / settled.len() as f64;
            let mut sum = 0.0;
            columns[joint]
                .iter()
                .enumerate()
                .map(|(k, x)| {
                    sum += if k < settled.start { 0.0 } else { x - mean };
                    sum
                })
                .collect()
        })
        .collect();
    let ratio = experiment.robot.joints[joint].gear_ratio;
    let mut found = Vec::new();
    for sign in [1.0, -1.0] {
        let mut each: Vec<(f64, Instance)> = DURATIONS_S
            .iter()
            .filter_map(|&duration_s| {
                let length = (duration_s / period_s) as usize;
                let mut strength = 0.0;
                let mut records = Vec::new();
                for sum in &sums {
                    if sum.len() <= length + 2 {
                        return None;
                    }
                    let of = |k: usize| sign * (sum[k + length] - sum[k]) / (length as f64).sqrt();
                    let best = (0..sum.len() - length).max_by(|&a, &b| of(a).total_cmp(&of(b)))?;
                    strength += of(best).max(0.0).powi(2);
                    records.push(vec![best as f64 * period_s]);
                }
                let size = sign * ratio.abs();
                let instance = Instance { kind, joint, common: vec![Some(size), Some(duration_s), None], records };
                Some((strength, instance))
            })
            .collect();
        each.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.extend(each.into_iter().take(2).map(|(_, instance)| instance));
    }
    found
}

//! What a small torque or position error leaves in the innovations, without simulating the arm: the state correction's
//! own dynamics with the arm's inertia. Good enough to look for orders and instants by the thousand.

use shared::arm::{Arm, Pose};
use shared::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

use super::trace::Trace;
use crate::identify::Experiment;

/// The arm's mobility along the recordings.
pub struct Response {
    /// Acceleration in counts/s² of joints 2 and 3 per motor torque in N m, `[of][by]`, sample by sample and segment by
    /// segment.
    mobility: Vec<Vec<[[f64; 2]; 2]>>,
    period_s: f64,
    position_gain: f64,
    velocity_gain: f64,
}

impl Response {
    /// Along the motion of `traces`.
    pub fn new(experiment: &Experiment, traces: &[Trace], arm: &Arm<f64>) -> Self {
        let period_s = experiment.robot.record_period_s;
        let omega = std::f64::consts::TAU * CORRECTION_HZ;
        let ratio: [f64; 2] =
            std::array::from_fn(|joint| experiment.robot.joints.get(joint).map_or(1.0, |joint| joint.gear_ratio));
        let counts: [f64; 2] = std::array::from_fn(|joint| experiment.counts_per_rad(joint));
        let mobility = traces
            .iter()
            .map(|trace| {
                (0..trace.time_s.len())
                    .map(|k| {
                        let inertia = arm.inertia(&Pose::at([trace.position_rad[0][k], trace.position_rad[1][k]]));
                        let determinant = inertia.d11 * inertia.d22 - inertia.d12 * inertia.d12;
                        let inverse = [[inertia.d22, -inertia.d12], [-inertia.d12, inertia.d11]];
                        std::array::from_fn(|of| {
                            std::array::from_fn(|by| counts[of] * inverse[of][by] * ratio[by] / determinant)
                        })
                    })
                    .collect()
            })
            .collect();
        Self {
            mobility,
            period_s,
            position_gain: 2.0 * CORRECTION_DAMPING * omega * period_s,
            velocity_gain: omega * omega * period_s,
        }
    }

    /// Innovations of joint `of` in segment `segment` under a torque of motor `by`.
    pub fn to_torque(&self, segment: usize, of: usize, by: usize, torque_nm: impl Fn(usize) -> f64) -> Vec<f64> {
        let (mut position, mut velocity) = (0.0, 0.0);
        self.mobility[segment]
            .iter()
            .enumerate()
            .map(|(k, mobility)| {
                let innovation = position;
                position -= self.position_gain * innovation;
                velocity -= self.velocity_gain * innovation;
                let old = velocity;
                velocity += self.period_s * mobility[of][by] * torque_nm(k);
                position += 0.5 * self.period_s * (old + velocity);
                innovation
            })
            .collect()
    }

    /// Innovations under an error of the measured position in counts.
    pub fn to_position(&self, segment: usize, error_counts: impl Fn(usize) -> f64) -> Vec<f64> {
        let (mut position, mut velocity) = (0.0, 0.0);
        (0..self.mobility[segment].len())
            .map(|k| {
                let innovation = position + error_counts(k);
                position -= self.position_gain * innovation;
                velocity -= self.velocity_gain * innovation;
                position += self.period_s * velocity;
                innovation
            })
            .collect()
    }

    /// The transpose of [`Response::to_torque`]: what each sample of a torque contributes to a product with `series`.
    pub fn back_to_torque(&self, segment: usize, of: usize, by: usize, series: &[f64]) -> Vec<f64> {
        // Backward in time, an impulse of torque at a sample is seen by all later innovations.
        let (mut position, mut velocity) = (0.0, 0.0);
        let mobility = &self.mobility[segment];
        let mut seen = vec![0.0; mobility.len()];
        for k in (0..mobility.len().min(series.len())).rev() {
            // Each forward step transposed, last operation first.
            velocity += self.period_s * position;
            seen[k] = self.period_s * mobility[k][of][by] * (velocity - 0.5 * self.period_s * position);
            position += series[k] - self.position_gain * position - self.velocity_gain * velocity;
        }
        seen
    }

    /// The transpose of [`Response::to_position`].
    pub fn back_to_position(&self, series: &[f64]) -> Vec<f64> {
        let (mut position, mut velocity) = (0.0, 0.0);
        let mut seen = vec![0.0; series.len()];
        for k in (0..series.len()).rev() {
            velocity += self.period_s * position;
            let innovation = series[k] - self.position_gain * position - self.velocity_gain * velocity;
            seen[k] = innovation;
            position += innovation;
        }
        seen
    }

    /// Mean acceleration of a joint in counts/s² per torque of its own motor in N m.
    pub fn own_mobility(&self, joint: usize) -> f64 {
        let all = self.mobility.iter().flatten();
        let (sum, count) = all.fold((0.0, 0.0), |(sum, count), m| (sum + m[joint][joint].abs(), count + 1.0));
        sum / f64::max(count, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ⟨b, L a⟩ = ⟨Lᵀ b, a⟩ for both responses.
    #[test]
    fn transposes_are_transposes() {
        let samples = 400;
        let mobility = (0..samples).map(|k| [[3.0 + (k as f64 * 0.05).sin(), 0.4], [0.2, 2.0]]).collect();
        let response =
            Response { mobility: vec![mobility], period_s: 0.7e-3, position_gain: 0.028, velocity_gain: 0.44 };
        let a: Vec<f64> = (0..samples).map(|k| (k as f64 * 0.31).sin()).collect();
        let b: Vec<f64> = (0..samples).map(|k| (k as f64 * 0.11).cos()).collect();
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        let forward = dot(&b, &response.to_torque(0, 0, 0, |k| a[k]));
        let backward = dot(&a, &response.back_to_torque(0, 0, 0, &b));
        assert!((forward - backward).abs() < 1e-9 * forward.abs(), "{forward} {backward}");
        let forward = dot(&b, &response.to_position(0, |k| a[k]));
        let backward = dot(&a, &response.back_to_position(&b));
        assert!((forward - backward).abs() < 1e-9 * forward.abs(), "{forward} {backward}");
    }
}

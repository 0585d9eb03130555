//! How large the gains of a robot's position loops may be.

use shared::arm::PARAMETERS;
use shared::control::{GainError, SampledLoop};

use super::{Kind, Law, Robot};

/// Why a joint's position loop must not move a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("joint {joint}: {source}")]
pub struct UnsafeGain {
    /// Name of the joint.
    pub joint: String,
    /// Index of the joint.
    pub index: usize,
    /// The gain and its limit.
    pub source: GainError,
}

impl Robot {
    /// What bounds the gain of joint `index`, or nothing where the law is not the position loop or the viscous
    /// friction is not known.
    ///
    /// The least inertia is taken from the search range, for the arm has not been identified yet; but never more than half
    /// of what the expected arm feels at the joint while the other is free, which is little on an arm without gears.
    pub fn sampled_loop(&self, index: usize) -> Option<SampledLoop> {
        let joint = self.joints.get(index)?;
        let Law::Proportional(position_loop) = joint.law else { return None };
        // With the other joint free, joint 2 feels at least f7 less twice the coupling, about half of f7 on any PUMA.
        let of_range = if index == 0 { 0.5 * self.search[6][0] } else { self.search[0][0] };
        let least_joint_inertia = match self.kind {
            Kind::TwoLink => of_range.min(0.5 * least_free_inertia_kg_m2(&self.expected_f(), index)),
            Kind::SingleAxis => of_range,
        };
        Some(SampledLoop {
            period_s: self.loop_period_s,
            command_delay_s: self.command_delay_s,
            viscous_friction_nm_s_per_rad: joint.viscous_friction_nm_s_per_rad?,
            counts_per_rev: joint.counts_per_rev,
            least_motor_inertia_kg_m2: least_joint_inertia / (joint.gear_ratio * joint.gear_ratio),
            lead: position_loop.lead,
        })
    }

    /// Accepts the robot's gains for motion only below each joint's stability limit.
    pub fn check_gains(&self) -> Result<(), UnsafeGain> {
        for (index, joint) in self.joints.iter().enumerate() {
            let (Law::Proportional(position_loop), Some(sampled)) = (joint.law, self.sampled_loop(index)) else {
                continue;
            };
            sampled
                .check_gain(position_loop.gain_a_per_count * joint.torque_constant_nm_per_a)
                .map_err(|source| UnsafeGain { joint: joint.name.clone(), index, source })?;
        }
        Ok(())
    }
}

/// The least inertia that joint `index` of an arm with this f feels while the other is free, over all angles, in kg m².
///
/// D11 − D12²/D22 and D22 − D12²/D11 change with q3 through k = f3 c3 − f4 s3 alone, and both are concave in k: each is
/// least at an end of k's range ±√(f3² + f4²).
fn least_free_inertia_kg_m2(f: &[f64; PARAMETERS], index: usize) -> f64 {
    let [f1, f2, f3, f4, _, _, f7, ..] = *f;
    let most = f3.hypot(f4);
    let at = |coupling: f64| {
        let (d11, d12, d22) = (f7 + 2.0 * coupling, f2 + coupling, f1);
        if index == 0 { d11 - d12 * d12 / d22 } else { d22 - d12 * d12 / d11 }
    };
    at(most).min(at(-most)).max(0.0)
}

#[cfg(test)]
mod tests {
    use shared::arm::{Arm, Pose, REFERENCE_F};

    use super::*;

    /// f of a double pendulum without gears, whose joints feel far less while the other is free than while it is held.
    const DIRECT_DRIVE: [f64; PARAMETERS] = [0.0326, 0.0316, 0.0, -0.049, 0.0, -0.14, 0.3153, 0.0, 0.89];

    /// The formula against the inverse of the inertia matrix, whose diagonal is one over what a joint feels with the other
    /// free, at many angles.
    #[test]
    fn the_least_free_inertia_is_that_of_the_worst_angle() {
        for f in [REFERENCE_F, DIRECT_DRIVE, [0.5, 0.3, 0.1, 0.05, 0.0, 0.0, 1.5, 0.0, 0.0]] {
            let arm = Arm { f, gravity_m_s2: 9.81 };
            for joint in 0..2 {
                let felt = |step: u32| {
                    let mut unit = [0.0; 2];
                    unit[joint] = 1.0;
                    arm.inertia(&Pose::at([0.0, f64::from(step) * std::f64::consts::TAU / 1e4])).inverse().times(unit)
                        [joint]
                };
                let least = (0..10_000).map(|step| 1.0 / felt(step)).fold(f64::INFINITY, f64::min);
                let found = least_free_inertia_kg_m2(&f, joint);
                assert!((found / least - 1.0).abs() < 1e-6, "{f:?}, joint {joint}: {found}, not {least}");
            }
        }
    }

    #[test]
    fn an_arm_without_gears_is_judged_by_what_it_feels() {
        let least = |robot: &Robot| [0, 1].map(|joint| robot.sampled_loop(joint).unwrap().least_motor_inertia_kg_m2);
        // On the paper's robot the search ranges decide.
        let paper = Robot::paper();
        let ratio2 = [0, 1].map(|joint: usize| paper.joints[joint].gear_ratio.powi(2));
        assert_eq!(least(&paper), [0.5 * 2.23 / ratio2[0], 0.28 / ratio2[1]]);
        let mut direct = paper;
        direct.search = DIRECT_DRIVE.map(|value| {
            let width = 0.2 * value.abs() + 0.001;
            [value - width, value + width]
        });
        direct.joints.iter_mut().for_each(|joint| joint.gear_ratio = 1.0);
        let half_free = [0, 1].map(|joint| 0.5 * least_free_inertia_kg_m2(&direct.expected_f(), joint));
        // The elbow feels a quarter of what its search range says.
        assert!(half_free[1] < 0.4 * direct.search[0][0]);
        assert!((least(&direct)[1] / half_free[1] - 1.0).abs() < 1e-9);
    }
}

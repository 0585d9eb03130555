//! How finely a recording has to be integrated: until the steps no longer show beside the noise.
//!
//! Friction that holds and lets go of a motor within a step is placed at the step's end. How much that shows depends on the
//! arm, on its counts and on how often it sticks, so the recording itself is asked.

use super::experiment::Experiment;
use super::parameters::Values;

/// Integration steps per record period of an experiment that needs no more.
pub(super) const FEWEST_SUBSTEPS: u32 = 4;

/// Steps that others are compared with.
const FINEST_SUBSTEPS: u32 = 64;

/// χ² that steps may add to a joint. A parameter of an effect costs some ten, and takes up a fifth of what steps add.
const TOLERATED_CHI2: f64 = 30.0;

/// Variance of a rounded position, counts².
const ROUNDING_COUNTS2: f64 = 1.0 / 12.0;

/// Friction of a joint whose robot file gives none, as a share of the largest torque.
const UNKNOWN_FRICTION: f64 = 0.1;

impl Experiment<'_> {
    /// The fewest integration steps per record period with which the innovations of the arm to expect are, to within a small
    /// part of the noise of rounding, those of many steps.
    pub(super) fn substeps_needed(&self) -> u32 {
        // The noise of positions that are not rounded only a fit tells.
        if !self.robot.quantised {
            return FEWEST_SUBSTEPS;
        }
        let values = self.expected_values();
        let finest = FINEST_SUBSTEPS.max(4 * self.ticks_per_record());
        let fine = self.innovations_in(&values, finest);
        let mut substeps = FEWEST_SUBSTEPS;
        while substeps < finest {
            let coarse = self.innovations_in(&values, substeps);
            let added = |joint: usize| {
                let of_segment = |(a, b): (&[Vec<f64>; 2], &[Vec<f64>; 2])| -> f64 {
                    a[joint].iter().zip(&b[joint]).map(|(a, b)| (a - b) * (a - b)).sum()
                };
                coarse.iter().zip(&fine).map(of_segment).sum::<f64>() / ROUNDING_COUNTS2
            };
            // The largest passes over NaN: an arm that blows up needs no better steps.
            if (0..self.robot.joints.len()).map(added).fold(0.0, f64::max) <= TOLERATED_CHI2 {
                break;
            }
            substeps *= 2;
        }
        substeps
    }

    /// The arm to expect, with the friction of the robot file.
    fn expected_values(&self) -> Values {
        let robot = self.robot;
        let mut values = Values { f: robot.expected_f(), ..Values::of_robot(robot) };
        for (coulomb_nm, joint) in values.coulomb_nm.iter_mut().zip(&robot.joints) {
            if joint.coulomb_friction_nm.is_none() {
                *coulomb_nm = UNKNOWN_FRICTION * joint.current_limit_a * joint.torque_constant_nm_per_a;
            }
        }
        values
    }
}

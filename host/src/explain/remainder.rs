//! Whether what a model leaves can be noise: the torque noise of a robot is small, and no tone.

use super::engine::{Engine, Fitted};
use super::noise::{self, Noise};
use super::verdict::MOST_TORQUE_NOISE;

/// A noise estimated from a few seconds scatters: this factor above what is plausible is still chance.
const ESTIMATED: f64 = 1.2;
/// Chance of a tone where there is none.
const FALSE_TONE: f64 = 1e-4;
/// Degrees of freedom that a refit takes out of the rows of each joint.
const FITTED: f64 = 6.0;

/// What a fitted model leaves in the motion of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Remainder {
    /// Torque noise that would leave it, as a share of the Coulomb friction.
    pub share_of_coulomb: f64,
    /// Its strongest line over what that noise leaves there, as power (mean 2 where it is noise).
    pub line: f64,
    /// Frequency of that line in Hz.
    pub line_hz: f64,
    /// Lines that were looked at.
    pub lines: usize,
}

impl Remainder {
    /// Whether more is left than any robot's torque noise.
    pub fn is_too_large(&self) -> bool {
        self.share_of_coulomb > ESTIMATED * MOST_TORQUE_NOISE
    }

    /// Whether it has a tone in it: a line that noise reaches in one of 10 000 recordings.
    ///
    /// The power of a line of noise is exponentially distributed (χ² with two degrees of freedom).
    pub fn has_a_tone(&self) -> bool {
        self.line > 2.0 * (self.lines as f64 / FALSE_TONE).ln()
    }
}

/// What `fitted` leaves in each joint, judged by the noise that is most likely behind it, whatever its size; the white
/// part is that of `noise`.
pub fn remainders(engine: &Engine, fitted: &Fitted, noise: &Noise) -> Vec<Remainder> {
    let rows = engine.setting.rows;
    let left = &fitted.residual.motion;
    let own = noise::most_likely(rows, left, noise.map(|joint| joint.white_counts2), FITTED);
    let torque_nm = engine.torque_noise_nm(&own);
    let weights = engine.weights(&own);
    let of = |joint: usize| {
        let coulomb_nm = engine.baseline.values.coulomb_nm[joint];
        let mut remainder = Remainder {
            share_of_coulomb: if coulomb_nm > 0.0 { torque_nm[joint] / coulomb_nm } else { 0.0 },
            line: 0.0,
            line_hz: 0.0,
            lines: 0,
        };
        for series in rows.series.iter().filter(|series| series.joint == joint) {
            // After the mean, rows come in pairs: a line's real and imaginary part.
            for row in (series.rows.start + 1..series.rows.end).step_by(2) {
                let power: f64 = (row..row + 2).map(|row| (left[row] * weights[row]).powi(2)).sum();
                remainder.lines += 1;
                if power > remainder.line {
                    (remainder.line, remainder.line_hz) = (power, rows.frequency_hz[row]);
                }
            }
        }
        remainder
    };
    (0..engine.setting.experiment.robot.joints.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 1000 lines of noise, each above x with probability exp(−x/2), the strongest exceeds 2 ln(10⁷) = 32.24 in one of
    /// 10 000 recordings.
    #[test]
    fn a_tone_is_what_noise_hardly_ever_reaches() {
        let with_line = |line: f64| Remainder { share_of_coulomb: 0.0, line, line_hz: 7.0, lines: 1000 };
        assert!(!with_line(32.2).has_a_tone());
        assert!(with_line(32.3).has_a_tone());
    }
}

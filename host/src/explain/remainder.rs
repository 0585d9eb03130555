//! Whether what a model leaves can be noise: the torque noise of a robot is small, and no tone.
//!
//! Where the loop is faster than the recording no tone is looked for: the encoder's rounding acts between the samples then,
//! unseen, and a moving loop turns it into tones of its own.

use super::engine::{Engine, FITTED, Fitted};
use super::noise::{self, JointNoise, Noise};
use super::verdict::{CLOSED, MOST_TORQUE_NOISE};

/// A noise estimated from a few seconds scatters: this factor above what is plausible is still chance.
pub const ESTIMATED: f64 = 1.2;
/// Slow power of one recording over that of another from which on it is no stationary noise: seconds of it hold some thirty
/// independent values each, and of a ratio of two such variances 99.9 % lie below.
const UNEVEN: f64 = 3.5;
/// Below this torque noise shows, in Hz.
const SLOW_HZ: f64 = 10.0;
/// Chance of a tone where there is none.
const FALSE_TONE: f64 = 1e-4;

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
    /// Chance that noise gathers as much of its slow power in one line of any recording.
    pub gathered_by_chance: f64,
    /// Frequency of that line in Hz.
    pub gathered_hz: f64,
    /// Slow power of the loudest recording over that of the quietest.
    pub uneven: f64,
}

impl Remainder {
    /// Whether more is left than any robot's torque noise.
    pub fn is_too_large(&self) -> bool {
        self.share_of_coulomb > ESTIMATED * MOST_TORQUE_NOISE
    }

    /// Whether so much of the slow power is in one line as noise gathers in one of 10 000 recordings: a noise estimated from that
    /// very line hides it.
    pub fn gathers(&self) -> bool {
        self.gathered_by_chance < FALSE_TONE
    }

    /// Whether one recording has much more of it than another.
    pub fn is_uneven(&self) -> bool {
        self.uneven > UNEVEN
    }

    /// Whether a line stands out that noise reaches in one of 10 000 recordings.
    ///
    /// The power of a line of noise is exponentially distributed (χ² with two degrees of freedom).
    pub fn has_a_line(&self) -> bool {
        self.line > 2.0 * (self.lines as f64 / FALSE_TONE).ln()
    }

    /// Frequency in Hz of a tone that noise does not have, if there is one.
    pub fn tone_hz(&self) -> Option<f64> {
        if self.has_a_line() { Some(self.line_hz) } else { self.gathers().then_some(self.gathered_hz) }
    }

    /// Whether it is no torque noise.
    pub fn is_no_noise(&self) -> bool {
        self.is_too_large() || self.gathers() || self.is_uneven()
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
            gathered_by_chance: 1.0,
            gathered_hz: 0.0,
            uneven: 1.0,
        };
        let (mut quietest, mut loudest) = (f64::INFINITY, 0.0_f64);
        // Where rounding is all there is, its slow power is next to none and gathers as it likes.
        let period_s = engine.setting.experiment.robot.record_period_s;
        let rounding = JointNoise::white(own[joint].white_counts2).rms_counts(period_s);
        let rings = engine.setting.experiment.commands_are_missing();
        let audible = own[joint].rms_counts(period_s) > CLOSED * rounding && !rings;
        let recordings = rows.series.iter().filter(|series| series.joint == joint).count() as f64;
        for series in rows.series.iter().filter(|series| series.joint == joint) {
            // After the mean, rows come in pairs: a line's real and imaginary part.
            let (mut slow, mut slow_hz): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
            for row in (series.rows.start + 1..series.rows.end).step_by(2) {
                let power: f64 = (row..row + 2).map(|row| (left[row] * weights[row]).powi(2)).sum();
                if audible && rows.frequency_hz[row] < SLOW_HZ {
                    slow.push(power);
                    slow_hz.push(rows.frequency_hz[row]);
                }
                remainder.lines += 1;
                if power > remainder.line && !rings {
                    (remainder.line, remainder.line_hz) = (power, rows.frequency_hz[row]);
                }
            }
            let mean = slow.iter().sum::<f64>() / slow.len().max(1) as f64;
            (quietest, loudest) = (quietest.min(mean), loudest.max(mean));
            let chance = (recordings * gathered_by_chance(&slow)).min(1.0);
            if chance < remainder.gathered_by_chance {
                let strongest = slow.iter().zip(slow_hz).max_by(|a, b| a.0.total_cmp(b.0));
                (remainder.gathered_by_chance, remainder.gathered_hz) = (chance, strongest.map_or(0.0, |(_, hz)| hz));
            }
        }
        remainder.uneven = if quietest > 0.0 { loudest / quietest } else { 1.0 };
        remainder
    };
    (0..engine.setting.experiment.robot.joints.len()).map(of).collect()
}

/// The chance that the strongest of so many lines of noise holds as large a share of all their power (Fisher 1929, first
/// term): n(1 − g)ⁿ⁻¹.
fn gathered_by_chance(lines: &[f64]) -> f64 {
    let (most, all) = lines.iter().fold((0.0_f64, 0.0), |(most, all), power| (most.max(*power), all + power));
    let count = lines.len() as f64;
    if all > 0.0 { (count * (1.0 - most / all).powf(count - 1.0)).min(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 1000 lines of noise, each above x with probability exp(−x/2), the strongest exceeds 2 ln(10⁷) = 32.24 in one of
    /// 10 000 recordings.
    #[test]
    fn a_tone_is_what_noise_hardly_ever_reaches() {
        let with_line = |line: f64| Remainder {
            share_of_coulomb: 0.0,
            line,
            line_hz: 7.0,
            lines: 1000,
            gathered_by_chance: 1.0,
            gathered_hz: 0.0,
            uneven: 1.0,
        };
        assert!(!with_line(32.2).has_a_line());
        assert!(with_line(32.3).has_a_line());
    }

    /// Twenty lines of equal power gather nothing; of a line that holds 0.9 of all, noise has 20·0.1¹⁹ = 2·10⁻¹⁸.
    #[test]
    fn a_line_that_holds_all_slow_power_is_no_chance() {
        assert!((gathered_by_chance(&[3.0; 20]) - 1.0).abs() < 1e-12);
        let mut lines = [0.1; 20];
        lines[7] = 17.1;
        assert!((gathered_by_chance(&lines) / 2e-18 - 1.0).abs() < 1e-6, "{}", gathered_by_chance(&lines));
        assert_eq!(gathered_by_chance(&[]), 1.0);
    }
}

//! What the innovations of a right model look like, and weighing them by it.
//!
//! Two things are left in them: the rounding of the encoder, white, and torque that no model knows, slow. The state
//! correction takes both for errors of the state and follows them below its bandwidth: rounding comes out without its
//! low frequencies, torque noise as a hump around the bandwidth. Residuals divided by the root of this spectrum are
//! never louder at one frequency than at another, so that least squares is not led by torque noise.

use shared::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

use super::low_pass::transforms;

/// Correlation times of torque noise to choose from, in s.
const CORRELATION_TIMES_S: [f64; 5] = [0.003, 0.01, 0.03, 0.1, 0.3];

/// Below this the spectrum is made of the few frequencies that the fit itself explains.
const LOWEST_HZ: f64 = 0.5;

/// The spectrum of one joint's innovations, relative to white noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InnovationNoise {
    /// Power of the torque noise at low frequency over that of the rounding, as they appear in the innovations.
    torque_ratio: f64,
    /// Correlation time of the torque noise in s.
    correlation_time_s: f64,
    period_s: f64,
}

impl InnovationNoise {
    /// Rounding and nothing else: every frequency counts the same.
    pub fn rounding_alone(period_s: f64) -> Self {
        Self { torque_ratio: 0.0, correlation_time_s: 0.0, period_s }
    }

    /// The most likely noise behind one joint's innovations (Whittle's likelihood over a grid).
    pub fn of<'a>(innovations: impl Iterator<Item = &'a [f64]>, period_s: f64) -> Self {
        let mut lines = Vec::new();
        for series in innovations {
            lines.extend(periodogram(series, period_s));
        }
        let candidate = |torque_ratio, correlation_time_s| Self { torque_ratio, correlation_time_s, period_s };
        let mut best = (f64::INFINITY, Self::rounding_alone(period_s));
        let ratios = (-12..=60).map(|step| 10f64.powf(f64::from(step) / 8.0));
        for torque_ratio in std::iter::once(0.0).chain(ratios) {
            for correlation_time_s in CORRELATION_TIMES_S {
                let noise = candidate(torque_ratio, correlation_time_s);
                // The level is the mean of power over shape; what remains of the likelihood is this.
                let (mut level, mut logarithms) = (0.0, 0.0);
                for &(frequency_hz, power) in &lines {
                    let shape = noise.shape(frequency_hz);
                    level += power / shape;
                    logarithms += shape.ln();
                }
                let count = lines.len().max(1) as f64;
                let unlikeliness = (level / count).max(f64::MIN_POSITIVE).ln() + logarithms / count;
                if unlikeliness < best.0 {
                    best = (unlikeliness, noise);
                }
            }
        }
        best.1
    }

    /// `series` divided by the root of the spectrum, zero-phase: white where `series` is noise like this.
    pub fn whiten(&self, series: &[f64]) -> Vec<f64> {
        let Some((&first, &last)) = series.first().zip(series.last()) else { return Vec::new() };
        // Either end goes on as its own mirror image turned about its value, for as long as the filter rings. Going on as
        // zeros would make a step of it, which no torque damps: in the sensitivities it looks like one moment that knows
        // everything.
        let ring = ((2.0 / CORRECTION_HZ / self.period_s) as usize).min(series.len() - 1);
        let before = series[1..=ring].iter().rev().map(|value| 2.0 * first - value);
        let after = series[series.len() - 1 - ring..series.len() - 1].iter().rev().map(|value| 2.0 * last - value);
        let mut padded: Vec<f64> = before.chain(series.iter().copied()).chain(after).collect();
        let length = padded.len();
        let (forward, backward) = transforms(length);
        let mut lines = forward.make_output_vec();
        // Both fail only on wrong buffer lengths, which the planner made itself.
        let _ = forward.process(&mut padded, &mut lines);
        for (k, line) in lines.iter_mut().enumerate() {
            let frequency_hz = k as f64 / (length as f64 * self.period_s);
            *line *= 1.0 / (self.shape(frequency_hz).sqrt() * length as f64);
        }
        let _ = backward.process(&mut lines, &mut padded);
        padded[ring..ring + series.len()].to_vec()
    }

    fn shape(&self, frequency_hz: f64) -> f64 {
        let relative = frequency_hz / CORRECTION_HZ;
        let squared = relative * relative;
        let correction = (1.0 - squared).powi(2) + (2.0 * CORRECTION_DAMPING * relative).powi(2);
        let slowness = std::f64::consts::TAU * frequency_hz * self.correlation_time_s;
        let torque = self.torque_ratio / (1.0 + slowness * slowness);
        // Below the bandwidth rounding leaves next to nothing; weighing that up would bring out the small faults that
        // every model has, so no frequency counts more than plain rounding does.
        ((squared * squared + torque) / correction).max(1.0)
    }
}

/// Frequencies in Hz and power of a series, from [`LOWEST_HZ`] up.
fn periodogram(series: &[f64], period_s: f64) -> Vec<(f64, f64)> {
    let length = series.len();
    if length < 2 {
        return Vec::new();
    }
    let (forward, _) = transforms(length);
    let mut lines = forward.make_output_vec();
    // Fails only on wrong buffer lengths, which the planner made itself.
    let _ = forward.process(&mut series.to_vec(), &mut lines);
    let spacing_hz = 1.0 / (length as f64 * period_s);
    let powers = lines.iter().enumerate().map(|(k, line)| (k as f64 * spacing_hz, line.norm_sqr() / length as f64));
    powers.filter(|&(frequency_hz, _)| frequency_hz >= LOWEST_HZ).collect()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    const PERIOD_S: f64 = 0.7e-3;

    /// Innovations of a mass under white rounding and torque noise of `torque_counts` per tick², correlated over
    /// 30 ms, followed by the state correction.
    fn innovations(torque_counts: f64) -> Vec<f64> {
        let mut random = rand::rngs::StdRng::seed_from_u64(3);
        let omega = std::f64::consts::TAU * CORRECTION_HZ;
        let (mut position, mut velocity, mut torque) = (0.0, 0.0, 0.0);
        let (mut estimate, mut rate) = (0.0, 0.0);
        let memory = (-PERIOD_S / 0.03).exp();
        (0..12_000)
            .map(|_| {
                let innovation = position + random.random_range(-0.5..0.5) - estimate;
                estimate += 2.0 * CORRECTION_DAMPING * omega * PERIOD_S * innovation;
                rate += omega * omega * PERIOD_S * PERIOD_S * innovation;
                torque = memory * torque + random.random_range(-1.0..1.0) * torque_counts;
                velocity += torque;
                position += velocity;
                estimate += rate;
                innovation
            })
            .collect()
    }

    fn power_below(series: &[f64], limit_hz: f64) -> f64 {
        let lines: Vec<f64> =
            periodogram(series, PERIOD_S).iter().filter(|line| line.0 < limit_hz).map(|line| line.1).collect();
        lines.iter().sum::<f64>() / lines.len() as f64
    }

    /// The hump that torque noise makes below 8 Hz must come down to the level of the rounding above it, within the
    /// scatter of some sixty lines.
    #[test]
    fn torque_noise_is_weighed_down_to_the_rounding() {
        for torque_counts in [3e-4, 1e-3] {
            let series = innovations(torque_counts);
            let before = power_below(&series, 8.0) / power_below(&series, 700.0);
            assert!(before > 5.0, "torque noise {torque_counts}: {before} before");
            let white = InnovationNoise::of(std::iter::once(series.as_slice()), PERIOD_S).whiten(&series);
            let after = power_below(&white, 8.0) / power_below(&white, 700.0);
            assert!((0.5..2.0).contains(&after), "torque noise {torque_counts}: {after} after");
        }
    }

    /// A series that stands far from zero where it begins and ends has no spikes there.
    #[test]
    fn the_ends_of_a_series_are_no_steps() {
        let noise = InnovationNoise { torque_ratio: 1e4, correlation_time_s: 0.03, period_s: PERIOD_S };
        let series: Vec<f64> = (0..5000).map(|k| 5.0 + (k as f64 / 400.0).cos()).collect();
        let white = noise.whiten(&series);
        let largest = |part: &[f64]| part.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
        let (middle, whole) = (largest(&white[1000..4000]), largest(&white));
        assert!(whole < 2.0 * middle, "{whole} at an end, {middle} in the middle");
    }

    /// Rounding alone is left as it is: what the state correction took from it is not brought back.
    #[test]
    fn rounding_alone_is_left_alone() {
        let series = innovations(0.0);
        let white = InnovationNoise::rounding_alone(PERIOD_S).whiten(&series);
        assert!(series.iter().zip(&white).all(|(before, after)| (before - after).abs() < 1e-9));
    }
}

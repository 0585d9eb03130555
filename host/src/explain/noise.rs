//! What the innovations of a right model look like: white rounding, and torque that no model knows.
//!
//! The state correction takes both for errors of the state and follows them below its bandwidth: rounding comes out
//! without its low frequencies, torque noise as a hump around the bandwidth.

use shared::replay::{CORRECTION_DAMPING, CORRECTION_HZ};

use super::rows::Rows;

/// Correlation times of torque noise to choose from, in s.
const CORRELATION_TIMES_S: [f64; 5] = [0.005, 0.015, 0.05, 0.15, 0.5];

/// Frequencies are gathered in bands this wide for fitting, as a ratio.
const BAND: f64 = 1.08;

/// One joint's noise in its innovations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointNoise {
    /// Variance of the white part in counts².
    pub white_counts2: f64,
    /// Power of the torque noise at low frequency in the innovations, counts² per row.
    pub torque_counts2: f64,
    /// Its correlation time in s.
    pub correlation_time_s: f64,
}

/// Both joints' noise.
pub type Noise = [JointNoise; 2];

impl JointNoise {
    /// Only the white part.
    pub fn white(white_counts2: f64) -> Self {
        Self { white_counts2, torque_counts2: 0.0, correlation_time_s: CORRELATION_TIMES_S[2] }
    }

    /// Variance of a row at this frequency.
    pub fn power(&self, frequency_hz: f64) -> f64 {
        let relative = frequency_hz / CORRECTION_HZ;
        let squared = relative * relative;
        let correction = (1.0 - squared).powi(2) + (2.0 * CORRECTION_DAMPING * relative).powi(2);
        let slowness = std::f64::consts::TAU * frequency_hz * self.correlation_time_s;
        let torque = self.torque_counts2 / (1.0 + slowness * slowness);
        // Below the bandwidth rounding leaves next to nothing. Weighing that up would bring out the small faults that
        // every model has, so no frequency counts more than plain rounding does.
        ((squared * squared * self.white_counts2 + torque) / correction).max(self.white_counts2)
    }

    /// Standard deviation of the angular acceleration noise in counts/s² behind this torque noise.
    ///
    /// Torque of power spectral density constant below 1/(2πτ) appears in the innovations as acceleration over ω₀².
    pub fn acceleration_counts_s2(&self, period_s: f64) -> f64 {
        let omega = std::f64::consts::TAU * CORRECTION_HZ;
        // A Gauss–Markov process of variance v has, sampled, the low-frequency power v·2τ/T a row.
        (self.torque_counts2 * period_s / (2.0 * self.correlation_time_s)).sqrt() * omega * omega
    }

    /// Root mean square that noise like this leaves in innovations sampled every `period_s`, in counts.
    pub fn rms_counts(&self, period_s: f64) -> f64 {
        let highest_hz = 0.5 / period_s;
        let steps = 4000;
        let sum: f64 = (0..steps).map(|k| self.power((f64::from(k) + 0.5) / f64::from(steps) * highest_hz)).sum();
        (sum / f64::from(steps)).sqrt()
    }
}

/// The most likely noise behind residual `rows` (Whittle's likelihood on a grid), the white part given.
/// `parameters` are the degrees of freedom that a fit has already taken out of the rows of each joint.
pub fn most_likely(layout: &Rows, rows: &[f64], white_counts2: [f64; 2], parameters: f64) -> Noise {
    [0, 1].map(|joint| joint_noise(layout, rows, joint, white_counts2[joint], parameters))
}

fn joint_noise(layout: &Rows, rows: &[f64], joint: usize, white_counts2: f64, parameters: f64) -> JointNoise {
    // Bands of frequencies: mean power and count.
    let mut bands: Vec<(f64, f64, f64)> = Vec::new();
    let band_of = |frequency_hz: f64| ((frequency_hz / 0.2).max(1.0).ln() / BAND.ln()) as usize;
    for ((&row, &frequency_hz), &of) in rows.iter().zip(&layout.frequency_hz).zip(&layout.joint) {
        if of == joint {
            let band = band_of(frequency_hz);
            if bands.len() <= band {
                bands.resize(band + 1, (0.0, 0.0, 0.0));
            }
            let entry = &mut bands[band];
            entry.0 += frequency_hz;
            entry.1 += row * row;
            entry.2 += 1.0;
        }
    }
    bands.retain(|band| band.2 > 0.0);
    // What a fit explains lies where the noise is: below some tens of hertz.
    let slow: f64 = bands.iter().filter(|band| band.0 / band.2 < 30.0).map(|band| band.2).sum();
    let inflation = if slow > 2.0 * parameters { slow / (slow - parameters) } else { 1.0 };
    let mut best = (f64::INFINITY, JointNoise::white(white_counts2));
    let ratios = (-8..=64).map(|step| 10f64.powf(f64::from(step) / 8.0));
    for ratio in std::iter::once(0.0).chain(ratios) {
        for correlation_time_s in CORRELATION_TIMES_S {
            let noise = JointNoise { white_counts2, torque_counts2: ratio * white_counts2, correlation_time_s };
            let unlikeliness: f64 = bands
                .iter()
                .map(|&(frequency_sum, power_sum, count)| {
                    let frequency_hz = frequency_sum / count;
                    let factor = if frequency_hz < 30.0 { inflation } else { 1.0 };
                    let power = noise.power(frequency_hz);
                    // Below the correction's bandwidth the floor is above what rounding leaves.
                    count * power.ln() + factor * power_sum / power
                })
                .sum();
            if unlikeliness < best.0 {
                best = (unlikeliness, noise);
            }
            if ratio == 0.0 {
                break;
            }
        }
    }
    best.1
}

/// One over the standard deviation of every row.
pub fn weights(layout: &Rows, noise: &Noise) -> Vec<f64> {
    let of = |(frequency_hz, joint): (&f64, &usize)| 1.0 / noise[*joint].power(*frequency_hz).sqrt();
    layout.frequency_hz.iter().zip(&layout.joint).map(of).collect()
}

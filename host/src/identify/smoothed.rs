//! A low-pass filter on running signals of any number type, for objectives judged below a frequency.

use shared::scalar::Scalar;

/// Quality factors of the two second-order sections of a fourth-order Butterworth filter.
const QUALITY: [f64; 2] = [0.541_196_100_146_197, 1.306_562_964_876_377];

/// Second-order sections of the whole filter: the fourth-order one twice.
const SECTIONS: usize = 4;

/// A causal filter with the gain of [`super::low_pass()`]: 1/(1 + (f/f_c)^8).
///
/// It delays, which that one does not; but the sum of the squares of what it lets through is the same, ends apart,
/// because by Parseval's theorem that sum does not know phases. So candidates can be judged while they run.
#[derive(Clone, Copy, Debug)]
pub struct Smoother<S> {
    sections: [Section<S>; SECTIONS],
}

/// b0 (1 + 2 z⁻¹ + z⁻²)/(1 + a1 z⁻¹ + a2 z⁻²), transposed direct form II.
#[derive(Clone, Copy, Debug)]
struct Section<S> {
    gain: S,
    minus_a1: S,
    minus_a2: S,
    memory: [S; 2],
}

impl<S: Scalar> Smoother<S> {
    /// A filter at rest for signals sampled every `period_s`; `cutoff_hz` must be below half the sampling rate.
    /// `number` makes constants.
    #[inline(always)]
    pub fn new(cutoff_hz: f64, period_s: f64, number: impl Fn(f64) -> S) -> Self {
        let omega = std::f64::consts::TAU * cutoff_hz * period_s;
        let section = |quality: f64| {
            let alpha = omega.sin() / (2.0 * quality);
            let scale = 1.0 / (1.0 + alpha);
            Section {
                gain: number(0.5 * (1.0 - omega.cos()) * scale),
                minus_a1: number(2.0 * omega.cos() * scale),
                minus_a2: number((alpha - 1.0) * scale),
                memory: [number(0.0); 2],
            }
        };
        let [first, second] = [section(QUALITY[0]), section(QUALITY[1])];
        Self { sections: [first, second, first, second] }
    }

    /// The filtered signal at the next sample.
    #[inline(always)]
    pub fn next(&mut self, value: S) -> S {
        let mut signal = value;
        for section in &mut self.sections {
            let part = section.gain * signal;
            let out = part + section.memory[0];
            section.memory[0] = section.minus_a1.mul_add(out, part + part + section.memory[1]);
            section.memory[1] = section.minus_a2.mul_add(out, part);
            signal = out;
        }
        signal
    }
}

#[cfg(test)]
mod tests {
    use super::super::low_pass::low_pass;
    use super::*;

    /// What it lets through must have the energy of what the zero-phase filter lets through.
    #[test]
    fn lets_as_much_through_as_the_zero_phase_filter() {
        let period_s = 0.7e-3;
        for frequency_hz in [3.0, 8.0, 10.0, 16.0] {
            let envelope = |k: usize| (std::f64::consts::PI * k as f64 / 8000.0).sin().powi(2);
            let signal: Vec<f64> = (0..8000)
                .map(|k| envelope(k) * (std::f64::consts::TAU * frequency_hz * k as f64 * period_s).sin())
                .collect();
            let energy = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>();
            let mut smoother = Smoother::new(8.0, period_s, |value| value);
            let running: Vec<f64> = signal.iter().map(|&value| smoother.next(value)).collect();
            let ratio = energy(&running) / energy(&low_pass(&signal, period_s, 8.0));
            assert!((0.98..1.02).contains(&ratio), "{frequency_hz} Hz: {ratio}");
        }
    }
}

//! A zero-phase low-pass filter: the same for measured and simulated signals, so that it moves neither in time.

use std::cell::RefCell;
use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

/// Order of the Butterworth magnitude; forward and backward passes of a filter of half this order give the same.
const ORDER: i32 = 8;

/// `signal`, sampled every `period_s`, without what is above `cutoff_hz`: multiplied in frequency by
/// 1/(1 + (f/f_c)^8), which is zero-phase. The ends are continued by odd reflection, so a signal that ends on a slope
/// keeps it.
pub fn low_pass(signal: &[f64], period_s: f64, cutoff_hz: f64) -> Vec<f64> {
    let length = signal.len();
    if length < 2 {
        return signal.to_vec();
    }
    // Three time constants of the filter ring out within the margin.
    let margin = ((3.0 / (cutoff_hz * period_s)) as usize).clamp(1, length - 1);
    let (first, last) = (signal[0], signal[length - 1]);
    let mut padded = Vec::with_capacity(length + 2 * margin);
    padded.extend((1..=margin).rev().map(|k| 2.0 * first - signal[k]));
    padded.extend_from_slice(signal);
    padded.extend((1..=margin).map(|k| 2.0 * last - signal[length - 1 - k]));

    // A transform is periodic: take the straight line between the ends away, and add it back afterwards.
    let total = padded.len();
    let (start, slope) = (padded[0], (padded[total - 1] - padded[0]) / (total - 1) as f64);
    for (k, value) in padded.iter_mut().enumerate() {
        *value -= start + slope * k as f64;
    }
    let (forward, backward) = transforms(total);
    let mut spectrum = forward.make_output_vec();
    if forward.process(&mut padded, &mut spectrum).is_err() {
        return signal.to_vec();
    }
    for (bin, value) in spectrum.iter_mut().enumerate() {
        let frequency_hz = bin as f64 / (total as f64 * period_s);
        *value *= 1.0 / ((1.0 + (frequency_hz / cutoff_hz).powi(ORDER)) * total as f64);
    }
    if backward.process(&mut spectrum, &mut padded).is_err() {
        return signal.to_vec();
    }
    (margin..margin + length).map(|k| padded[k] + start + slope * k as f64).collect()
}

/// Forward and backward transforms of a length. A fit filters series of the same few lengths thousands of times, and
/// planning takes longer than transforming.
pub(super) fn transforms(length: usize) -> (Arc<dyn RealToComplex<f64>>, Arc<dyn ComplexToReal<f64>>) {
    thread_local! {
        static PLANNER: RefCell<RealFftPlanner<f64>> = RefCell::new(RealFftPlanner::new());
    }
    PLANNER.with_borrow_mut(|planner| (planner.plan_fft_forward(length), planner.plan_fft_inverse(length)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(length: usize, period_s: f64, frequency_hz: f64) -> Vec<f64> {
        (0..length).map(|k| (std::f64::consts::TAU * frequency_hz * k as f64 * period_s).sin()).collect()
    }

    fn rms(signal: impl Iterator<Item = f64>, length: usize) -> f64 {
        (signal.map(|x| x * x).sum::<f64>() / length as f64).sqrt()
    }

    #[test]
    fn passes_slow_motion_unshifted_and_stops_fast_motion() {
        let (length, period_s) = (5214, 0.7e-3);
        let slow = sine(length, period_s, 1.0);
        let filtered = low_pass(&slow, period_s, 8.0);
        // At an eighth of the cut-off the gain is 1/(1 + 8^-8); what is left are the ends.
        assert!(rms(slow.iter().zip(&filtered).map(|(a, b)| a - b), length) < 2e-3);
        let fast = sine(length, period_s, 40.0);
        let filtered = low_pass(&fast, period_s, 8.0);
        assert!(rms(filtered[500..length - 500].iter().copied(), length - 1000) < 1e-3);
    }

    #[test]
    fn half_power_is_at_the_cutoff() {
        let (length, period_s) = (20_000, 0.7e-3);
        let filtered = low_pass(&sine(length, period_s, 8.0), period_s, 8.0);
        let middle = &filtered[4000..16_000];
        let gain = rms(middle.iter().copied(), middle.len()) * 2f64.sqrt();
        assert!((gain - 0.5).abs() < 0.01, "{gain}");
    }

    #[test]
    fn a_straight_line_stays() {
        let line: Vec<f64> = (0..500).map(|k| 3.0 - 0.25 * k as f64).collect();
        for (a, b) in line.iter().zip(low_pass(&line, 1e-3, 10.0)) {
            assert!((a - b).abs() < 1e-9);
        }
    }
}

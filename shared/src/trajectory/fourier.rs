//! Finite Fourier series: the movements that excite what identification wants to see.

use super::phase::{STEP_PEAKS, phase, seconds, sin_cos_of_phase, smooth_step, unit};
use super::{DerivativeBounds, LimitError, Part};
use crate::control::JointReference;
use crate::scalar::Number;
use core::f64::consts::TAU;
use serde::{Deserialize, Serialize};

/// The most harmonics a [`Fourier`] has.
pub const MAX_HARMONICS: usize = 8;

/// What one harmonic adds to each joint: `cosine_rad cos(kωt) + sine_rad sin(kωt)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Harmonic {
    /// Amplitude of the cosine for each joint, rad.
    pub cosine_rad: [f32; 2],
    /// Amplitude of the sine for each joint, rad.
    pub sine_rad: [f32; 2],
}

/// `q = centre + w(t) Σ (cosine_k cos kωt + sine_k sin kωt)`, ω = 2π/period, repeated.
///
/// The window w rises from 0 to 1 as 10u³ − 15u⁴ + 6u⁵ during the first `fade_ns` and falls likewise during the last,
/// so a movement with a fade starts and ends at rest, at the centre, without a step of acceleration, whatever its
/// amplitudes. Without a fade w = 1: then it starts and ends at `centre + Σ cosine_k`, and it does so at rest only
/// where Σ k sine_k = 0 for each joint, as with cosines alone. [`super::check`] refuses any other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fourier {
    /// Period of the fundamental in ns, not zero.
    pub period_ns: u64,
    /// How many periods the movement lasts, fades included; not zero.
    pub repeats: u32,
    /// How long the fade-in and the fade-out take, in ns each: 0 for none, at most half the duration.
    pub fade_ns: u64,
    /// Middle of the movement for each joint, rad.
    pub centre_rad: [f32; 2],
    /// Amplitudes of harmonic 1, the fundamental, of harmonic 2 and so on.
    pub harmonics: heapless::Vec<Harmonic, MAX_HARMONICS>,
}

impl Fourier {
    pub(crate) fn duration_ns(&self) -> u64 {
        self.period_ns.saturating_mul(u64::from(self.repeats))
    }

    pub(super) fn moving<S: Number>(&self, time_ns: u64) -> JointReference<S> {
        let number = |value: f32| S::from_f64(f64::from(value));
        let centre = self.centre_rad.map(number);
        if self.duration_ns() == 0 {
            return super::at_rest(centre);
        }
        let turn = phase(time_ns, self.period_ns);
        let omega = S::from_f64(TAU) / seconds(self.period_ns);
        let mut series = super::at_rest([S::zero(); 2]);
        let mut order = 0_u32;
        let mut frequency = S::zero();
        for harmonic in &self.harmonics {
            order += 1;
            frequency += omega;
            let (sine, cosine) = sin_cos_of_phase::<S>(turn.wrapping_mul(order));
            for joint in 0..2 {
                let in_phase = number(harmonic.cosine_rad[joint]);
                let in_quadrature = number(harmonic.sine_rad[joint]);
                let position = in_phase * cosine + in_quadrature * sine;
                series.position_rad[joint] += position;
                series.velocity_rad_s[joint] += frequency * (in_quadrature * cosine - in_phase * sine);
                series.acceleration_rad_s2[joint] -= frequency * frequency * position;
            }
        }
        let [window, slope, curvature] = self.window::<S>(time_ns);
        let mut reference = super::at_rest(centre);
        for joint in 0..2 {
            let position = series.position_rad[joint];
            let velocity = series.velocity_rad_s[joint];
            reference.position_rad[joint] += window * position;
            reference.velocity_rad_s[joint] = slope * position + window * velocity;
            reference.acceleration_rad_s2[joint] =
                curvature * position + (slope + slope) * velocity + window * series.acceleration_rad_s2[joint];
        }
        reference
    }

    /// The window and its first two derivatives by time in s.
    fn window<S: Number>(&self, time_ns: u64) -> [S; 3] {
        let left_ns = self.duration_ns().saturating_sub(time_ns);
        let nearest_ns = time_ns.min(left_ns);
        if nearest_ns >= self.fade_ns {
            return [S::one(), S::zero(), S::zero()];
        }
        let [step, slope, curvature] = smooth_step(unit::<S>(phase(nearest_ns, self.fade_ns)));
        let per_second = S::one() / seconds(self.fade_ns);
        let forward = if time_ns <= left_ns { per_second } else { -per_second };
        [step, slope * forward, curvature * per_second * per_second]
    }

    #[inline]
    pub(crate) fn well_formed(&self) -> Result<(), LimitError> {
        if self.period_ns == 0 {
            return Err(LimitError::Zero { part: Part::Period });
        }
        if self.repeats == 0 {
            return Err(LimitError::Zero { part: Part::Repeats });
        }
        let longest_ns = self.duration_ns() / 2;
        if self.fade_ns > longest_ns {
            return Err(LimitError::FadeTooLong { fade_ns: self.fade_ns, longest_ns });
        }
        Part::Centre.finite(self.centre_rad)?;
        for (index, harmonic) in (1_u8..).zip(&self.harmonics) {
            Part::Harmonic(index).finite(harmonic.cosine_rad)?;
            Part::Harmonic(index).finite(harmonic.sine_rad)?;
        }
        Ok(())
    }

    /// The smooth pieces a check has to look at: fade-in, one period at full amplitude, fade-out.
    pub(super) fn piece_ns(&self, index: usize) -> Option<(u64, u64)> {
        let fade_out = self.duration_ns() - self.fade_ns;
        let piece = match (self.fade_ns, index) {
            (0, 0) => (0, self.period_ns),
            (0, _) => return None,
            (fade_ns, 0) => (0, fade_ns),
            (fade_ns, 1) => (fade_ns, fade_out.min(fade_ns.saturating_add(self.period_ns))),
            (_, 2) => (fade_out, self.duration_ns()),
            _ => return None,
        };
        Some(piece)
    }

    /// By Leibniz' rule from the amplitudes of series and window.
    pub(super) fn derivative_bounds(&self) -> DerivativeBounds {
        const BINOMIAL: [[f32; 5]; 3] =
            [[1.0, 2.0, 1.0, 0.0, 0.0], [1.0, 3.0, 3.0, 1.0, 0.0], [1.0, 4.0, 6.0, 4.0, 1.0]];
        let omega = core::f32::consts::TAU / seconds::<f32>(self.period_ns);
        let mut window = [1.0, 0.0, 0.0, 0.0, 0.0];
        if self.fade_ns > 0 {
            let mut per_second = 1.0;
            for (bound, peak) in window.iter_mut().zip(STEP_PEAKS) {
                *bound = peak * per_second;
                per_second /= seconds::<f32>(self.fade_ns);
            }
        }
        [0, 1].map(|joint| {
            let mut series = [0.0; 5];
            let mut frequency = 0.0;
            for harmonic in &self.harmonics {
                frequency += omega;
                let mut bound = harmonic.cosine_rad[joint].abs() + harmonic.sine_rad[joint].abs();
                for derivative in &mut series {
                    *derivative += bound;
                    bound *= frequency;
                }
            }
            let mut bounds = [0.0; 3];
            for (derivative, bound) in bounds.iter_mut().enumerate() {
                for share in 0..=derivative + 2 {
                    *bound += BINOMIAL[derivative][share] * window[share] * series[derivative + 2 - share];
                }
            }
            bounds
        })
    }
}

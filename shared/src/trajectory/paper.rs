//! The paper's movement, its equation (6).

use super::DerivativeBounds;
use super::phase::{phase, seconds, sin_cos_of_phase};
use crate::control::JointReference;
use crate::scalar::Number;
use core::f64::consts::{FRAC_PI_4, TAU};
use serde::{Deserialize, Serialize};

/// `q2 = −π/4 + π/4 cos(2πt/T)`, `q3 = π/4 − π/4 cos(2πt/(T/2))`, for one T: from (0, 0) to (−π/2, 0) and back, the
/// forearm going to π/2 and back twice. Starts and ends at rest at exactly (0, 0).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Paper {
    /// T in ns, not zero; the paper's is 3.65 s.
    pub period_ns: u64,
}

impl Paper {
    pub(super) fn duration_ns(&self) -> u64 {
        self.period_ns
    }

    pub(super) fn moving<S: Number>(&self, time_ns: u64) -> JointReference<S> {
        if self.period_ns == 0 {
            return super::at_rest([S::zero(); 2]);
        }
        let turn = phase(time_ns, self.period_ns);
        let (sine, cosine) = sin_cos_of_phase::<S>(turn);
        let (sine_twice, cosine_twice) = sin_cos_of_phase::<S>(turn.wrapping_mul(2));
        let amplitude = S::from_f64(FRAC_PI_4);
        let omega = S::from_f64(TAU) / seconds(self.period_ns);
        let omega_twice = omega + omega;
        JointReference {
            position_rad: [amplitude * cosine - amplitude, amplitude - amplitude * cosine_twice],
            velocity_rad_s: [-amplitude * omega * sine, amplitude * omega_twice * sine_twice],
            acceleration_rad_s2: [
                -amplitude * omega * omega * cosine,
                amplitude * omega_twice * omega_twice * cosine_twice,
            ],
        }
    }
}

impl Paper {
    pub(super) fn derivative_bounds(&self) -> DerivativeBounds {
        let omega = core::f32::consts::TAU / seconds::<f32>(self.period_ns);
        [omega, omega + omega].map(|frequency| {
            let acceleration = core::f32::consts::FRAC_PI_4 * frequency * frequency;
            [acceleration, acceleration * frequency, acceleration * frequency * frequency]
        })
    }
}

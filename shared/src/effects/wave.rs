//! What repeats with position: ripple, cogging, friction over a turn, an eccentric gear, a spring's torque over its joint.

use crate::scalar::Scalar;

/// `size` · cos(`order` · position + `phase`).
#[derive(Clone, Copy, Debug)]
pub(super) struct Wave<S> {
    /// What it swings by to either side, in the unit of whatever repeats.
    pub size: S,
    /// Periods over a turn of the angle it is asked at.
    pub order: S,
    /// Its angle in rad at position zero.
    pub phase: S,
}

impl<S: Scalar> Wave<S> {
    /// Its value at a position in rad. Where it has no size in any lane its cosine is not computed: most waves are off, and
    /// cosines would take a quarter of a simulation's time. Which are off does not change while a model runs, so that each
    /// step takes as long as any other.
    #[inline(always)]
    pub fn at(&self, position_rad: S) -> S {
        if self.size.is_zero() {
            return self.size;
        }
        let (_, cosine) = self.order.mul_add(position_rad, self.phase).sin_cos();
        self.size * cosine
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dual::Dual;

    #[test]
    fn a_wave_is_a_cosine_of_its_size() {
        let wave = Wave { size: 0.3, order: 2.0, phase: 0.5 };
        assert!((wave.at(0.4) - 0.3 * 1.3_f64.cos()).abs() < 1e-15);
        assert_eq!(Wave { size: 0.0, ..wave }.at(0.4), 0.0);
        // A model gone wrong is noticed.
        assert!(Wave { size: f64::NAN, ..wave }.at(0.4).is_nan());
    }

    /// A wave that is off would still grow with its size.
    #[test]
    fn the_derivative_by_a_size_is_there_at_size_zero() {
        let size = Dual { value: 0.0, slope: 1.0 };
        let wave = Wave { size, order: Dual::fixed(2.0), phase: Dual::fixed(0.5) };
        let Dual { value, slope } = wave.at(Dual::fixed(0.4));
        assert_eq!(value, 0.0);
        assert!((slope - 1.3_f64.cos()).abs() < 1e-15);
    }
}

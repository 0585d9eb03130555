//! Exact phases of periodic terms, and their sine and cosine.

use crate::scalar::Number;

/// How far `time_ns` is into its period, in units of 2⁻³² periods, rounded down; zero if `period_ns` is zero.
///
/// Exact for every time and period, so a phase does not drift however long the movement. Truncation to 2⁻³² turn is
/// 1.5e-9 rad: 2e-5 count at an amplitude of 10 780 counts.
///
/// Long division by two digits of 16 bits, each estimated from the leading bits with the 32-bit division that a
/// processor has, and then corrected (Knuth, The Art of Computer Programming 2, 4.3.1, algorithm D): a 128-bit division
/// would cost the board many times as much.
pub fn phase(time_ns: u64, period_ns: u64) -> u32 {
    /// Bits of the divisor once it is shifted: a remainder less twice the divisor still fits a signed 64-bit number.
    const DIVISOR_BITS: u32 = 62;
    if period_ns == 0 {
        return 0;
    }
    // Mostly already inside the period, and the division is slow on a 32-bit processor.
    let mut remainder = if time_ns < period_ns { time_ns } else { time_ns % period_ns };
    let Some(shift) = period_ns.leading_zeros().checked_sub(u64::BITS - DIVISOR_BITS) else {
        return binary_phase(remainder, period_ns);
    };
    let divisor = period_ns << shift;
    remainder <<= shift;
    // Of 16 bits, the highest of them set.
    let leading = (divisor >> (DIVISOR_BITS - 16)) as u32;
    let mut fraction = 0_u32;
    for _ in 0..2 {
        // At most two too large.
        let mut digit = (remainder >> (DIVISOR_BITS - 32)) as u32 / leading;
        remainder = (remainder << 16).wrapping_sub(divisor.wrapping_mul(u64::from(digit)));
        for _ in 0..2 {
            if remainder.cast_signed() < 0 {
                remainder = remainder.wrapping_add(divisor);
                digit = digit.wrapping_sub(1);
            }
        }
        fraction = fraction << 16 | digit;
    }
    fraction
}

/// The same bit by bit, for periods of more than 146 years, whose remainders leave no bits to spare.
fn binary_phase(mut remainder: u64, period_ns: u64) -> u32 {
    let mut fraction = 0_u32;
    for _ in 0..32 {
        // Doubling the remainder directly could overflow.
        let missing = period_ns - remainder;
        fraction <<= 1;
        if remainder >= missing {
            remainder -= missing;
            fraction |= 1;
        } else {
            remainder += remainder;
        }
    }
    fraction
}

/// Sine and cosine of `phase` · 2⁻³² turns, within 1.5e-7 in `f32` and 5e-16 in `f64`.
///
/// The angle is reduced to ±π/4 on the integer, where that is exact whatever the phase.
pub fn sin_cos_of_phase<S: Number>(phase: u32) -> (S, S) {
    const RAD_PER_UNIT: f64 = core::f64::consts::TAU / 4_294_967_296.0;

    let quadrant = phase.wrapping_add(1 << 29) >> 30;
    let remainder = phase.wrapping_sub(quadrant << 30).cast_signed();
    let angle = S::from_f64(f64::from(remainder)) * S::from_f64(RAD_PER_UNIT);
    let (sine, cosine) = angle.sin_cos_within_eighth();
    match quadrant {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// `fraction` · 2⁻³² as a number, 0 ≤ u < 1 (1 by rounding in `f32`).
pub(super) fn unit<S: Number>(fraction: u32) -> S {
    S::from_f64(f64::from(fraction)) * S::from_f64(1.0 / 4_294_967_296.0)
}

/// A duration in s. In halves of 32 bits, because from those the board's `f32` hardware converts directly.
pub(super) fn seconds<S: Number>(duration_ns: u64) -> S {
    let high = S::from_f64(f64::from((duration_ns >> 32) as u32)) * S::from_f64(4_294_967_296.0e-9);
    high + S::from_f64(f64::from(duration_ns as u32)) * S::from_f64(1.0e-9)
}

/// The minimum-jerk step 10u³ − 15u⁴ + 6u⁵ from 0 to 1 and its first two derivatives by u, all zero or one at both
/// ends (Flash & Hogan 1985). Its derivatives are at most [`STEP_PEAKS`].
pub(super) fn smooth_step<S: Number>(u: S) -> [S; 3] {
    let number = S::from_f64;
    let rest = S::one() - u;
    // Near u = 1 the terms are large and nearly cancel, so that half is taken from the other by symmetry.
    let near = u.minimum(rest);
    let step = near * near * near * (number(10.0) + near * (number(6.0) * near - number(15.0)));
    let product = u * rest;
    [
        S::select(u.less(rest), step, S::one() - step),
        number(30.0) * product * product,
        number(60.0) * product * (rest - u),
    ]
}

/// The greatest absolute value of [`smooth_step`] and its derivatives up to the fourth: 1, 15/8, 10/√3, 60, 360.
pub(super) const STEP_PEAKS: [f32; 5] = [1.0, 1.875, 5.773_503, 60.0, 360.0];

//! The number trait the plant and the controllers are written over.
//!
//! One source serves `f32` on the board and `f64` on the host. The trait is shaped so that SIMD lanes and dual
//! numbers fit later: a comparison gives a [`Mask`], and where lanes could differ the code computes both sides and
//! [`Scalar::select`]s, instead of branching.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// The outcome of comparing two [`Scalar`]s: `bool` for plain numbers, one bit a lane for SIMD.
pub trait Mask: Copy + Debug {
    /// True where both are true.
    fn and(self, other: Self) -> Self;
    /// True where either is true.
    fn or(self, other: Self) -> Self;
    /// True where `self` is false.
    fn not(self) -> Self;
}

impl Mask for bool {
    fn and(self, other: Self) -> Self {
        self && other
    }
    fn or(self, other: Self) -> Self {
        self || other
    }
    fn not(self) -> Self {
        !self
    }
}

/// A real number, or several side by side.
///
/// Operations are those of IEEE 754 in the type's own precision; no operation panics, and results are the same to the
/// bit on every machine.
pub trait Scalar:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// What a comparison gives.
    type Mask: Mask;

    /// The nearest representable number, the same in every lane.
    fn from_f64(value: f64) -> Self;
    /// The nearest integer of a number below 2²² in magnitude.
    fn round_small(self) -> Self;
    /// π/2 in three parts, of which the first two times an integer below 2¹⁰ are exact.
    const HALF_PI: [f64; 3];
    /// Square root; NaN below zero.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The paper's `fix()`: the integer part, truncated toward zero. Its derivative is zero almost everywhere, so
    /// models that are differentiated leave it out.
    fn fix(self) -> Self;
    /// Where `self < other`.
    fn less(self, other: Self) -> Self::Mask;
    /// `if_true` where the mask is true, else `if_false`.
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self;

    /// Sine and cosine of an angle in radians, up to a thousand turns; within 1.5e-7 in `f32` and 5e-16 in `f64`.
    ///
    /// Without a branch, so that lanes need none, and in the type's own precision: `libm`'s `sincosf` computes in
    /// `f64`, which the board has to emulate. The angle is reduced to ±π/4 by Cody and Waite's method.
    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        let number = Self::from_f64;
        let quarters = (self * number(core::f64::consts::FRAC_2_PI)).round_small();
        let [high, middle, low] = Self::HALF_PI;
        let angle = self - quarters * number(high) - quarters * number(middle) - quarters * number(low);
        let (sine, cosine) = angle.sin_cos_within_eighth();
        // The quadrant 0..=3 and its two bits, each by rounding: what is rounded is never halfway.
        let quadrant = quarters - number(4.0) * (quarters * number(0.25) - number(0.375)).round_small();
        let half_turn = (quadrant * number(0.5) - number(0.25)).round_small();
        let odd = quadrant - half_turn - half_turn;
        let swap = number(0.5).less(odd);
        let sign = Self::one() - half_turn - half_turn;
        let sign_of_cosine = sign * (Self::one() - odd - odd);
        (sign * Self::select(swap, cosine, sine), sign_of_cosine * Self::select(swap, sine, cosine))
    }

    /// Sine and cosine of an angle within ±π/4: Taylor polynomials, cut where the next term is below 3e-18.
    #[inline]
    fn sin_cos_within_eighth(self) -> (Self, Self) {
        /// −1/3!, 1/5!, … of the sine's series, highest power first.
        const SINE: [f64; 8] = [
            1.0 / 355_687_428_096_000.0,
            -1.0 / 1_307_674_368_000.0,
            1.0 / 6_227_020_800.0,
            -1.0 / 39_916_800.0,
            1.0 / 362_880.0,
            -1.0 / 5_040.0,
            1.0 / 120.0,
            -1.0 / 6.0,
        ];
        /// −1/2!, 1/4!, … of the cosine's series, highest power first.
        const COSINE: [f64; 8] = [
            1.0 / 20_922_789_888_000.0,
            -1.0 / 87_178_291_200.0,
            1.0 / 479_001_600.0,
            -1.0 / 3_628_800.0,
            1.0 / 40_320.0,
            -1.0 / 720.0,
            1.0 / 24.0,
            -1.0 / 2.0,
        ];
        let square = self * self;
        let series = |coefficients: [f64; 8]| {
            let mut sum = Self::from_f64(coefficients[0]);
            for coefficient in &coefficients[1..] {
                sum = sum * square + Self::from_f64(*coefficient);
            }
            sum * square
        };
        (self + self * series(SINE), Self::one() + series(COSINE))
    }

    /// Zero.
    fn zero() -> Self {
        Self::from_f64(0.0)
    }
    /// One.
    fn one() -> Self {
        Self::from_f64(1.0)
    }
    /// The lesser of two numbers; NaN where `self` is NaN.
    fn minimum(self, other: Self) -> Self {
        Self::select(other.less(self), other, self)
    }
    /// The greater of two numbers; NaN where `self` is NaN.
    fn maximum(self, other: Self) -> Self {
        Self::select(self.less(other), other, self)
    }
    /// The nearest number in `-bound ..= bound`; `bound` must not be negative. NaN stays NaN, so that a command gone
    /// wrong is noticed instead of becoming a full one.
    fn clamp_abs(self, bound: Self) -> Self {
        self.maximum(-bound).minimum(bound)
    }
    /// `magnitude` with the sign of `self`; `-magnitude` only where `self < 0`.
    fn signed(self, magnitude: Self) -> Self {
        Self::select(self.less(Self::zero()), -magnitude, magnitude)
    }
}

macro_rules! plain_number {
    ($number:ty, $sqrt:path, $trunc:path, $round_by:expr, $half_pi:expr) => {
        impl Scalar for $number {
            type Mask = bool;
            const HALF_PI: [f64; 3] = $half_pi;

            #[inline]
            fn from_f64(value: f64) -> Self {
                value as $number
            }
            // Adding and subtracting 1.5 times the power of two whose last bit is one leaves the nearest integer.
            #[inline]
            fn round_small(self) -> Self {
                (self + $round_by) - $round_by
            }
            #[inline]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }
            #[inline]
            fn abs(self) -> Self {
                <$number>::abs(self)
            }
            #[inline]
            fn fix(self) -> Self {
                $trunc(self)
            }
            #[inline]
            fn less(self, other: Self) -> bool {
                self < other
            }
            #[inline]
            fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
                if mask { if_true } else { if_false }
            }
        }
    };
}

plain_number!(
    f32,
    libm::sqrtf,
    libm::truncf,
    12_582_912.0,
    [1.570_312_5, 4.837_512_969_970_703e-4, 7.549_789_954_891_882e-8]
);
plain_number!(
    f64,
    libm::sqrt,
    libm::trunc,
    6_755_399_441_055_744.0,
    [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21]
);

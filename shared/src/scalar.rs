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
    /// Whether it is true in any lane.
    fn any(self) -> bool;
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
    fn any(self) -> bool {
        self
    }
}

/// A real number, or several side by side.
///
/// Operations are those of IEEE 754 in the type's own precision, but for [`Scalar::mul_add`]; no operation panics, and
/// results are the same to the bit on every machine.
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

    /// The representable number nearest to `value`, in every lane. A method, because lanes can be made from others
    /// only: those prove that the machine has the instructions.
    fn constant(self, value: f64) -> Self;
    /// `self · factor + addend`, rounded once where that is one instruction, else twice.
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        self * factor + addend
    }
    /// The nearest integer of a number below 2²² in magnitude.
    fn round_small(self) -> Self;
    /// π/2 in three parts, of which the first two times an integer below 2¹⁰ are exact.
    const HALF_PI: [f64; 3];
    /// Coefficients of (sin x − x)/x³ in x² for |x| ≤ π/4, lowest power first: minimax to the type's precision.
    const SINE: &'static [f64];
    /// Coefficients of (cos x − 1 + x²/2)/x⁴ in x² for |x| ≤ π/4, lowest power first: minimax to the type's precision.
    const COSINE: &'static [f64];
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

    /// Sine and cosine of an angle in radians, up to a thousand turns; within 1e-6 in `f32` and 2e-15 in `f64`.
    ///
    /// Without a branch or a selection, and in the type's own precision: `libm`'s `sincosf` computes in `f64`, which
    /// the board has to emulate, and `micromath` errs by 1e-3, more than a reference may. A quarter of the angle is reduced to ±π/4 by Cody and Waite's method; doubling twice
    /// brings back the whole one, and makes full turns of the quarter turns that were taken off.
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos_in_place(self)
    }

    /// Sine and cosine of an angle within ±π/4.
    #[inline(always)]
    fn sin_cos_within_eighth(self) -> (Self, Self) {
        let square = self * self;
        let sine = (square * self).mul_add(square.series(Self::SINE), self);
        let parabola = square.mul_add(self.constant(-0.5), self.constant(1.0));
        (sine, (square * square).mul_add(square.series(Self::COSINE), parabola))
    }

    /// The polynomial of `self` with these coefficients, lowest power first. A loop, not an iterator with closures: on
    /// lanes those may be compiled apart, without the vector instructions of the code around them.
    #[inline(always)]
    fn series(self, coefficients: &[f64]) -> Self {
        let [rest @ .., highest] = coefficients else { return self.constant(0.0) };
        let mut left = rest;
        let mut sum = self.constant(*highest);
        while let [lower @ .., coefficient] = left {
            sum = sum.mul_add(self, self.constant(*coefficient));
            left = lower;
        }
        sum
    }

    /// The lesser of two numbers; NaN where `self` is NaN.
    #[inline(always)]
    fn minimum(self, other: Self) -> Self {
        Self::select(other.less(self), other, self)
    }
    /// The greater of two numbers; NaN where `self` is NaN.
    #[inline(always)]
    fn maximum(self, other: Self) -> Self {
        Self::select(self.less(other), other, self)
    }
    /// The nearest number in `-bound ..= bound`; `bound` must not be negative. NaN stays NaN, so that a command gone
    /// wrong is noticed instead of becoming a full one.
    #[inline(always)]
    fn clamp_abs(self, bound: Self) -> Self {
        self.maximum(-bound).minimum(bound)
    }
    /// Whether all lanes are zero, or not a number; with derivatives, those too.
    #[inline(always)]
    fn is_zero(self) -> bool {
        let zero = self.constant(0.0);
        !self.less(zero).or(zero.less(self)).any()
    }
    /// `magnitude` with the sign of `self`; `-magnitude` only where `self < 0`.
    #[inline(always)]
    fn signed(self, magnitude: Self) -> Self {
        Self::select(self.less(self.constant(0.0)), -magnitude, magnitude)
    }
}

/// [`Scalar::sin_cos`], where it is called.
#[inline(always)]
fn sin_cos_in_place<S: Scalar>(angle: S) -> (S, S) {
    let quarter = angle * angle.constant(0.25);
    let turns = (quarter * angle.constant(core::f64::consts::FRAC_2_PI)).round_small();
    let [high, middle, low] = S::HALF_PI;
    let [high, middle, low] = [angle.constant(-high), angle.constant(-middle), angle.constant(-low)];
    let (mut sine, mut cosine) =
        turns.mul_add(low, turns.mul_add(middle, turns.mul_add(high, quarter))).sin_cos_within_eighth();
    for _ in 0..2 {
        let double = sine + sine;
        (sine, cosine) = (double * cosine, (-double).mul_add(sine, angle.constant(1.0)));
    }
    (sine, cosine)
}

/// A [`Scalar`] that can be made from a value alone: any but lanes.
pub trait Number: Scalar {
    /// The nearest representable number.
    fn from_f64(value: f64) -> Self;
    /// Zero.
    fn zero() -> Self {
        Self::from_f64(0.0)
    }
    /// One.
    fn one() -> Self {
        Self::from_f64(1.0)
    }
}

macro_rules! plain_number {
    ($number:ty, $sqrt:path, $trunc:path, $round_by:expr, $half_pi:expr, $sine:expr, $cosine:expr $(, $own:item)*) => {
        impl Number for $number {
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as $number
            }
        }

        impl Scalar for $number {
            type Mask = bool;
            const HALF_PI: [f64; 3] = $half_pi;
            const SINE: &'static [f64] = &$sine;
            const COSINE: &'static [f64] = &$cosine;
            $($own)*

            #[inline(always)]
            fn constant(self, value: f64) -> Self {
                value as $number
            }
            // Adding and subtracting 1.5 times the power of two whose last bit is one leaves the nearest integer.
            #[inline(always)]
            fn round_small(self) -> Self {
                (self + $round_by) - $round_by
            }
            #[inline]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$number>::abs(self)
            }
            #[inline]
            fn fix(self) -> Self {
                $trunc(self)
            }
            #[inline(always)]
            fn less(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
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
    [1.570_312_5, 4.837_512_969_970_703e-4, 7.549_789_954_891_882e-8],
    [-0.166_666_549_401_994_9, 0.008_332_177_916_358_392, -0.000_195_172_668_409_034_14],
    [0.041_666_646_860_525_5, -0.001_388_736_721_294_005_2, 0.000_024_438_415_537_795_277],
    // The board asks for a dozen of them in a tick, and has room for one copy.
    #[inline(never)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos_in_place(self)
    }
);
plain_number!(
    f64,
    libm::sqrt,
    libm::trunc,
    6_755_399_441_055_744.0,
    [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21],
    [
        -0.166_666_666_666_666_32,
        0.008_333_333_333_322_419,
        -0.000_198_412_698_298_123_94,
        2.755_731_369_357_710_4e-6,
        -2.505_075_838_497_588_8e-8,
        1.589_681_182_907_706_7e-10,
    ],
    [
        0.041_666_666_666_602_23,
        -0.001_388_888_887_827_015_3,
        0.000_024_801_580_969_800_72,
        -2.755_556_678_578_943_8e-7,
        2.064_771_533_448_216_7e-9,
    ]
);

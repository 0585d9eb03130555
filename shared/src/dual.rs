//! Dual numbers: a value with its derivative, so that what runs on them gives exact sensitivities.
//!
//! Each operation follows the rule of its derivative; a choice takes the derivative of what it chose. Where a function
//! has a corner (friction at a reversal, a limit, [`Scalar::fix`]) that is the derivative on the side taken, and the
//! jump itself has none.

use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use crate::scalar::{Number, Scalar};

/// A number and its derivative with respect to one variable; on lanes, another variable in each lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<S> {
    /// The number.
    pub value: S,
    /// Its derivative.
    pub slope: S,
}

impl<S: Scalar> Add for Dual<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl<S: Scalar> Sub for Dual<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl<S: Scalar> Mul for Dual<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let slope = self.value.mul_add(other.slope, self.slope * other.value);
        Self { value: self.value * other.value, slope }
    }
}

impl<S: Scalar> Div for Dual<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, slope: (-value).mul_add(other.slope, self.slope) / other.value }
    }
}

impl<S: Scalar> Neg for Dual<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl<S: Scalar> AddAssign for Dual<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Scalar> SubAssign for Dual<S> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<S: Scalar> Dual<S> {
    /// A number that depends on nothing.
    #[inline(always)]
    pub fn fixed(value: S) -> Self {
        Self { value, slope: value.constant(0.0) }
    }
}

impl<S: Scalar> Scalar for Dual<S> {
    type Mask = S::Mask;
    const HALF_PI: [f64; 3] = S::HALF_PI;
    const SINE: &'static [f64] = S::SINE;
    const COSINE: &'static [f64] = S::COSINE;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::fixed(self.value.constant(value))
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        let slope = self.value.mul_add(factor.slope, self.slope.mul_add(factor.value, addend.slope));
        Self { value: self.value.mul_add(factor.value, addend.value), slope }
    }
    #[inline(always)]
    fn round_small(self) -> Self {
        Self::fixed(self.value.round_small())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, slope: self.slope / (value + value) }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::select(self.value.less(self.value.constant(0.0)), -self, self)
    }
    #[inline(always)]
    fn fix(self) -> Self {
        Self::fixed(self.value.fix())
    }
    #[inline(always)]
    fn less(self, other: Self) -> S::Mask {
        self.value.less(other.value)
    }
    #[inline(always)]
    fn select(mask: S::Mask, if_true: Self, if_false: Self) -> Self {
        Self {
            value: S::select(mask, if_true.value, if_false.value),
            slope: S::select(mask, if_true.slope, if_false.slope),
        }
    }
    #[inline(always)]
    fn is_zero(self) -> bool {
        self.value.is_zero() && self.slope.is_zero()
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = self.value.sin_cos();
        (Self { value: sine, slope: cosine * self.slope }, Self { value: cosine, slope: -(sine * self.slope) })
    }
}

impl<S: Number> Number for Dual<S> {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self::fixed(S::from_f64(value))
    }
}

//! Many numbers side by side in vector registers, as one of the plant's number types.
//!
//! The instructions are chosen when the program runs (AVX-512, AVX2, SSE2, NEON or plain code), by `on_vectors!`; every
//! lane gets the same result whatever its neighbours hold.

use fearless_simd::{Select, Simd, SimdFloat, SimdMask};
use shared::scalar::{Mask, Number, Scalar};
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Does `$work` with `$machine` standing for the widest vector instructions that this program was built for and finds.
///
/// Like [`fearless_simd::dispatch`], without a copy of the code for SSE4.2, which gains nothing on SSE2: a simulation is
/// large, and every copy of it makes the program longer to build. The unit tests get the narrowest copy alone; what
/// the wide ones compute is tested from outside the library.
macro_rules! on_vectors {
    ($machine:ident => $work:expr) => {{
        let level = fearless_simd::Level::new();
        #[cfg(target_arch = "x86_64")]
        {
            use fearless_simd::Simd;
            #[cfg(not(test))]
            let wide = if let Some($machine) = level.as_avx512() {
                Some($machine.vectorize(
                    #[inline(always)]
                    || $work,
                ))
            } else if let Some($machine) = level.as_avx2() {
                Some($machine.vectorize(
                    #[inline(always)]
                    || $work,
                ))
            } else {
                None
            };
            #[cfg(test)]
            let wide = None;
            match (wide, level.as_sse2()) {
                (Some(result), _) => result,
                (None, Some($machine)) => $machine.vectorize(
                    #[inline(always)]
                    || $work,
                ),
                (None, None) => unreachable!("every x86-64 has SSE2"),
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        fearless_simd::dispatch!(level, $machine => $work)
    }};
}
pub(crate) use on_vectors;

/// `GROUPS` vectors `V` of the machine `S`. More than one group, because an operation has to wait for the one before
/// it: the groups' chains of operations run in each other's gaps.
pub struct Lanes<S: Simd, V: SimdFloat<S>, const GROUPS: usize>([V; GROUPS], PhantomData<S>);

impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> Lanes<S, V, GROUPS> {
    /// Numbers held.
    pub const COUNT: usize = V::LEN * GROUPS;

    /// The number that `value` gives for each lane.
    #[inline(always)]
    pub fn from_fn(machine: S, mut value: impl FnMut(usize) -> f64) -> Self {
        let group = |group: usize| V::from_fn(machine, |lane| V::Element::from_f64(value(group * V::LEN + lane)));
        Self(std::array::from_fn(group), PhantomData)
    }

    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(machine: S, value: f64) -> Self {
        Self([V::splat(machine, V::Element::from_f64(value)); GROUPS], PhantomData)
    }

    /// The number in one lane.
    pub fn get(&self, lane: usize) -> V::Element {
        self.0[lane / V::LEN][lane % V::LEN]
    }
}

/// Does an operation group by group. A plain loop: a closure handed to a function of the core library may be compiled
/// apart from the code around it, without that code's vector instructions.
macro_rules! each_group {
    ($first:expr, $group:ident => $value:expr) => {{
        let mut result = $first;
        let mut $group = 0;
        while $group < GROUPS {
            result[$group] = $value;
            $group += 1;
        }
        result
    }};
}

impl<S: Simd, V: SimdFloat<S>, const GROUPS: usize> Clone for Lanes<S, V, GROUPS> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}
impl<S: Simd, V: SimdFloat<S>, const GROUPS: usize> Copy for Lanes<S, V, GROUPS> {}

impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> fmt::Debug for Lanes<S, V, GROUPS> {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.debug_list().entries((0..Self::COUNT).map(|lane| self.get(lane))).finish()
    }
}

macro_rules! operators {
    ($($operator:ident :: $function:ident),*) => {$(
        impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> $operator for Lanes<S, V, GROUPS> {
            type Output = Self;
            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(each_group!(self.0, group => $operator::$function(self.0[group], other.0[group])), PhantomData)
            }
        }
    )*};
}
operators!(Add::add, Sub::sub, Mul::mul, Div::div);

impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> Neg for Lanes<S, V, GROUPS> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(each_group!(self.0, group => -self.0[group]), PhantomData)
    }
}
impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> AddAssign for Lanes<S, V, GROUPS> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> SubAssign for Lanes<S, V, GROUPS> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

/// One truth a lane.
pub struct LaneMask<S: Simd, M: SimdMask<S>, const GROUPS: usize>([M; GROUPS], PhantomData<S>);

impl<S: Simd, M: SimdMask<S>, const GROUPS: usize> Clone for LaneMask<S, M, GROUPS> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}
impl<S: Simd, M: SimdMask<S>, const GROUPS: usize> Copy for LaneMask<S, M, GROUPS> {}

impl<S: Simd, M: SimdMask<S>, const GROUPS: usize> fmt::Debug for LaneMask<S, M, GROUPS> {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.debug_list().entries(self.0.iter().map(|mask| mask.to_bitmask())).finish()
    }
}

impl<S: Simd, M: SimdMask<S>, const GROUPS: usize> Mask for LaneMask<S, M, GROUPS> {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(each_group!(self.0, group => self.0[group] & other.0[group]), PhantomData)
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        Self(each_group!(self.0, group => self.0[group] | other.0[group]), PhantomData)
    }
    #[inline(always)]
    fn not(self) -> Self {
        Self(each_group!(self.0, group => !self.0[group]), PhantomData)
    }
    #[inline(always)]
    fn any(self) -> bool {
        let mut all = self.0[0];
        let mut group = 1;
        while group < GROUPS {
            all |= self.0[group];
            group += 1;
        }
        all.any_true()
    }
}

impl<S: Simd, V: SimdFloat<S, Element: Number>, const GROUPS: usize> Scalar for Lanes<S, V, GROUPS> {
    type Mask = LaneMask<S, V::Mask, GROUPS>;
    const HALF_PI: [f64; 3] = V::Element::HALF_PI;
    const SINE: &'static [f64] = V::Element::SINE;
    const COSINE: &'static [f64] = V::Element::COSINE;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(self.0[0].token(), value)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(each_group!(self.0, group => self.0[group].mul_add(factor.0[group], addend.0[group])), PhantomData)
    }
    #[inline(always)]
    fn round_small(self) -> Self {
        Self(each_group!(self.0, group => self.0[group].round_ties_even()), PhantomData)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(each_group!(self.0, group => self.0[group].sqrt()), PhantomData)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(each_group!(self.0, group => self.0[group].abs()), PhantomData)
    }
    #[inline(always)]
    fn fix(self) -> Self {
        Self(each_group!(self.0, group => self.0[group].trunc()), PhantomData)
    }
    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        let first = self.0[0].simd_lt(other.0[0]);
        LaneMask(each_group!([first; GROUPS], group => self.0[group].simd_lt(other.0[group])), PhantomData)
    }
    #[inline(always)]
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self {
        Self(each_group!(if_true.0, group => mask.0[group].select(if_true.0[group], if_false.0[group])), PhantomData)
    }
    // One instruction each. Where one of two numbers is not a number x86 gives the second, NEON that one.
    #[inline(always)]
    fn minimum(self, other: Self) -> Self {
        Self(each_group!(self.0, group => other.0[group].min(self.0[group])), PhantomData)
    }
    #[inline(always)]
    fn maximum(self, other: Self) -> Self {
        Self(each_group!(self.0, group => other.0[group].max(self.0[group])), PhantomData)
    }
}

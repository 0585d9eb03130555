//! Two forces that may not leave a range and give way only where they reach its end: Coulomb friction of two coupled
//! joints, and the play between two pairs of gear teeth.

use crate::arm::Inertia;
use crate::scalar::{Mask, Scalar};

/// What two bounded impulses do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounded<S: Scalar> {
    /// The impulses.
    pub impulse: [S; 2],
    /// The velocities they leave, exactly zero where an impulse is inside its range.
    pub velocity: [S; 2],
    /// Where an impulse is inside its range.
    pub inside: [S::Mask; 2],
}

/// The impulses λ within `low ..= high` for which v = `free` + `mobility` λ is zero where λ is inside, negative or zero
/// where it is at its high end and positive or zero at its low end: the minimiser of ½ λᵀWλ + λᵀ`free` over the box.
///
/// Minimising over one variable leaves a convex function of the other, so clamping in turn is exact: λ2 of the
/// unconstrained minimum is clamped, λ3 follows and is clamped, then λ2 follows from that λ3. `mobility` W must be
/// positive definite and `low` must not exceed `high`.
#[inline(always)]
pub(super) fn bounded<S: Scalar>(mobility: &Inertia<S>, free: [S; 2], low: [S; 2], high: [S; 2]) -> Bounded<S> {
    let Inertia { d11, d12, d22 } = *mobility;
    let determinant = d11.mul_add(d22, -(d12 * d12));
    let one = d11.constant(1.0);
    let first = clamp((d12 * free[1] - d22 * free[0]) / determinant, low[0], high[0]);
    let second = clamp(-(d12.mul_add(first, free[1])) * (one / d22), low[1], high[1]);
    let first = clamp(-(d12.mul_add(second, free[0])) * (one / d11), low[0], high[0]);
    let velocity = [
        d11.mul_add(first, d12.mul_add(second, free[0])),
        d12.mul_add(first, d22.mul_add(second, free[1])),
    ];
    let zero = d11.constant(0.0);
    let inside = [low[0].less(first).and(first.less(high[0])), low[1].less(second).and(second.less(high[1]))];
    Bounded {
        impulse: [first, second],
        velocity: [S::select(inside[0], zero, velocity[0]), S::select(inside[1], zero, velocity[1])],
        inside,
    }
}

#[inline(always)]
fn clamp<S: Scalar>(value: S, low: S, high: S) -> S {
    value.maximum(low).minimum(high)
}

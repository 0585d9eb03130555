//! Trajectories: derivatives, exactness of time and of both ends, rounding of `f32` in counts, splines, the approach,
//! and the check against limits.

mod check;
mod common;
mod exact;
mod properties;

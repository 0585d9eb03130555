//! What is a small error of a parameter, and what a large one.

use shared::arm::{PARAMETERS, REFERENCE_F};

use crate::identify::{MOMENTS, Parameter, Values};
use crate::robot::Robot;

/// The magnitude by which an error of `parameter` is judged: its own, but for an f that is small beside its search range, as
/// f3, f5 and f8 of a PUMA are, that of its fellows in the same unit: 1 on the reference robot, as much less on an arm as
/// those are smaller.
pub(super) fn magnitude(robot: &Robot, values: &Values, parameter: Parameter) -> f64 {
    let value = values.get(parameter).abs();
    match parameter {
        Parameter::F(index) => {
            let [low, high] = robot.search[index];
            if value < 0.1 * (high - low) { size_of_fellows(&values.f, index) } else { value }
        }
        _ => value.max(f64::MIN_POSITIVE),
    }
}

/// How large the inertias, or the moments, of `f` are beside the reference robot's, according to which f`index` is.
fn size_of_fellows(f: &[f64; PARAMETERS], index: usize) -> f64 {
    let fellows = (0..PARAMETERS).filter(|other| MOMENTS.contains(other) == MOMENTS.contains(&index));
    let size = |f: &[f64; PARAMETERS]| fellows.clone().map(|other| f[other].powi(2)).sum::<f64>().sqrt();
    (size(f) / size(&REFERENCE_F)).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half the size is an eighth of the mass: inertias become 1/32, moments 1/16 of what they were.
    #[test]
    fn a_small_arm_is_judged_as_the_same_arm_in_large() {
        let share = |index: usize| if MOMENTS.contains(&index) { 1.0 / 16.0 } else { 1.0 / 32.0 };
        let judged = |share: fn(usize) -> f64| -> [f64; PARAMETERS] {
            let mut robot = Robot::paper();
            let mut values = Values::of_robot(&robot);
            values.f = std::array::from_fn(|index| share(index) * REFERENCE_F[index]);
            for (index, range) in robot.search.iter_mut().enumerate() {
                *range = range.map(|end| share(index) * end);
            }
            std::array::from_fn(|index| magnitude(&robot, &values, Parameter::F(index)))
        };
        let (large, small) = (judged(|_| 1.0), judged(share));
        for (index, f) in REFERENCE_F.into_iter().enumerate() {
            let own = if matches!(index, 2 | 4 | 7) { 1.0 } else { f.abs() };
            assert_eq!(large[index], own, "f{}", index + 1);
            assert!((small[index] / (share(index) * own) - 1.0).abs() < 1e-12, "f{}", index + 1);
        }
    }
}

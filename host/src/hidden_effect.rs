//! Effects drawn for a simulated robot: what is to be found.

use shared::effects::catalogue::{Entry, LIBRARY, Parameter, Role, Scope};

use crate::compensation::why_not;
use crate::effects::BOTH_JOINTS;
use crate::model::Effect;
use crate::random::Random;
use crate::robot::Robot;

/// Purpose of the random numbers, as [`Random::new`] wants it.
const PURPOSE: u64 = 4;

/// Smallest and largest size, in sizes that show clearly on the reference robot: large enough to spoil computed torque.
const SIZES: [f64; 2] = [1.5, 3.0];

/// Largest order drawn, per revolution of joint or motor: a whole number, as poles and teeth are.
const MOST_PERIODS: f64 = 8.0;

/// By how much other shapes differ from the usual one at most, as a factor.
const SHAPE_FACTOR: f64 = 1.5;

/// An effect of the library that computed torque can compensate, of a joint, a size and a shape drawn from `seed`.
pub fn draw(robot: &Robot, seed: u64) -> Effect {
    let mut random = Random::new(seed, PURPOSE);
    let able: Vec<&Entry> = LIBRARY.iter().filter(|entry| why_not(entry.name).is_none()).collect();
    let pick = |random: &mut Random, count: usize| ((random.unit() * count as f64) as usize).min(count - 1);
    let entry = able[pick(&mut random, able.len())];
    let joint = match entry.scope {
        Scope::Arm => BOTH_JOINTS.into(),
        Scope::Joint => robot.joints[pick(&mut random, robot.joints.len())].name.clone(),
    };
    let parameters =
        entry.parameters.iter().map(|parameter| (parameter.name.into(), value(parameter, &mut random))).collect();
    Effect { name: entry.name.into(), joint, parameters, standard_error: Default::default() }
}

fn value(parameter: &Parameter, random: &mut Random) -> f64 {
    let [low, high] = parameter.range;
    let drawn = match parameter.role {
        Role::Size => parameter.typical * random.between(SIZES[0], SIZES[1]),
        Role::Shape if parameter.unit == "rad" => random.between(-std::f64::consts::PI, std::f64::consts::PI),
        Role::Shape if parameter.name == "order" => 1.0 + (random.unit() * MOST_PERIODS).floor(),
        Role::Shape => parameter.typical * random.between(1.0 / SHAPE_FACTOR, SHAPE_FACTOR),
    };
    drawn.clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn what_is_drawn_can_be_and_every_effect_comes() {
        let robot = Robot::paper();
        let mut names = BTreeSet::new();
        for seed in 0..200 {
            let effect = draw(&robot, seed);
            crate::effects::from_entries(std::slice::from_ref(&effect), &robot).unwrap();
            names.insert(effect.name);
        }
        let able = LIBRARY.iter().filter(|entry| why_not(entry.name).is_none()).count();
        assert_eq!(names.len(), able, "{names:?}");
        assert_eq!(draw(&robot, 7), draw(&robot, 7));
    }
}

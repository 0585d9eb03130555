//! Coulomb friction: which joints stick, which slide, and the accelerations that follow.
//!
//! A joint that moves slides against its friction. A joint at rest either sticks or starts to slide up or down; the
//! right choice is the one whose consequences agree with it. A stuck joint must need no more than the Coulomb
//! torque to stay, a sliding one must accelerate the way it slides. The mass matrix is positive definite, so
//! exactly one combination for the two joints agrees (two coincide on the border between them).

use super::dynamics::EquationsOfMotion;

/// What Coulomb friction does in one joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The joint does not move; friction supplies whatever torque that takes.
    Stuck,
    /// The joint moves or starts to move toward larger angles, friction pushes back.
    Up,
    /// The joint moves or starts to move toward smaller angles, friction pushes back.
    Down,
}

impl Mode {
    /// The direction of motion: -1, 0 or 1.
    #[must_use]
    pub fn direction(self) -> f64 {
        match self {
            Self::Stuck => 0.0,
            Self::Up => 1.0,
            Self::Down => -1.0,
        }
    }
}

/// Solves the equations of motion for the accelerations in rad/s².
///
/// `net_torque_nm` is the joint torque less viscous friction; Coulomb friction is taken from `modes` and
/// `coulomb_nm`, both at the joints.
#[must_use]
pub fn accelerations(
    equations: &EquationsOfMotion,
    net_torque_nm: [f64; 2],
    coulomb_nm: [f64; 2],
    modes: [Mode; 2],
) -> [f64; 2] {
    let mass = &equations.mass_kg_m2;
    let push: [f64; 2] = std::array::from_fn(|joint| {
        net_torque_nm[joint] - equations.bias_nm[joint] - modes[joint].direction() * coulomb_nm[joint]
    });
    match modes.map(|mode| mode == Mode::Stuck) {
        [true, true] => [0.0, 0.0],
        [true, false] => [0.0, push[1] / mass[1][1]],
        [false, true] => [push[0] / mass[0][0], 0.0],
        [false, false] => {
            let determinant = mass[0][0] * mass[1][1] - mass[0][1] * mass[1][0];
            [
                (mass[1][1] * push[0] - mass[0][1] * push[1]) / determinant,
                (mass[0][0] * push[1] - mass[1][0] * push[0]) / determinant,
            ]
        }
    }
}

/// By how many N m the consequences of `modes` contradict a joint at rest; zero or less when they agree.
fn contradiction_nm(
    equations: &EquationsOfMotion,
    net_torque_nm: [f64; 2],
    coulomb_nm: [f64; 2],
    modes: [Mode; 2],
    joint: usize,
) -> f64 {
    let acceleration = accelerations(equations, net_torque_nm, coulomb_nm, modes);
    let mass = &equations.mass_kg_m2;
    if modes[joint] == Mode::Stuck {
        let holding = net_torque_nm[joint]
            - equations.bias_nm[joint]
            - mass[joint][0] * acceleration[0]
            - mass[joint][1] * acceleration[1];
        holding.abs() - coulomb_nm[joint]
    } else {
        -modes[joint].direction() * acceleration[joint] * mass[joint][joint]
    }
}

/// The friction modes of both joints at this instant.
///
/// A velocity of exactly zero means "at rest"; [`Plant`](super::plant::Plant) sets it when a joint reverses. A joint
/// without Coulomb friction never sticks.
#[must_use]
pub fn modes(
    equations: &EquationsOfMotion,
    net_torque_nm: [f64; 2],
    coulomb_nm: [f64; 2],
    velocity_rad_s: [f64; 2],
) -> [Mode; 2] {
    // At rest all three are tried, "sticks" first, so that it wins on the border.
    const AT_REST: &[Mode] = &[Mode::Stuck, Mode::Up, Mode::Down];
    let at_rest: [bool; 2] = std::array::from_fn(|joint| velocity_rad_s[joint] == 0.0 && coulomb_nm[joint] > 0.0);
    let choices: [&[Mode]; 2] = std::array::from_fn(|joint| {
        if at_rest[joint] {
            AT_REST
        } else if velocity_rad_s[joint] < 0.0 {
            &[Mode::Down]
        } else {
            &[Mode::Up]
        }
    });

    let mut best = [choices[0][0], choices[1][0]];
    let mut least_contradiction = f64::INFINITY;
    for &upper in choices[0] {
        for &fore in choices[1] {
            let candidate = [upper, fore];
            let contradiction = (0..2)
                .filter(|&joint| at_rest[joint])
                .map(|joint| contradiction_nm(equations, net_torque_nm, coulomb_nm, candidate, joint))
                .fold(f64::NEG_INFINITY, f64::max);
            if contradiction <= 0.0 {
                return candidate;
            }
            // Only rounding can leave every combination contradicted, and then by next to nothing.
            if contradiction < least_contradiction {
                (best, least_contradiction) = (candidate, contradiction);
            }
        }
    }
    best
}

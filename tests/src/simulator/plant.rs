//! The arm with its friction, moved through time under given torques.
//!
//! Fourth-order Runge–Kutta with short fixed steps. Inside a step every joint keeps its friction mode, so the
//! equations are smooth; where a sliding joint reverses, the step is cut at that instant (found by bisection), the
//! joint's speed becomes exactly zero and the modes are chosen anew. A stuck joint is asked at the beginning of
//! every step whether it still sticks.

use super::dynamics::Arm;
use super::friction::{Mode, accelerations, modes};
use super::robot::Robot;

/// Halvings of the step when a reversal is located: 20 µs shrink to less than 1e-16 s.
const BISECTIONS: usize = 38;

/// Reversals handled one by one within a step. More than two joints reversing twice does not happen; the limit
/// only guards against an endless loop.
const REVERSALS_PER_STEP: usize = 8;

/// Where the arm is and how fast it moves, at the joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Joint angles in radians, joint "2" first.
    pub angle_rad: [f64; 2],
    /// Joint speeds in rad/s; exactly zero while a joint sticks.
    pub velocity_rad_s: [f64; 2],
}

impl State {
    /// At rest at the given joint angles.
    #[must_use]
    pub fn at_rest(angle_rad: [f64; 2]) -> Self {
        Self { angle_rad, velocity_rad_s: [0.0; 2] }
    }

    /// This state after `time_s` of a constant slope.
    fn along(&self, slope: &Slope, time_s: f64) -> Self {
        Self {
            angle_rad: std::array::from_fn(|joint| self.angle_rad[joint] + time_s * slope.velocity[joint]),
            velocity_rad_s: std::array::from_fn(|joint| {
                self.velocity_rad_s[joint] + time_s * slope.acceleration[joint]
            }),
        }
    }
}

/// The mechanical part of a robot, all quantities at the joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// The moving parts.
    pub arm: Arm,
    /// Gravity in m/s².
    pub gravity_m_s2: f64,
    /// Viscous friction at the joints in N m s/rad.
    pub viscous_nm_s: [f64; 2],
    /// Coulomb friction at the joints in N m.
    pub coulomb_nm: [f64; 2],
}

impl Plant {
    /// The mechanics of `robot`; motor-side friction is carried through the gears.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        Self {
            arm: robot.arm,
            gravity_m_s2: robot.gravity_m_s2,
            viscous_nm_s: robot.drives.map(|drive| drive.viscous_friction_nm_s_per_rad * drive.gear_ratio.powi(2)),
            coulomb_nm: robot.drives.map(|drive| drive.coulomb_friction_nm * drive.gear_ratio.abs()),
        }
    }

    /// Moves the arm for `duration_s` under constant joint torques, in equal steps no longer than `max_step_s`.
    pub fn advance(&self, state: &mut State, joint_torque_nm: [f64; 2], duration_s: f64, max_step_s: f64) {
        // A duration that is a whole number of steps up to rounding must not get one more.
        let steps = (duration_s / max_step_s - 1e-6).ceil().max(1.0);
        let step_s = duration_s / steps;
        for _ in 0..steps as u64 {
            self.step(state, joint_torque_nm, step_s);
        }
    }

    /// Friction modes at this instant under these joint torques.
    #[must_use]
    pub fn modes(&self, state: &State, joint_torque_nm: [f64; 2]) -> [Mode; 2] {
        let moves = |joint: usize| state.velocity_rad_s[joint] != 0.0;
        if moves(0) && moves(1) {
            return state.velocity_rad_s.map(|velocity| if velocity > 0.0 { Mode::Up } else { Mode::Down });
        }
        let equations = self.arm.equations(state.angle_rad, state.velocity_rad_s, self.gravity_m_s2);
        modes(&equations, self.less_viscous(joint_torque_nm, state), self.coulomb_nm, state.velocity_rad_s)
    }

    fn less_viscous(&self, joint_torque_nm: [f64; 2], state: &State) -> [f64; 2] {
        std::array::from_fn(|joint| joint_torque_nm[joint] - self.viscous_nm_s[joint] * state.velocity_rad_s[joint])
    }

    fn step(&self, state: &mut State, joint_torque_nm: [f64; 2], step_s: f64) {
        let mut remaining_s = step_s;
        for _ in 0..REVERSALS_PER_STEP {
            let modes = self.modes(state, joint_torque_nm);
            let whole = self.runge_kutta(state, joint_torque_nm, modes, remaining_s);
            if self.reversed(&whole, modes) == [false; 2] {
                *state = whole;
                return;
            }
            let (mut before_s, mut after_s, mut after) = (0.0, remaining_s, whole);
            for _ in 0..BISECTIONS {
                let middle_s = 0.5 * (before_s + after_s);
                let middle = self.runge_kutta(state, joint_torque_nm, modes, middle_s);
                if self.reversed(&middle, modes) == [false; 2] {
                    before_s = middle_s;
                } else {
                    (after_s, after) = (middle_s, middle);
                }
            }
            self.stop_reversed(&mut after, modes);
            *state = after;
            remaining_s -= after_s;
            if remaining_s <= 0.0 {
                return;
            }
        }
        let modes = self.modes(state, joint_torque_nm);
        let mut end = self.runge_kutta(state, joint_torque_nm, modes, remaining_s);
        self.stop_reversed(&mut end, modes);
        *state = end;
    }

    /// Which joints move against their mode. Without Coulomb friction a reversal changes nothing and is none.
    fn reversed(&self, state: &State, modes: [Mode; 2]) -> [bool; 2] {
        std::array::from_fn(|joint| {
            self.coulomb_nm[joint] > 0.0 && state.velocity_rad_s[joint] * modes[joint].direction() < 0.0
        })
    }

    fn stop_reversed(&self, state: &mut State, modes: [Mode; 2]) {
        let reversed = self.reversed(state, modes);
        for (velocity, _) in state.velocity_rad_s.iter_mut().zip(reversed).filter(|(_, reversed)| *reversed) {
            *velocity = 0.0;
        }
    }

    fn slope(&self, state: &State, joint_torque_nm: [f64; 2], modes: [Mode; 2]) -> Slope {
        let equations = self.arm.equations(state.angle_rad, state.velocity_rad_s, self.gravity_m_s2);
        let net_torque_nm = self.less_viscous(joint_torque_nm, state);
        Slope {
            velocity: state.velocity_rad_s,
            acceleration: accelerations(&equations, net_torque_nm, self.coulomb_nm, modes),
        }
    }

    fn runge_kutta(&self, start: &State, joint_torque_nm: [f64; 2], modes: [Mode; 2], step_s: f64) -> State {
        let slope = |state: &State| self.slope(state, joint_torque_nm, modes);
        let first = slope(start);
        let second = slope(&start.along(&first, 0.5 * step_s));
        let third = slope(&start.along(&second, 0.5 * step_s));
        let fourth = slope(&start.along(&third, step_s));
        let mean = |part: fn(&Slope) -> [f64; 2]| -> [f64; 2] {
            let [first, second, third, fourth] = [&first, &second, &third, &fourth].map(part);
            std::array::from_fn(|joint| (first[joint] + 2.0 * (second[joint] + third[joint]) + fourth[joint]) / 6.0)
        };
        start.along(
            &Slope { velocity: mean(|slope| slope.velocity), acceleration: mean(|slope| slope.acceleration) },
            step_s,
        )
    }
}

/// How a state changes per second.
struct Slope {
    velocity: [f64; 2],
    acceleration: [f64; 2],
}

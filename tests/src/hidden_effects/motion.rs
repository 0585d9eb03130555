//! The machine moved through time.
//!
//! Fourth-order Runge–Kutta with short fixed steps. Each motor keeps its friction mode (sticks, slides up, slides
//! down) inside a step; where a sliding motor reverses the step is cut there by the rule of the secant, its speed
//! becomes exactly zero and the modes are chosen anew by consistency.

use crate::simulator::EquationsOfMotion;
use crate::simulator::friction::{Mode, accelerations, modes as consistent_modes};

use super::machine::{Machine, Sliding, Transmission};
use super::outside::{Outside, STATES};

const ANGLE: usize = 0;
const SPEED: usize = 2;
const MOTOR_ANGLE: usize = 4;
const MOTOR_SPEED: usize = 6;
const CURRENT: usize = 8;
const OUTSIDE: usize = 10;
const LENGTH: usize = OUTSIDE + STATES;

/// Reversals handled one by one within a step.
const REVERSALS_PER_STEP: usize = 8;

/// Current of a limited rate follows otherwise with this lag in s: too short to be seen as the library's own lag, long enough
/// for the integration step.
const SLEW_LAG_S: f64 = 15e-6;

/// Everything that moves. Motor angles and speeds are those at the joint (divided by the gear ratio) and used for
/// elastic joints only.
type Values = [f64; LENGTH];

/// What drives the machine between two instants.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drive {
    /// Commands in A.
    pub command_a: [f64; 2],
    /// Disturbing motor torques in N m.
    pub disturbance_nm: [f64; 2],
}

/// A machine in motion.
#[derive(Clone, Debug)]
pub struct Motion<'a> {
    machine: &'a Machine,
    values: Values,
    /// Torque through each gear at the end of the last step, at the motor.
    load_nm: [f64; 2],
    /// Seconds since the record's start.
    pub time_s: f64,
    step_s: f64,
}

/// Forces at one instant, all but Coulomb friction.
struct Forces {
    equations: EquationsOfMotion,
    /// On the links: from the motors where the joint is rigid, from the spring where it is elastic.
    link_net_nm: [f64; 2],
    link_coulomb_nm: [f64; 2],
    motor_net_nm: [f64; 2],
    motor_coulomb_nm: [f64; 2],
    current_a: [f64; 2],
    current_slope_a_per_s: [f64; 2],
    /// Torque of a swinging tool on the forearm.
    tool_torque_nm: f64,
}

impl<'a> Motion<'a> {
    /// At rest at joint angles `angle_rad`, `time_s` from the record's start, moved in steps of at most `step_s`.
    #[must_use]
    pub fn at_rest(machine: &'a Machine, angle_rad: [f64; 2], time_s: f64, step_s: f64) -> Self {
        let mut values = [0.0; LENGTH];
        for first in [ANGLE, MOTOR_ANGLE] {
            values[first..first + 2].copy_from_slice(&angle_rad);
        }
        Self { machine, values, load_nm: [0.0; 2], time_s, step_s }
    }

    /// The same, from here on in steps of at most `step_s`.
    #[must_use]
    pub fn with_step(mut self, step_s: f64) -> Self {
        self.step_s = step_s;
        self
    }

    /// Angles of the links in rad.
    #[must_use]
    pub fn angle_rad(&self) -> [f64; 2] {
        [self.values[ANGLE], self.values[ANGLE + 1]]
    }

    /// Speeds of the links in rad/s.
    #[must_use]
    pub fn velocity_rad_s(&self) -> [f64; 2] {
        [self.values[SPEED], self.values[SPEED + 1]]
    }

    /// Sets the links' speeds, and those of the motors with them.
    pub fn set_velocity_rad_s(&mut self, velocity_rad_s: [f64; 2]) {
        for first in [SPEED, MOTOR_SPEED] {
            self.values[first..first + 2].copy_from_slice(&velocity_rad_s);
        }
    }

    /// Angle of a motor divided by its gear ratio, in rad.
    #[must_use]
    pub fn motor_angle_at_joint_rad(&self, joint: usize) -> f64 {
        if self.elastic(joint) { self.values[MOTOR_ANGLE + joint] } else { self.values[ANGLE + joint] }
    }

    /// Speed of a motor divided by its gear ratio, in rad/s.
    #[must_use]
    pub fn motor_speed_at_joint_rad_s(&self, joint: usize) -> f64 {
        drive_speed(self.machine, &self.values, joint)
    }

    /// The currents that flow under `drive`, in A.
    #[must_use]
    pub fn current_a(&self, drive: &Drive) -> [f64; 2] {
        std::array::from_fn(|joint| self.current_of(&self.values, drive, joint).0)
    }

    /// Moves on by `duration_s` under a constant drive.
    pub fn advance(&mut self, drive: &Drive, duration_s: f64) {
        if duration_s <= 0.0 {
            return;
        }
        // A duration that is a whole number of steps up to rounding must not get one more.
        let steps = (duration_s / self.step_s - 1e-6).ceil().max(1.0);
        let step_s = duration_s / steps;
        for _ in 0..steps as u64 {
            self.step(drive, step_s);
        }
    }

    fn elastic(&self, joint: usize) -> bool {
        elastic(self.machine, joint)
    }

    /// The current and its slope. Without lag the current is a function of the command and its slope is none.
    fn current_of(&self, values: &Values, drive: &Drive, joint: usize) -> (f64, f64) {
        let machine = &self.machine.joints[joint];
        let amplifier = &machine.amplifier;
        let motor_speed = drive_speed(self.machine, values, joint) * machine.gear_ratio;
        let settled = amplifier.settled_a(drive.command_a[joint], motor_speed);
        let flowing = values[CURRENT + joint];
        if let Some(slew) = amplifier.slew_a_per_s {
            (flowing, ((settled - flowing) / SLEW_LAG_S).clamp(-slew, slew))
        } else if amplifier.lag_s > 0.0 {
            (flowing, (settled - flowing) / amplifier.lag_s)
        } else {
            (settled, 0.0)
        }
    }

    fn forces(&self, values: &Values, drive: &Drive, time_s: f64) -> Forces {
        let machine = self.machine;
        let angle = [values[ANGLE], values[ANGLE + 1]];
        let velocity = [values[SPEED], values[SPEED + 1]];
        let outside = machine.outside.as_ref();
        let gravity = machine.gravity_m_s2 + outside.map_or(0.0, |outside| outside.added_gravity_m_s2(time_s));
        // Inertia and speed forces do not depend on the first angle, so a tilt changes gravity alone.
        let mut equations = machine.base.equations([angle[0] + machine.base_tilt_rad, angle[1]], velocity, gravity);
        let mut link_net_nm = outside.map_or([0.0; 2], |outside| outside.link_torque_nm(angle, velocity, time_s));
        let mut forces = Forces {
            equations,
            link_net_nm,
            link_coulomb_nm: [0.0; 2],
            motor_net_nm: [0.0; 2],
            motor_coulomb_nm: [0.0; 2],
            current_a: [0.0; 2],
            current_slope_a_per_s: [0.0; 2],
            tool_torque_nm: 0.0,
        };
        for joint in 0..2 {
            (forces.current_a[joint], forces.current_slope_a_per_s[joint]) = self.current_of(values, drive, joint);
        }
        for joint in 0..2 {
            let part = &machine.joints[joint];
            let speed = drive_speed(machine, values, joint);
            let motor_speed = part.gear_ratio * speed;
            let elastic = elastic(machine, joint);
            let motor_angle = part.gear_ratio * values[if elastic { MOTOR_ANGLE } else { ANGLE } + joint];

            let mut constant = part.torque_constant_nm_per_a * (1.0 + part.ripple.at(motor_angle));
            if let Some(Outside::WarmMotor { joint: warm, loss_per_a2_s, .. }) = outside
                && *warm == joint
            {
                constant *= 1.0 - loss_per_a2_s * values[OUTSIDE];
            }
            let mut motor_nm = constant * forces.current_a[joint] - part.torque_offset_nm
                + part.cogging.at(motor_angle)
                + drive.disturbance_nm[joint];
            if let Some(Outside::Crosstalk { joint: disturbed, share }) = outside
                && *disturbed == joint
            {
                motor_nm += share * constant * forces.current_a[1 - joint];
            }

            let sliding = Sliding {
                speed_rad_s: motor_speed,
                joint_angle_rad: angle[joint],
                time_s,
                load_nm: self.load_nm[joint],
            };
            let friction = &part.friction;
            let [up, down] = [1.0, -1.0].map(|direction| friction.level_nm(direction, &sliding));
            // A pair of unequal levels is an equal pair and a constant.
            let mut coulomb = 0.5 * (up + down) * part.gear_ratio.abs();
            let mut drive_nm = part.gear_ratio * (motor_nm - friction.viscous_nm(motor_speed) - 0.5 * (up - down));
            if !machine.sticks(joint) {
                drive_nm -= coulomb * values[OUTSIDE];
                coulomb = 0.0;
            }

            link_net_nm[joint] += part.balance_spring_nm.at(angle[joint]);
            if let Some(contact) = part.contact
                && (contact.start_s..contact.start_s + contact.duration_s).contains(&time_s)
            {
                link_net_nm[joint] += contact.torque_nm;
            }
            match outside {
                Some(Outside::CableHysteresis { joint: bent, torque_nm, stiffness_nm_per_rad, .. })
                    if *bent == joint =>
                {
                    link_net_nm[joint] -= torque_nm * values[OUTSIDE] + stiffness_nm_per_rad * angle[joint];
                }
                Some(Outside::ResonantTool { inertia_kg_m2, frequency_hz, damping_ratio }) => {
                    let natural = std::f64::consts::TAU * frequency_hz;
                    forces.tool_torque_nm = inertia_kg_m2
                        * (natural * natural * values[OUTSIDE] + 2.0 * damping_ratio * natural * values[OUTSIDE + 1]);
                    // A turn of the forearm counts fully in both joint angles.
                    link_net_nm[joint] += forces.tool_torque_nm;
                }
                _ => {}
            }

            if elastic {
                let spring = part.transmission.torque_nm(
                    values[MOTOR_ANGLE + joint] - angle[joint],
                    values[MOTOR_SPEED + joint] - velocity[joint],
                );
                equations.mass_kg_m2[joint][joint] -= part.motor_inertia_kg_m2;
                link_net_nm[joint] += spring;
                forces.motor_net_nm[joint] = drive_nm - spring;
                forces.motor_coulomb_nm[joint] = coulomb;
            } else {
                link_net_nm[joint] += drive_nm;
                forces.link_coulomb_nm[joint] = coulomb;
            }
        }
        forces.equations = equations;
        forces.link_net_nm = link_net_nm;
        forces
    }

    fn modes(&self, drive: &Drive) -> [Mode; 2] {
        let speeds = [0, 1].map(|joint| drive_speed(self.machine, &self.values, joint));
        let moving = speeds.map(|speed| if speed > 0.0 { Mode::Up } else { Mode::Down });
        if speeds[0] != 0.0 && speeds[1] != 0.0 {
            return moving;
        }
        let forces = self.forces(&self.values, drive, self.time_s);
        let link = consistent_modes(&forces.equations, forces.link_net_nm, forces.link_coulomb_nm, speeds);
        std::array::from_fn(|joint| {
            if !self.elastic(joint) {
                link[joint]
            } else if speeds[joint] != 0.0 {
                moving[joint]
            } else if forces.motor_net_nm[joint].abs() <= forces.motor_coulomb_nm[joint] {
                Mode::Stuck
            } else if forces.motor_net_nm[joint] > 0.0 {
                Mode::Up
            } else {
                Mode::Down
            }
        })
    }

    fn slope(&self, values: &Values, drive: &Drive, modes: [Mode; 2], time_s: f64) -> Values {
        let forces = self.forces(values, drive, time_s);
        // An elastic joint's link has no friction of its own; "up" with none is free motion.
        let link_modes = std::array::from_fn(|joint| if self.elastic(joint) { Mode::Up } else { modes[joint] });
        let acceleration = accelerations(&forces.equations, forces.link_net_nm, forces.link_coulomb_nm, link_modes);
        let mut slope = [0.0; LENGTH];
        for joint in 0..2 {
            slope[ANGLE + joint] = values[SPEED + joint];
            slope[SPEED + joint] = acceleration[joint];
            slope[CURRENT + joint] = forces.current_slope_a_per_s[joint];
            if self.elastic(joint) {
                slope[MOTOR_ANGLE + joint] = values[MOTOR_SPEED + joint];
                if modes[joint] != Mode::Stuck {
                    let push = forces.motor_net_nm[joint] - modes[joint].direction() * forces.motor_coulomb_nm[joint];
                    slope[MOTOR_SPEED + joint] = push / self.machine.joints[joint].motor_inertia_kg_m2;
                }
            }
        }
        match self.machine.outside {
            Some(Outside::PreSliding { joint, travel_rad }) => {
                slope[OUTSIDE] = turned_round(drive_speed(self.machine, values, joint), travel_rad, values[OUTSIDE]);
            }
            Some(Outside::CableHysteresis { joint, travel_rad, .. }) => {
                slope[OUTSIDE] = turned_round(values[SPEED + joint], travel_rad, values[OUTSIDE]);
            }
            Some(Outside::WarmMotor { joint, cooling_s, .. }) => {
                slope[OUTSIDE] = forces.current_a[joint].powi(2) - values[OUTSIDE] / cooling_s;
            }
            Some(Outside::ResonantTool { inertia_kg_m2, .. }) => {
                slope[OUTSIDE] = values[OUTSIDE + 1];
                slope[OUTSIDE + 1] = -forces.tool_torque_nm / inertia_kg_m2 - acceleration[0] - acceleration[1];
            }
            _ => {}
        }
        slope
    }

    fn runge_kutta(&self, drive: &Drive, modes: [Mode; 2], step_s: f64) -> Values {
        let start = &self.values;
        let along = |slope: &Values, time_s: f64| -> Values {
            std::array::from_fn(|index| time_s.mul_add(slope[index], start[index]))
        };
        let (now, middle, end) = (self.time_s, self.time_s + 0.5 * step_s, self.time_s + step_s);
        let first = self.slope(start, drive, modes, now);
        let second = self.slope(&along(&first, 0.5 * step_s), drive, modes, middle);
        let third = self.slope(&along(&second, 0.5 * step_s), drive, modes, middle);
        let fourth = self.slope(&along(&third, step_s), drive, modes, end);
        std::array::from_fn(|index| {
            let sum = first[index] + 2.0 * (second[index] + third[index]) + fourth[index];
            (step_s / 6.0).mul_add(sum, start[index])
        })
    }

    /// Which motors move against their mode. Without Coulomb friction a reversal changes nothing and is none.
    fn reversed(&self, values: &Values, modes: [Mode; 2]) -> [bool; 2] {
        std::array::from_fn(|joint| {
            self.machine.sticks(joint) && drive_speed(self.machine, values, joint) * modes[joint].direction() < 0.0
        })
    }

    fn step(&mut self, drive: &Drive, step_s: f64) {
        let mut remaining_s = step_s;
        for _ in 0..REVERSALS_PER_STEP {
            let modes = self.modes(drive);
            let whole = self.runge_kutta(drive, modes, remaining_s);
            let reversed = self.reversed(&whole, modes);
            if reversed == [false; 2] {
                self.accept(whole, drive, modes, remaining_s);
                return;
            }
            // The first of the reversals; speeds are all but straight over a step this short, so two secants do.
            let crossing = |values: &Values, within_s: f64, joint: usize| {
                let (before, after) =
                    (drive_speed(self.machine, &self.values, joint), drive_speed(self.machine, values, joint));
                within_s * before / (before - after)
            };
            let (mut part_s, mut joint) = (remaining_s, 0);
            for candidate in (0..2).filter(|&candidate| reversed[candidate]) {
                let at = crossing(&whole, remaining_s, candidate);
                if at < part_s {
                    (part_s, joint) = (at, candidate);
                }
            }
            let mut values = self.runge_kutta(drive, modes, part_s);
            let refined_s = crossing(&values, part_s, joint);
            if refined_s.is_finite() && (0.0..=remaining_s).contains(&refined_s) {
                part_s = refined_s;
                values = self.runge_kutta(drive, modes, part_s);
            }
            values[if self.elastic(joint) { MOTOR_SPEED } else { SPEED } + joint] = 0.0;
            self.accept(values, drive, modes, part_s);
            remaining_s -= part_s;
            if remaining_s <= 0.0 {
                return;
            }
        }
        let modes = self.modes(drive);
        let mut values = self.runge_kutta(drive, modes, remaining_s);
        for joint in 0..2 {
            if self.reversed(&values, modes)[joint] {
                values[if self.elastic(joint) { MOTOR_SPEED } else { SPEED } + joint] = 0.0;
            }
        }
        self.accept(values, drive, modes, remaining_s);
    }

    fn accept(&mut self, values: Values, drive: &Drive, modes: [Mode; 2], step_s: f64) {
        self.values = values;
        self.time_s += step_s;
        let loaded = |joint: usize| self.machine.joints[joint].friction.load_share != 0.0;
        if loaded(0) || loaded(1) {
            // What the gear transmits is what the link takes: its inertia, its weight and what couples it, without
            // the rotor. Friction depends on it and it on friction, so it is that of the step before.
            let slope = self.slope(&self.values, drive, modes, self.time_s);
            let forces = self.forces(&self.values, drive, self.time_s);
            for joint in 0..2 {
                let part = &self.machine.joints[joint];
                let rotor = if self.elastic(joint) { 0.0 } else { part.motor_inertia_kg_m2 };
                let mass = forces.equations.mass_kg_m2[joint];
                let link_nm = mass[0] * slope[SPEED] + mass[1] * slope[SPEED + 1] - rotor * slope[SPEED + joint]
                    + forces.equations.bias_nm[joint];
                self.load_nm[joint] = link_nm / part.gear_ratio;
            }
        }
    }
}

fn elastic(machine: &Machine, joint: usize) -> bool {
    machine.joints[joint].transmission != Transmission::Rigid
}

/// Speed of the coordinate that friction and motor act on, at the joint.
fn drive_speed(machine: &Machine, values: &Values, joint: usize) -> f64 {
    values[if elastic(machine, joint) { MOTOR_SPEED } else { SPEED } + joint]
}

/// Dahl's law: the relative friction `share` moves toward the direction of motion over `travel_rad`.
fn turned_round(speed_rad_s: f64, travel_rad: f64, share: f64) -> f64 {
    speed_rad_s / travel_rad * (1.0 - share * speed_rad_s.signum())
}

//! The plain plant with all effects, as a machine that the replays move.
//!
//! Each step follows the plain plant's own two passes; what beyond it depends on position is taken in the middle that
//! the old velocity leads to, what depends on velocity in the mean of old and predicted velocity.

use super::amplifier::{Amplifier, MotorAt};
use super::friction::{Circumstances, Friction};
use super::link::Link;
use super::motion::Motion;
use super::shaft::{Passed, Shaft, TwoMass};
use super::wave::Wave;
use super::{Effects, JointEffects};
use crate::arm::{Arm, Inertia, Load, Pose};
use crate::machine::{Machine, Movable};
use crate::plant::{Plant, State};
use crate::scalar::Scalar;

/// The least share of a joint's inertia that its motor has: less would have to be integrated more finely.
const LEAST_MOTOR_SHARE: f64 = 0.02;

/// A slipping encoder passes over the counts it loses in this time, s: no longer than a sampling period, and not at
/// once, so that a misfit depends continuously on the instant.
pub const SLIP_DURATION_S: f64 = 7e-4;

/// An arm with its drives and effects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtendedPlant<S> {
    /// The plain plant.
    pub plant: Plant<S>,
    /// What it has beyond.
    pub effects: Effects<S>,
}

impl<S: Scalar> ExtendedPlant<S> {
    /// A plant in this number type: `number` is asked for every constant in turn, with a function that gives this
    /// constant of a plain one.
    #[inline(always)]
    pub fn from_constants(number: impl Fn(&dyn Fn(&ExtendedPlant<f64>) -> f64) -> S) -> Self {
        Self {
            plant: Plant::from_constants(|constant: &dyn Fn(&Plant<f64>) -> f64| {
                number(&|extended| constant(&extended.plant))
            }),
            effects: Effects::from_constants(|constant: &dyn Fn(&Effects<f64>) -> f64| {
                number(&|extended| constant(&extended.effects))
            }),
        }
    }
}

impl<S: Scalar> Movable for ExtendedPlant<S> {
    type Number = S;
    type Machine = ExtendedMachine<S>;

    #[inline(always)]
    fn machine(&self) -> ExtendedMachine<S> {
        ExtendedMachine::new(self)
    }
}

/// An [`ExtendedPlant`] with its products of constants taken out of the step. Its input is the current in A that a
/// command stands for.
#[derive(Clone, Copy, Debug)]
pub struct ExtendedMachine<S> {
    arm: Arm<S>,
    tilt: [S; 2],
    counts_per_rad: [S; 2],
    motor_inertia: [S; 2],
    inverse_motor_inertia: [S; 2],
    amplifiers: [Amplifier<S>; 2],
    frictions: [Friction<S>; 2],
    shafts: [Shaft<S>; 2],
    links: [Link<S>; 2],
    encoders: [Encoder<S>; 2],
    /// Joint torque per joint torque of the other motor.
    crosstalk: [S; 2],
}

/// Where one encoder is wrong.
#[derive(Clone, Copy, Debug)]
struct Encoder<S> {
    error: Wave<S>,
    slip: S,
    instant: S,
    inverse_duration: S,
}

/// What acts during one step: the input, and a motor torque beside it.
#[derive(Clone, Copy, Debug)]
pub struct Held<S> {
    input_a: [S; 2],
    added_torque_nm: [S; 2],
}

impl<S: Scalar> Encoder<S> {
    fn new(effects: &JointEffects<S>, gear_ratio: S, counts_per_rad: S) -> Self {
        Self {
            error: Wave {
                size: counts_per_rad * effects.transmission_error_rad,
                order: gear_ratio * effects.transmission_error_order,
                phase: effects.transmission_error_phase_rad,
            },
            slip: effects.slip_counts,
            instant: effects.slip_instant_s,
            inverse_duration: gear_ratio.constant(1.0 / SLIP_DURATION_S),
        }
    }

    /// Counts shown beyond the position.
    #[inline(always)]
    fn beyond_counts(&self, position_rad: S, time_s: S) -> S {
        let slipped = (time_s - self.instant) * self.inverse_duration;
        let slipped = slipped.maximum(slipped.constant(0.0)).minimum(slipped.constant(1.0));
        self.slip.mul_add(slipped, self.error.at(position_rad))
    }
}

/// The motors' inertias at their joints: as `effects` have them, but such that the links keep some of each joint's
/// inertia wherever the arm stands.
fn motor_inertias<S: Scalar>(plant: &Plant<S>, effects: &Effects<S>) -> [S; 2] {
    let [f1, f2, f3, f4, _, _, f7, _, _] = plant.arm.f;
    let one = f1.constant(1.0);
    let least = f1.constant(LEAST_MOTOR_SHARE);
    let wanted = |joint: usize, whole: S| {
        let ratio = plant.drives[joint].gear_ratio;
        (ratio * ratio * effects.joints[joint].motor_inertia_kg_m2).maximum(least * whole)
    };
    let (second, third) = (wanted(0, f7), wanted(1, f1));
    // D less the motors is positive definite if b2 (D⁻¹)11 + b3 (D⁻¹)22 ≤ 1. As in `Arm::check_inertia`, what holds at
    // both ends of the coupling's range holds between.
    let reach = f3.abs() + f4.abs();
    let share = |coupling: S| {
        let d11 = f7 + coupling + coupling;
        let d12 = f2 + coupling;
        (second * f1 + third * d11) / (d11 * f1 - d12 * d12)
    };
    let scale = one / share(reach).maximum(share(-reach)).maximum(one);
    [second * scale, third * scale]
}

impl<S: Scalar> ExtendedMachine<S> {
    /// The machine of `extended`.
    pub fn new(extended: &ExtendedPlant<S>) -> Self {
        let ExtendedPlant { plant, effects } = extended;
        let [second, third] = &effects.joints;
        let body = &effects.arm;
        let delta = Load {
            mass_kg: body.payload_kg,
            centre_m: [body.payload_x_m, body.payload_y_m],
            inertia_kg_m2: body.payload_kg * body.payload_gyration_m2,
        }
        .delta_f(body.upper_arm_m);
        let mut loaded = *plant;
        for (f, delta) in loaded.arm.f.iter_mut().zip(delta) {
            *f += delta;
        }
        let motor_inertia = motor_inertias(&loaded, effects);
        let one = body.tilt_rad.constant(1.0);
        let (sine, cosine) = body.tilt_rad.sin_cos();
        let counts_per_rad = [plant.drives[0].counts_per_rad(), plant.drives[1].counts_per_rad()];
        let ratios = [plant.drives[0].gear_ratio, plant.drives[1].gear_ratio];
        Self {
            arm: loaded.arm,
            tilt: [sine, cosine],
            counts_per_rad,
            motor_inertia,
            inverse_motor_inertia: [one / motor_inertia[0], one / motor_inertia[1]],
            amplifiers: [Amplifier::new(&plant.drives[0], second), Amplifier::new(&plant.drives[1], third)],
            frictions: [Friction::new(&plant.drives[0], second), Friction::new(&plant.drives[1], third)],
            shafts: [Shaft::new(second), Shaft::new(third)],
            links: [Link::new(second), Link::new(third)],
            encoders: [
                Encoder::new(second, plant.drives[0].gear_ratio, counts_per_rad[0]),
                Encoder::new(third, plant.drives[1].gear_ratio, counts_per_rad[1]),
            ],
            crosstalk: [second.crosstalk_share * ratios[0] / ratios[1], third.crosstalk_share * ratios[1] / ratios[0]],
        }
    }

    /// Inertias of both motors at their joints in kg m², as used: within what the links leave them.
    pub fn motor_inertia_kg_m2(&self) -> [S; 2] {
        self.motor_inertia
    }

    /// Gravity's torque on a base that leans.
    #[inline(always)]
    fn gravity_torque_nm(&self, pose: &Pose<S>) -> [S; 2] {
        let [sine, cosine] = self.tilt;
        let leaning = Pose {
            s2: pose.s2.mul_add(cosine, pose.c2 * sine),
            c2: pose.c2.mul_add(cosine, -(pose.s2 * sine)),
            s23: pose.s23.mul_add(cosine, pose.c23 * sine),
            c23: pose.c23.mul_add(cosine, -(pose.s23 * sine)),
            ..*pose
        };
        self.arm.gravity_torque_nm(&leaning)
    }

    #[inline(always)]
    fn advanced(&self, motion: &Motion<S>, held: &Held<S>, period_s: S, midpoint: bool) -> Motion<S> {
        let half = period_s * period_s.constant(0.5);
        let one_half = period_s.constant(0.5);
        let (theta, old) = (motion.motor.position_rad, motion.motor.velocity_rad_s);
        let old_link = [old[0] - motion.twist_rate_rad_s[0], old[1] - motion.twist_rate_rad_s[1]];
        let ahead = if midpoint { half } else { period_s.constant(0.0) };
        let middle = [ahead.mul_add(old[0], theta[0]), ahead.mul_add(old[1], theta[1])];
        let middle_link = [
            ahead.mul_add(old_link[0], theta[0] - motion.twist_rad[0]),
            ahead.mul_add(old_link[1], theta[1] - motion.twist_rad[1]),
        ];
        let mut step = Step {
            machine: self,
            motion,
            held,
            period_s,
            motor_at: [self.amplifiers[0].motor.at(middle[0]), self.amplifiers[1].motor.at(middle[1])],
            slow_friction_nm: [
                self.slow_friction_nm(0, middle[0], motion),
                self.slow_friction_nm(1, middle[1], motion),
            ],
            outer_nm: [
                self.links[0].spring_nm(middle_link[0]) + self.links[0].contact_nm(motion.time_s, period_s),
                self.links[1].spring_nm(middle_link[1]) + self.links[1].contact_nm(motion.time_s, period_s),
            ],
            gear_torque_nm: motion.gear_torque_nm,
            friction_torque_nm: motion.friction_torque_nm,
        };
        let pose = Pose::at(middle_link);
        let (mut passed, mut current) = step.pass(&pose, old, old_link);
        if midpoint {
            let shift =
                [(passed.motor_velocity[0] - old[0]) * one_half, (passed.motor_velocity[1] - old[1]) * one_half];
            let new_link =
                [passed.motor_velocity[0] - passed.twist_rate[0], passed.motor_velocity[1] - passed.twist_rate[1]];
            let link_shift = [(new_link[0] - old_link[0]) * one_half, (new_link[1] - old_link[1]) * one_half];
            let pose = pose.turned([half * link_shift[0], half * link_shift[1]]);
            step.learn(&passed);
            (passed, current) = step.pass(
                &pose,
                [old[0] + shift[0], old[1] + shift[1]],
                [old_link[0] + link_shift[0], old_link[1] + link_shift[1]],
            );
        }
        step.learn(&passed);
        let new = passed.motor_velocity;
        let position_rad = if midpoint {
            [half.mul_add(old[0] + new[0], theta[0]), half.mul_add(old[1] + new[1], theta[1])]
        } else {
            [period_s.mul_add(new[0], theta[0]), period_s.mul_add(new[1], theta[1])]
        };
        Motion {
            motor: State { position_rad, velocity_rad_s: new },
            twist_rad: passed.twist,
            twist_rate_rad_s: passed.twist_rate,
            gear_torque_nm: step.gear_torque_nm,
            friction_torque_nm: step.friction_torque_nm,
            current_a: current,
            time_s: motion.time_s + period_s,
        }
    }

    #[inline(always)]
    fn slow_friction_nm(&self, joint: usize, position_rad: S, motion: &Motion<S>) -> S {
        self.frictions[joint].slow_level_nm(&Circumstances { position_rad, time_s: motion.time_s })
    }
}

/// What stays the same over both passes of a step, and what the first teaches the second.
struct Step<'a, S> {
    machine: &'a ExtendedMachine<S>,
    motion: &'a Motion<S>,
    held: &'a Held<S>,
    period_s: S,
    motor_at: [MotorAt<S>; 2],
    slow_friction_nm: [S; 2],
    outer_nm: [S; 2],
    gear_torque_nm: [S; 2],
    friction_torque_nm: [S; 2],
}

impl<S: Scalar> Step<'_, S> {
    /// Forces at `pose` and at these velocities of motors and links; gives the currents at the end as well.
    #[inline(always)]
    fn pass(&self, pose: &Pose<S>, motor_velocity: [S; 2], link_velocity: [S; 2]) -> (Passed<S>, [S; 2]) {
        let machine = self.machine;
        let period_s = self.period_s;
        let (own2, wet2, current2) = self.drive(0, motor_velocity[0]);
        let (own3, wet3, current3) = self.drive(1, motor_velocity[1]);
        let drive2 = machine.crosstalk[0].mul_add(own3, own2 + wet2);
        let drive3 = machine.crosstalk[1].mul_add(own2, own3 + wet3);
        let (low2, high2) = self.friction_range(0, motor_velocity[0]);
        let (low3, high3) = self.friction_range(1, motor_velocity[1]);
        let whole = machine.arm.inertia(pose);
        let links = Inertia {
            d11: whole.d11 - machine.motor_inertia[0],
            d12: whole.d12,
            d22: whole.d22 - machine.motor_inertia[1],
        };
        let h = machine.arm.velocity_torque_nm(pose, link_velocity);
        let g = machine.gravity_torque_nm(pose);
        let two_mass = TwoMass {
            inverse_motor: machine.inverse_motor_inertia,
            inverse_link: links.inverse(),
            motor_velocity: self.motion.motor.velocity_rad_s,
            twist: self.motion.twist_rad,
            twist_rate: self.motion.twist_rate_rad_s,
            motor_impulse: [period_s * drive2, period_s * drive3],
            link_impulse: [period_s * (self.outer_nm[0] - h[0] - g[0]), period_s * (self.outer_nm[1] - h[1] - g[1])],
            friction_low: [period_s * low2, period_s * low3],
            friction_high: [period_s * high2, period_s * high3],
            friction_guess: [period_s * self.friction_torque_nm[0], period_s * self.friction_torque_nm[1]],
        };
        (two_mass.pass(&machine.shafts, period_s), [current2, current3])
    }

    /// A motor's torque at its joint, friction that is not dry, and the current at the end of the step.
    #[inline(always)]
    fn drive(&self, joint: usize, velocity: S) -> (S, S, S) {
        let amplifier = &self.machine.amplifiers[joint];
        let target = amplifier.target_a(self.held.input_a[joint], velocity);
        let (current, mean) = amplifier.lagged_a(self.motion.current_a[joint], target, self.period_s);
        let mean = amplifier.drifted_a(mean, self.motion.time_s);
        let torque = amplifier.motor.joint_torque_nm(&self.motor_at[joint], mean, self.held.added_torque_nm[joint]);
        (torque, self.machine.frictions[joint].wet_torque_nm(velocity), current)
    }

    #[inline(always)]
    fn friction_range(&self, joint: usize, velocity: S) -> (S, S) {
        self.machine.frictions[joint].range_nm(self.slow_friction_nm[joint], velocity, self.gear_torque_nm[joint])
    }

    /// Takes over what a pass has found.
    #[inline(always)]
    fn learn(&mut self, passed: &Passed<S>) {
        let per_period = self.period_s.constant(1.0) / self.period_s;
        self.gear_torque_nm = [passed.shaft_impulse[0] * per_period, passed.shaft_impulse[1] * per_period];
        self.friction_torque_nm = [passed.friction_impulse[0] * per_period, passed.friction_impulse[1] * per_period];
    }
}

impl<S: Scalar> Machine<S> for ExtendedMachine<S> {
    type Motion = Motion<S>;
    type Held = Held<S>;

    #[inline(always)]
    fn number(&self, value: f64) -> S {
        self.counts_per_rad[0].constant(value)
    }

    #[inline(always)]
    fn counts_per_rad(&self) -> [S; 2] {
        self.counts_per_rad
    }

    /// Shafts twisted by gravity and the springs alone.
    #[inline(always)]
    fn start(&self, state: State<S>, time_s: f64) -> Motion<S> {
        let zero = self.number(0.0);
        let q = state.position_rad;
        let g = self.gravity_torque_nm(&Pose::at(q));
        let gear_torque_nm = [g[0] - self.links[0].spring_nm(q[0]), g[1] - self.links[1].spring_nm(q[1])];
        Motion {
            motor: state,
            twist_rad: [self.shafts[0].twist_rad(gear_torque_nm[0]), self.shafts[1].twist_rad(gear_torque_nm[1])],
            twist_rate_rad_s: [zero; 2],
            gear_torque_nm,
            friction_torque_nm: [zero; 2],
            current_a: [zero; 2],
            time_s: self.number(time_s),
        }
    }

    #[inline(always)]
    fn state(&self, motion: &Motion<S>) -> State<S> {
        motion.motor
    }

    #[inline(always)]
    fn position_counts(&self, motion: &Motion<S>) -> [S; 2] {
        let q = motion.motor.position_rad;
        [
            q[0].mul_add(self.counts_per_rad[0], self.encoders[0].beyond_counts(q[0], motion.time_s)),
            q[1].mul_add(self.counts_per_rad[1], self.encoders[1].beyond_counts(q[1], motion.time_s)),
        ]
    }

    #[inline(always)]
    fn input(&self, command_a: [S; 2]) -> [S; 2] {
        [self.amplifiers[0].input_a(command_a[0]), self.amplifiers[1].input_a(command_a[1])]
    }

    #[inline(always)]
    fn begun(&self, motion: &Motion<S>, input: [S; 2]) -> Motion<S> {
        let velocity = motion.motor.velocity_rad_s;
        let current_a =
            [self.amplifiers[0].target_a(input[0], velocity[0]), self.amplifiers[1].target_a(input[1], velocity[1])];
        Motion { current_a, ..*motion }
    }

    #[inline(always)]
    fn held(&self, share: S, previous: [S; 2], input: [S; 2], added_torque_nm: [S; 2]) -> Held<S> {
        let input_a =
            [share.mul_add(previous[0] - input[0], input[0]), share.mul_add(previous[1] - input[1], input[1])];
        Held { input_a, added_torque_nm }
    }

    #[inline(always)]
    fn fresh(&self, input: [S; 2], added_torque_nm: [S; 2]) -> Held<S> {
        Held { input_a: input, added_torque_nm }
    }

    #[inline(always)]
    fn step(&self, motion: &Motion<S>, held: &Held<S>, period_s: S) -> Motion<S> {
        self.advanced(motion, held, period_s, true)
    }

    #[inline(always)]
    fn step_symplectic(&self, motion: &Motion<S>, held: &Held<S>, period_s: S) -> Motion<S> {
        self.advanced(motion, held, period_s, false)
    }

    #[inline(always)]
    fn start_symplectic(&self, motion: &Motion<S>, held: &Held<S>, period_s: S) -> Motion<S> {
        let half = period_s * period_s.constant(0.5);
        let mut next = self.advanced(motion, held, half, false);
        for joint in 0..2 {
            next.motor.position_rad[joint] += half * next.motor.velocity_rad_s[joint];
        }
        next.time_s += half;
        next
    }

    /// The links move with the motors: twist and its rate stay.
    #[inline(always)]
    fn corrected(&self, motion: &Motion<S>, position_rad: [S; 2], velocity_rad_s: [S; 2]) -> Motion<S> {
        let State { position_rad: q, velocity_rad_s: v } = motion.motor;
        let motor = State {
            position_rad: [q[0] + position_rad[0], q[1] + position_rad[1]],
            velocity_rad_s: [v[0] + velocity_rad_s[0], v[1] + velocity_rad_s[1]],
        };
        Motion { motor, ..*motion }
    }
}

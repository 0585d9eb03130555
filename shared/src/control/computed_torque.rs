//! Computed-torque control: the model's inverse dynamics, a velocity observer, and friction feedforward.
//!
//! `tau = D̂ (q̈ref + 2ζω (q̇ref − v̂) + ω² (qref − q)) + ĥ + ĝ + friction(q̇ref)`. The feedforward is evaluated where
//! the arm will be in the middle of the interval in which the torque acts (half a period plus the command delay
//! ahead); the feedback uses the reference at the instant of sampling.
//!
//! Friction, the motor's torque and springs come from the functions of the plant with effects ([`crate::effects`]),
//! inverted: with [`ComputedTorque::with_effects`] the feedforward knows friction that depends on direction, speed, load
//! and angle, torque offset and constant, ripple, cogging and balance springs.
//!
//! Left out: integral action, and effects between motor and link, in the amplifier, in the encoder and in time.
//!
//! A controller takes over without a jump of the current, from another law ([`ComputedTorque::follow`]) or from another
//! model ([`ComputedTorque::change_to`]): what would have been the jump is added, and fades within [`FADE_S`].
//!
//! # What approximations cost
//! Sines and cosines are right to 1e-6 ([`crate::scalar::Scalar::sin_cos`]): of the reference robot's 70 N m of gravity
//! that is 70 µN m, which ω holds to 70e-6/(5.6 · 200²) rad, 5e-6 counts. Angles up to 2 rad are rounded to 0.12 µrad,
//! 1/600 count, by `f32` itself. `micromath` is not used: its 1e-3 would be 0.004 counts here, but 27 in a reference.

use crate::arm::{Arm, PARAMETERS, Pose};
use crate::drive::{Drive, centre_of_count};
use crate::effects::{DriveFeedforward, Instant, JointEffects};
use crate::scalar::Number;

/// Time in which what a change of law or model would have made a jump falls to 1/e, s: as fast as the tracking error
/// itself, 1/ω. Slower, some of it would be left as an error when a short approach comes to its end, and friction would
/// keep the arm there.
pub const FADE_S: f64 = 0.005;

/// Bandwidths of the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComputedTorqueSettings<S> {
    /// ω: closed-loop bandwidth of the tracking error, rad/s.
    pub bandwidth_rad_s: S,
    /// ζ: damping ratio of the tracking error.
    pub damping_ratio: S,
    /// Bandwidth of the velocity observer, rad/s.
    pub observer_bandwidth_rad_s: S,
    /// Motor speed over which the Coulomb feedforward changes sign, rad/s; at most 1 (design §4).
    pub friction_switch_motor_rad_s: S,
}

impl<S: Number> ComputedTorqueSettings<S> {
    /// ω = 200 rad/s, ζ = 1, observer 800 rad/s, friction switching within 0.5 rad/s at the motor.
    ///
    /// Of the bandwidths that leave at least the margins of 150 and 400 rad/s at 0.7 ms, on a rigid arm and on one with a
    /// flexible shaft, and let the rounding of the encoders move the command by less than 5 % of the amplifiers' 12 A,
    /// these track best with a model that is 5 % off: by half the error of 150 and 400 rad/s. `armid bench track` prints the
    /// comparison, `armid info --margins` an arm's margins.
    pub fn at_record_period() -> Self {
        Self {
            bandwidth_rad_s: S::from_f64(200.0),
            damping_ratio: S::one(),
            observer_bandwidth_rad_s: S::from_f64(800.0),
            friction_switch_motor_rad_s: S::from_f64(0.5),
        }
    }
}

/// Where both joints should be at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointReference<S> {
    /// Joint angles in rad.
    pub position_rad: [S; 2],
    /// Joint velocities in rad/s.
    pub velocity_rad_s: [S; 2],
    /// Joint accelerations in rad/s².
    pub acceleration_rad_s2: [S; 2],
}

/// What one tick of the controller looks at.
#[derive(Clone, Copy, Debug)]
pub struct ComputedTorqueInput<S> {
    /// The reference at this sampling instant.
    pub reference: JointReference<S>,
    /// The reference half a period plus the command delay later.
    pub reference_ahead: JointReference<S>,
    /// Encoder counts of both motors, truncated toward zero.
    pub encoder_counts: [S; 2],
}

/// What one tick of the controller asks for.
#[derive(Clone, Copy, Debug)]
pub struct ComputedTorqueOutput<S> {
    /// Current for both motors in A, already inside the amplifier's limit.
    pub command_a: [S; 2],
    /// The current asked for before the limit in A; differs where the limit acts.
    pub unlimited_command_a: [S; 2],
}

/// The controller with its observer.
#[derive(Clone, Copy, Debug)]
pub struct ComputedTorque<S> {
    arm: Arm<S>,
    drives: [Drive<S>; 2],
    feedforward: [DriveFeedforward<S>; 2],
    settings: ComputedTorqueSettings<S>,
    period_s: S,
    position_correction: S,
    velocity_correction: S,
    predicted_position_rad: [S; 2],
    velocity_rad_s: [S; 2],
    /// Current asked for at the last tick, A, and the acceleration it was to give, rad/s².
    last_a: [S; 2],
    last_wanted_rad_s2: [S; 2],
    /// Current added to what the model asks for, A, and the share of it that a tick leaves.
    fading_a: [S; 2],
    fading_kept: S,
    /// Whether the next tick is to go on from the last one's current, and from how far at most, A.
    follows: bool,
    follows_within_a: [S; 2],
}

impl<S: Number> ComputedTorque<S> {
    /// A controller for `arm` and `drives` called every `period_s`, starting at rest at `position_rad`.
    ///
    /// The observer's poles both lie at 1/(1 + ω_o period): a first-order stand-in for exp(−ω_o period), at the same
    /// place to second order and without an exponential.
    #[inline(always)]
    pub fn new(
        arm: Arm<S>,
        drives: [Drive<S>; 2],
        settings: ComputedTorqueSettings<S>,
        period_s: S,
        position_rad: [S; 2],
    ) -> Self {
        let off = JointEffects::from_constants(|constant: &dyn Fn(&JointEffects<f64>) -> f64| {
            S::from_f64(constant(&JointEffects::OFF))
        });
        Self::with_effects(arm, drives, [&off, &off], settings, period_s, position_rad)
    }

    /// The same for drives that have `effects`; those that no feedforward meets (see above) do nothing.
    #[inline(always)]
    pub fn with_effects(
        arm: Arm<S>,
        drives: [Drive<S>; 2],
        effects: [&JointEffects<S>; 2],
        settings: ComputedTorqueSettings<S>,
        period_s: S,
        position_rad: [S; 2],
    ) -> Self {
        let switch = settings.friction_switch_motor_rad_s;
        let pole = S::one() / (S::one() + settings.observer_bandwidth_rad_s * period_s);
        let rest = S::one() - pole;
        Self {
            arm,
            drives,
            feedforward: [
                DriveFeedforward::new(&drives[0], effects[0], switch),
                DriveFeedforward::new(&drives[1], effects[1], switch),
            ],
            settings,
            period_s,
            position_correction: S::one() - pole * pole,
            velocity_correction: rest * rest / period_s,
            predicted_position_rad: position_rad,
            velocity_rad_s: [S::zero(); 2],
            last_a: [S::zero(); 2],
            last_wanted_rad_s2: [S::zero(); 2],
            fading_a: [S::zero(); 2],
            fading_kept: S::one() / (S::one() + period_s * S::from_f64(1.0 / FADE_S)),
            follows: false,
            follows_within_a: [S::zero(); 2],
        }
    }

    /// Makes the next tick go on from `command_a`, which another law asked of the resting arm, A: as far as Coulomb
    /// friction explains that it rests. An arm that has just been let go of by its brakes gets its weight's torque at once.
    pub fn follow(&mut self, command_a: [S; 2]) {
        self.last_a = command_a;
        self.last_wanted_rad_s2 = [S::zero(); 2];
        self.follows = true;
        self.follows_within_a = self.drives.map(|drive| drive.coulomb_friction_nm / drive.torque_constant_nm_per_a);
    }

    /// Goes on with the model and settings of `next`: estimates stay, and the next tick asks for what the last one did
    /// but for what its feedback adds.
    pub fn change_to(&mut self, next: &Self) {
        *self = Self {
            predicted_position_rad: self.predicted_position_rad,
            velocity_rad_s: self.velocity_rad_s,
            last_a: self.last_a,
            last_wanted_rad_s2: self.last_wanted_rad_s2,
            follows: true,
            follows_within_a: [S::from_f64(f64::INFINITY); 2],
            ..*next
        };
    }

    /// One tick: constant time, no branch on data. The first after a change of law or model takes a few operations
    /// more.
    pub fn tick(&mut self, input: &ComputedTorqueInput<S>) -> ComputedTorqueOutput<S> {
        let settings = &self.settings;
        let ahead = &input.reference_ahead;
        let mut position = [S::zero(); 2];
        let mut wanted = [S::zero(); 2];
        for joint in 0..2 {
            let measured = centre_of_count(input.encoder_counts[joint]) / self.drives[joint].counts_per_rad();
            let innovation = measured - self.predicted_position_rad[joint];
            position[joint] = self.predicted_position_rad[joint] + self.position_correction * innovation;
            self.velocity_rad_s[joint] += self.velocity_correction * innovation;
            let omega = settings.bandwidth_rad_s;
            wanted[joint] = ahead.acceleration_rad_s2[joint]
                + (settings.damping_ratio + settings.damping_ratio)
                    * omega
                    * (input.reference.velocity_rad_s[joint] - self.velocity_rad_s[joint])
                + omega * omega * (input.reference.position_rad[joint] - position[joint]);
        }

        let pose = Pose::at(ahead.position_rad);
        let inertia = self.arm.inertia(&pose);
        let inertial = inertia.times(wanted);
        let h = self.arm.velocity_torque_nm(&pose, ahead.velocity_rad_s);
        let g = self.arm.gravity_torque_nm(&pose);
        let mut command = [S::zero(); 2];
        let mut unlimited = [S::zero(); 2];
        let mut missing = [S::zero(); 2];
        let foreseen = inertia.times(ahead.acceleration_rad_s2);
        let added = inertia.times([wanted[0] - self.last_wanted_rad_s2[0], wanted[1] - self.last_wanted_rad_s2[1]]);
        for joint in 0..2 {
            let unaccelerated = h[joint] + g[joint];
            let instant = Instant {
                position_rad: ahead.position_rad[joint],
                velocity_rad_s: ahead.velocity_rad_s[joint],
                acceleration_rad_s2: ahead.acceleration_rad_s2[joint],
                arm_torque_nm: foreseen[joint] + unaccelerated,
            };
            let (current_a, torque_per_a) =
                self.feedforward[joint].current_a(&instant, inertial[joint] + unaccelerated);
            if self.follows {
                let jump_a = self.last_a[joint] + added[joint] / torque_per_a - current_a;
                self.fading_a[joint] = jump_a.clamp_abs(self.follows_within_a[joint]);
            }
            unlimited[joint] = current_a + self.fading_a[joint];
            self.fading_a[joint] = self.fading_a[joint] * self.fading_kept;
            command[joint] = unlimited[joint].clamp_abs(self.drives[joint].current_limit_a);
            missing[joint] = torque_per_a * (command[joint] - unlimited[joint]);
        }
        self.follows = false;
        self.last_a = unlimited;
        self.last_wanted_rad_s2 = wanted;

        // The observer is driven by the acceleration the model gives for the torque really commanded, so that a
        // limited torque does not wind it up. What fades is not counted: it stands for what the model does not know.
        let shortfall = inertia.inverse().times(missing);
        let half = S::from_f64(0.5);
        for joint in 0..2 {
            let acceleration = wanted[joint] + shortfall[joint];
            self.predicted_position_rad[joint] =
                position[joint] + self.period_s * (self.velocity_rad_s[joint] + half * self.period_s * acceleration);
            self.velocity_rad_s[joint] += self.period_s * acceleration;
        }
        ComputedTorqueOutput { command_a: command, unlimited_command_a: unlimited }
    }

    /// Adds to the model's f1..f9, in their units: for a load taken up or set down. The observer goes on as it is.
    pub fn add_to_f(&mut self, added: &[S; PARAMETERS]) {
        for (f, &added) in self.arm.f.iter_mut().zip(added) {
            *f += added;
        }
    }

    /// The observer's estimate of the joint velocities at the next sampling instant, rad/s.
    pub fn velocity_rad_s(&self) -> [S; 2] {
        self.velocity_rad_s
    }
}

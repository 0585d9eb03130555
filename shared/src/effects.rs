//! What a real arm has beyond the plain plant: the library of effects that `explain` names, as numbers in SI units.
//!
//! Every effect is there all the time; its size decides whether it shows. With every size at its neutral value
//! ([`Effects::OFF`]) the extended plant is the plain one to the rounding, and as nothing is left out whose
//! derivative is not zero too, derivatives with respect to a size exist there as well.
//!
//! ```text
//! command ─ dead zone, limits ─ lag, back-EMF, voltage ─ current ─ torque constant, ripple, cogging, offset
//!                                                                     │
//!    encoder: transmission error, slip ── motor: inertia, friction of every kind
//!                                                                     │ shaft: flexibility, backlash
//!                                                link: arm, payload, tilt, spring, contact
//! ```
//!
//! Frictions, torques of the drive and angles of periodic drive effects are those of the motor, as in
//! [`Drive`](crate::drive::Drive), and "forward" is the motor's own direction; a shaft, a spring and a contact act at
//! the joint. On a linear axis a radian is a metre and a newton metre a newton.

pub mod catalogue;

mod amplifier;
mod boxed;
mod feedforward;
mod friction;
mod link;
mod motion;
mod plant;
mod shaft;
mod wave;

pub use feedforward::{DriveFeedforward, Instant};
pub use motion::Motion;
pub use plant::{ExtendedMachine, ExtendedPlant};

macro_rules! constants {
    ($(#[$of_type:meta])* $name:ident { $($(#[$of_field:meta])* $field:ident = $off:expr,)* }) => {
        $(#[$of_type])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name<S> {
            $($(#[$of_field])* pub $field: S,)*
        }

        impl $name<f64> {
            /// Every effect off; shape constants at what is usual.
            pub const OFF: Self = Self { $($field: $off,)* };
        }

        impl $name<f32> {
            /// The same in the board's precision.
            pub const OFF_SINGLE: Self = Self { $($field: $off as f32,)* };
        }

        impl<S> $name<S> {
            /// The same constants in another number type: `number` is asked for each in turn, with a function that
            /// gives this constant of plain ones.
            #[inline(always)]
            pub fn from_constants(number: impl Fn(&dyn Fn(&$name<f64>) -> f64) -> S) -> Self {
                Self { $($field: number(&|constants| constants.$field),)* }
            }
        }
    };
}

constants! {
    /// Effects of one joint. Sizes are zero, and limits infinite, when off.
    JointEffects {
        /// What the Coulomb friction differs by from the drive's, N m at the motor. The sum cannot fall below zero.
        coulomb_change_nm = 0.0,
        /// What the viscous friction differs by from the drive's, N m s/rad at the motor.
        viscous_change_nm_s_per_rad = 0.0,
        /// Coulomb friction of a motor turning forward less that of one turning backward, N m at the motor. The mean
        /// of both stays.
        coulomb_asymmetry_nm = 0.0,
        /// Viscous friction of a motor turning forward less that of one turning backward, N m s/rad at the motor.
        viscous_asymmetry_nm_s_per_rad = 0.0,
        /// Friction at rest beyond Coulomb friction, N m at the motor; negative where friction grows from rest.
        stribeck_nm = 0.0,
        /// Motor speed at which 1/e of it is left, rad/s.
        stribeck_velocity_rad_s = 10.0,
        /// How it falls with x = |speed|/Stribeck velocity: 1 as exp(−x²), 0 as exp(−x), between as a mixture of the
        /// exponents.
        stribeck_sharpness = 1.0,
        /// Coulomb friction per torque that the gear transmits, both at the motor: no unit.
        load_friction_coefficient = 0.0,
        /// Amplitude of Coulomb friction over the joint's angle, N m at the motor.
        position_friction_nm = 0.0,
        /// Its periods per joint revolution.
        position_friction_order = 1.0,
        /// Its phase: the friction is greatest where order · joint angle + phase = 0, rad.
        position_friction_phase_rad = 0.0,
        /// Growth of the Coulomb friction in N m per second at the motor, from the start of a recording.
        friction_drift_nm_per_s = 0.0,
        /// Friction per square of the motor's speed, N m s²/rad², against the motion.
        quadratic_nm_s2_per_rad2 = 0.0,
        /// Constant torque the motor has to overcome, beside the drive's own, N m at the motor.
        torque_offset_nm = 0.0,
        /// Relative change of the torque constant.
        torque_constant_change = 0.0,
        /// Relative amplitude of the torque constant over the motor's angle.
        ripple_share = 0.0,
        /// Its periods per motor revolution.
        ripple_order = 6.0,
        /// Its phase: greatest where order · motor angle + phase = 0, rad.
        ripple_phase_rad = 0.0,
        /// Amplitude of a motor torque over the motor's angle, N m.
        cogging_nm = 0.0,
        /// Its periods per motor revolution.
        cogging_order = 12.0,
        /// Its phase: greatest forward torque where order · motor angle + phase = 0, rad.
        cogging_phase_rad = 0.0,
        /// Amplitude of the error of the measured position, rad of joint angle.
        transmission_error_rad = 0.0,
        /// Its periods per motor revolution.
        transmission_error_order = 1.0,
        /// Its phase: greatest where order · motor angle + phase = 0, rad.
        transmission_error_phase_rad = 0.0,
        /// Twist of the shaft between motor and link per torque, rad/(N m) at the joint.
        compliance_rad_per_nm = 0.0,
        /// The shaft's damping over its stiffness, s: damping ratio times 2 over the mode's angular frequency.
        shaft_damping_s = 0.0,
        /// Angle the motor passes between touching both flanks, rad of joint angle.
        gap_rad = 0.0,
        /// Inertia of motor and gear on the motor's side of shaft and gap, kg m² at the motor. Part of f1 and f7.
        motor_inertia_kg_m2 = 2e-4,
        /// Time constant of the current, s.
        current_lag_s = 0.0,
        /// The amplifier's largest current, A, where below the drive's.
        current_limit_a = f64::INFINITY,
        /// Voltage that the amplifier can give, V.
        supply_v = f64::INFINITY,
        /// Resistance of the winding that it works against, ohm.
        winding_ohm = 1.6,
        /// Current missing per speed of the motor, A s/rad.
        back_emf_a_s_per_rad = 0.0,
        /// Commands up to this give no current, greater ones this much less, A.
        dead_zone_a = 0.0,
        /// Torque amplitude of a spring over the joint's angle, N m at the joint.
        spring_nm = 0.0,
        /// Joint angle at which it pulls most in positive direction, rad.
        spring_angle_rad = 0.0,
        /// Counts the encoder shows more after a slip.
        slip_counts = 0.0,
        /// When it slips, s after the start of the recording.
        slip_instant_s = 0.0,
        /// Torque of a contact, N m at the joint, in positive direction.
        contact_nm = 0.0,
        /// When the contact begins, s after the start of the recording.
        contact_start_s = 0.0,
        /// How long it lasts, s.
        contact_duration_s = 0.5,
        // From here on: what is in no catalogue, because `explain` only knows it in order not to give it another's name.
        /// Fastest change of the current, A/s.
        current_slew_a_per_s = f64::INFINITY,
        /// Relative change of the torque constant per second, from the start of a recording.
        torque_constant_drift_per_s = 0.0,
        /// Share of the other motor's torque that this motor gives too, both at the motor.
        crosstalk_share = 0.0,
        /// Stiffness of a spring beyond its slack, N m/rad at the joint.
        slack_spring_nm_per_rad = 0.0,
        /// Joint angle in the middle of the slack, rad.
        slack_centre_rad = 0.0,
        /// Half of the slack, rad of joint angle.
        half_slack_rad = 0.0,
    }
}

constants! {
    /// Effects of the whole arm.
    ArmEffects {
        /// Mass of a body at the tool, kg; negative where the tool is lighter than thought.
        payload_kg = 0.0,
        /// Its centre along x of frame 3, m. The reference tool's where nothing else is known.
        payload_x_m = -0.02,
        /// Its centre along y of frame 3, m.
        payload_y_m = -0.53,
        /// Its own inertia per mass, m²: the square of its radius of gyration.
        payload_gyration_m2 = 0.0,
        /// Length a3 of the upper arm, m.
        upper_arm_m = crate::arm::PUMA_UPPER_ARM_M,
        /// Angle by which the base leans in the plane of the arm, toward positive q2, rad.
        tilt_rad = 0.0,
    }
}

/// Every effect of both joints and of the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects<S> {
    /// Effects of the two joints.
    pub joints: [JointEffects<S>; 2],
    /// Effects of the whole arm.
    pub arm: ArmEffects<S>,
}

impl Effects<f64> {
    /// Every effect off.
    pub const OFF: Self = Self { joints: [JointEffects::OFF; 2], arm: ArmEffects::OFF };

    /// Every effect off, for a single axis: its payload sits on the axis and adds its mass (or inertia) as it is.
    pub const SINGLE_AXIS: Self = Self {
        joints: [JointEffects::OFF; 2],
        arm: ArmEffects { payload_x_m: 0.0, payload_y_m: 0.0, upper_arm_m: 1.0, ..ArmEffects::OFF },
    };
}

impl<S> Effects<S> {
    /// The effects in this number type: `number` is asked for every constant in turn, with a function that gives this
    /// constant of plain effects.
    #[inline(always)]
    pub fn from_constants(number: impl Fn(&dyn Fn(&Effects<f64>) -> f64) -> S) -> Self {
        let joint = |index: usize| {
            JointEffects::from_constants(|constant: &dyn Fn(&JointEffects<f64>) -> f64| {
                number(&|effects| constant(&effects.joints[index]))
            })
        };
        Self {
            joints: [joint(0), joint(1)],
            arm: ArmEffects::from_constants(|constant: &dyn Fn(&ArmEffects<f64>) -> f64| {
                number(&|effects| constant(&effects.arm))
            }),
        }
    }
}

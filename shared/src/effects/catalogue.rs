//! The library of effects by name: what `explain` may name, and what a model file and a command line may ask for.
//!
//! The names are a contract with other programs, those of the parameters as well.

use super::{ArmEffects, Effects, JointEffects};

/// What an effect belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// One joint.
    Joint,
    /// The whole arm: its joint is called "both".
    Arm,
}

/// What a parameter does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// How much of the effect there is: the effect vanishes at the neutral value.
    Size,
    /// How the effect looks; without meaning where the size is neutral.
    Shape,
}

/// Where a parameter is found in [`Effects`].
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// A constant of each joint.
    Joint(fn(&mut JointEffects<f64>) -> &mut f64),
    /// A constant of the arm.
    Arm(fn(&mut ArmEffects<f64>) -> &mut f64),
}

/// One parameter of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Name, with the unit at its end.
    pub name: &'static str,
    /// Unit; "1" for none.
    pub unit: &'static str,
    /// Size or shape.
    pub role: Role,
    /// Whether every recording has a value of its own: an instant, or a phase against an encoder that is set to zero
    /// anew.
    pub per_recording: bool,
    /// Whether the parameter must be given: it has no usual value.
    pub required: bool,
    /// Least and greatest value, both included.
    pub range: [f64; 2],
    /// A size that shows clearly on the reference robot; a usual shape. Where a fit may begin.
    pub typical: f64,
    /// Where its value is kept.
    pub place: Place,
    /// What it is.
    pub meaning: &'static str,
}

/// One effect.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its contract name.
    pub name: &'static str,
    /// What it belongs to.
    pub scope: Scope,
    /// Its parameters, the size first.
    pub parameters: &'static [Parameter],
    /// Effects that tracking errors and currents of one experiment hardly tell from it.
    pub alike: &'static [&'static str],
    /// What it is, in a few words.
    pub meaning: &'static str,
    /// What it leaves out.
    pub left_out: &'static str,
}

impl Parameter {
    /// The value at which the effect is off, or the usual shape.
    pub fn neutral(&self) -> f64 {
        self.get(&Effects::OFF, 0)
    }

    /// Its value in `effects`; `joint` counts from 0 and does not matter to the arm's.
    pub fn get(&self, effects: &Effects<f64>, joint: usize) -> f64 {
        let mut effects = *effects;
        *self.slot(&mut effects, joint)
    }

    /// Changes its value in `effects`.
    pub fn set(&self, effects: &mut Effects<f64>, joint: usize, value: f64) {
        *self.slot(effects, joint) = value;
    }

    /// Whether `value` is in its range. Beside the range the neutral value is good too: it is how to switch off.
    pub fn accepts(&self, value: f64) -> bool {
        value == self.neutral() || (self.range[0]..=self.range[1]).contains(&value)
    }

    fn slot<'a>(&self, effects: &'a mut Effects<f64>, joint: usize) -> &'a mut f64 {
        match self.place {
            Place::Joint(of) => of(&mut effects.joints[joint.min(1)]),
            Place::Arm(of) => of(&mut effects.arm),
        }
    }
}

impl Entry {
    /// The parameter of this name.
    pub fn parameter(&self, name: &str) -> Option<&'static Parameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// Its size parameter.
    pub fn size(&self) -> &'static Parameter {
        &self.parameters[0]
    }

    /// Whether it is on in `effects`.
    pub fn is_on(&self, effects: &Effects<f64>, joint: usize) -> bool {
        self.size().get(effects, joint) != self.size().neutral()
    }
}

/// The effect of this name.
pub fn find(name: &str) -> Option<&'static Entry> {
    LIBRARY.iter().find(|entry| entry.name == name)
}

macro_rules! parameter {
    ($role:ident $name:literal [$unit:literal] ($place:expr) $low:literal, $high:literal, $typical:literal, $meaning:literal $(, $flag:ident)*) => {
        Parameter {
            $($flag: true,)*
            ..Parameter {
                name: $name,
                unit: $unit,
                role: Role::$role,
                per_recording: false,
                required: false,
                range: [$low, $high],
                typical: $typical,
                place: $place,
                meaning: $meaning,
            }
        }
    };
}

macro_rules! joint {
    ($role:ident $name:literal [$unit:literal] $field:ident $low:literal ..= $high:literal, $typical:literal, $meaning:literal $(, $flag:ident)*) => {
        parameter!($role $name [$unit] (Place::Joint(|joint| &mut joint.$field)) $low, $high, $typical, $meaning $(, $flag)*)
    };
}

macro_rules! arm {
    ($role:ident $name:literal [$unit:literal] $field:ident $low:literal ..= $high:literal, $typical:literal, $meaning:literal $(, $flag:ident)*) => {
        parameter!($role $name [$unit] (Place::Arm(|arm| &mut arm.$field)) $low, $high, $typical, $meaning $(, $flag)*)
    };
}

const MOTOR_INERTIA: Parameter = joint!(Shape "motor_inertia_kg_m2" ["kg m²"] motor_inertia_kg_m2 1e-7 ..= 10.0, 2e-4,
    "inertia on the motor's side, at the motor; part of f1 and f7; the tool takes less where the arm leaves it less");

/// Every effect, in the order of the specification.
pub const LIBRARY: &[Entry] = &[
    Entry {
        name: "coulomb-friction",
        scope: Scope::Joint,
        parameters: &[joint!(Size "change_nm" ["N m"] coulomb_change_nm -100.0 ..= 100.0, 0.03,
            "what the Coulomb friction at the motor differs by", required)],
        alike: &[],
        meaning: "Coulomb friction differs from the model's",
        left_out: "friction that differs at rest: stribeck-friction",
    },
    Entry {
        name: "viscous-friction",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "change_nm_s_per_rad" ["N m s/rad"] viscous_change_nm_s_per_rad -1000.0 ..= 1000.0, 3e-4,
            "what the viscous friction at the motor differs by", required),
        ],
        alike: &["back-emf"],
        meaning: "viscous friction differs from the model's",
        left_out: "dependence on temperature",
    },
    Entry {
        name: "asymmetric-friction",
        scope: Scope::Joint,
        parameters: &[joint!(Size "difference_nm" ["N m"] coulomb_asymmetry_nm -100.0 ..= 100.0, 0.04,
            "Coulomb friction of a motor turning forward less that of one turning backward", required)],
        alike: &["torque-offset"],
        meaning: "Coulomb friction differs by direction",
        left_out: "which of both directions is the usual one: their mean is the model's Coulomb friction",
    },
    Entry {
        name: "asymmetric-viscous-friction",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "difference_nm_s_per_rad" ["N m s/rad"] viscous_asymmetry_nm_s_per_rad -1000.0 ..= 1000.0, 4e-4,
            "viscous friction of a motor turning forward less that of one turning backward", required),
        ],
        alike: &[],
        meaning: "viscous friction differs by direction",
        left_out: "which of both directions is the usual one: their mean is the model's viscous friction",
    },
    Entry {
        name: "stribeck-friction",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "extra_nm" ["N m"] stribeck_nm -100.0 ..= 100.0, 0.04,
                "friction at rest beyond Coulomb friction; negative where friction grows from rest", required),
            joint!(Shape "velocity_rad_s" ["rad/s"] stribeck_velocity_rad_s 1e-4 ..= 1000.0, 10.0,
                "motor speed at which 1/e of it is left"),
            joint!(Shape "sharpness" ["1"] stribeck_sharpness 0.0 ..= 1.0, 1.0,
                "1: falls as exp(−x²) of speed over Stribeck velocity; 0: as exp(−x)"),
        ],
        alike: &["quadratic-friction", "cogging"],
        meaning: "friction differs at low speed",
        left_out: "memory of the friction (presliding, frictional lag)",
    },
    Entry {
        name: "load-dependent-friction",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "coefficient" ["1"] load_friction_coefficient -1.0 ..= 1.0, 0.05,
            "Coulomb friction per torque that the gear transmits", required),
            MOTOR_INERTIA,
        ],
        alike: &[],
        meaning: "Coulomb friction grows with the torque in the gear",
        left_out: "the difference between driving and being driven",
    },
    Entry {
        name: "position-dependent-friction",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "amplitude_nm" ["N m"] position_friction_nm -100.0 ..= 100.0, 0.03,
                "amplitude of Coulomb friction over the joint's angle, at the motor", required),
            joint!(Shape "order" ["1"] position_friction_order 0.0 ..= 1000.0, 1.0, "periods per joint revolution"),
            joint!(Shape "phase_rad" ["rad"] position_friction_phase_rad -6.3 ..= 6.3, 0.0,
                "greatest where order · joint angle + phase is zero"),
        ],
        alike: &[],
        meaning: "Coulomb friction varies with the joint's angle",
        left_out: "more than one harmonic",
    },
    Entry {
        name: "friction-drift",
        scope: Scope::Joint,
        parameters: &[joint!(Size "rate_nm_per_s" ["N m/s"] friction_drift_nm_per_s -10.0 ..= 10.0, 0.005,
            "growth of the Coulomb friction from the start of a recording, at the motor", required)],
        alike: &[],
        meaning: "Coulomb friction changes in time",
        left_out: "viscous friction's drift, and that warming up comes to an end",
    },
    Entry {
        name: "quadratic-friction",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "coefficient_nm_s2_per_rad2" ["N m s²/rad²"] quadratic_nm_s2_per_rad2 -1000.0 ..= 1000.0, 5e-6,
            "friction per square of the motor's speed", required),
        ],
        alike: &["stribeck-friction", "cogging"],
        meaning: "friction grows with the square of the speed",
        left_out: "fluid whose friction depends on direction",
    },
    Entry {
        name: "torque-offset",
        scope: Scope::Joint,
        parameters: &[joint!(Size "torque_nm" ["N m"] torque_offset_nm -100.0 ..= 100.0, 0.03,
            "constant torque the motor has to overcome", required)],
        alike: &["asymmetric-friction", "base-tilt"],
        meaning: "constant torque: bias of amplifier or sensor, pull of a cable",
        left_out: "a cable's pull that depends on the angle: gravity-spring",
    },
    Entry {
        name: "torque-constant",
        scope: Scope::Joint,
        parameters: &[joint!(Size "relative_change" ["1"] torque_constant_change -0.9 ..= 10.0, 0.05,
            "relative change of motor torque per current", required)],
        alike: &["payload"],
        meaning: "the drive's gain differs",
        left_out: "saturation of the iron at high current",
    },
    Entry {
        name: "torque-ripple",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "amplitude" ["1"] ripple_share -1.0 ..= 1.0, 0.05, "relative amplitude of the torque constant", required),
            joint!(Shape "order" ["1"] ripple_order 0.001 ..= 24.0, 6.0, "periods per motor revolution"),
            joint!(Shape "phase_rad" ["rad"] ripple_phase_rad -6.3 ..= 6.3, 0.0,
                "greatest where order · motor angle + phase is zero", per_recording),
        ],
        alike: &["cogging", "transmission-error"],
        meaning: "torque per current varies with the motor's angle",
        left_out: "more than one harmonic",
    },
    Entry {
        name: "cogging",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "amplitude_nm" ["N m"] cogging_nm -100.0 ..= 100.0, 0.02,
                "amplitude of a motor torque over the motor's angle", required),
            joint!(Shape "order" ["1"] cogging_order 0.001 ..= 24.0, 12.0, "periods per motor revolution"),
            joint!(Shape "phase_rad" ["rad"] cogging_phase_rad -6.3 ..= 6.3, 0.0,
                "greatest forward torque where order · motor angle + phase is zero", per_recording),
        ],
        alike: &["torque-ripple", "transmission-error", "stribeck-friction", "quadratic-friction"],
        meaning: "the motor pulls toward certain angles, with or without current",
        left_out: "more than one harmonic",
    },
    Entry {
        name: "transmission-error",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "amplitude_rad" ["rad"] transmission_error_rad -0.1 ..= 0.1, 3e-4,
                "amplitude of the error of the measured position, as joint angle", required),
            joint!(Shape "order" ["1"] transmission_error_order 0.001 ..= 24.0, 1.0, "periods per motor revolution"),
            joint!(Shape "phase_rad" ["rad"] transmission_error_phase_rad -6.3 ..= 6.3, 0.0,
                "greatest where order · motor angle + phase is zero", per_recording),
        ],
        alike: &["torque-ripple", "cogging"],
        meaning: "the measured position errs with the angle: eccentricity of encoder or gear",
        left_out: "the torque that the link needs to follow an eccentric gear",
    },
    Entry {
        name: "joint-flexibility",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "compliance_rad_per_nm" ["rad/(N m)"] compliance_rad_per_nm 0.0 ..= 1.0, 3e-5,
                "twist of the shaft per torque, at the joint", required),
            joint!(Shape "damping_s" ["s"] shaft_damping_s 0.0 ..= 0.1, 2e-4, "the shaft's damping over its stiffness"),
            MOTOR_INERTIA,
        ],
        alike: &["backlash"],
        meaning: "the link hangs on the motor by a spring",
        left_out: "a spring that hardens, and hysteresis",
    },
    Entry {
        name: "backlash",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "gap_rad" ["rad"] gap_rad 0.0 ..= 0.2, 0.001, "angle between touching both flanks, at the joint", required),
            MOTOR_INERTIA,
        ],
        alike: &["joint-flexibility"],
        meaning: "play between the gear's teeth",
        left_out: "bouncing: teeth meet without rebound unless the shaft is flexible",
    },
    Entry {
        name: "current-lag",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "time_constant_s" ["s"] current_lag_s 0.0 ..= 0.05, 3e-4, "time constant of the current", required),
        ],
        alike: &[],
        meaning: "the current follows its command late",
        left_out: "overshoot of the current loop",
    },
    Entry {
        name: "current-saturation",
        scope: Scope::Joint,
        parameters: &[joint!(Size "limit_a" ["A"] current_limit_a 1e-3 ..= 1e6, 4.0,
            "the amplifier's largest current, where below the robot file's", required)],
        alike: &["voltage-saturation"],
        meaning: "the amplifier gives less current than thought",
        left_out: "limits that depend on heating",
    },
    Entry {
        name: "voltage-saturation",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "supply_v" ["V"] supply_v 0.1 ..= 1e6, 38.0, "voltage that the amplifier can give", required),
            joint!(Shape "winding_ohm" ["ohm"] winding_ohm 1e-3 ..= 1e4, 1.6, "resistance of the winding"),
        ],
        alike: &["current-saturation"],
        meaning: "at speed the amplifier's voltage no longer drives the current",
        left_out: "inductance; and a supply that sags",
    },
    Entry {
        name: "back-emf",
        scope: Scope::Joint,
        parameters: &[joint!(Size "current_a_s_per_rad" ["A s/rad"] back_emf_a_s_per_rad -100.0 ..= 100.0, 1.2e-3,
            "current missing per speed of the motor", required)],
        alike: &["viscous-friction"],
        meaning: "an imperfect current loop lets the back-EMF through",
        left_out: "the loop's own dynamics: current-lag",
    },
    Entry {
        name: "amplifier-dead-zone",
        scope: Scope::Joint,
        parameters: &[joint!(Size "width_a" ["A"] dead_zone_a 0.0 ..= 100.0, 0.1,
            "commands up to this give no current, greater ones this much less", required)],
        alike: &["coulomb-friction"],
        meaning: "small commands give no current",
        left_out: "a zone that is not symmetric: torque-offset beside it",
    },
    Entry {
        name: "payload",
        scope: Scope::Arm,
        parameters: &[
            arm!(Size "mass_kg" ["kg"] payload_kg -100.0 ..= 1000.0, 0.5, "mass of a body at the tool", required),
            arm!(Shape "x_m" ["m"] payload_x_m -3.0 ..= 3.0, -0.02, "its centre along x of frame 3"),
            arm!(Shape "y_m" ["m"] payload_y_m -3.0 ..= 3.0, -0.53, "its centre along y of frame 3"),
            arm!(Shape "gyration_m2" ["m²"] payload_gyration_m2 0.0 ..= 1.0, 0.0, "its own inertia per mass"),
        ],
        alike: &["torque-constant"],
        meaning: "a body at the tool: Δf along one known direction",
        left_out: "a body that swings, or is picked up during the recording",
    },
    Entry {
        name: "gravity-spring",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "torque_nm" ["N m"] spring_nm -1e4 ..= 1e4, 3.0, "torque amplitude over the joint's angle", required),
            joint!(Shape "angle_rad" ["rad"] spring_angle_rad -6.3 ..= 6.3, 0.0,
                "joint angle at which it pulls most in positive direction"),
        ],
        alike: &["base-tilt"],
        meaning: "a balance spring, torque · cos(q − angle) at the joint",
        left_out: "more than the first harmonic of a real spring's lever",
    },
    Entry {
        name: "base-tilt",
        scope: Scope::Arm,
        parameters: &[arm!(Size "angle_rad" ["rad"] tilt_rad -1.6 ..= 1.6, 0.02,
            "angle by which the base leans in the plane of the arm, toward positive q2", required)],
        alike: &["gravity-spring", "torque-offset"],
        meaning: "gravity comes from another direction",
        left_out: "leaning out of the plane, which only weakens gravity",
    },
    Entry {
        name: "count-loss",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "counts" ["counts"] slip_counts -1e6 ..= 1e6, 10.0, "counts shown more after the slip", required),
            joint!(Shape "instant_s" ["s"] slip_instant_s 0.0 ..= 1e6, 1.0,
                "when it slips, after the start of the recording", per_recording, required),
        ],
        alike: &[],
        meaning: "the encoder slips",
        left_out: "more than one slip a recording",
    },
    Entry {
        name: "external-contact",
        scope: Scope::Joint,
        parameters: &[
            joint!(Size "torque_nm" ["N m"] contact_nm -1e4 ..= 1e4, 3.0, "torque at the joint, in positive direction", required),
            joint!(Shape "start_s" ["s"] contact_start_s 0.0 ..= 1e6, 1.0,
                "when it begins, after the start of the recording", per_recording, required),
            joint!(Shape "duration_s" ["s"] contact_duration_s 0.0 ..= 1e6, 0.5, "how long it lasts", per_recording),
        ],
        alike: &[],
        meaning: "something pushes for a while",
        left_out: "a torque that varies with the position of what is touched",
    },
];

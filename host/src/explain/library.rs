//! The effects `explain` knows: their parameters, where they may lie, and what is tried first.

use shared::effects::{Effects, JointEffects};

/// What a parameter is to its effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// How strong the effect is: at its neutral value there is none.
    Size,
    /// Its shape.
    Shape,
    /// An angle with all directions alike.
    Phase,
    /// A moment at which something changes, or how long after another.
    Moment,
    /// Its shape, of which next to all is known beforehand: its range is narrow, and the recordings tell little more.
    Detail,
}

/// One parameter of an effect.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Name with the unit.
    pub name: &'static str,
    /// Unit alone.
    pub unit: &'static str,
    /// Its place among the effects of both joints and the arm.
    pub place: Place,
    /// What it is to its effect.
    pub role: Role,
    /// Step of its derivative.
    pub step: f64,
    /// Least and greatest value.
    pub range: [f64; 2],
    /// Whether every recording has its own: instants, and phases where the motor angle is counted from where the robot
    /// was switched on.
    pub per_record: bool,
}

/// Where a number of the effects is.
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// Of one joint.
    Joint(fn(&mut JointEffects<f64>) -> &mut f64),
    /// Of the whole arm.
    Arm(fn(&mut Effects<f64>) -> &mut f64),
}

impl Parameter {
    /// What it is where nothing else is said: off, or the usual shape.
    pub fn usual(&self) -> f64 {
        let mut effects = Effects::OFF;
        *self.of(&mut effects, 0)
    }

    /// How many parameters it counts for where ΔBIC sets a price on them. A moment can be anywhere in a recording, so that
    /// chance has as many tries: it counts for two (modified BIC of Zhang and Siegmund, Biometrics 63, 2007). What a detail
    /// costs hangs on how much the recordings tell of it ([`Parameter::price_of_detail`]).
    fn price(&self) -> usize {
        match self.role {
            Role::Moment => 2,
            Role::Detail => 0,
            Role::Size | Role::Shape | Role::Phase => 1,
        }
    }

    /// What a detail costs in χ² that was found with this standard error, where others cost `whole`: nothing if it can be
    /// anywhere in its range still (the volume of its posterior over that of its prior, as in Laplace's approximation, which
    /// BIC is the limit of).
    pub fn price_of_detail(&self, standard_error: f64, whole: f64) -> f64 {
        let [low, high] = self.range;
        (2.0 * ((high - low) / standard_error).ln()).clamp(0.0, whole)
    }

    /// The number itself.
    pub fn of<'a>(&self, effects: &'a mut Effects<f64>, joint: usize) -> &'a mut f64 {
        match self.place {
            Place::Joint(place) => place(&mut effects.joints[joint]),
            Place::Arm(place) => place(effects),
        }
    }
}

/// How an effect is first looked for.
#[derive(Clone, Copy, Debug)]
pub enum Search {
    /// Proportional to its first parameter: one derivative at each of these values of the others (in their order).
    Proportional(&'static [&'static [f64]]),
    /// A wave: derivatives by its first parameter at two phases a quarter apart. Orders that are tried, or none for
    /// those that a scan of the residual finds.
    Wave(Option<&'static [f64]>),
    /// Not proportional: simulated at these values; parameters that have none begin at what is usual.
    Finite(&'static [&'static [f64]]),
    /// A limit: simulated at these shares of the largest demand; other parameters as given.
    Limit(&'static [f64]),
    /// Where the residual jumps most, in every recording.
    Instant,
}

/// An effect of the library.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Its name: a contract.
    pub name: &'static str,
    /// Whether it is the whole arm's, not one joint's.
    pub of_arm: bool,
    /// Its parameters: sizes first.
    pub parameters: &'static [Parameter],
    /// How it is looked for.
    pub search: Search,
    /// Effects that tracking errors and currents cannot tell from it.
    pub equivalent: &'static [&'static str],
    /// What it is called in a sentence.
    pub phrase: &'static str,
}

impl Kind {
    /// How many parameters the effect counts for in so many recordings where ΔBIC sets a price on them.
    pub fn price(&self, records: usize) -> f64 {
        let of = |parameter: &Parameter| parameter.price() * if parameter.per_record { records } else { 1 };
        self.parameters.iter().map(of).sum::<usize>() as f64
    }
}

macro_rules! joint {
    ($field:ident) => {
        Place::Joint(|effects| &mut effects.$field)
    };
}
macro_rules! arm {
    ($field:ident) => {
        Place::Arm(|effects| &mut effects.arm.$field)
    };
}

/// A parameter that says how strong an effect is.
pub const fn size(name: &'static str, unit: &'static str, place: Place, step: f64, range: [f64; 2]) -> Parameter {
    Parameter { name, unit, place, role: Role::Size, step, range, per_record: false }
}
const fn shape(name: &'static str, unit: &'static str, place: Place, step: f64, range: [f64; 2]) -> Parameter {
    Parameter { name, unit, place, role: Role::Shape, step, range, per_record: false }
}
const fn detail(name: &'static str, unit: &'static str, place: Place, step: f64, range: [f64; 2]) -> Parameter {
    Parameter { name, unit, place, role: Role::Detail, step, range, per_record: false }
}
const fn phase(name: &'static str, place: Place, per_record: bool) -> Parameter {
    Parameter { name, unit: "rad", place, role: Role::Phase, step: 1e-3, range: [-1e3, 1e3], per_record }
}

/// Both ends unlimited, for what has no sign of its own.
pub const ANY: [f64; 2] = [-1e6, 1e6];

/// How a joint's inertia is shared out between motor and link, once something gives way between them.
pub const MOTOR_INERTIA: Parameter =
    shape("motor_inertia_kg_m2", "kg m²", joint!(motor_inertia_kg_m2), 1e-6, [1e-7, 10.0]);

/// The library.
pub const LIBRARY: [Kind; 26] = [
    Kind {
        name: "coulomb-friction",
        of_arm: false,
        parameters: &[size("change_nm", "N m", joint!(coulomb_change_nm), 1e-3, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "a changed Coulomb friction",
    },
    Kind {
        name: "viscous-friction",
        of_arm: false,
        parameters: &[size("change_nm_s_per_rad", "N m s/rad", joint!(viscous_change_nm_s_per_rad), 1e-5, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &["back-emf"],
        phrase: "a changed viscous friction",
    },
    Kind {
        name: "asymmetric-friction",
        of_arm: false,
        parameters: &[size("difference_nm", "N m", joint!(coulomb_asymmetry_nm), 1e-3, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &["torque-offset"],
        phrase: "Coulomb friction that differs by direction",
    },
    Kind {
        name: "asymmetric-viscous-friction",
        of_arm: false,
        parameters: &[size("difference_nm_s_per_rad", "N m s/rad", joint!(viscous_asymmetry_nm_s_per_rad), 1e-5, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "viscous friction that differs by direction",
    },
    Kind {
        name: "stribeck-friction",
        of_arm: false,
        parameters: &[
            size("extra_nm", "N m", joint!(stribeck_nm), 1e-3, ANY),
            shape("velocity_rad_s", "rad/s", joint!(stribeck_velocity_rad_s), 1e-3, [1e-3, 60.0]),
        ],
        search: Search::Proportional(&[&[3.0], &[6.0], &[12.0], &[24.0]]),
        equivalent: &[],
        phrase: "friction of another level at low speed",
    },
    Kind {
        name: "load-dependent-friction",
        of_arm: false,
        parameters: &[
            size("coefficient", "", joint!(load_friction_coefficient), 1e-3, [-1.0, 1.0]),
            // What the gear transmits is what the motor's own inertia does not take.
            detail("motor_inertia_kg_m2", "kg m²", joint!(motor_inertia_kg_m2), 1e-5, [1e-7, 2e-3]),
        ],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "friction that grows with the load",
    },
    Kind {
        name: "position-dependent-friction",
        of_arm: false,
        parameters: &[
            size("amplitude_nm", "N m", joint!(position_friction_nm), 1e-3, ANY),
            phase("phase_rad", joint!(position_friction_phase_rad), false),
            shape("order", "per joint turn", joint!(position_friction_order), 0.01, [0.2, 1e3]),
        ],
        search: Search::Wave(Some(&[1.2, 2.0, 2.8, 3.6, 4.4, 5.2, 6.0, 7.5, 9.0, 11.0, 13.0])),
        equivalent: &[],
        phrase: "friction that depends on position",
    },
    Kind {
        name: "friction-drift",
        of_arm: false,
        parameters: &[size("rate_nm_per_s", "N m/s", joint!(friction_drift_nm_per_s), 1e-4, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "friction that drifts in time",
    },
    Kind {
        name: "quadratic-friction",
        of_arm: false,
        parameters: &[size("coefficient_nm_s2_per_rad2", "N m s²/rad²", joint!(quadratic_nm_s2_per_rad2), 1e-7, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "friction that grows with the square of the speed",
    },
    Kind {
        name: "torque-offset",
        of_arm: false,
        parameters: &[size("torque_nm", "N m", joint!(torque_offset_nm), 1e-3, ANY)],
        search: Search::Proportional(&[&[]]),
        equivalent: &["asymmetric-friction"],
        phrase: "a constant torque",
    },
    Kind {
        name: "torque-constant",
        of_arm: false,
        parameters: &[size("relative_change", "", joint!(torque_constant_change), 1e-3, [-0.9, 9.0])],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "a changed torque per ampere",
    },
    Kind {
        name: "torque-ripple",
        of_arm: false,
        parameters: &[
            size("amplitude", "", joint!(ripple_share), 1e-3, [-0.9, 0.9]),
            phase("phase_rad", joint!(ripple_phase_rad), true),
            shape("order", "per motor turn", joint!(ripple_order), 1e-3, [0.05, 1e5]),
        ],
        search: Search::Wave(None),
        equivalent: &[],
        phrase: "torque ripple",
    },
    Kind {
        name: "cogging",
        of_arm: false,
        parameters: &[
            size("amplitude_nm", "N m", joint!(cogging_nm), 1e-3, ANY),
            phase("phase_rad", joint!(cogging_phase_rad), true),
            shape("order", "per motor turn", joint!(cogging_order), 1e-3, [0.05, 1e5]),
        ],
        search: Search::Wave(None),
        equivalent: &[],
        phrase: "cogging",
    },
    Kind {
        name: "transmission-error",
        of_arm: false,
        parameters: &[
            size("amplitude_rad", "rad", joint!(transmission_error_rad), 1e-5, ANY),
            phase("phase_rad", joint!(transmission_error_phase_rad), true),
            shape("order", "per motor turn", joint!(transmission_error_order), 1e-3, [0.05, 1e5]),
        ],
        search: Search::Wave(None),
        equivalent: &[],
        phrase: "a periodic position error",
    },
    Kind {
        name: "joint-flexibility",
        of_arm: false,
        parameters: &[
            size("compliance_rad_per_nm", "rad/(N m)", joint!(compliance_rad_per_nm), 1e-6, [0.0, 1e-2]),
            shape("damping_s", "s", joint!(shaft_damping_s), 1e-5, [0.0, 0.01]),
            MOTOR_INERTIA,
        ],
        search: Search::Finite(&[
            &[3e-6, 4e-4],
            &[7e-6, 4e-4],
            &[1.5e-5, 4e-4],
            &[3e-5, 4e-4],
            &[6e-5, 4e-4],
            &[1e-4, 4e-4],
            &[1.6e-4, 4e-4],
            &[2.5e-4, 4e-4],
            &[4e-4, 4e-4],
            &[6e-4, 4e-4],
        ]),
        equivalent: &[],
        phrase: "flexibility between motor and link",
    },
    Kind {
        name: "backlash",
        of_arm: false,
        parameters: &[size("gap_rad", "rad", joint!(gap_rad), 1e-5, [0.0, 0.1]), MOTOR_INERTIA],
        search: Search::Finite(&[
            &[1e-4],
            &[1.6e-4],
            &[2.5e-4],
            &[3.5e-4],
            &[4.5e-4],
            &[5.5e-4],
            &[7e-4],
            &[8.5e-4],
            &[1e-3],
            &[1.25e-3],
            &[1.5e-3],
            &[1.8e-3],
            &[2.2e-3],
            &[2.7e-3],
            &[3.4e-3],
            &[4.2e-3],
            &[5e-3],
        ]),
        equivalent: &[],
        phrase: "backlash",
    },
    Kind {
        name: "current-lag",
        of_arm: false,
        parameters: &[size("time_constant_s", "s", joint!(current_lag_s), 5e-6, [0.0, 0.02])],
        search: Search::Finite(&[&[5e-5], &[1.5e-4], &[4e-4], &[1e-3]]),
        equivalent: &[],
        phrase: "a lag of the current",
    },
    Kind {
        name: "current-saturation",
        of_arm: false,
        parameters: &[size("limit_a", "A", joint!(current_limit_a), 0.02, [0.05, 1e3])],
        search: Search::Limit(&[0.995, 0.985, 0.95, 0.9, 0.8, 0.7]),
        equivalent: &[],
        phrase: "a current limit",
    },
    Kind {
        name: "voltage-saturation",
        of_arm: false,
        parameters: &[
            size("supply_v", "V", joint!(supply_v), 0.05, [0.5, 1e4]),
            shape("winding_ohm", "Ω", joint!(winding_ohm), 0.01, [0.3, 10.0]),
        ],
        search: Search::Limit(&[0.995, 0.985, 0.95, 0.9, 0.8, 0.7]),
        equivalent: &[],
        phrase: "a voltage limit",
    },
    Kind {
        name: "back-emf",
        of_arm: false,
        parameters: &[size("current_a_s_per_rad", "A s/rad", joint!(back_emf_a_s_per_rad), 1e-5, [0.0, 1.0])],
        search: Search::Proportional(&[&[]]),
        equivalent: &["viscous-friction"],
        phrase: "current lost to the motor's speed",
    },
    Kind {
        name: "amplifier-dead-zone",
        of_arm: false,
        parameters: &[size("width_a", "A", joint!(dead_zone_a), 2e-3, [0.0, 10.0])],
        search: Search::Finite(&[&[0.01], &[0.04], &[0.1], &[0.2], &[0.4]]),
        equivalent: &[],
        phrase: "a dead zone of the amplifier",
    },
    Kind {
        name: "payload",
        of_arm: true,
        parameters: &[
            size("mass_kg", "kg", arm!(payload_kg), 1e-3, [-20.0, 20.0]),
            detail("x_m", "m", arm!(payload_x_m), 1e-3, [-0.15, 0.15]),
            detail("y_m", "m", arm!(payload_y_m), 1e-3, [-0.75, -0.1]),
        ],
        search: Search::Proportional(&[&[0.0, -0.35], &[0.0, -0.45], &[0.0, -0.55]]),
        equivalent: &[],
        phrase: "a payload",
    },
    Kind {
        name: "gravity-spring",
        of_arm: false,
        parameters: &[
            size("torque_nm", "N m", joint!(spring_nm), 1e-2, ANY),
            phase("angle_rad", joint!(spring_angle_rad), false),
        ],
        search: Search::Wave(Some(&[1.0])),
        equivalent: &[],
        phrase: "a balance spring",
    },
    Kind {
        name: "base-tilt",
        of_arm: true,
        parameters: &[size("angle_rad", "rad", arm!(tilt_rad), 1e-4, [-0.7, 0.7])],
        search: Search::Proportional(&[&[]]),
        equivalent: &[],
        phrase: "a base that leans",
    },
    Kind {
        name: "count-loss",
        of_arm: false,
        parameters: &[
            size("counts", "counts", joint!(slip_counts), 0.05, ANY),
            Parameter {
                name: "instant_s",
                unit: "s",
                place: joint!(slip_instant_s),
                role: Role::Moment,
                step: 2e-4,
                range: [-1.0, 1e5],
                per_record: true,
            },
        ],
        search: Search::Instant,
        equivalent: &[],
        phrase: "counts lost by the encoder",
    },
    Kind {
        name: "external-contact",
        of_arm: false,
        parameters: &[
            size("torque_nm", "N m", joint!(contact_nm), 1e-2, ANY),
            Parameter {
                name: "duration_s",
                unit: "s",
                place: joint!(contact_duration_s),
                role: Role::Moment,
                step: 2e-3,
                range: [0.02, 3.0],
                per_record: false,
            },
            Parameter {
                name: "start_s",
                unit: "s",
                place: joint!(contact_start_s),
                role: Role::Moment,
                step: 2e-3,
                range: [-3.0, 1e5],
                per_record: true,
            },
        ],
        search: Search::Instant,
        equivalent: &[],
        phrase: "a contact from outside",
    },
];

/// The effect of this name.
pub fn kind(name: &str) -> Option<&'static Kind> {
    LIBRARY.iter().find(|kind| kind.name == name)
}

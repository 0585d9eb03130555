//! The machine with everything that may be wrong with it, all quantities in SI units.
//!
//! Each part holds its own faults, all of them absent in [`Machine::healthy`]. Nothing here is shared with the plant
//! that the identification uses: these are the laws as the literature on drives and friction writes them.

use crate::simulator::{Arm, BaseParameters, Robot};

use super::outside::Outside;

/// A cosine of an angle: `amplitude · cos(order · angle + phase)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wave {
    /// Amplitude in the unit of what it disturbs; 0 for none.
    pub amplitude: f64,
    /// Waves per 2π of the angle; need not be whole.
    pub order: f64,
    /// Phase at angle zero in rad.
    pub phase_rad: f64,
}

impl Wave {
    /// The wave's value at `angle_rad`.
    #[must_use]
    pub fn at(&self, angle_rad: f64) -> f64 {
        if self.amplitude == 0.0 { 0.0 } else { self.amplitude * (self.order * angle_rad + self.phase_rad).cos() }
    }
}

/// Friction at one motor. "Up" is motion of the motor (not of the joint) toward larger angles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Friction {
    /// Mean Coulomb friction in N m.
    pub coulomb_nm: f64,
    /// Half of the difference of the Coulomb friction upward less downward, in N m.
    pub coulomb_asymmetry_nm: f64,
    /// Mean viscous friction in N m s/rad.
    pub viscous_nm_s_per_rad: f64,
    /// Half of the difference of the viscous friction upward less downward, in N m s/rad.
    pub viscous_asymmetry_nm_s_per_rad: f64,
    /// Extra friction at standstill in N m; negative for friction that rises with speed.
    pub stribeck_nm: f64,
    /// Motor speed in rad/s where the extra friction has fallen to 1/e.
    pub stribeck_speed_rad_s: f64,
    /// Exponent of the fall: 2 for a Gaussian, 1 for an exponential.
    pub stribeck_exponent: f64,
    /// Friction per N m that the gear transmits, both at the motor.
    pub load_share: f64,
    /// Relative change of the Coulomb friction over the joint's angle.
    pub over_angle: Wave,
    /// Relative change of the Coulomb friction per second since the record's start.
    pub drift_per_s: f64,
    /// Torque per squared motor speed in N m s²/rad².
    pub quadratic_nm_s2_per_rad2: f64,
}

/// Where and how a motor slides.
#[derive(Clone, Copy, Debug)]
pub struct Sliding {
    /// Motor speed in rad/s.
    pub speed_rad_s: f64,
    /// The joint's angle in rad.
    pub joint_angle_rad: f64,
    /// Seconds since the record's start; negative while the arm is held before.
    pub time_s: f64,
    /// Torque that the gear transmits, at the motor, in N m.
    pub load_nm: f64,
}

impl Friction {
    /// What opposes a motion in `direction` (1 or -1, of the motor) apart from what grows with speed, in N m.
    #[must_use]
    pub fn level_nm(&self, direction: f64, sliding: &Sliding) -> f64 {
        let coulomb_nm = (self.coulomb_nm + self.coulomb_asymmetry_nm * direction)
            * (1.0 + self.over_angle.at(sliding.joint_angle_rad))
            * (1.0 + self.drift_per_s * sliding.time_s.max(0.0));
        let stribeck_nm = if self.stribeck_nm == 0.0 {
            0.0
        } else {
            let relative = sliding.speed_rad_s.abs() / self.stribeck_speed_rad_s;
            self.stribeck_nm * (-relative.powf(self.stribeck_exponent)).exp()
        };
        (coulomb_nm + stribeck_nm + self.load_share * sliding.load_nm.abs()).max(0.0)
    }

    /// What grows with speed, with the sign of `speed_rad_s`, in N m.
    #[must_use]
    pub fn viscous_nm(&self, speed_rad_s: f64) -> f64 {
        let slope = self.viscous_nm_s_per_rad + self.viscous_asymmetry_nm_s_per_rad * speed_rad_s.signum();
        (slope + self.quadratic_nm_s2_per_rad2 * speed_rad_s.abs()) * speed_rad_s
    }
}

/// The end of the supply voltage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoltageLimit {
    /// Supply voltage in V.
    pub limit_v: f64,
    /// Winding resistance in Ω.
    pub resistance_ohm: f64,
    /// Induced voltage per motor speed in V s/rad.
    pub emf_v_s_per_rad: f64,
}

/// From the command to the current.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplifier {
    /// Largest current in A.
    pub limit_a: f64,
    /// Taken off the magnitude of the command, in A.
    pub dead_zone_a: f64,
    /// Current lost per motor speed, in A s/rad: a current loop that does not reject the induced voltage.
    pub back_emf_a_s_per_rad: f64,
    /// The supply's end, if it is reached.
    pub voltage: Option<VoltageLimit>,
    /// First-order lag of the current in s; 0 for none.
    pub lag_s: f64,
    /// Fastest change of the current in A/s, if limited.
    pub slew_a_per_s: Option<f64>,
}

impl Amplifier {
    /// The current that flows once the lag is over.
    #[must_use]
    pub fn settled_a(&self, command_a: f64, motor_speed_rad_s: f64) -> f64 {
        let live_a = command_a - command_a.clamp(-self.dead_zone_a, self.dead_zone_a);
        let limited_a = live_a.clamp(-self.limit_a, self.limit_a) - self.back_emf_a_s_per_rad * motor_speed_rad_s;
        match self.voltage {
            None => limited_a,
            Some(voltage) => {
                let induced_v = voltage.emf_v_s_per_rad * motor_speed_rad_s;
                let reach = |end_v: f64| (end_v - induced_v) / voltage.resistance_ohm;
                limited_a.clamp(reach(-voltage.limit_v), reach(voltage.limit_v))
            }
        }
    }
}

/// What lies between motor and link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Transmission {
    /// Motor and link turn as one.
    Rigid,
    /// A spring with play; all quantities at the joint.
    Elastic {
        /// Stiffness in N m/rad.
        stiffness_nm_per_rad: f64,
        /// Hardening: torque per cubed deflection in N m/rad³.
        hardening_nm_per_rad3: f64,
        /// Damping in N m s/rad, while the spring is loaded.
        damping_nm_s_per_rad: f64,
        /// Whole play in rad.
        gap_rad: f64,
    },
}

impl Transmission {
    /// Torque on the link in N m when the motor is ahead by `ahead_rad` and gaining `gaining_rad_s`, at the joint.
    #[must_use]
    pub fn torque_nm(&self, ahead_rad: f64, gaining_rad_s: f64) -> f64 {
        match *self {
            Self::Rigid => 0.0,
            Self::Elastic { stiffness_nm_per_rad, hardening_nm_per_rad3, damping_nm_s_per_rad, gap_rad } => {
                let half = 0.5 * gap_rad;
                let wound_rad = ahead_rad - ahead_rad.clamp(-half, half);
                if wound_rad == 0.0 {
                    return 0.0;
                }
                let torque = stiffness_nm_per_rad * wound_rad
                    + hardening_nm_per_rad3 * wound_rad.powi(3)
                    + damping_nm_s_per_rad * gaining_rad_s;
                // Teeth push; the damping of a contact that opens must not pull.
                if gap_rad > 0.0 && torque * wound_rad < 0.0 { 0.0 } else { torque }
            }
        }
    }
}

/// A constant joint torque over an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Seconds from the record's start.
    pub start_s: f64,
    /// How long, in s.
    pub duration_s: f64,
    /// Torque on the joint in N m.
    pub torque_nm: f64,
}

/// Counts that the encoder loses at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slip {
    /// Seconds from the record's start.
    pub time_s: f64,
    /// Added to every later count.
    pub counts: f64,
}

/// One joint with its motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Motor turns per joint turn, negative where the motor turns the other way.
    pub gear_ratio: f64,
    /// Counts per motor turn.
    pub counts_per_rev: f64,
    /// Motor torque per ampere in N m/A.
    pub torque_constant_nm_per_a: f64,
    /// Gain of the position loop in A per count.
    pub gain_a_per_count: f64,
    /// Largest command in A.
    pub command_limit_a: f64,
    /// Inertia of the rotor seen at the joint in kg m²; part of the arm's parameters, taken out if the joint is elastic.
    pub motor_inertia_kg_m2: f64,
    /// Friction at the motor.
    pub friction: Friction,
    /// From command to current.
    pub amplifier: Amplifier,
    /// Constant torque that the motor has to overcome in N m: it is taken off the motor's torque.
    pub torque_offset_nm: f64,
    /// Relative change of the torque constant over the motor angle.
    pub ripple: Wave,
    /// Motor torque over the motor angle in N m.
    pub cogging: Wave,
    /// Error of the encoder over the motor angle in counts.
    pub encoder_error_counts: Wave,
    /// Where between two counts the encoder's zero lies, in counts.
    pub encoder_phase_counts: f64,
    /// The encoder slips.
    pub slip: Option<Slip>,
    /// Something touches the arm.
    pub contact: Option<Contact>,
    /// A balance spring's torque on the joint over the joint's angle in N m.
    pub balance_spring_nm: Wave,
    /// Between motor and link.
    pub transmission: Transmission,
}

impl Joint {
    /// Counts per radian of the joint, with the gear's sign.
    #[must_use]
    pub fn counts_per_rad(&self) -> f64 {
        self.gear_ratio * self.counts_per_rev / std::f64::consts::TAU
    }

    /// What the encoder counts with the motor at `motor_angle_rad` (of the motor), not yet a whole number.
    #[must_use]
    pub fn encoder_counts(&self, motor_angle_rad: f64, time_s: f64) -> f64 {
        let slipped = self.slip.map_or(0.0, |slip| if time_s >= slip.time_s { slip.counts } else { 0.0 });
        motor_angle_rad * self.counts_per_rev / std::f64::consts::TAU
            + self.encoder_error_counts.at(motor_angle_rad)
            + self.encoder_phase_counts
            + slipped
    }
}

/// A whole machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// The arm, motor inertias included.
    pub base: BaseParameters,
    /// Gravity in m/s².
    pub gravity_m_s2: f64,
    /// Turn of the base in the arm's plane in rad: gravity acts as if joint 2 were further on by this angle.
    pub base_tilt_rad: f64,
    /// From sampling to the new current in s.
    pub command_delay_s: f64,
    /// Time between two samples of the loop in s.
    pub period_s: f64,
    /// The command is rounded to a 12-bit converter's codes.
    pub converter: bool,
    /// Joints "2" and "3".
    pub joints: [Joint; 2],
    /// Something that no library of effects contains.
    pub outside: Option<Outside>,
}

impl Machine {
    /// Whether a joint has friction that holds it at rest: not where friction builds up over a travel instead.
    #[must_use]
    pub fn sticks(&self, joint: usize) -> bool {
        let builds_up = matches!(self.outside, Some(Outside::PreSliding { joint: sliding, .. }) if sliding == joint);
        self.joints[joint].friction.coulomb_nm > 0.0 && !builds_up
    }

    /// `robot` without any fault. `rotor_inertia_kg_m2` is that of the shoulder's motor itself; the elbow's follows
    /// from `f1 - f2`.
    #[must_use]
    pub fn healthy(robot: &Robot, rotor_inertia_kg_m2: f64) -> Self {
        let base = match robot.arm {
            Arm::Base(base) => base,
            Arm::Links(links) => links.base_parameters(),
        };
        let joints = std::array::from_fn(|index| {
            let drive = &robot.drives[index];
            let of_rotor = [rotor_inertia_kg_m2 * drive.gear_ratio.powi(2), base.0[0] - base.0[1]];
            Joint {
                gear_ratio: drive.gear_ratio,
                counts_per_rev: drive.counts_per_rev,
                torque_constant_nm_per_a: drive.torque_constant_nm_per_a,
                gain_a_per_count: drive.position_gain_a_per_count,
                command_limit_a: drive.current_limit_a,
                motor_inertia_kg_m2: of_rotor[index],
                friction: Friction {
                    coulomb_nm: drive.coulomb_friction_nm,
                    viscous_nm_s_per_rad: drive.viscous_friction_nm_s_per_rad,
                    ..Friction::default()
                },
                amplifier: Amplifier {
                    limit_a: drive.current_limit_a,
                    dead_zone_a: 0.0,
                    back_emf_a_s_per_rad: 0.0,
                    voltage: None,
                    lag_s: 0.0,
                    slew_a_per_s: None,
                },
                torque_offset_nm: 0.0,
                ripple: Wave::default(),
                cogging: Wave::default(),
                encoder_error_counts: Wave::default(),
                encoder_phase_counts: 0.0,
                slip: None,
                contact: None,
                balance_spring_nm: Wave::default(),
                transmission: Transmission::Rigid,
            }
        });
        Self {
            base,
            gravity_m_s2: robot.gravity_m_s2,
            base_tilt_rad: 0.0,
            command_delay_s: robot.command_delay_s,
            period_s: robot.loop_period_s,
            converter: false,
            joints,
            outside: None,
        }
    }
}

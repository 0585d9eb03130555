//! Faults that no library of effects contains: a good verdict on them is "unknown", never a name.

use std::f64::consts::TAU;

use crate::simulator::BaseParameters;
use crate::simulator::base_parameters::UPPER_ARM_LENGTH_M;

use super::draw::Draw;
use super::library::{Injected, link_inertia_kg_m2};
use super::machine::{Machine, Transmission};

/// States that an outside fault may need in the integration.
pub const STATES: usize = 2;

/// One fault outside the library. Torques and stiffnesses are at the joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outside {
    /// Coulomb friction replaced by Dahl's: it builds up over a travel instead of at once.
    PreSliding {
        /// Which joint.
        joint: usize,
        /// Joint travel in rad over which friction turns round (1/e).
        travel_rad: f64,
    },
    /// A cable that resists bending with hysteresis, on top of everything else.
    CableHysteresis {
        /// Which joint.
        joint: usize,
        /// Largest torque in N m.
        torque_nm: f64,
        /// Joint travel in rad over which it turns round (1/e).
        travel_rad: f64,
        /// Its elastic part in N m/rad.
        stiffness_nm_per_rad: f64,
    },
    /// The encoder is read at the wrong instant, by a time that wanders.
    SamplingJitter {
        /// Which joint.
        joint: usize,
        /// Standard deviation of the instant in s.
        deviation_s: f64,
        /// Correlation time of the wandering in s.
        correlation_s: f64,
    },
    /// A motor that loses torque as its current warms it.
    WarmMotor {
        /// Which joint.
        joint: usize,
        /// Relative loss of torque per A² s of heat kept.
        loss_per_a2_s: f64,
        /// Cooling time in s.
        cooling_s: f64,
    },
    /// A tool that swings on the forearm against a spring.
    ResonantTool {
        /// Its inertia in kg m².
        inertia_kg_m2: f64,
        /// Its frequency with the forearm held, in Hz.
        frequency_hz: f64,
        /// Its damping ratio.
        damping_ratio: f64,
    },
    /// A balance spring with slack in its middle.
    SlackSpring {
        /// Which joint.
        joint: usize,
        /// Stiffness in N m/rad.
        stiffness_nm_per_rad: f64,
        /// Joint angle in the middle of the slack in rad.
        centre_rad: f64,
        /// Half of the slack in rad.
        half_slack_rad: f64,
    },
    /// The current's rate is limited.
    SlewLimit {
        /// Which joint.
        joint: usize,
        /// Fastest change in A/s.
        slew_a_per_s: f64,
    },
    /// The whole arm turns about the vertical meanwhile: centrifugal forces.
    TurningBase {
        /// Largest turning speed in rad/s.
        speed_rad_s: f64,
        /// Turning frequency in Hz.
        frequency_hz: f64,
        /// Phase at the record's start in rad.
        phase_rad: f64,
        /// Mass on the upper arm's middle and on the forearm's tip in kg.
        masses_kg: [f64; 2],
    },
    /// A cable that catches and lets go: torque rising over a travel and falling at once, against the motion.
    CatchingCable {
        /// Which joint.
        joint: usize,
        /// Largest torque in N m.
        torque_nm: f64,
        /// Joint travel between two catches in rad.
        pitch_rad: f64,
    },
    /// The floor moves up and down.
    FloorVibration {
        /// Acceleration amplitude in m/s².
        acceleration_m_s2: f64,
        /// Frequency in Hz.
        frequency_hz: f64,
        /// Phase at the record's start in rad.
        phase_rad: f64,
    },
    /// One motor's current adds to the other's torque.
    Crosstalk {
        /// Whose torque is disturbed.
        joint: usize,
        /// Share of the other motor's torque constant times current.
        share: f64,
    },
    /// The encoder shows only every few counts.
    CoarseEncoder {
        /// Which joint.
        joint: usize,
        /// Counts per step.
        step_counts: f64,
    },
    /// Motor and link joined by a spring that hardens, soft about its middle.
    HardeningGear {
        /// Which joint; its transmission holds the numbers.
        joint: usize,
    },
}

impl Outside {
    /// Its name in truth files and tables.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::PreSliding { .. } => "outside:pre-sliding",
            Self::CableHysteresis { .. } => "outside:cable-hysteresis",
            Self::SamplingJitter { .. } => "outside:sampling-jitter",
            Self::WarmMotor { .. } => "outside:warm-motor",
            Self::ResonantTool { .. } => "outside:resonant-tool",
            Self::SlackSpring { .. } => "outside:slack-spring",
            Self::SlewLimit { .. } => "outside:slew-limit",
            Self::TurningBase { .. } => "outside:turning-base",
            Self::CatchingCable { .. } => "outside:catching-cable",
            Self::FloorVibration { .. } => "outside:floor-vibration",
            Self::Crosstalk { .. } => "outside:crosstalk",
            Self::CoarseEncoder { .. } => "outside:coarse-encoder",
            Self::HardeningGear { .. } => "outside:hardening-gear",
        }
    }

    /// Torque on both links in N m that depends on time and position and speed alone.
    #[must_use]
    pub fn link_torque_nm(&self, angle_rad: [f64; 2], velocity_rad_s: [f64; 2], time_s: f64) -> [f64; 2] {
        let on = |joint: usize, torque: f64| if joint == 0 { [torque, 0.0] } else { [0.0, torque] };
        match *self {
            Self::SlackSpring { joint, stiffness_nm_per_rad, centre_rad, half_slack_rad } => {
                let off = angle_rad[joint] - centre_rad;
                on(joint, -stiffness_nm_per_rad * (off - off.clamp(-half_slack_rad, half_slack_rad)))
            }
            Self::CatchingCable { joint, torque_nm, pitch_rad } => {
                // Rises along the motion and lets go once per pitch; going back it rises the other way.
                let turns = angle_rad[joint] / pitch_rad;
                let along = if velocity_rad_s[joint] >= 0.0 { turns.rem_euclid(1.0) } else { (-turns).rem_euclid(1.0) };
                // Fades in with speed so that it holds nothing at standstill.
                on(joint, -torque_nm * along * (velocity_rad_s[joint] / 0.02).tanh())
            }
            Self::TurningBase { speed_rad_s, frequency_hz, phase_rad, masses_kg } => {
                let turning = speed_rad_s * (TAU * frequency_hz * time_s.max(0.0) + phase_rad).sin();
                // The slope over each angle of ½ Σ m r², r the distance from the vertical axis.
                let (upper_sin, upper_cos) = angle_rad[0].sin_cos();
                let (fore_sin, fore_cos) = (angle_rad[0] + angle_rad[1]).sin_cos();
                const FOREARM_M: f64 = 0.43;
                let [upper, fore] = masses_kg;
                let middle = 0.5 * UPPER_ARM_LENGTH_M;
                let tip = UPPER_ARM_LENGTH_M * upper_cos + FOREARM_M * fore_sin;
                let over_fore = fore * tip * FOREARM_M * fore_cos;
                let over_upper =
                    -upper * middle * middle * upper_cos * upper_sin - fore * tip * UPPER_ARM_LENGTH_M * upper_sin;
                [turning * turning * (over_upper + over_fore), turning * turning * over_fore]
            }
            _ => [0.0; 2],
        }
    }

    /// Added to gravity in m/s².
    #[must_use]
    pub fn added_gravity_m_s2(&self, time_s: f64) -> f64 {
        match *self {
            Self::FloorVibration { acceleration_m_s2, frequency_hz, phase_rad } => {
                acceleration_m_s2 * (TAU * frequency_hz * time_s + phase_rad).sin()
            }
            _ => 0.0,
        }
    }
}

/// Names of all kinds, in the order of [`put`].
pub const NAMES: [&str; 13] = [
    "outside:pre-sliding",
    "outside:cable-hysteresis",
    "outside:sampling-jitter",
    "outside:warm-motor",
    "outside:resonant-tool",
    "outside:slack-spring",
    "outside:slew-limit",
    "outside:turning-base",
    "outside:catching-cable",
    "outside:floor-vibration",
    "outside:crosstalk",
    "outside:coarse-encoder",
    "outside:hardening-gear",
];

/// Puts the fault `name` into the machines of all records; `size` 1 is clear.
///
/// # Panics
/// If there is no such fault.
pub fn put(machines: &mut [Machine], name: &str, joint: usize, size: f64, draw: &mut Draw) -> Injected {
    let part = machines[0].joints[joint];
    let coulomb_nm = part.friction.coulomb_nm * part.gear_ratio.abs();
    let size = size * draw.between(0.8, 1.2);
    let mut fault = match name {
        "outside:pre-sliding" => Outside::PreSliding { joint, travel_rad: 0.006 * size },
        "outside:cable-hysteresis" => Outside::CableHysteresis {
            joint,
            torque_nm: 0.35 * size * coulomb_nm,
            travel_rad: draw.logarithmic(0.06, 0.2),
            stiffness_nm_per_rad: 0.1 * size * coulomb_nm,
        },
        "outside:sampling-jitter" => {
            Outside::SamplingJitter { joint, deviation_s: 0.25e-3 * size, correlation_s: draw.logarithmic(0.03, 0.2) }
        }
        "outside:warm-motor" => {
            Outside::WarmMotor { joint, loss_per_a2_s: [0.006, 0.02][joint] * size, cooling_s: draw.between(2.0, 6.0) }
        }
        "outside:resonant-tool" => Outside::ResonantTool {
            inertia_kg_m2: 0.12 * size,
            frequency_hz: draw.logarithmic(3.0, 9.0),
            damping_ratio: draw.between(0.01, 0.05),
        },
        "outside:slack-spring" => Outside::SlackSpring {
            joint,
            stiffness_nm_per_rad: [12.0, 6.0][joint] * size,
            centre_rad: [-0.8, 0.75][joint] + draw.between(-0.2, 0.2),
            half_slack_rad: draw.between(0.25, 0.45),
        },
        "outside:slew-limit" => Outside::SlewLimit { joint, slew_a_per_s: 90.0 / size },
        "outside:turning-base" => Outside::TurningBase {
            speed_rad_s: 1.6 * size.sqrt(),
            frequency_hz: draw.between(0.3, 1.1),
            phase_rad: draw.phase(),
            masses_kg: [15.0, 5.0],
        },
        "outside:catching-cable" => {
            Outside::CatchingCable { joint, torque_nm: 0.4 * size * coulomb_nm, pitch_rad: draw.between(0.13, 0.3) }
        }
        "outside:floor-vibration" => Outside::FloorVibration {
            acceleration_m_s2: 0.25 * size,
            frequency_hz: draw.logarithmic(1.3, 8.0),
            phase_rad: draw.phase(),
        },
        "outside:crosstalk" => Outside::Crosstalk { joint, share: draw.sign() * 0.05 * size },
        "outside:coarse-encoder" => Outside::CoarseEncoder { joint, step_counts: (6.0 * size).round().max(2.0) },
        "outside:hardening-gear" => Outside::HardeningGear { joint },
        _ => panic!("there is no fault {name}"),
    };
    let softness = draw.between(0.01, 0.04);
    for machine in machines.iter_mut() {
        if let Outside::HardeningGear { joint } = fault {
            // Soft up to about the deflection under friction, several times as stiff under weight.
            let soft = [25_000.0, 9_000.0][joint] / size;
            let deflection_rad = coulomb_nm / soft;
            let link_kg_m2 = link_inertia_kg_m2(machine, joint);
            machine.joints[joint].transmission = Transmission::Elastic {
                stiffness_nm_per_rad: soft,
                hardening_nm_per_rad3: soft / deflection_rad.powi(2),
                damping_nm_s_per_rad: 2.0 * softness * (soft * link_kg_m2).sqrt(),
                gap_rad: 0.0,
            };
        }
        if let Outside::ResonantTool { inertia_kg_m2, .. } = fault {
            // The tool was there, rigidly, before: the arm keeps its inertia as a whole.
            let [f1, f2, _, _, f5, f6, f7, f8, f9] = machine.base.0;
            machine.base = BaseParameters::with_consistent_elbow(
                f1 - inertia_kg_m2,
                f2 - inertia_kg_m2,
                f5,
                f6,
                f7 - inertia_kg_m2,
                f8,
                f9,
            );
        }
        if let Outside::SlewLimit { joint, slew_a_per_s } = fault {
            machine.joints[joint].amplifier.slew_a_per_s = Some(slew_a_per_s);
        }
        machine.outside = Some(fault);
        if let Outside::TurningBase { phase_rad, .. } | Outside::FloorVibration { phase_rad, .. } = &mut fault {
            // Nothing ties what goes on outside to the start of a record.
            *phase_rad = draw.phase();
        }
    }
    let whole =
        matches!(fault, Outside::ResonantTool { .. } | Outside::TurningBase { .. } | Outside::FloorVibration { .. });
    let joint = if whole { "both" } else { ["2", "3"][joint] };
    Injected { name: name.to_owned(), joint: joint.to_owned(), parameters: vec![("size".to_owned(), size)] }
}

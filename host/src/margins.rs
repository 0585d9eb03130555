//! How far computed torque is from instability on an arm, by the exact sampled loop, linear about rest.
//!
//! ```text
//! model ─→ masses, shafts, amplifiers in continuous time ─→ over one period: held before, after the delay, held anew
//!          plant.rs                                          │
//! settings ─→ law and observer, as the board runs them ──────┴─→ closed loop ─→ margins over poses
//!                                                                sampled.rs     this file
//! ```
//!
//! With the model's own feedforward what is left of the arm is its inertia, its viscous friction, its shafts, the lag of
//! its amplifiers and the time from sampling to torque. One loop at a time is opened at its motor's command while the
//! other stays closed. Margins are those of the worst pose.
//!
//! Left out: gravity's and velocity's change with the pose (below 4 rad/s, against 200), dry friction (which damps),
//! friction that falls with speed, backlash, rounding, and the limits of the currents.

mod plant;
mod sampled;

use nalgebra::Complex;
use shared::arm::PARAMETERS;
use shared::control::ComputedTorqueSettings;
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant};
use shared::plant::Plant;
use shared::protocol::Model as BoardModel;

use crate::board_setup::SetupError;
use crate::compensation::board_model;
use crate::effects;
use crate::model::Model;
use crate::robot::Robot;
use plant::LinearArm;
use sampled::{ClosedLoop, Timing};

/// Least gain margin to be run with: a load that is dropped leaves half of the inertia that the model has.
pub const LEAST_GAIN_MARGIN: f64 = 2.0;

/// Least phase margin to be run with, in degrees: a resonance peaks to twice its input at most.
pub const LEAST_PHASE_MARGIN_DEG: f64 = 30.0;

/// Lag of the amplifiers' current loop where nothing else is known, in s: 2.5 kHz of bandwidth.
pub const AMPLIFIER_LAG_S: f64 = 64e-6;

/// Poses that margins are looked for in, over the range of joint 3.
const POSES: usize = 7;

/// Lowest frequency of the open loop that is looked at, in rad/s, and how many there are up to half the sampling rate.
const LOWEST_RAD_S: f64 = 1.0;
const FREQUENCIES: usize = 3000;

/// What decides about stability: all at the joints.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmLoop {
    /// f1..f9 of the arm; the controller's model is the same.
    pub f: [f64; PARAMETERS],
    /// Viscous friction in N m s/rad.
    pub viscous_nm_s_per_rad: [f64; 2],
    /// Inertias of motors and gears in kg m², part of f1 and f7.
    pub motor_inertia_kg_m2: [f64; 2],
    /// Twist of the shafts per torque in rad/(N m); 0 where a shaft is rigid.
    pub compliance_rad_per_nm: [f64; 2],
    /// Damping of the shafts over their stiffness in s.
    pub shaft_damping_s: [f64; 2],
    /// Time constants of the amplifiers' currents in s.
    pub current_lag_s: [f64; 2],
    /// Control period and time from sampling to the new current, in s.
    period_s: f64,
    command_delay_s: f64,
    /// Range of joint 3 in rad.
    range_rad: [f64; 2],
}

impl ArmLoop {
    /// The loop that `model` describes, its shafts and lags included.
    pub fn of_model(robot: &Robot, model: &Model) -> Result<Self, SetupError> {
        let effects = effects::from_entries(&model.effects, robot)?;
        let folded = board_model(robot, model)?;
        Ok(Self::new(robot, folded.f, folded.viscous_friction_nm_s_per_rad, &effects))
    }

    /// The loop that the board's model describes: it knows of neither shafts nor lags.
    pub fn of_board(robot: &Robot, model: &BoardModel) -> Self {
        Self::rigid(robot, model.f, model.viscous_friction_nm_s_per_rad)
    }

    /// The loop of a rigid arm of this f, with viscous friction at the motors in N m s/rad.
    pub fn rigid(robot: &Robot, f: [f64; PARAMETERS], viscous_nm_s_per_rad: [f64; 2]) -> Self {
        Self::new(robot, f, viscous_nm_s_per_rad, &Effects::OFF)
    }

    fn new(robot: &Robot, f: [f64; PARAMETERS], viscous_nm_s_per_rad: [f64; 2], effects: &Effects<f64>) -> Self {
        let drives = [0, 1].map(|joint: usize| robot.joints[joint].drive());
        let arm = shared::arm::Arm { f, gravity_m_s2: robot.gravity_m_s2 };
        // This f has the load in it already.
        let unloaded = Effects { arm: Effects::OFF.arm, ..*effects };
        let machine = ExtendedMachine::new(&ExtendedPlant { plant: Plant { arm, drives }, effects: unloaded });
        let of = |value: fn(&shared::effects::JointEffects<f64>) -> f64| effects.joints.each_ref().map(value);
        let limits = &robot.joints[1].limits;
        Self {
            f,
            viscous_nm_s_per_rad: [0, 1]
                .map(|joint: usize| viscous_nm_s_per_rad[joint] * drives[joint].gear_ratio.powi(2)),
            motor_inertia_kg_m2: machine.motor_inertia_kg_m2(),
            compliance_rad_per_nm: of(|joint| joint.compliance_rad_per_nm),
            shaft_damping_s: of(|joint| joint.shaft_damping_s),
            current_lag_s: of(|joint| joint.current_lag_s).map(|lag_s| lag_s.max(AMPLIFIER_LAG_S)),
            period_s: robot.loop_period_s,
            command_delay_s: robot.command_delay_s,
            range_rad: [limits.position_low_rad, limits.position_high_rad],
        }
    }

    fn closed(&self, settings: &ComputedTorqueSettings<f64>, q3_rad: f64) -> ClosedLoop {
        let timing = Timing { period_s: self.period_s, command_delay_s: self.command_delay_s };
        ClosedLoop::new(&LinearArm::new(self, q3_rad), self.inertia(q3_rad), settings, &timing)
    }

    /// The margins under `settings`, of the worst pose each.
    pub fn margins(&self, settings: &ComputedTorqueSettings<f64>) -> Margins {
        let [low, high] = self.range_rad;
        let mut margins = Margins { spectral_radius: 0.0, least_inertia_share: 0.0, joints: [JointMargins::NONE; 2] };
        for pose in 0..POSES {
            let q3_rad = low + (high - low) * pose as f64 / (POSES - 1) as f64;
            let closed = self.closed(settings, q3_rad);
            let radius = closed.spectral_radius([1.0; 2]);
            margins.spectral_radius = margins.spectral_radius.max(radius);
            if radius >= 1.0 {
                margins.least_inertia_share = 1.0;
                margins.joints = [JointMargins { q3_rad, ..JointMargins::UNSTABLE }; 2];
                return margins;
            }
            margins.least_inertia_share = margins.least_inertia_share.max(1.0 / closed.largest_gain());
            for (joint, worst) in margins.joints.iter_mut().enumerate() {
                worst.take_worse(&self.open(&closed, joint, q3_rad));
            }
        }
        margins
    }

    /// Margins of one joint's loop, opened at its command.
    fn open(&self, closed: &ClosedLoop, joint: usize, q3_rad: f64) -> JointMargins {
        let response = closed.opened(joint);
        let highest_rad_s = std::f64::consts::PI / self.period_s;
        let step = (0.9999 * highest_rad_s / LOWEST_RAD_S).powf(1.0 / (FREQUENCIES - 1) as f64);
        let at = |index: usize| {
            let omega_rad_s = LOWEST_RAD_S * step.powi(index as i32);
            (omega_rad_s, response.at(Complex::from_polar(1.0, omega_rad_s * self.period_s)))
        };
        let mut found = JointMargins { q3_rad, ..JointMargins::NONE };
        let mut before = at(0);
        for index in 1..FREQUENCIES {
            let now = at(index);
            found.pass(before, now);
            before = now;
        }
        found
    }

    /// The settings of the largest bandwidth, up to that of `wanted`, and then of the slowest observer, that have margin.
    pub fn with_margin(&self, wanted: &ComputedTorqueSettings<f64>) -> Option<ComputedTorqueSettings<f64>> {
        const SHARES: [f64; 9] = [1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2];
        // Faster ones turn the rounding of the encoders into more than a tenth of the amplifiers' current.
        const OBSERVERS_RAD_S: [f64; 4] = [600.0, 800.0, 1000.0, 1200.0];
        let candidates = SHARES.into_iter().flat_map(|share| {
            OBSERVERS_RAD_S.into_iter().map(move |observer_bandwidth_rad_s| ComputedTorqueSettings {
                bandwidth_rad_s: (share * wanted.bandwidth_rad_s).round(),
                observer_bandwidth_rad_s,
                ..*wanted
            })
        });
        candidates.into_iter().find(|settings| self.margins(settings).check().is_ok())
    }

    /// Accepts `settings` only with margin.
    pub fn check(&self, robot: &Robot) -> Result<Margins, MarginError> {
        let settings = &robot.computed_torque;
        let margins = self.margins(settings);
        margins.check().map_err(|lack| MarginError {
            lack,
            joint: lack.joint().map_or_else(|| "the ".into(), |joint| format!("joint {}'s ", robot.joints[joint].name)),
            bandwidth_rad_s: settings.bandwidth_rad_s,
            observer_bandwidth_rad_s: settings.observer_bandwidth_rad_s,
            remedy: match self.with_margin(settings) {
                Some(ComputedTorqueSettings { bandwidth_rad_s, observer_bandwidth_rad_s, .. }) => format!(
                    "write into the robot file: [computed_torque] bandwidth_rad_s = {bandwidth_rad_s:?}, \
                     observer_bandwidth_rad_s = {observer_bandwidth_rad_s:?}"
                ),
                None => "no bandwidth has enough on this arm: shorten the loop period, or check the model".into(),
            },
        })?;
        Ok(margins)
    }
}

/// Margins over all poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Largest magnitude of the closed loop's poles; below 1 where it is stable.
    pub spectral_radius: f64,
    /// Down to which share of the model's the arm's inertia, all of it, may be before it is unstable.
    pub least_inertia_share: f64,
    /// Of each joint's loop.
    pub joints: [JointMargins; 2],
}

/// Margins of one joint's loop, opened at its command while the other joint's stays closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointMargins {
    /// Factor that the loop's gain may grow by; infinite where any may be.
    pub gain_margin: f64,
    /// Factor that it may fall to; 0 where any may be.
    pub gain_reduction: f64,
    /// Phase that may be added or taken at any frequency where the gain is 1, in degrees.
    pub phase_margin_deg: f64,
    /// Time that the command may come later, in s.
    pub delay_margin_s: f64,
    /// Greatest frequency at which the gain is 1, in rad/s.
    pub crossover_rad_s: f64,
    /// Angle of joint 3 where the phase margin is least, in rad.
    pub q3_rad: f64,
}

impl JointMargins {
    const NONE: Self = Self {
        gain_margin: f64::INFINITY,
        gain_reduction: 0.0,
        phase_margin_deg: 180.0,
        delay_margin_s: f64::INFINITY,
        crossover_rad_s: 0.0,
        q3_rad: 0.0,
    };

    const UNSTABLE: Self = Self {
        gain_margin: 1.0,
        gain_reduction: 1.0,
        phase_margin_deg: 0.0,
        delay_margin_s: 0.0,
        crossover_rad_s: 0.0,
        q3_rad: 0.0,
    };

    /// Takes in what the open loop passes between two neighbouring frequencies.
    fn pass(&mut self, (omega_rad_s, before): (f64, Complex<f64>), (_, now): (f64, Complex<f64>)) {
        if before.im * now.im < 0.0 && before.re + now.re < 0.0 {
            // Where the line between them meets the real axis.
            let share = before.im / (before.im - now.im);
            let factor = -1.0 / (before.re + share * (now.re - before.re));
            if factor > 1.0 {
                self.gain_margin = self.gain_margin.min(factor);
            } else {
                self.gain_reduction = self.gain_reduction.max(factor);
            }
        }
        if (before.norm() - 1.0) * (now.norm() - 1.0) < 0.0 {
            let lead_rad = (before.arg() + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
            let either_way_rad = lead_rad.min(std::f64::consts::TAU - lead_rad);
            self.phase_margin_deg = self.phase_margin_deg.min(either_way_rad.to_degrees());
            self.delay_margin_s = self.delay_margin_s.min(lead_rad / omega_rad_s);
            self.crossover_rad_s = self.crossover_rad_s.max(omega_rad_s);
        }
    }

    fn take_worse(&mut self, other: &Self) {
        if other.phase_margin_deg < self.phase_margin_deg {
            self.q3_rad = other.q3_rad;
        }
        self.gain_margin = self.gain_margin.min(other.gain_margin);
        self.gain_reduction = self.gain_reduction.max(other.gain_reduction);
        self.phase_margin_deg = self.phase_margin_deg.min(other.phase_margin_deg);
        self.delay_margin_s = self.delay_margin_s.min(other.delay_margin_s);
        self.crossover_rad_s = self.crossover_rad_s.max(other.crossover_rad_s);
    }
}

/// What is missing.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MarginLack {
    /// The loop is unstable as it is.
    #[error("spectral radius is {spectral_radius:.3}, and must be below 1")]
    Unstable {
        /// Largest magnitude of the closed loop's poles.
        spectral_radius: f64,
    },
    /// A little more gain, or a little less inertia, makes it unstable.
    #[error("gain margin is {gain_margin:.2}, and must be at least {LEAST_GAIN_MARGIN}")]
    Gain {
        /// Which joint, by index.
        joint: usize,
        /// The factor.
        gain_margin: f64,
    },
    /// Less gain, or more inertia, makes it unstable.
    #[error("gain may fall to {gain_reduction:.2} only, and must be allowed to fall to {}", 1.0 / LEAST_GAIN_MARGIN)]
    Reduction {
        /// Which joint, by index.
        joint: usize,
        /// The factor.
        gain_reduction: f64,
    },
    /// A little more delay makes it unstable.
    #[error("phase margin is {phase_margin_deg:.1}°, and must be at least {LEAST_PHASE_MARGIN_DEG}°")]
    Phase {
        /// Which joint, by index.
        joint: usize,
        /// The margin in degrees.
        phase_margin_deg: f64,
    },
}

impl MarginLack {
    /// The joint it is about, by index, if it is about one.
    fn joint(&self) -> Option<usize> {
        match *self {
            Self::Unstable { .. } => None,
            Self::Gain { joint, .. } | Self::Reduction { joint, .. } | Self::Phase { joint, .. } => Some(joint),
        }
    }
}

/// Settings that are refused on an arm.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "computed torque is too near to instability on this arm: under bandwidth_rad_s {bandwidth_rad_s} and \
     observer_bandwidth_rad_s {observer_bandwidth_rad_s} {joint}{lack}; {remedy}"
)]
pub struct MarginError {
    /// What is missing.
    pub lack: MarginLack,
    /// Whose it is, in words.
    joint: String,
    /// ω.
    bandwidth_rad_s: f64,
    /// Bandwidth of the observer.
    observer_bandwidth_rad_s: f64,
    /// What to do.
    remedy: String,
}

impl Margins {
    /// Accepts only what leaves the least margins.
    pub fn check(&self) -> Result<(), MarginLack> {
        if self.spectral_radius >= 1.0 {
            return Err(MarginLack::Unstable { spectral_radius: self.spectral_radius });
        }
        // The worse joint first: a shaft shows in the other's loop as well.
        let mut order = [0, 1];
        order.sort_by(|&a: &usize, &b: &usize| self.joints[a].gain_margin.total_cmp(&self.joints[b].gain_margin));
        for joint in order {
            let JointMargins { gain_margin, gain_reduction, phase_margin_deg, .. } = self.joints[joint];
            if gain_margin < LEAST_GAIN_MARGIN {
                return Err(MarginLack::Gain { joint, gain_margin });
            }
            if gain_reduction > 1.0 / LEAST_GAIN_MARGIN {
                return Err(MarginLack::Reduction { joint, gain_reduction });
            }
            if phase_margin_deg < LEAST_PHASE_MARGIN_DEG {
                return Err(MarginLack::Phase { joint, phase_margin_deg });
            }
        }
        Ok(())
    }
}

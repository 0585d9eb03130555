//! A load taken up while the arm moves: noticed, identified, and put into computed torque, all on the board.
//!
//! The paper's three stages. **Collect**: 100–200 ms of rows, each a position and the command sent, while computed torque
//! assumes half the largest load; begun only in motion, because friction hides the load of an arm at rest. **Search**: the
//! genetic algorithm over the load's parameters. **Act**: what passes the physical gate enters computed torque, by degrees
//! and with the observer's state kept. From then on every row is tested for a change of load, which starts again.
//!
//! # The replica
//! The paper lets a model of arm and controller repeat the tracking errors. Here the model arm is driven by the recorded
//! commands and its state slowly corrected by what it did not foresee, the innovation ([`crate::replay::Innovations`] in
//! small): stiff control hides a load from the tracking error and shows it in the command, so the innovations tell it far
//! more clearly than errors under computed torque do, and each candidate costs no controller. A step of one row is enough,
//! but for reversals: friction that turns with the end of a row instead of within it passes for a load.
//!
//! A bundle of such replicas runs side by side: one with the parameters assumed, one with each parameter moved a
//! little. What they show is linear in what a load adds to f, but for the division by D, so the sum of squares of the
//! innovations is a quadratic form; running the bundle again from the result removes what was not linear. The genetic
//! algorithm searches mass, centre and inertia within their physical limits on that form, so a candidate costs some
//! sums instead of a simulation.
//!
//! # What is not known exactly
//! f1..f9, friction, the commands' delay and the state at the first row are unknowns too, each with the standard error it is
//! known to. They are eliminated at every candidate, so what the data show of them is used, and what they leave open stands
//! in the standard errors of the load. Centre and inertia have such priors as well: what the data cannot tell stays there.
//!
//! # The difference from the empty arm
//! Where the gripper is empty when a movement begins ([`LoadSettings::differential`]), the first rows show f and friction as
//! they are: the same sums, with the load held at none. What they leave of the unknowns' covariance is the prior of every
//! identification after it, so that errors of the model cancel.
//!
//! # Time
//! The first round of replicas runs while the rows arrive; a second, about the load it found, is the last where the result
//! stays put. Five are the most there are, for an arm that is light beside its load. What the last one still moved stands in
//! the standard errors.
//!
//! Left out: effects beyond the plain arm ([`crate::effects`]).

mod bundle;
mod identifier;
mod learned;
mod prior;
mod quadratic;
mod search;
mod watch;
mod window;

pub use identifier::{COST_NS_PER_REPLICA_STEP, Identifier, Piece};
pub use search::LoadEstimate;
pub use window::{LONGEST_COLLECTION_ROWS, LoadRow};

use serde::{Deserialize, Serialize};

use crate::arm::{Load, PARAMETERS};
use crate::drive::Drive;

/// Rows of the shortest collection: 100 ms at 0.7 ms.
pub const SHORTEST_COLLECTION_ROWS: u16 = 143;

/// What is known of a load before it is identified, and how to identify it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadSettings {
    /// Largest mass the arm may carry, kg; half of it is assumed until one is found.
    pub maximum_kg: f32,
    /// Length of the upper arm, m.
    pub upper_arm_m: f32,
    /// Where the gripper holds a load: its centre of mass in frame 3, m.
    pub centre_m: [f32; 2],
    /// How far the centre may be from there, standard deviation in m; 0 where the grasp is known.
    pub centre_standard_error_m: f32,
    /// The load's inertia about its own centre, kg m².
    pub inertia_kg_m2: f32,
    /// Its standard deviation in kg m²; 0 where it is known.
    pub inertia_standard_error_kg_m2: f32,
    /// Largest distance of the load's centre from the axis of joint 3, m.
    pub reach_m: f32,
    /// Whether a host identifies from the stream of rows, and the board only assumes: then no load changes unless the host
    /// says so ([`crate::protocol::Request::UseLoad`]).
    pub by_host: bool,
    /// Whether the arm is empty when a movement begins: the first rows then show what is wrong with the model, and a load is
    /// found by its difference from the empty arm. Nothing is assumed to be held until a load is noticed.
    pub differential: bool,
    /// Rows to collect, [`SHORTEST_COLLECTION_ROWS`] to [`LONGEST_COLLECTION_ROWS`].
    pub collect_rows: u16,
    /// Standard errors of the model's f1..f9, in their units.
    pub f_standard_error: [f32; PARAMETERS],
    /// Of its viscous friction, N m s/rad at the motor.
    pub viscous_standard_error: [f32; 2],
    /// Of its Coulomb friction, N m at the motor.
    pub coulomb_standard_error: [f32; 2],
}

impl LoadSettings {
    /// Settings for loads of at most `maximum_kg` held at `centre_m`, for a model that is known exactly: mass alone, from
    /// 286 rows, which are 0.2 s at 0.7 ms a row.
    pub fn known_grasp(maximum_kg: f32, upper_arm_m: f32, centre_m: [f32; 2]) -> Self {
        Self {
            maximum_kg,
            upper_arm_m,
            centre_m,
            centre_standard_error_m: 0.0,
            inertia_kg_m2: 0.0,
            inertia_standard_error_kg_m2: 0.0,
            reach_m: 1.0,
            by_host: false,
            differential: false,
            collect_rows: 2 * SHORTEST_COLLECTION_ROWS,
            f_standard_error: [0.0; PARAMETERS],
            viscous_standard_error: [0.0; 2],
            coulomb_standard_error: [0.0; 2],
        }
    }

    /// The load assumed where nothing is known yet: half the largest, at the gripper; none where the arm is empty.
    pub fn assumed(&self) -> Load<f32> {
        self.held(if self.differential { 0.0 } else { 0.5 * self.maximum_kg })
    }

    /// A load of `mass_kg` where the gripper holds it, within what it may be; without a mass, no inertia either.
    pub fn held(&self, mass_kg: f32) -> Load<f32> {
        // Not `clamp`, whose message about limits that are none would take 10 KB of flash.
        let mass_kg = mass_kg.max(0.0).min(self.maximum_kg);
        let inertia_kg_m2 = if mass_kg > 0.0 { self.inertia_kg_m2 } else { 0.0 };
        Load { mass_kg, centre_m: self.centre_m, inertia_kg_m2 }
    }

    /// Refuses the first setting outside its limits. What is accepted makes every calculation here finite.
    pub fn check(&self) -> Result<(), LoadSettingError> {
        let [x, y] = self.centre_m;
        let rows = f32::from(SHORTEST_COLLECTION_ROWS)..=f32::from(LONGEST_COLLECTION_ROWS as u16);
        let errors = self.f_standard_error.iter().chain(&self.viscous_standard_error);
        let worst_error = errors
            .chain(&self.coulomb_standard_error)
            .fold(0.0, |worst: f32, &error| if error >= 0.0 && worst >= 0.0 { worst.max(error) } else { -1.0 });
        for (setting, value, limits) in [
            (LoadSetting::MaximumMass, self.maximum_kg, 0.05..=100.0),
            (LoadSetting::UpperArm, self.upper_arm_m, 0.01..=10.0),
            (LoadSetting::Reach, self.reach_m, 0.01..=10.0),
            (LoadSetting::Centre, libm::sqrtf(x * x + y * y), 0.0..=self.reach_m),
            (LoadSetting::CentreError, self.centre_standard_error_m, 0.0..=1.0),
            (LoadSetting::Inertia, self.inertia_kg_m2, 0.0..=10.0),
            (LoadSetting::InertiaError, self.inertia_standard_error_kg_m2, 0.0..=10.0),
            (LoadSetting::Rows, f32::from(self.collect_rows), rows),
            (LoadSetting::ModelError, worst_error, 0.0..=100.0),
        ] {
            if !limits.contains(&value) {
                return Err(LoadSettingError { setting, value, low: *limits.start(), high: *limits.end() });
            }
        }
        Ok(())
    }
}

/// A field of [`LoadSettings`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LoadSetting {
    /// [`LoadSettings::maximum_kg`].
    MaximumMass,
    /// [`LoadSettings::upper_arm_m`].
    UpperArm,
    /// [`LoadSettings::reach_m`].
    Reach,
    /// Distance of [`LoadSettings::centre_m`] from the axis of joint 3.
    Centre,
    /// [`LoadSettings::centre_standard_error_m`].
    CentreError,
    /// [`LoadSettings::inertia_kg_m2`].
    Inertia,
    /// [`LoadSettings::inertia_standard_error_kg_m2`].
    InertiaError,
    /// [`LoadSettings::collect_rows`].
    Rows,
    /// The worst of the model's standard errors; -1 where one is negative or not a number.
    ModelError,
}

/// A setting outside its limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("{setting:?} of the load identification is {value}, but must be from {low} to {high}; choose another")]
pub struct LoadSettingError {
    /// Which.
    pub setting: LoadSetting,
    /// Its value.
    pub value: f32,
    /// Least value.
    pub low: f32,
    /// Greatest value.
    pub high: f32,
}

/// Everything the identification needs to know of the board: made by it when a movement begins.
#[derive(Clone, Copy, Debug)]
pub struct LoadSetup {
    /// What was asked for.
    pub settings: LoadSettings,
    /// f1..f9 of the active model, without load.
    pub f: [f32; PARAMETERS],
    /// Gravitational acceleration, m/s².
    pub gravity_m_s2: f32,
    /// The drives, with the active model's friction.
    pub drives: [Drive<f32>; 2],
    /// Amperes per code of the commands.
    pub a_per_code: [f32; 2],
    /// Amperes at mid-scale.
    pub offset_a: [f32; 2],
    /// Time between two rows, s.
    pub period_s: f32,
    /// From sampling to the new current, s.
    pub command_delay_s: f32,
    /// The load that computed torque assumes now.
    pub assumed: Load<f32>,
}

/// Why the collection has not begun, or began anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Waiting {
    /// A joint stands, or is about to turn: friction hides the load.
    Slow {
        /// Which, from 0.
        joint: u8,
    },
    /// Rows were lost on the way to the identification.
    RowsLost,
}

/// Why a result is not used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Rejected {
    /// The data want more mass than the arm may carry, by more than their uncertainty.
    TooHeavy,
    /// The data want less than no mass, by more than their uncertainty: the model does not fit.
    Negative,
    /// The mass is known too poorly.
    Uncertain,
    /// The centre is out of reach.
    OutOfReach,
    /// The rows are not of one arm with one load: the load changed among them, or the model is wrong.
    Inconsistent,
    /// A result is not a number.
    NotFinite,
}

/// What the identification has to tell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum LoadNews {
    /// Stage 1 cannot begin yet.
    Waiting(Waiting),
    /// Stage 1: rows are being collected.
    Collecting,
    /// Stage 2: the rows are there.
    Searching,
    /// The rows of the empty arm have shown what is wrong with its model; from now on a load may be taken up.
    Learned {
        /// What they leave, over what noise of the encoder alone would.
        noise_ratio: f32,
    },
    /// Stage 3: this enters computed torque.
    Found(LoadEstimate),
    /// The result did not pass the gate; stage 1 begins anew.
    Rejected(Rejected, LoadEstimate),
    /// The load is another now; stage 1 begins anew, with a load assumed that the change test suggests.
    Changed {
        /// By how much more the arm seems to carry, kg.
        by_kg: f32,
        /// What is assumed from now on.
        assumed_kg: f32,
    },
}

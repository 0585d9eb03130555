//! A movement under computed torque made once more, on a simulated board around a model's arm.

use shared::protocol::ControlLaw;

use crate::board_setup::{self, SetupError};
use crate::capture::{self, Circumstances};
use crate::client::{Client, ClientError, MovementPlan, Pose, SessionError};
use crate::compensation;
use crate::effects::EffectError;
use crate::file_error::FileError;
use crate::hidden_robot::HiddenRobot;
use crate::link::SimulatedBoard;
use crate::model::Model;
use crate::recording::{Mode, Recording};
use crate::robot::Robot;
use crate::trajectory_file;

/// How long the arm stands at the start, in ns: its ringing has died away. No manifest notes how long it was.
const SETTLE_NS: u64 = 2_000_000_000;

/// Seed of the noise of the simulated current sensor.
const SEED: u64 = 1;

/// How far the references may be apart, in counts: the same movement gives the same to the count.
const REFERENCE_COUNTS: f64 = 1.0;

/// Why a movement cannot be made once more as it was.
#[derive(Debug, thiserror::Error)]
pub enum RerunError {
    /// Nothing says which movement it was.
    #[error("its manifest does not say which movement it is of")]
    Unnamed,
    /// The movement was cut short, which the simulated one would not be.
    #[error("only part of the movement was recorded ({0})")]
    Partial(String),
    /// The movement, or what the manifest says of the loop.
    #[error(transparent)]
    File(#[from] FileError),
    /// The movement of that name is another one now.
    #[error(
        "its reference is {apart_counts:.0} counts from that of the movement \"{name}\": that file is another one now"
    )]
    AnotherMovement {
        /// What the manifest calls it.
        name: String,
        /// How far the references are apart.
        apart_counts: f64,
    },
    /// The robot or the controller's model cannot run on a board.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The arm cannot be.
    #[error("the model's {0}")]
    Effect(#[from] EffectError),
    /// The simulated board refused.
    #[error("the simulated board: {0}")]
    Board(#[from] SessionError),
    /// The simulated arm did not come to the end.
    #[error("the simulated arm did not come to the end of the movement: {0}")]
    Stopped(String),
}

impl From<ClientError> for RerunError {
    fn from(error: ClientError) -> Self {
        SessionError::from(error).into()
    }
}

/// What a simulated board records in place of `recording`: the arm of `arm` with its effects, computed torque with the model
/// `controller`, the movement that the manifest names.
///
/// # Errors
/// Where it would not be the same movement under the same conditions.
pub fn under_computed_torque(
    robot: &Robot,
    arm: &Model,
    controller: &Model,
    recording: &Recording,
) -> Result<Recording, RerunError> {
    let noted = recording.manifest.as_ref().filter(|noted| !noted.trajectory.is_empty()).ok_or(RerunError::Unnamed)?;
    if let Some(reason) = &noted.partial {
        return Err(RerunError::Partial(reason.clone()));
    }
    recording.check_periods(robot)?;
    let trajectory = trajectory_file::named(&noted.trajectory)?;
    let configuration = board_setup::configuration(robot)?;
    let board = SimulatedBoard::new(robot, HiddenRobot::from_model(arm, robot)?, SEED);
    let mut client = Client::connect(Box::new(board))?;
    client.prepare(&configuration, Pose::DefaultsTo([0.0; 2]), false)?;
    client.upload(&compensation::board_model(robot, controller)?)?;
    client.load_trajectory(&trajectory)?;
    let plan = MovementPlan { law: ControlLaw::ComputedTorque, settle_ns: SETTLE_NS };
    let movement = client.run(&plan, &mut |_| ())?;
    let circumstances = Circumstances {
        robot,
        mode: Mode::Ctc,
        trajectory: noted.trajectory.clone(),
        board: client.info().clone(),
        seed: Some(SEED),
    };
    let again = capture::recording(&movement, &circumstances, recording.path.clone());
    if let Some(reason) = again.manifest.as_ref().and_then(|manifest| manifest.partial.clone()) {
        return Err(RerunError::Stopped(reason));
    }
    let apart_counts = references_apart_counts(recording, &again);
    if apart_counts > REFERENCE_COUNTS {
        return Err(RerunError::AnotherMovement { name: noted.trajectory.clone(), apart_counts });
    }
    Ok(again)
}

/// The largest difference of the references at the recording's ticks; infinite where the other one has not as many.
fn references_apart_counts(recording: &Recording, again: &Recording) -> f64 {
    let columns = recording.reference_counts.iter().zip(&again.reference_counts);
    let apart = columns.flat_map(|(own, other)| {
        let rows = recording.tick.iter().zip(own);
        rows.map(|(&tick, own)| other.get(tick as usize).map_or(f64::INFINITY, |other| (own - other).abs()))
    });
    apart.fold(0.0, f64::max)
}

//! Running one movement on a board and turning it into a recording: what record, track, simulate and demo share.

use std::path::PathBuf;

use armid::capture::{self, Circumstances};
use armid::client::{Client, Movement, MovementPlan};
use armid::recording::{Mode, Recording};
use armid::robot::Robot;
use shared::protocol::{ControlLaw, LimitsActive};

use super::common::{Prepared, advise};
use super::{CommandError, progress};

/// A movement to run.
pub struct Run<'a> {
    pub robot: &'a Robot,
    pub movement: &'a Prepared,
    pub mode: Mode,
    pub seed: Option<u64>,
    /// Where the recording will go.
    pub path: PathBuf,
}

impl Run<'_> {
    /// Loads, runs and reads the movement; tells on stderr about rows lost and limits that acted.
    ///
    /// A movement that ended early still gives its recording, marked as partial.
    pub fn on(&self, client: &mut Client) -> Result<Ran, CommandError> {
        client.load_trajectory(&self.movement.trajectory)?;
        let law = match self.mode {
            Mode::P => ControlLaw::Position,
            Mode::Ctc => ControlLaw::ComputedTorque,
        };
        let plan = MovementPlan { law, settle_ns: self.movement.settle_ns };
        let mut show = progress::of_movement(&self.movement.name);
        let movement = client.run(&plan, &mut show)?;
        report(&movement);
        let board = client.info().clone();
        let circumstances = Circumstances {
            robot: self.robot,
            mode: self.mode,
            trajectory: self.movement.name.clone(),
            board: &board,
            seed: self.seed,
        };
        let recording = capture::recording(&movement, &circumstances, self.path.clone());
        Ok(Ran { recording, board_lost: movement.recording.is_none() })
    }
}

/// What running a movement brought.
pub struct Ran {
    /// The recording, not yet written.
    pub recording: Recording,
    /// The board went away before the end.
    board_lost: bool,
}

impl Ran {
    /// Why the recording is only part of its movement, if it is.
    pub fn partial(&self) -> Option<&str> {
        self.recording.manifest.as_ref()?.partial.as_deref()
    }

    /// The recording; an error where the movement did not come to its end.
    pub fn whole(self) -> Result<Recording, CommandError> {
        match self.partial() {
            None => Ok(self.recording),
            Some(reason) => Err(CommandError::Incomplete { reason: reason.to_string(), board_lost: self.board_lost }),
        }
    }
}

fn report(movement: &Movement) {
    if movement.reread_rows > 0 {
        advise(format!("{} rows were lost on the way and read from the board's memory", movement.reread_rows));
    }
    if movement.differing_rows > 0 {
        advise(format!(
            "{} rows came differently over the stream than they stand in the board's memory; the memory's are used",
            movement.differing_rows
        ));
    }
    let limits = movement.recording.map_or_else(LimitsActive::default, |recording| recording.limits_active);
    for limit in limits.iter() {
        advise(format!("a limit acted during the movement: {}", limit.name()));
    }
}

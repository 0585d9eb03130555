//! The model of an arm about which nothing is known yet: recorded and identified on the spot, for commands that were
//! given none.

use armid::client::Client;
use armid::identify::Options;
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::robot::Robot;

use super::common::{TrajectoryArguments, advise};
use super::run::Run;
use super::{CommandError, identify};

/// Periods T of the two movements to identify from, in s: one alone leaves a combination of f7, f8 and f9 nearly free.
pub const TRAINING_PERIODS_S: [f64; 2] = [3.65, 5.0];

/// What a board says of its model: no standard errors, no effects.
pub fn of_board(active: &shared::protocol::Model) -> Model {
    Model {
        f: active.f,
        f_standard_error: None,
        viscous_nm_s_per_rad: active.viscous_friction_nm_s_per_rad.to_vec(),
        viscous_standard_error: None,
        coulomb_nm: active.coulomb_friction_nm.to_vec(),
        coulomb_standard_error: None,
        effects: Vec::new(),
        provenance: toml::Table::new(),
    }
}

/// Runs the two movements under the position loop on the connected board, which must be ready to move, and identifies
/// the arm from them; `seed` is that of the search and, where the board is simulated, the one written down with the
/// model. Nothing is uploaded or written to files.
pub fn identified(client: &mut Client, robot: &Robot, seed: u64) -> Result<Model, CommandError> {
    advise("no model was given: recording two movements under the position loop, and identifying the arm from them");
    let recordings = TRAINING_PERIODS_S
        .into_iter()
        .enumerate()
        .map(|(index, period_s)| {
            let movement = TrajectoryArguments::paper(period_s).prepare(robot)?;
            let path = format!("own-model-{}.csv", index + 1).into();
            Run { robot, movement: &movement, mode: Mode::P, seed: Some(seed), path }.on(client)?.whole()
        })
        .collect::<Result<Vec<Recording>, CommandError>>()?;
    let options = Options { seed, ..Options::default() };
    let found = identify::with_progress(robot, &recordings, &[], &options)?;
    Ok(identify::to_model(robot, &recordings, &found, &options))
}

//! The model of an arm about which nothing is known yet: recorded and identified on the spot, for commands that were
//! given none.

use armid::client::Client;
use armid::excite::{self, Settings};
use armid::identify::Options;
use armid::model::Model;
use armid::recording::{Mode, Recording};
use armid::robot::Robot;

use super::common::{Prepared, TrajectoryArguments, advise};
use super::run::Run;
use super::{CommandError, identify, progress};

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

/// Runs two movements under the position loop on the connected board, which must be ready to move, and identifies the arm
/// from them: the paper's, or where the robot's limits do not hold those, `given` and one designed within the limits.
/// `seed` is that of the searches and, where the board is simulated, the one written down with the model. Nothing is
/// uploaded or written to files.
pub fn identified(client: &mut Client, robot: &Robot, given: &Prepared, seed: u64) -> Result<Model, CommandError> {
    advise("no model was given: recording two movements under the position loop, and identifying the arm from them");
    let of_paper: Result<Vec<Prepared>, CommandError> =
        TRAINING_PERIODS_S.iter().map(|&period_s| TrajectoryArguments::paper(period_s).prepare(robot)).collect();
    let movements = match of_paper {
        Err(CommandError::Limit(_) | CommandError::PaperMovement(_)) => {
            vec![given.clone(), design(robot, given, seed)?]
        }
        of_paper => of_paper?,
    };
    let recordings = movements
        .iter()
        .enumerate()
        .map(|(index, movement)| {
            let path = format!("own-model-{}.csv", index + 1).into();
            Run { robot, movement, mode: Mode::P, seed: Some(seed), path }.on(client)?.whole()
        })
        .collect::<Result<Vec<Recording>, CommandError>>()?;
    let options = Options { seed, ..Options::default() };
    let found = identify::with_progress(robot, &recordings, &[], &options)?;
    Ok(identify::to_model(robot, &recordings, &found, &options))
}

/// A movement within the limits of a robot whose limits do not hold the paper's, to identify it from beside `given`.
fn design(robot: &Robot, given: &Prepared, seed: u64) -> Result<Prepared, CommandError> {
    advise(format!(
        "the paper's movements do not fit this robot: it is identified from {} and a movement designed within its limits",
        given.name
    ));
    let settings = Settings { seed, ..Settings::of_duration(excite::usual_duration_s(robot)) };
    let bar = progress::bar("excite", 0);
    let design = excite::design(robot, None, &settings, &|done, planned| {
        bar.set_length(planned as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    given.beside(design.trajectory, "designed within the robot's limits".into(), robot)
}

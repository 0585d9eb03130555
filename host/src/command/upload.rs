//! `armid upload`.

use std::path::PathBuf;

use armid::compensation;
use armid::model::Effect;
use clap::Args;
use serde_json::json;
use shared::protocol::{Request, StoreState, StoredParameters};

use super::CommandError;
use super::common::{BoardArguments, RobotArguments, for_board, print, print_json, read_model};

const EFFECTS: &str = "Effects that `explain --out` has added to the model are compensated where computed torque can: \
    friction of every shape, torque offset and constant, ripple, cogging, springs, load, lean. Others are named on stderr. \
    Ripple and cogging count from where the encoder was switched on: the board drops them when a pose is declared \
    anew, after a restart above all, until the model is uploaded again.

Example:
  armid upload extended.toml --robot robot.toml --board usb";

/// Arguments of `upload`.
#[derive(Debug, Args)]
#[command(after_help = EFFECTS)]
pub struct Upload {
    /// Model file
    #[arg(value_name = "MODEL", required_unless_present_any = ["model", "forget"])]
    file: Option<PathBuf>,
    /// Model file, as an option
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    model: Option<PathBuf>,
    /// Upload nothing: make the board forget the robot constants and the model it keeps over a restart
    #[arg(long, conflicts_with_all = ["file", "model"])]
    forget: bool,
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Upload {
    pub fn run(&self) -> Result<(), CommandError> {
        if self.forget {
            return self.forget();
        }
        let robot = self.robot.read_for_motion()?;
        let Some(path) = self.file.as_ref().or(self.model.as_ref()) else {
            return Err(CommandError::Usage("give a model file".into()));
        };
        let model = read_model(path, &robot)?;
        let board_model = for_board(&robot, &model)?;
        let mut client = self.board.connect_ready(&robot)?;
        let receipt = client.upload(&board_model)?;
        check_stored(client.wait_until_stored()?)?;
        let active = &receipt.active;
        let hexadecimal = |crc: u32| format!("{crc:08x}");
        let (left_out, compensated): (Vec<&Effect>, Vec<&Effect>) =
            model.effects.iter().partition(|effect| compensation::why_not(&effect.name).is_some());
        let named = |effects: &[&Effect]| -> Vec<String> {
            effects.iter().map(|effect| format!("{} of joint {}", effect.name, effect.joint)).collect()
        };
        if self.json {
            return print_json(&json!({
                "active": {"f": active.f, "viscous_nm_s_per_rad": active.viscous_friction_nm_s_per_rad,
                           "coulomb_nm": active.coulomb_friction_nm, "crc": hexadecimal(receipt.crc)},
                "replaced_crc": receipt.replaced_crc.map(hexadecimal),
                "compensated_effects": named(&compensated),
                "effects_left_out": named(&left_out),
                "stored": true,
            }));
        }
        let f: Vec<String> =
            active.f.iter().enumerate().map(|(index, value)| format!("f{} = {value:.4}", index + 1)).collect();
        let replaced = match receipt.replaced_crc {
            Some(crc) if crc == receipt.crc => "the same as before".into(),
            Some(crc) => format!("in place of {crc:08x}"),
            None => "where there was none".into(),
        };
        let effects = if compensated.is_empty() {
            String::new()
        } else {
            format!("\ncompensated: {}", named(&compensated).join(", "))
        };
        print(format!(
            "now active: {} (CRC {:08x}, read back from the board), {replaced}\n{}\nviscous friction {:.4e}, {:.4e} N m \
             s/rad; Coulomb friction {:.4}, {:.4} N m{effects}\nstored with the robot constants: the board starts with both from \
             now on",
            path.display(),
            receipt.crc,
            f.join(", "),
            active.viscous_friction_nm_s_per_rad[0],
            active.viscous_friction_nm_s_per_rad[1],
            active.coulomb_friction_nm[0],
            active.coulomb_friction_nm[1],
        ))
    }
    /// The board forgets what it keeps; nothing else about it changes.
    fn forget(&self) -> Result<(), CommandError> {
        let mut client = self.board.connect(&self.robot.read()?)?;
        client.command(Request::ForgetParameters)?;
        check_stored(client.wait_until_stored()?)?;
        if self.json {
            return print_json(&json!({"stored": false}));
        }
        print("the board starts without robot constants and model from now on; what is active stays so until then")
    }
}

/// Parameters that are active but not kept are half an upload.
fn check_stored(stored: StoredParameters) -> Result<(), CommandError> {
    let why = match stored.state {
        StoreState::Stored | StoreState::Nothing => return Ok(()),
        StoreState::Pending => "the board is not idle, and stores only then".into(),
        StoreState::Failed(failure) => failure.to_string(),
    };
    Err(CommandError::Failed(format!("done, but not stored, so a restart undoes it: {why}")))
}

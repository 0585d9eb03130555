//! `armid upload`.

use std::path::PathBuf;

use armid::board_setup::board_model;
use clap::Args;
use serde_json::json;

use super::CommandError;
use super::common::{BoardArguments, RobotArguments, print, print_json, read_model};

/// Arguments of `upload`.
#[derive(Debug, Args)]
pub struct Upload {
    /// Model file
    #[arg(value_name = "MODEL", required_unless_present = "model")]
    file: Option<PathBuf>,
    /// Model file, as an option
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    model: Option<PathBuf>,
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
        let robot = self.robot.read_for_motion()?;
        let Some(path) = self.file.as_ref().or(self.model.as_ref()) else {
            return Err(CommandError::Usage("give a model file".into()));
        };
        let model = read_model(path, &robot)?;
        let mut client = self.board.connect_ready(&robot)?;
        let receipt = client.upload(&board_model(&robot, &model)?)?;
        let active = &receipt.active;
        let hexadecimal = |crc: u32| format!("{crc:08x}");
        if self.json {
            return print_json(&json!({
                "active": {"f": active.f, "viscous_nm_s_per_rad": active.viscous_friction_nm_s_per_rad,
                           "coulomb_nm": active.coulomb_friction_nm, "crc": hexadecimal(receipt.crc)},
                "replaced_crc": receipt.replaced_crc.map(hexadecimal),
            }));
        }
        let f: Vec<String> =
            active.f.iter().enumerate().map(|(index, value)| format!("f{} = {value:.4}", index + 1)).collect();
        let replaced = match receipt.replaced_crc {
            Some(crc) if crc == receipt.crc => "the same as before".into(),
            Some(crc) => format!("in place of {crc:08x}"),
            None => "where there was none".into(),
        };
        print(format!(
            "now active: {} (CRC {:08x}, read back from the board), {replaced}\n{}\nviscous friction {:.4e}, {:.4e} N m \
             s/rad; Coulomb friction {:.4}, {:.4} N m",
            path.display(),
            receipt.crc,
            f.join(", "),
            active.viscous_friction_nm_s_per_rad[0],
            active.viscous_friction_nm_s_per_rad[1],
            active.coulomb_friction_nm[0],
            active.coulomb_friction_nm[1],
        ))
    }
}

//! `armid info`.

mod margins;

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use shared::protocol::{Fault, Link, Mode, StoreState};

use super::CommandError;
use super::common::{BoardArguments, RobotArguments, print, print_json};
use super::wording::in_its_words;

const EXAMPLES: &str = "Examples:
  armid info                                        the board found on USB
  armid info --margins --model model.toml           how far computed torque is from instability; needs no board
  armid info --margins --board sim                  the same for the board's active model";

/// Arguments of `info`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Info {
    #[command(flatten)]
    robot: RobotArguments,
    #[command(flatten)]
    board: BoardArguments,
    /// Show how far computed torque is from instability instead: on the arm of --model, joint flexibility and lags that
    /// the model has included, or on that of the board's active model
    #[arg(long)]
    margins: bool,
    /// Model for --margins; no board is asked
    #[arg(long, value_name = "FILE", requires = "margins")]
    model: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Info {
    pub fn run(&self) -> Result<(), CommandError> {
        if self.margins {
            return self.show_margins();
        }
        let robot = self.robot.read()?;
        let mut client = self.board.connect(&robot)?;
        if self.board.clear_fault {
            client.command(shared::protocol::Request::ClearFault)?;
        }
        let info = client.hello()?;
        let status = client.status()?;
        let identity = &info.identity;
        let fault = match status.mode {
            Mode::Fault(fault) => Some(fault),
            _ => None,
        };
        let limits: Vec<String> = status.limits_active.iter().map(|limit| in_its_words(limit.name())).collect();
        let chip_id: String = identity.chip_id.iter().map(|byte| format!("{byte:02x}")).collect();
        let crc = |crc: Option<u32>| crc.map(|crc| format!("{crc:08x}"));
        let (recording, stored) = (status.recording, status.stored);
        let named = |fault: Fault| json!({"name": fault.name(), "message": in_its_words(&fault.to_string())});
        if self.json {
            return print_json(&json!({
                "address": client.address(),
                "board": identity.board.as_str(),
                "firmware_version": identity.firmware_version.as_str(),
                "git_revision": identity.git_revision.as_str(),
                "protocol_version": info.protocol_version,
                "chip_id": chip_id,
                "chip_revision": identity.chip_revision,
                "reset_cause": identity.reset_cause.name(),
                "mode": status.mode.name(),
                "fault": fault.map(named),
                "last_fault": info.last_fault.map(named),
                "pose_known": status.pose_known,
                "position_counts": status.position_counts,
                "current_a": status.current_a,
                "emergency_stop": status.emergency_stop,
                "limits_active": limits,
                "configuration_crc": crc(status.configuration_crc),
                "active_model_crc": crc(status.active_model_crc),
                "staged_model_crc": crc(status.staged_model_crc),
                "stored": {
                    "state": match stored.state {
                        StoreState::Nothing => "nothing",
                        StoreState::Stored => "stored",
                        StoreState::Pending => "pending",
                        StoreState::Failed(_) => "failed",
                    },
                    "failure": match stored.state {
                        StoreState::Failed(failure) => Some(failure.to_string()),
                        _ => None,
                    },
                    "configuration_crc": crc(stored.configuration_crc),
                    "model_crc": crc(stored.model_crc),
                    "damaged_records": stored.damaged_records,
                },
                "recording": {"movement": recording.movement, "rows": recording.rows,
                              "planned_rows": recording.planned_rows, "capacity": info.recording_capacity},
                "timing": {
                    "cycles_per_second": info.timing.cycles_per_second,
                    "worst_tick_cycles": info.timing.worst_tick_cycles,
                    "worst_start_cycles": info.timing.worst_start_cycles,
                    "best_start_cycles": info.timing.best_start_cycles,
                    "missed_deadlines": info.timing.missed_deadlines,
                },
                "links": Link::ALL.iter().zip(info.links).map(|(link, counters)| json!({
                    "link": format!("{link:?}").to_lowercase(), "received": counters.received,
                    "bad_frames": counters.bad_frames, "telemetry_dropped": counters.telemetry_dropped,
                    "replies_dropped": counters.replies_dropped,
                })).collect::<Vec<_>>(),
                "requests_repeated": client.repeats(),
            }));
        }
        let or_none = |text: Option<String>| text.unwrap_or_else(|| "none".into());
        let mut lines = vec![
            format!("board         {} at {}", identity.board, client.address()),
            format!(
                "firmware      {}{} (protocol {})",
                identity.firmware_version,
                if identity.git_revision.is_empty() { String::new() } else { format!(", {}", identity.git_revision) },
                info.protocol_version
            ),
            format!("chip          {chip_id}, revision {:#06x}", identity.chip_revision),
            format!("last start    {}", identity.reset_cause.name()),
            format!("mode          {}", status.mode.name()),
        ];
        if let Some(fault) = fault {
            lines.push(format!("fault         {}", in_its_words(&fault.to_string())));
        }
        lines.extend([
            format!("last fault    {}", or_none(info.last_fault.map(|fault| in_its_words(&fault.to_string())))),
            format!(
                "pose          {}",
                match (status.pose_known, status.position_counts) {
                    (true, [second, third]) => format!("{second}, {third} counts at the motors"),
                    (false, _) => "not known".into(),
                }
            ),
            format!("constants     {}", or_none(crc(status.configuration_crc))),
            format!(
                "model         active {}, staged {}",
                or_none(crc(status.active_model_crc)),
                or_none(crc(status.staged_model_crc))
            ),
            format!(
                "stored        {}{}",
                match stored.state {
                    StoreState::Nothing => "nothing".into(),
                    StoreState::Stored => "the same, kept over a restart".into(),
                    StoreState::Pending => "not yet; the board stores them by itself when it is idle".into(),
                    StoreState::Failed(failure) => format!("failed: {failure}"),
                },
                match stored.damaged_records {
                    0 => String::new(),
                    count => format!("; {count} damaged record(s): the last store was cut, older parameters are back"),
                }
            ),
            format!(
                "recording     movement {}, {} of {} rows; room for {}",
                recording.movement, recording.rows, recording.planned_rows, info.recording_capacity
            ),
        ]);
        if !limits.is_empty() {
            lines.push(format!("limits acted  {}", limits.join(", ")));
        }
        let timing = info.timing;
        if timing.cycles_per_second > 0 {
            let microseconds = |cycles: u32| f64::from(cycles) * 1e6 / f64::from(timing.cycles_per_second);
            lines.push(format!(
                "timing        longest tick {:.1} µs, start jitter {:.2} µs, {} deadlines missed",
                microseconds(timing.worst_tick_cycles),
                microseconds(timing.worst_start_cycles.saturating_sub(timing.best_start_cycles)),
                timing.missed_deadlines
            ));
        }
        for (link, counters) in Link::ALL.iter().zip(info.links) {
            lines.push(format!(
                "{:13} {} frames, {} damaged; dropped {} rows, {} replies",
                format!("{link:?}").to_lowercase(),
                counters.received,
                counters.bad_frames,
                counters.telemetry_dropped,
                counters.replies_dropped
            ));
        }
        print(lines.join("\n"))
    }
}

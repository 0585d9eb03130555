//! One look at the board.

use std::time::Duration;

use serde_json::{Value, json};
use shared::protocol::{Info, Link, LinkCounters, Mode, Status};

use super::super::wording::in_its_words;

/// What the board was doing at an instant.
#[derive(Clone, Debug)]
pub struct Row {
    /// Since the monitor began, in s.
    pub time_s: f64,
    pub status: Status,
    pub links: [LinkCounters; 2],
    /// Control ticks that came too late since the board started.
    pub missed_deadlines: u32,
}

impl Row {
    pub fn new(since_start: Duration, status: Status, info: &Info) -> Self {
        Self {
            time_s: since_start.as_secs_f64(),
            status,
            links: info.links,
            missed_deadlines: info.timing.missed_deadlines,
        }
    }

    /// The mode, with its fault in words.
    pub fn mode(&self) -> String {
        match self.status.mode {
            Mode::Fault(fault) => format!("fault: {}", in_its_words(&fault.to_string())),
            mode => mode.name().into(),
        }
    }

    /// Names of the limits that have acted since arming.
    pub fn limits(&self) -> String {
        let names: Vec<String> = self.status.limits_active.iter().map(|limit| in_its_words(limit.name())).collect();
        if names.is_empty() { "none".into() } else { names.join(", ") }
    }

    /// Traffic of the links that have any.
    pub fn traffic(&self) -> String {
        let used = Link::ALL.iter().zip(self.links).filter(|(_, counters)| *counters != LinkCounters::default());
        let texts: Vec<String> = used
            .map(|(link, counters)| {
                format!(
                    "{} {} frames, {} damaged, {} rows and {} replies dropped",
                    format!("{link:?}").to_lowercase(),
                    counters.received,
                    counters.bad_frames,
                    counters.telemetry_dropped,
                    counters.replies_dropped
                )
            })
            .collect();
        texts.join("; ")
    }

    /// Names of what [`Self::to_line`] shows.
    pub fn header() -> String {
        format!(
            "{:>8}  {:>15}  {:>11}  {:>17}  {:>6}  {}",
            "time, s", "counts", "error", "current, A", "E-stop", "mode"
        )
    }

    pub fn to_line(&self) -> String {
        let Status { position_counts: [p2, p3], error_counts: [e2, e3], current_a: [i2, i3], .. } = self.status;
        format!(
            "{:>8.2}  {p2:>7} {p3:>7}  {e2:>5} {e3:>5}  {i2:>8.3} {i3:>8.3}  {:>6}  {}",
            self.time_s,
            if self.status.emergency_stop { "open" } else { "closed" },
            self.mode()
        )
    }

    pub fn to_json(&self) -> Value {
        let status = &self.status;
        let limits: Vec<String> = status.limits_active.iter().map(|limit| in_its_words(limit.name())).collect();
        let fault = match status.mode {
            Mode::Fault(fault) => Some(json!({"name": fault.name(), "message": in_its_words(&fault.to_string())})),
            _ => None,
        };
        let links = Link::ALL.iter().zip(self.links).map(|(link, counters)| {
            json!({
                "link": format!("{link:?}").to_lowercase(), "received": counters.received,
                "bad_frames": counters.bad_frames, "telemetry_dropped": counters.telemetry_dropped,
                "replies_dropped": counters.replies_dropped,
            })
        });
        json!({
            "time_s": self.time_s, "tick": status.tick, "mode": status.mode.name(), "fault": fault,
            "pose_known": status.pose_known, "position_counts": status.position_counts,
            "error_counts": status.error_counts, "current_a": status.current_a,
            "emergency_stop": status.emergency_stop, "limits_active": limits,
            "missed_deadlines": self.missed_deadlines, "links": links.collect::<Vec<Value>>(),
        })
    }
}

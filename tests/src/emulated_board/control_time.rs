//! How long the control interrupt took, and how long it may take.

use std::fmt;

use super::observations::{Observations, Tick};

/// Longest run of the control interrupt under the position loop, in µs on the emulated core, whatever is asked for
/// meanwhile: half of the shortest loop period.
pub const POSITION_LIMIT_US: f64 = 25.0;

/// Longest run under computed torque, in µs on the emulated core, whatever is asked for meanwhile: the shortest loop
/// period.
pub const COMPUTED_TORQUE_LIMIT_US: f64 = 50.0;

/// The runs of the control interrupt within a time.
#[derive(Clone, Debug)]
pub struct ControlTime {
    /// From the shortest to the longest, at least one.
    ticks: Vec<Tick>,
}

impl ControlTime {
    /// The runs that started in a time given in ns. None where there was no run.
    pub fn within(observations: &Observations, from_ns: u64, to_ns: u64) -> Option<Self> {
        let in_time = |tick: &&Tick| (from_ns..to_ns).contains(&tick.start_ns);
        let mut ticks: Vec<Tick> = observations.ticks.iter().filter(in_time).copied().collect();
        ticks.sort_by_key(|tick| tick.instructions);
        (!ticks.is_empty()).then_some(Self { ticks })
    }

    /// The runs while the amplifiers were on for the first time. None where they never were, or never off again.
    pub fn while_powered(observations: &Observations) -> Option<Self> {
        let switched = |on: bool, from_ns: u64| {
            let mut changes = observations.outputs.iter();
            changes.find(|change| change.at_ns > from_ns && change.outputs.amplifiers_enabled == on)
        };
        let on_ns = switched(true, 0)?.at_ns;
        Self::within(observations, on_ns, switched(false, on_ns)?.at_ns)
    }

    /// The longest run, the requests answered in it included.
    pub fn longest(&self) -> Tick {
        self.ticks[self.ticks.len() - 1]
    }
}

impl fmt::Display for ControlTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (median, longest) = (self.ticks[self.ticks.len() / 2], self.longest());
        write!(
            f,
            "median {} instructions ({:.1} µs), longest {} ({:.1} µs)",
            median.instructions,
            median.duration_us(),
            longest.instructions,
            longest.duration_us()
        )
    }
}

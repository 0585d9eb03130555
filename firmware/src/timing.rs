//! How punctual the control interrupt is: measured on the board, shown by `armid info`.

use cortex_m::peripheral::{DCB, DWT};
use shared::protocol::Timing;

use crate::clocks::CORE_CLOCK_HZ;

const NOTHING_MEASURED: Timing = Timing {
    cycles_per_second: CORE_CLOCK_HZ,
    worst_tick_cycles: 0,
    worst_start_cycles: 0,
    best_start_cycles: u32::MAX,
    missed_deadlines: 0,
};

/// Takes the times of every tick and keeps the extremes since the amplifiers were last switched on, or since the start
/// before that. Not longer, because requests that are only possible while they are off, such as checking a whole
/// configuration, take several periods and would hide what matters.
pub struct Stopwatch {
    timing: Timing,
    started_at: u32,
}

impl Stopwatch {
    /// Starts the core's cycle counter.
    pub fn new(mut debug: DCB, mut trace: DWT) -> Self {
        debug.enable_trace();
        trace.enable_cycle_counter();
        Self { timing: NOTHING_MEASURED, started_at: 0 }
    }

    /// Forgets what was measured.
    pub fn restart(&mut self) {
        self.timing = NOTHING_MEASURED;
    }

    /// The tick begins, so many cycles after the timer asked for it.
    pub fn start(&mut self, cycles_since_event: u32) {
        self.started_at = DWT::cycle_count();
        self.timing.best_start_cycles = self.timing.best_start_cycles.min(cycles_since_event);
        self.timing.worst_start_cycles = self.timing.worst_start_cycles.max(cycles_since_event);
    }

    /// The tick ends; `missed` if the next one is due already.
    pub fn stop(&mut self, missed: bool) {
        // The counter wraps every 25 s, a difference does not notice.
        let cycles = DWT::cycle_count().wrapping_sub(self.started_at);
        self.timing.worst_tick_cycles = self.timing.worst_tick_cycles.max(cycles);
        self.timing.missed_deadlines = self.timing.missed_deadlines.saturating_add(missed.into());
    }

    /// What was measured so far.
    pub fn timing(&self) -> Timing {
        self.timing
    }
}

//! The control laws a recording may have been made under, behind one trait, so that a model can repeat it.

use super::PositionLoop;
use crate::scalar::Scalar;

/// When a loop samples, acts and records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledTiming {
    /// Time between two recorded samples in s.
    pub record_period_s: f64,
    /// Time between two ticks of the position loop in s; at most the record period.
    pub loop_period_s: f64,
    /// From sampling the encoder to the new current in s.
    pub command_delay_s: f64,
}

impl SampledTiming {
    /// Whether several loop ticks fall between two samples, so that most commands are not in the recording.
    pub fn loop_is_faster_than_recording(&self) -> bool {
        self.loop_period_s < 0.75 * self.record_period_s
    }

    /// Loop ticks from one sample to the next, at least 1.
    pub fn ticks_per_record(&self) -> u32 {
        // Rounded half up: periods are positive.
        ((self.record_period_s / self.loop_period_s + 0.5) as u32).max(1)
    }
}

/// A position controller of one joint that is called once a tick.
pub trait PositionLaw<S> {
    /// The commanded current in A for this tick, before the amplifier's limit; remembers what the next tick needs.
    fn command_a(&mut self, reference_counts: S, actual_counts: S) -> S;

    /// Takes the lead (in ticks) out of the law, for emulators that apply it as an advance in time instead.
    fn take_lead(&mut self) -> S;
}

/// A cascade of position and velocity loop:
/// `u[k] = kv (kp (ref[k] − act[k]) − (m[k] − m[k−1]) / period)`, `m[k] = (act[k] + act[k−1]) / 2`, lengths in the
/// joint's unit. The law of the EMPS axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cascade<S> {
    /// kp in 1/s.
    pub position_gain_per_s: S,
    /// kv in A (or V) per rad/s (or m/s).
    pub velocity_gain: S,
    /// Counts per rad (or m).
    pub counts_per_unit: S,
    /// Loop period in s.
    pub period_s: S,
}

/// One of the known laws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law<S> {
    /// P with optional lead.
    Proportional(PositionLoop<S>),
    /// Position loop around a velocity loop.
    Cascade(Cascade<S>),
}

impl Law<f64> {
    /// The same law in another number type.
    pub fn map<S>(&self, number: impl Fn(f64) -> S) -> Law<S> {
        match self {
            Self::Proportional(law) => Law::Proportional(PositionLoop {
                gain_a_per_count: number(law.gain_a_per_count),
                lead: number(law.lead),
            }),
            Self::Cascade(law) => Law::Cascade(Cascade {
                position_gain_per_s: number(law.position_gain_per_s),
                velocity_gain: number(law.velocity_gain),
                counts_per_unit: number(law.counts_per_unit),
                period_s: number(law.period_s),
            }),
        }
    }
}

/// A law with its memory: the actual counts of the last two ticks and the last error.
#[derive(Clone, Copy, Debug)]
pub struct LawState<S> {
    law: Law<S>,
    memory: Option<Memory<S>>,
}

#[derive(Clone, Copy, Debug)]
struct Memory<S> {
    error: S,
    actual: S,
    actual_before: S,
}

impl<S> LawState<S> {
    /// A law that has seen nothing yet: its first tick takes the past to have been like the present.
    pub fn new(law: Law<S>) -> Self {
        Self { law, memory: None }
    }

    /// A law that takes over at `actual_counts` while the motor moves by `counts_per_tick`.
    pub fn moving(law: Law<S>, error_counts: S, actual_counts: S, counts_per_tick: S) -> Self
    where
        S: Scalar,
    {
        let actual = actual_counts - counts_per_tick;
        Self { law, memory: Some(Memory { error: error_counts, actual, actual_before: actual - counts_per_tick }) }
    }

    /// The same with another lead, in ticks. A cascade has none and stays as it is.
    pub fn with_lead(mut self, lead: S) -> Self {
        if let Law::Proportional(position_loop) = &mut self.law {
            position_loop.lead = lead;
        }
        self
    }
}

impl<S: Scalar> PositionLaw<S> for LawState<S> {
    #[inline(always)]
    fn command_a(&mut self, reference_counts: S, actual_counts: S) -> S {
        let error = reference_counts - actual_counts;
        let past = self.memory.unwrap_or(Memory { error, actual: actual_counts, actual_before: actual_counts });
        self.memory = Some(Memory { error, actual: actual_counts, actual_before: past.actual });
        match &self.law {
            Law::Proportional(position_loop) => position_loop.command_a(error, past.error),
            Law::Cascade(cascade) => {
                // The difference of two two-tick means is half the travel over two ticks.
                let travel = (actual_counts - past.actual_before) * error.constant(0.5);
                cascade.velocity_gain / cascade.counts_per_unit
                    * (cascade.position_gain_per_s * error - travel / cascade.period_s)
            }
        }
    }

    fn take_lead(&mut self) -> S {
        match &mut self.law {
            Law::Proportional(position_loop) => {
                let none = position_loop.lead.constant(0.0);
                core::mem::replace(&mut position_loop.lead, none)
            }
            Law::Cascade(cascade) => cascade.period_s.constant(0.0),
        }
    }
}

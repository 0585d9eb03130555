//! One link's sequence numbers: what may be carried out, what is only answered again.

use crate::protocol::Refusal;

/// What came of a request: all that is needed to answer it, now or again. What a reply reports of the board's state is
/// looked up when it is answered, so nothing large has to be kept or copied.
#[derive(Clone, Copy, Debug)]
pub(super) enum Outcome {
    /// It was carried out; the reply is what the request asks about.
    Done,
    /// It began a movement.
    Started { movement: u32, approach_ns: u64, rows: u32 },
    /// It was refused.
    Refused(Refusal),
}

/// What is remembered of one link.
#[derive(Clone, Debug)]
pub(super) struct Session {
    /// The last request's number and what came of it; `None` before a hello.
    last: Option<(u32, Outcome)>,
}

impl Session {
    pub(super) const fn new() -> Self {
        Self { last: None }
    }

    /// What to do with a request other than hello: carry it out (`None`), or answer with this outcome instead.
    ///
    /// Numbers are compared modulo 2³²: up to 2³¹ − 1 ahead of the last one is newer.
    pub(super) fn outcome_without_doing(&self, sequence: u32) -> Option<Outcome> {
        let Some((last, outcome)) = &self.last else {
            return Some(Outcome::Refused(Refusal::NotGreeted));
        };
        match sequence.wrapping_sub(*last).cast_signed() {
            0 => Some(*outcome),
            ahead if ahead > 0 => None,
            _ => Some(Outcome::Refused(Refusal::StaleSequence { sequence, last: *last })),
        }
    }

    /// Remembers a request and what came of it.
    pub(super) fn answered(&mut self, sequence: u32, outcome: Outcome) {
        self.last = Some((sequence, outcome));
    }

    /// Forgets the link: another hello is needed.
    pub(super) fn close(&mut self) {
        self.last = None;
    }
}

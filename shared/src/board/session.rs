//! One link's sequence numbers: what may be carried out, what is only answered again.

use crate::protocol::Refusal;

/// What came of a request that was carried out: all that is needed to answer it, now or again. What a reply reports of
/// the board's state is looked up when it is answered, so nothing large has to be kept or copied.
#[derive(Clone, Copy, Debug)]
pub(super) enum Outcome {
    /// The reply is what the request asks about.
    Done,
    /// It began a movement.
    Started { movement: u32, approach_ns: u64, rows: u32 },
}

/// What to do with a request by its number.
pub(super) enum Order {
    /// Carry it out.
    New,
    /// Answer it again.
    Last,
    /// Refuse it.
    Refused(Refusal),
}

/// What is remembered of one link.
#[derive(Clone, Debug)]
pub(super) struct Session {
    /// The last request's number; `None` before a hello.
    last: Option<u32>,
    /// What came of it, in its place: it is written once and answered from there.
    result: Result<Outcome, Refusal>,
}

impl Session {
    pub(super) const fn new() -> Self {
        Self { last: None, result: Ok(Outcome::Done) }
    }

    /// What to do with a request other than hello.
    ///
    /// Numbers are compared modulo 2³²: up to 2³¹ − 1 ahead of the last one is newer.
    pub(super) fn order(&self, sequence: u32) -> Order {
        let Some(last) = self.last else {
            return Order::Refused(Refusal::NotGreeted);
        };
        match sequence.wrapping_sub(last).cast_signed() {
            0 => Order::Last,
            ahead if ahead > 0 => Order::New,
            _ => Order::Refused(Refusal::StaleSequence { sequence, last }),
        }
    }

    /// Remembers a request and what came of it.
    pub(super) fn answered(&mut self, sequence: u32, result: Result<Outcome, Refusal>) {
        self.last = Some(sequence);
        self.result = result;
    }

    /// What came of the last request.
    pub(super) fn result(&self) -> &Result<Outcome, Refusal> {
        &self.result
    }

    /// Forgets the link: another hello is needed.
    pub(super) fn close(&mut self) {
        self.last = None;
    }
}

//! One link's sequence numbers: what may be carried out, what is only answered again.

use crate::protocol::{Refusal, Reply};

/// What is remembered of one link.
#[derive(Clone, Debug)]
pub(super) struct Session {
    /// The last request's number and its reply; `None` before a hello.
    last: Option<(u32, Reply)>,
}

impl Session {
    pub(super) const fn new() -> Self {
        Self { last: None }
    }

    /// What to do with a request other than hello: carry it out (`None`), or give this reply instead.
    ///
    /// Numbers are compared modulo 2³²: up to 2³¹ − 1 ahead of the last one is newer.
    pub(super) fn reply_without_doing(&self, sequence: u32) -> Option<Reply> {
        let Some((last, reply)) = &self.last else {
            return Some(Reply::Refused(Refusal::NotGreeted));
        };
        match sequence.wrapping_sub(*last).cast_signed() {
            0 => Some(reply.clone()),
            ahead if ahead > 0 => None,
            _ => Some(Reply::Refused(Refusal::StaleSequence { sequence, last: *last })),
        }
    }

    /// Remembers a request and its reply.
    pub(super) fn answered(&mut self, sequence: u32, reply: &Reply) {
        self.last = Some((sequence, reply.clone()));
    }

    /// Forgets the link: another hello is needed.
    pub(super) fn close(&mut self) {
        self.last = None;
    }
}

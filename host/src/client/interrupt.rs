//! The wish of whoever sits at the computer to end a movement.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};

/// What asked for the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AskedBy {
    /// Ctrl-C, the signal SIGINT.
    CtrlC,
    /// The signal SIGTERM: another program, or the system, ends this one.
    Termination,
    /// The signal SIGHUP: the terminal went away.
    HangUp,
}

impl AskedBy {
    /// Its name, as a user knows it.
    pub fn name(self) -> &'static str {
        match self {
            Self::CtrlC => "Ctrl-C",
            Self::Termination => "SIGTERM",
            Self::HangUp => "SIGHUP: its terminal was closed",
        }
    }

    /// What a shell expects of a program that ended by it: 128 and the signal's number.
    pub fn exit_code(self) -> u8 {
        match self {
            Self::CtrlC => 130,
            Self::Termination => 143,
            Self::HangUp => 129,
        }
    }
}

/// Counts how often the end was asked for. Clones share one count, so a signal handler can hold one and the client
/// another.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<Asked>);

#[derive(Debug, Default)]
struct Asked {
    times: AtomicU32,
    first_by: OnceLock<AskedBy>,
}

impl Interrupt {
    /// Asks once more for the end, and says how often it was asked for by now. The first time the arm slows down along
    /// its path, the second time the amplifiers go off and the brakes on.
    pub fn ask(&self, by: AskedBy) -> u32 {
        self.0.first_by.get_or_init(|| by);
        self.0.times.fetch_add(1, Ordering::SeqCst) + 1
    }

    /// How often the end was asked for.
    pub fn asked(&self) -> u32 {
        self.0.times.load(Ordering::SeqCst)
    }

    /// What asked for the end first, if anything did.
    pub fn asked_by(&self) -> Option<AskedBy> {
        self.0.first_by.get().copied()
    }
}

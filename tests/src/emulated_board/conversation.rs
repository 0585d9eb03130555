//! The host's end of the hand-over between the host's thread and the emulator's.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use super::command::{Answer, Command};

/// What the host keeps of the conversation.
#[derive(Debug)]
pub struct Conversation {
    /// Gone once the run is to end.
    commands: Option<Sender<Command>>,
    answers: Receiver<Answer>,
    now_ns: u64,
    from_board: VecDeque<u8>,
    /// What the bench is told next; what stays true stays in it.
    next: Command,
}

impl Conversation {
    /// With a bench that waits for its first command.
    pub fn new(commands: Sender<Command>, answers: Receiver<Answer>) -> Self {
        Self { commands: Some(commands), answers, now_ns: 0, from_board: VecDeque::new(), next: Command::default() }
    }

    /// The board's time.
    pub fn now(&self) -> Duration {
        Duration::from_nanos(self.now_ns)
    }

    /// Puts bytes on the line as soon as time goes on.
    pub fn send(&mut self, bytes: &[u8]) {
        self.next.to_board.extend_from_slice(bytes);
    }

    /// What else is to happen as soon as time goes on.
    pub fn next(&mut self) -> &mut Command {
        &mut self.next
    }

    /// Lets the board run until it has sent a frame, for at most `timeout`; nothing when the emulation has ended.
    pub fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Option<usize> {
        if self.from_board.is_empty() {
            self.run(timeout, true)?;
        }
        let count = buffer.len().min(self.from_board.len());
        for (slot, byte) in buffer.iter_mut().zip(self.from_board.drain(..count)) {
            *slot = byte;
        }
        Some(count)
    }

    /// Lets the board run; nothing when the emulation has ended.
    pub fn run(&mut self, duration: Duration, until_frame: bool) -> Option<()> {
        let run_until_ns = self.now_ns.saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX));
        let next = Command { emergency_stop: self.next.emergency_stop, ..Command::default() };
        let command = Command { run_until_ns, until_frame, ..std::mem::replace(&mut self.next, next) };
        self.commands.as_ref()?.send(command).ok()?;
        let answer = self.answers.recv().ok()?;
        self.now_ns = answer.at_ns;
        self.from_board.extend(answer.from_board);
        Some(())
    }

    /// Ends the run.
    pub fn end(&mut self) {
        self.commands = None;
    }
}

//! The host's end of the hand-over between the host's thread and the emulator's.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use super::bench::{Answer, Command, PowerCut};

/// What the host keeps of the conversation.
#[derive(Debug)]
pub struct Conversation {
    /// Gone once the run is to end.
    commands: Option<Sender<Command>>,
    answers: Receiver<Answer>,
    now_ns: u64,
    to_board: Vec<u8>,
    from_board: VecDeque<u8>,
    emergency_stop: bool,
    power_cut: Option<PowerCut>,
}

impl Conversation {
    /// With a bench that waits for its first command.
    pub fn new(commands: Sender<Command>, answers: Receiver<Answer>) -> Self {
        Self {
            commands: Some(commands),
            answers,
            now_ns: 0,
            to_board: Vec::new(),
            from_board: VecDeque::new(),
            emergency_stop: false,
            power_cut: None,
        }
    }

    /// The board's time.
    pub fn now(&self) -> Duration {
        Duration::from_nanos(self.now_ns)
    }

    /// Puts bytes on the line as soon as time goes on.
    pub fn send(&mut self, bytes: &[u8]) {
        self.to_board.extend_from_slice(bytes);
    }

    /// Presses or releases the emergency stop as soon as time goes on.
    pub fn set_emergency_stop(&mut self, pressed: bool) {
        self.emergency_stop = pressed;
    }

    /// Cuts the power, counted from when time goes on.
    pub fn cut_power(&mut self, when: PowerCut) {
        self.power_cut = Some(when);
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
        let command = Command {
            to_board: std::mem::take(&mut self.to_board),
            emergency_stop: self.emergency_stop,
            power_cut: self.power_cut.take(),
            run_until_ns: self.now_ns.saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)),
            until_frame,
        };
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

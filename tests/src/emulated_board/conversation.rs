//! The host's end of the hand-over between the host's thread and the emulator's.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use shared::protocol::Link;

use super::command::{Answer, Command, PowerCut, Until};
use super::usb::UsbAction;

/// Bytes that a system keeps of a serial line nobody reads.
const SYSTEM_BYTES: usize = 4096;

/// What the host keeps of the conversation.
#[derive(Debug)]
pub struct Conversation {
    /// Gone once the run is to end.
    commands: Option<Sender<Command>>,
    answers: Receiver<Answer>,
    now_ns: u64,
    from_board: VecDeque<u8>,
    from_usb: VecDeque<u8>,
    usb_is_open: bool,
    /// Until when nobody reads the serial line.
    stalled_until_ns: u64,
    /// What the bench is told next; what stays true stays in it.
    next: Command,
}

impl Conversation {
    /// With a bench that waits for its first command.
    pub fn new(commands: Sender<Command>, answers: Receiver<Answer>) -> Self {
        Self {
            commands: Some(commands),
            answers,
            now_ns: 0,
            from_board: VecDeque::new(),
            from_usb: VecDeque::new(),
            usb_is_open: false,
            stalled_until_ns: 0,
            next: Command::default(),
        }
    }

    /// The board's time.
    pub fn now(&self) -> Duration {
        Duration::from_nanos(self.now_ns)
    }

    /// Sends bytes over a link as soon as time goes on.
    pub fn send(&mut self, link: Link, bytes: &[u8]) {
        match link {
            Link::Usb => self.next.to_usb.extend_from_slice(bytes),
            Link::Serial => self.next.to_board.extend_from_slice(bytes),
        }
    }

    /// Lets something happen on USB so much later.
    pub fn plan_on_usb(&mut self, after: Duration, action: UsbAction) {
        let at_ns = self.until_ns(after);
        self.next.usb_actions.push((at_ns, action));
    }

    /// The serial line is not read for so long.
    pub fn stall_serial(&mut self, duration: Duration) {
        self.stalled_until_ns = self.until_ns(duration);
    }

    /// Whether the USB port is open.
    pub fn usb_is_open(&self) -> bool {
        self.usb_is_open
    }

    /// What else is to happen as soon as time goes on.
    pub fn next(&mut self) -> &mut Command {
        &mut self.next
    }

    /// Cuts the power, counted from when time goes on.
    pub fn cut_power(&mut self, when: PowerCut) {
        self.next.power_cut = Some(when);
    }

    /// Lets the board run until it has sent a frame, for at most `timeout`; nothing when the emulation has ended.
    pub fn receive(&mut self, link: Link, buffer: &mut [u8], timeout: Duration) -> Option<usize> {
        if link == Link::Serial && self.now_ns < self.stalled_until_ns {
            let left = Duration::from_nanos(self.stalled_until_ns - self.now_ns);
            self.run(timeout.min(left), Until::TimeIsUp)?;
            if self.now_ns < self.stalled_until_ns {
                return Some(0);
            }
        }
        if self.from(link).is_empty() {
            self.run(timeout, Until::Frame(link))?;
        }
        let from = self.from(link);
        let count = buffer.len().min(from.len());
        for (slot, byte) in buffer.iter_mut().zip(from.drain(..count)) {
            *slot = byte;
        }
        Some(count)
    }

    /// Lets the board run; nothing when the emulation has ended.
    pub fn run(&mut self, duration: Duration, until: Until) -> Option<()> {
        let run_until_ns = self.until_ns(duration);
        let next = Command { emergency_stop: self.next.emergency_stop, ..Command::default() };
        let command = Command { run_until_ns, until, ..std::mem::replace(&mut self.next, next) };
        self.commands.as_ref()?.send(command).ok()?;
        let answer = self.answers.recv().ok()?;
        let is_stalled = self.now_ns < self.stalled_until_ns;
        self.now_ns = answer.at_ns;
        self.from_board.extend(answer.from_board);
        if is_stalled {
            self.from_board.truncate(SYSTEM_BYTES);
        }
        self.from_usb.extend(answer.from_usb);
        self.usb_is_open = answer.usb_is_open;
        Some(())
    }

    fn until_ns(&self, duration: Duration) -> u64 {
        self.now_ns.saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX))
    }

    fn from(&mut self, link: Link) -> &mut VecDeque<u8> {
        match link {
            Link::Usb => &mut self.from_usb,
            Link::Serial => &mut self.from_board,
        }
    }

    /// Ends the run.
    pub fn end(&mut self) {
        self.commands = None;
    }
}

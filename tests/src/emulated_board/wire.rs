//! The serial line between the board and this process.

use std::collections::VecDeque;

use rigless::chip::{Timeline, uart::Peer};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

use crate::line::{Line, Losses, Trouble};

/// The host's end of the line. The USART takes and delivers words at its own pace, so bytes travel as slowly as they
/// would on a real one.
#[derive(Debug)]
pub struct Wire {
    to_board: VecDeque<u8>,
    from_board: Vec<u8>,
    /// The line in both directions: to the board, from the board.
    lines: [Line; 2],
}

impl Wire {
    /// A sound line; `seed` makes its noise.
    pub fn new(seed: u64) -> Self {
        let lines = [Line::new(seed), Line::new(seed.wrapping_add(1))];
        Self { to_board: VecDeque::new(), from_board: Vec::new(), lines }
    }

    /// Puts bytes on the line.
    pub fn send(&mut self, bytes: impl IntoIterator<Item = u8>) {
        self.to_board.extend(bytes);
    }

    /// What the board has sent and nobody has taken yet.
    pub fn received(&self) -> &[u8] {
        &self.from_board
    }

    /// Takes it.
    pub fn take_received(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.from_board)
    }

    /// From now on in trouble in both directions, until `until_ns`.
    pub fn disturb(&mut self, trouble: Trouble, until_ns: u64) {
        for line in &mut self.lines {
            line.disturb(trouble, until_ns);
        }
    }

    /// What became of the bytes to the board and from it.
    pub fn losses(&self) -> [Losses; 2] {
        [self.lines[0].losses(), self.lines[1].losses()]
    }
}

/// Runs begin at reset, so nothing is ever put back.
impl Store for Wire {}

impl Peer for Wire {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        self.from_board.extend(self.lines[1].carry(context.now().0, word as u8));
    }

    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        while let Some(byte) = self.to_board.pop_front() {
            if let Some(byte) = self.lines[0].carry(now.0, byte) {
                return Some(byte.into());
            }
        }
        None
    }
}

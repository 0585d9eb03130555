//! The serial line between the board and this process.

use std::collections::VecDeque;

use rigless::chip::{Timeline, uart::Peer};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// The host's end of the line. The USART takes and delivers words at its own pace, so bytes travel as slowly as they
/// would on a real one.
#[derive(Debug, Default)]
pub struct Wire {
    to_board: VecDeque<u8>,
    from_board: Vec<u8>,
}

impl Wire {
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
}

/// Runs begin at reset, so nothing is ever put back.
impl Store for Wire {}

impl Peer for Wire {
    fn receive(&mut self, word: u16, _: &mut Timeline<'_, '_>) {
        self.from_board.push(word as u8);
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        self.to_board.pop_front().map(u16::from)
    }
}

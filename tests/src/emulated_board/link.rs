//! The serial line and the USB port as armid's links.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use armid::link::{Link, LinkError};
use shared::protocol::Link as Wire;

use super::command::Until;
use super::conversation::Conversation;

/// A link to an emulated board, for [`armid::client::Client`]. Its clock is the board's.
///
/// The USB port behaves as a system's device file: when the cable is pulled it is gone, and has to be opened again.
pub struct EmulatedLink {
    conversation: Arc<Mutex<Conversation>>,
    wire: Wire,
}

impl EmulatedLink {
    pub(super) fn new(conversation: Arc<Mutex<Conversation>>, wire: Wire) -> Self {
        Self { conversation, wire }
    }

    fn with<T>(&self, act: impl FnOnce(&mut Conversation) -> T) -> T {
        act(&mut self.conversation.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn broken(&self, reason: &str) -> LinkError {
        LinkError::Broken { address: self.name(), reason: reason.into() }
    }

    fn check_presence(&self) -> Result<(), LinkError> {
        if self.wire == Wire::Serial || self.with(|conversation| conversation.usb_is_open()) {
            Ok(())
        } else {
            Err(self.broken("the USB port is gone"))
        }
    }
}

impl Link for EmulatedLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.check_presence()?;
        self.with(|conversation| conversation.send(self.wire, bytes));
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        let count = self.with(|conversation| conversation.receive(self.wire, buffer, timeout));
        match count.ok_or_else(|| self.broken("the emulation ended"))? {
            0 => self.check_presence().map(|()| 0),
            count => Ok(count),
        }
    }

    fn reopen(&mut self, timeout: Duration) -> Result<(), LinkError> {
        self.with(|conversation| conversation.run(timeout, Until::UsbIsOpen))
            .ok_or_else(|| self.broken("the emulation ended"))?;
        self.check_presence()
    }

    fn now(&self) -> Duration {
        self.with(|conversation| conversation.now())
    }

    fn name(&self) -> String {
        match self.wire {
            Wire::Usb => "emulated USB".into(),
            Wire::Serial => "emulated".into(),
        }
    }
}

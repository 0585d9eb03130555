//! The serial line as one of armid's links.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use armid::link::{Link, LinkError};

use super::conversation::Conversation;

/// The serial line to an emulated board, for [`armid::client::Client`]. Its clock is the board's.
pub struct EmulatedLink {
    conversation: Arc<Mutex<Conversation>>,
}

impl EmulatedLink {
    pub(super) fn new(conversation: Arc<Mutex<Conversation>>) -> Self {
        Self { conversation }
    }

    fn with<T>(&self, act: impl FnOnce(&mut Conversation) -> T) -> T {
        act(&mut self.conversation.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn broken(&self) -> LinkError {
        LinkError::Broken { address: self.name(), reason: "the emulation ended".into() }
    }
}

impl Link for EmulatedLink {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        self.with(|conversation| conversation.send(bytes));
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, LinkError> {
        self.with(|conversation| conversation.receive(buffer, timeout)).ok_or_else(|| self.broken())
    }

    fn now(&self) -> Duration {
        self.with(|conversation| conversation.now())
    }

    fn name(&self) -> String {
        "emulated".into()
    }
}

//! The last fault, kept in memory that a reset leaves as it is.

use crate::protocol::{Fault, PROTOCOL_VERSION, ResetCause, crc_32};

/// Marks memory that holds a fault; nothing else is likely to.
const MAGIC: u32 = 0x6661_756c;

/// Bytes for a fault in postcard.
const FAULT_BYTES: usize = 48;

/// A fault in plain bytes and words, for memory that survives a reset but not the loss of power, after which it holds
/// anything.
///
/// A CRC-32 over everything, the protocol version among it, tells a fault from chance and from what another version of
/// the firmware left behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct KeptFault {
    magic: u32,
    /// Starts since the fault.
    starts: u32,
    fault: [u8; FAULT_BYTES],
    crc: u32,
}

impl KeptFault {
    /// No fault.
    pub const NONE: Self = Self { magic: 0, starts: 0, fault: [0; FAULT_BYTES], crc: 0 };

    /// A fault that has just happened. Never panics, so a panic can be kept too.
    #[inline]
    pub fn new(fault: &Fault) -> Self {
        Self::after(fault, 0)
    }

    #[inline]
    fn after(fault: &Fault, starts: u32) -> Self {
        let mut kept = Self { magic: MAGIC, starts, ..Self::NONE };
        if postcard::to_slice(fault, &mut kept.fault).is_err() {
            return Self::NONE;
        }
        kept.crc = kept.computed_crc();
        kept
    }

    #[inline]
    fn computed_crc(&self) -> u32 {
        let [a, b, c, d] = self.starts.to_le_bytes();
        crc_32(&[&[PROTOCOL_VERSION, a, b, c, d], &self.fault])
    }

    /// The fault and how many starts ago it happened; `None` where the memory holds none.
    #[inline]
    fn open(&self) -> Option<(Fault, u32)> {
        if self.magic != MAGIC || self.crc != self.computed_crc() {
            return None;
        }
        let (fault, _) = postcard::take_from_bytes(&self.fault).ok()?;
        Some((fault, self.starts))
    }

    /// What to report at a start as the last fault, given why the processor starts, and leaves behind what the next
    /// start is to find.
    ///
    /// A panic or a hardware fault ends in a reset by the watchdog and explains it. A watchdog that resets the board
    /// without such a fault since the start before is a fault itself.
    #[inline]
    pub fn at_start(&mut self, cause: ResetCause) -> Option<Fault> {
        let kept = self.open();
        let explained = kept.is_some_and(|(fault, starts)| fault.halts() && starts == 0);
        let (fault, starts) = match cause {
            ResetCause::Watchdog if !explained => (Fault::Watchdog, 0),
            _ => kept?,
        };
        *self = Self::after(&fault, starts.saturating_add(1));
        Some(fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_changed_holds_no_fault() {
        let sound = KeptFault::new(&Fault::UnexpectedInterrupt { number: 7 });
        assert_eq!(sound.open(), Some((Fault::UnexpectedInterrupt { number: 7 }, 0)));
        for bit in 0..32 {
            for wrong in [
                KeptFault { magic: sound.magic ^ 1 << bit, ..sound },
                KeptFault { starts: sound.starts ^ 1 << bit, ..sound },
                KeptFault { crc: sound.crc ^ 1 << bit, ..sound },
            ] {
                assert_eq!(wrong.open(), None);
            }
        }
        for bit in 0..8 * FAULT_BYTES {
            let mut wrong = sound;
            wrong.fault[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(wrong.open(), None, "bit {bit}");
        }
    }
}

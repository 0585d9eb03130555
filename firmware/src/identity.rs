//! What the board can tell about itself: firmware, chip, and why it last started.

use core::fmt::Write;

use embassy_stm32::{pac, uid};
use heapless::String;
use shared::protocol::{BoardIdentity, ResetCause};

/// Reads the identity. Call it once: it clears the reset flags, so that the next start shows its own.
pub fn read() -> BoardIdentity {
    BoardIdentity {
        firmware_version: firmware_version(),
        git_revision: text(env!("ARMID_GIT_REVISION")),
        board: text("nucleo-f429zi"),
        chip_id: uid::uid(),
        chip_revision: pac::DBGMCU.idcode().read().rev_id(),
        reset_cause: take_reset_cause(),
    }
}

/// Version of this package.
pub fn firmware_version() -> String<16> {
    text(env!("CARGO_PKG_VERSION"))
}

/// The flags add up until they are cleared, and every reset pulls the reset pin too; so the rarest comes first.
fn take_reset_cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|register| register.set_rmvf(true));
    if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if flags.porrstf() || flags.borrstf() {
        ResetCause::PowerOn
    } else if flags.padrstf() {
        ResetCause::Pin
    } else {
        ResetCause::Other
    }
}

/// As much of the text as fits; all of it, for the texts above.
fn text<const CAPACITY: usize>(text: &str) -> String<CAPACITY> {
    let mut short = String::new();
    let _ = short.write_str(text);
    short
}

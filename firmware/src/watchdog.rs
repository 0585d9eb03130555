//! The watchdog: restarts the board, which disarms it, when the control interrupt or the tasks stop running. That is
//! also how a panic or a fault ends, after it has made the outputs safe.

use embassy_stm32::{Peri, pac, peripherals::IWDG, wdg::IndependentWatchdog};
use embassy_time::Timer;

use crate::control_interrupt;

/// Its oscillator runs at 17 to 47 kHz instead of 32, so this is 34 to 94 ms in truth.
const TIMEOUT_MICROSECONDS: u32 = 50_000;

/// A third of the shortest timeout, and 14 of the longest loop periods.
const LOOK_EVERY_MILLISECONDS: u64 = 10;

/// Starts the watchdog; nothing can stop it any more.
pub fn start(watchdog: Peri<'static, IWDG>) -> IndependentWatchdog<'static, IWDG> {
    // Not while a debugger has stopped the core.
    pac::DBGMCU.apb1fzr().modify(|register| register.set_iwdg(true));
    let mut watchdog = IndependentWatchdog::new(watchdog, TIMEOUT_MICROSECONDS);
    watchdog.unleash();
    // The counter starts from its reset value, 512 ms, and takes the timeout at the first feeding after that has
    // crossed into its clock domain: 0.2 ms. Without its clock this never ends, and without it nothing may start.
    while pac::IWDG.sr().read().rvu() || pac::IWDG.sr().read().pvu() {}
    watchdog.pet();
    watchdog
}

/// Feeds the watchdog as long as control ticks go on.
#[embassy_executor::task]
pub async fn feed(mut watchdog: IndependentWatchdog<'static, IWDG>) {
    let mut seen = control_interrupt::ticks();
    loop {
        Timer::after_millis(LOOK_EVERY_MILLISECONDS).await;
        let ticks = control_interrupt::ticks();
        if ticks != seen {
            watchdog.pet();
        }
        seen = ticks;
    }
}

//! The clock tree: 168 MHz from the 8 MHz that the ST-LINK of the Nucleo board puts out.

use embassy_stm32::{
    Config, pac,
    rcc::{AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk},
    time::Hertz,
};

use crate::interrupt_priorities::TASK_PRIORITY;

/// Of the core and of TIM1 (which counts at twice the bus clock).
pub const CORE_CLOCK_HZ: u32 = 168_000_000;

/// 168 MHz and not the 180 MHz the part can do: USB needs 48 MHz from the same PLL, and 0.7 ms is then a whole
/// number of cycles.
pub fn configuration() -> Config {
    let mut config = Config::default();
    config.dma_interrupt_priority = TASK_PRIORITY;
    // Bypass: a clock comes in, there is no crystal to drive.
    config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
    config.rcc.pll_src = PllSource::HSE;
    config.rcc.pll = Some(Pll {
        prediv: PllPreDiv::DIV4,   // 2 MHz into the PLL, the value with the least jitter
        mul: PllMul::MUL168,       // 336 MHz
        divp: Some(PllPDiv::DIV2), // 168 MHz: core
        divq: Some(PllQDiv::DIV7), // 48 MHz: USB
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4; // 42 MHz, its timers (encoders, time driver) at 84 MHz
    config.rcc.apb2_pre = APBPrescaler::DIV2; // 84 MHz, its timers (control interrupt) at 168 MHz, the ADC at 21 MHz
    config
}

/// Lets the core read ahead and keep what it has read of the flash memory, which at this clock takes six cycles for every
/// line of 16 bytes. The driver sets the wait states and leaves all three off.
pub fn enable_flash_caches() {
    pac::FLASH.acr().modify(|register| {
        register.set_prften(true);
        register.set_icen(true);
        register.set_dcen(true);
    });
}

//! The motor encoders: two 32 bit hardware counters that need no help from the processor.

use embassy_stm32::{
    Peri, pac,
    peripherals::{PA0, PA1, PA15, PB3, TIM2, TIM5},
    timer::{
        low_level::FilterValue,
        qei::{Config, Qei, QeiMode},
    },
};

/// A level must hold for eight samples of the 84 MHz timer clock divided by eight, 0.76 µs, before it counts. The
/// shortest level of a real signal is 8 µs even at 250 000 counts/s, ten times the fastest movement.
const INPUT_FILTER: FilterValue = FilterValue::FDTS_DIV8_N8;

/// Both encoders, counting every edge of both channels.
pub struct Encoders {
    // Kept for the pins and the clock gates they hold; the counters themselves are read as 32 bit registers, while
    // the driver knows 16 bits only.
    _joint_2: Qei<'static, TIM2>,
    _joint_3: Qei<'static, TIM5>,
}

impl Encoders {
    /// Starts both counters at zero.
    pub fn new(
        joint_2: (Peri<'static, TIM2>, Peri<'static, PA15>, Peri<'static, PB3>),
        joint_3: (Peri<'static, TIM5>, Peri<'static, PA0>, Peri<'static, PA1>),
    ) -> Self {
        let config = Config { mode: QeiMode::Mode3, ..Config::default() };
        let encoders = Self {
            _joint_2: Qei::new(joint_2.0, joint_2.1, joint_2.2, config),
            _joint_3: Qei::new(joint_3.0, joint_3.1, joint_3.2, config),
        };
        for timer in [pac::TIM2, pac::TIM5] {
            timer.ccmr_input(0).modify(|register| {
                register.set_icf(0, INPUT_FILTER);
                register.set_icf(1, INPUT_FILTER);
            });
            timer.arr().write_value(u32::MAX);
            timer.cnt().write_value(0);
        }
        encoders
    }

    /// Counts of both motors since the start, wrapping at 32 bits. The two reads are a few cycles apart.
    pub fn counts(&self) -> [i32; 2] {
        [pac::TIM2.cnt().read().cast_signed(), pac::TIM5.cnt().read().cast_signed()]
    }
}

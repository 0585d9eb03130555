//! The controller board: a NUCLEO-F429ZI between the encoders and amplifiers of two joints and the host.
//!
//! What the board does is decided in `shared::board`, which also runs on a computer. Here are only registers,
//! interrupts and pins. This file gives every pin its use and starts everything.
//!
//! ```text
//! encoders, currents ──→ control_interrupt ──→ currents, safe_output     once a tick: counts and codes in, codes and
//!                             │   ↑                                      enable out
//!                       `shared::board`
//!                             │   ↑
//! link_usb, link_serial ── link ── load, storage                         tasks below it: frames, load search, flash
//! watchdog, last_fault, identity, timing, clocks                         what keeps it safe, and what it tells of itself
//! ```
//!
//! | Pin | Nucleo | Use |
//! |---|---|---|
//! | PA15, PB3 | D20, D23 | encoder of joint 2, channels A and B (TIM2) |
//! | PA0, PA1 | D32, – | encoder of joint 3, channels A and B (TIM5) |
//! | PA3, PC0 | A0, A1 | measured armature current of joint 2 (ADC1), joint 3 (ADC2) |
//! | PA4, PA5 | D24, D13 | current command of joint 2, joint 3 (DAC) |
//! | PF12 | D8 | amplifier enable, high = on; needs a pull-down outside |
//! | PF13 | D7 | emergency stop: normally closed contact to ground, open = stop |
//! | PD8, PD9 | – | serial link through the ST-LINK (USART3) |
//! | PA11, PA12 | user USB | USB link |
//!
//! PA1 also carries the 50 MHz reference clock of the Ethernet chip on the Nucleo board, until the solder bridge between
//! them is opened (SB13 on the boards of 2016; check the manual of yours).
#![no_std]
#![no_main]

mod clocks;
mod control_interrupt;
mod critical_section;
mod currents;
mod encoders;
mod identity;
mod interrupt_owned;
mod interrupt_priorities;
mod last_fault;
mod link;
mod link_serial;
mod link_usb;
mod load;
mod safe_output;
mod storage;
mod timing;
mod watchdog;

use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::gpio::{Input, Pull};
use shared::{
    board::{Board, DEFAULT_SAMPLES},
    protocol::PackedSample,
};
use static_cell::{ConstStaticCell, StaticCell};

use crate::{
    control_interrupt::Control,
    currents::{Amplifiers, MeasuredCurrents},
    encoders::Encoders,
    link::Link,
    load::Load,
    storage::Storage,
    timing::Stopwatch,
};

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let core_peripherals = cortex_m::Peripherals::take().expect("taken once");
    interrupt_priorities::set_all(core_peripherals.NVIC);
    let peripherals = embassy_stm32::init(clocks::configuration());
    clocks::enable_flash_caches();
    // First of all, so that the amplifiers are held off and at no current while the rest starts.
    let amplifiers = Amplifiers::new(peripherals.PF12, peripherals.DAC1, peripherals.PA4, peripherals.PA5);
    let watchdog = watchdog::start(peripherals.IWDG);
    defmt::info!("armid {} ({})", env!("CARGO_PKG_VERSION"), env!("ARMID_GIT_REVISION"));

    static ROWS: ConstStaticCell<[PackedSample; DEFAULT_SAMPLES]> =
        ConstStaticCell::new([PackedSample::EMPTY; DEFAULT_SAMPLES]);
    static BOARD: StaticCell<Board<&'static mut [PackedSample]>> = StaticCell::new();
    let identity = identity::read();
    let chip_id = identity.chip_id;
    let board = BOARD.init_with(|| Board::new(identity, ROWS.take()));
    if let Some(fault) = last_fault::at_start(board.identity().reset_cause) {
        board.report_last_fault(fault);
    }
    let (log, found) = storage::open();
    board.restore_stored(&found);
    static STORAGE: ConstStaticCell<Storage> = ConstStaticCell::new(Storage::new());
    let (storage, storage_task) = STORAGE.take().split();
    static LOAD: ConstStaticCell<Load> = ConstStaticCell::new(Load::new());
    let (load, load_task) = LOAD.take().split();
    let identifier = load::identifier();

    // Made at run time: their initial values are not all zeros, and would take 4 KB of flash each.
    static USB: StaticCell<Link> = StaticCell::new();
    let (usb, usb_receive, usb_send) = USB.init_with(Link::new).split(&link::USB);
    static SERIAL: StaticCell<Link> = StaticCell::new();
    let (serial, serial_receive, serial_send) = SERIAL.init_with(Link::new).split(&link::SERIAL);
    link::enable_relay();
    let (transmitter, receiver) = link_serial::open(
        peripherals.USART3,
        (peripherals.PD8, peripherals.DMA1_CH3),
        (peripherals.PD9, peripherals.DMA1_CH1),
    )
    .expect("1 Mbaud can be had from these clocks");

    let control = Control {
        board,
        encoders: Encoders::new(
            (peripherals.TIM2, peripherals.PA15, peripherals.PB3),
            (peripherals.TIM5, peripherals.PA0, peripherals.PA1),
        ),
        measured_currents: MeasuredCurrents::new(
            (peripherals.ADC1, peripherals.PA3),
            (peripherals.ADC2, peripherals.PC0),
        ),
        amplifiers,
        emergency_stop: Input::new(peripherals.PF13, Pull::Up),
        links: [usb, serial],
        storage,
        load,
        stopwatch: Stopwatch::new(core_peripherals.DCB, core_peripherals.DWT),
    };
    control_interrupt::start(peripherals.TIM1, control);

    spawner.spawn(watchdog::feed(watchdog).expect("spawned once"));
    spawner.spawn(storage::store(log, storage_task).expect("spawned once"));
    spawner.spawn(load::identify(identifier, load_task).expect("spawned once"));
    let port = link_usb::open(peripherals.USB_OTG_FS, peripherals.PA12, peripherals.PA11, &chip_id);
    spawner.spawn(link_usb::run(port.device).expect("spawned once"));
    spawner.spawn(link_usb::receive(port.receiver, usb_receive).expect("spawned once"));
    spawner.spawn(link_usb::send(port.sender, port.control, usb_send).expect("spawned once"));
    spawner.spawn(link_serial::receive(receiver, serial_receive).expect("spawned once"));
    spawner.spawn(link_serial::send(transmitter, serial_send).expect("spawned once"));
}

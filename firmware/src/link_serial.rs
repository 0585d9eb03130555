//! The serial link: USART3, which the ST-LINK of the Nucleo board passes on as a virtual COM port. Bytes in and out
//! are moved by DMA.

use embassy_stm32::{
    Peri, bind_interrupts, dma,
    mode::Async,
    pac,
    peripherals::{DMA1_CH1, DMA1_CH3, PD8, PD9, USART3},
    usart::{self, Config, ConfigError, RingBufferedUartRx, Uart, UartTx},
};
use embassy_time::{Duration, with_timeout};
use shared::protocol::MAX_FRAME;
use static_cell::ConstStaticCell;

use crate::link::{ReceiveEnd, SendEnd};

/// 42 MHz / 16 / 2.625, which the USART divides exactly.
const BAUD_RATE: u32 = 1_000_000;

/// Received bytes wait here for the task: 10 ms at 1 Mbaud.
const RECEIVE_BUFFER_BYTES: usize = 1024;

/// How often to look whether DMA still moves received bytes. Stopped, by an error on its bus for one, it says nothing.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Longer than the longest frame takes.
const SEND_TIMEOUT: Duration = Duration::from_millis(50);

/// The stream of DMA1 that moves received bytes.
const RECEIVE_STREAM: usize = 1;

bind_interrupts!(struct Interrupts {
    USART3 => usart::InterruptHandler<USART3>;
    DMA1_STREAM1 => dma::InterruptHandler<DMA1_CH1>;
    DMA1_STREAM3 => dma::InterruptHandler<DMA1_CH3>;
});

/// Opens the port: 1 Mbaud, 8 data bits, no parity, one stop bit.
pub fn open(
    usart: Peri<'static, USART3>,
    transmit: (Peri<'static, PD8>, Peri<'static, DMA1_CH3>),
    receive: (Peri<'static, PD9>, Peri<'static, DMA1_CH1>),
) -> Result<(UartTx<'static, Async>, RingBufferedUartRx<'static>), ConfigError> {
    // Static, hence in SRAM: DMA cannot reach the stack.
    static RECEIVE_BUFFER: ConstStaticCell<[u8; RECEIVE_BUFFER_BYTES]> =
        ConstStaticCell::new([0; RECEIVE_BUFFER_BYTES]);
    let mut config = Config::default();
    config.baudrate = BAUD_RATE;
    let uart = Uart::new(usart, receive.0, transmit.0, transmit.1, receive.1, Interrupts, config)?;
    let (transmitter, receiver) = uart.split();
    Ok((transmitter, receiver.into_ring_buffered(RECEIVE_BUFFER.take())))
}

/// Passes received bytes on, and starts DMA again where it has stopped.
#[embassy_executor::task]
pub async fn receive(mut uart: RingBufferedUartRx<'static>, mut link: ReceiveEnd) {
    let mut bytes = [0; 64];
    loop {
        match with_timeout(LOOK_EVERY, uart.read(&mut bytes)).await {
            Ok(Ok(count)) => link.accept(&bytes[..count]).await,
            // Bytes are missing now; the CRC of the frame they belong to will tell.
            Ok(Err(error)) => defmt::warn!("serial receive: {}", error),
            Err(_) if pac::DMA1.st(RECEIVE_STREAM).cr().read().en() => {}
            Err(_) => uart.start_uart(),
        }
    }
}

/// Sends what the board has to say. What DMA does not get done in time is given up, and DMA with it: the next frame starts
/// it again.
#[embassy_executor::task]
pub async fn send(mut uart: UartTx<'static, Async>, mut link: SendEnd) {
    let mut buffer = [0; MAX_FRAME];
    loop {
        let frame = link.next_frame(&mut buffer).await;
        if let Ok(Err(error)) = with_timeout(SEND_TIMEOUT, uart.write(frame)).await {
            defmt::warn!("serial send: {}", error);
        }
    }
}

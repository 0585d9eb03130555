//! The USB link: a CDC-ACM serial port on the OTG full-speed core.
//!
//! A host takes part when it has configured the board, keeps the bus awake and has the port open (DTR). Only then is
//! anything queued for it. The board is powered by the ST-LINK and does not sense VBUS, so a pulled cable is seen as a
//! suspended bus.

use core::{
    str,
    sync::atomic::{AtomicBool, Ordering},
};

use embassy_futures::select::{Either, select};
use embassy_stm32::{
    Peri, bind_interrupts, pac,
    peripherals::{PA11, PA12, USB_OTG_FS},
    usb::{self, Driver},
};
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, signal::Signal};
use embassy_time::{Duration, Timer, with_timeout};
use embassy_usb::{
    Builder, Handler, UsbDevice,
    class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State},
};
use shared::protocol::{
    MAX_FRAME,
    usb::{MANUFACTURER, PRODUCT, PRODUCT_ID, SERIAL_NUMBER_LENGTH, VENDOR_ID, serial_number},
};
use static_cell::{ConstStaticCell, StaticCell};

use crate::link::{Carries, ReceiveEnd, SendEnd};

/// Bytes of a packet, the most a full-speed bulk endpoint can have.
const PACKET_BYTES: usize = 64;

/// How long a host may take to fetch a packet before what it holds is given up. A host that reads at all fetches one
/// within a millisecond; what is given up can be read again from the recording.
const FETCH_TIMEOUT: Duration = Duration::from_millis(100);

/// How often to look whether the driver still handles what happens on the bus: often enough that a host, which leaves a
/// device 10 ms after a reset, notices nothing.
const LOOK_EVERY: Duration = Duration::from_millis(4);

/// Ends a frame cut short, so that the next one is not taken for its rest.
const FRAME_END: u8 = 0;

bind_interrupts!(struct Interrupts {
    OTG_FS => usb::InterruptHandler<USB_OTG_FS>;
});

type Core = Driver<'static, USB_OTG_FS>;

/// The parts of the link, each for its own task.
pub struct Port {
    /// Answers the host's questions about the board itself.
    pub device: UsbDevice<'static, Core>,
    /// Takes packets of bytes from the host.
    pub receiver: Receiver<'static, Core>,
    /// Sends packets of bytes to the host.
    pub sender: Sender<'static, Core>,
    /// Tells whether the port is open.
    pub control: ControlChanged<'static>,
}

/// Connects to the bus. The serial number is made of `chip_id`.
pub fn open(
    core: Peri<'static, USB_OTG_FS>,
    data_plus: Peri<'static, PA12>,
    data_minus: Peri<'static, PA11>,
    chip_id: &[u8; 12],
) -> Port {
    static RECEIVE_BUFFER: ConstStaticCell<[u8; 2 * PACKET_BYTES]> = ConstStaticCell::new([0; 2 * PACKET_BYTES]);
    static CONFIGURATION_DESCRIPTOR: ConstStaticCell<[u8; 96]> = ConstStaticCell::new([0; 96]);
    static BINARY_OBJECT_DESCRIPTOR: ConstStaticCell<[u8; 16]> = ConstStaticCell::new([0; 16]);
    static CONTROL_BUFFER: ConstStaticCell<[u8; 128]> = ConstStaticCell::new([0; 128]);
    static SERIAL_NUMBER: StaticCell<[u8; SERIAL_NUMBER_LENGTH]> = StaticCell::new();
    static CLASS: StaticCell<State> = StaticCell::new();
    static WATCH: ConstStaticCell<Watch> = ConstStaticCell::new(Watch);

    let mut driver_configuration = usb::Config::default();
    driver_configuration.vbus_detection = false;
    let driver = Driver::new_fs(core, Interrupts, data_plus, data_minus, RECEIVE_BUFFER.take(), driver_configuration);

    let mut configuration = embassy_usb::Config::new(VENDOR_ID, PRODUCT_ID);
    configuration.manufacturer = Some(MANUFACTURER);
    configuration.product = Some(PRODUCT);
    configuration.serial_number = str::from_utf8(SERIAL_NUMBER.init(serial_number(chip_id))).ok();
    configuration.self_powered = true;
    configuration.max_power = 0;
    let mut builder = Builder::new(
        driver,
        configuration,
        CONFIGURATION_DESCRIPTOR.take(),
        BINARY_OBJECT_DESCRIPTOR.take(),
        &mut [],
        CONTROL_BUFFER.take(),
    );
    builder.handler(WATCH.take());
    let class = CdcAcmClass::new(&mut builder, CLASS.init_with(State::new), PACKET_BYTES as u16);
    let (sender, receiver, control) = class.split_with_control();
    Port { device: builder.build(), receiver, sender, control }
}

/// Whether the host has configured the board and not been gone since.
static CONFIGURED: AtomicBool = AtomicBool::new(false);

/// Whether the bus sleeps, or the cable is pulled.
static SUSPENDED: AtomicBool = AtomicBool::new(false);

/// One of the two has changed.
static BUS_CHANGED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The core runs. Before, its registers have no clock.
static RUNS: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Is told what happens on the bus.
struct Watch;

impl Handler for Watch {
    fn enabled(&mut self, enabled: bool) {
        if enabled {
            RUNS.signal(());
        }
    }

    fn reset(&mut self) {
        end_transfers();
        CONFIGURED.store(false, Ordering::Relaxed);
        SUSPENDED.store(false, Ordering::Relaxed);
        BUS_CHANGED.signal(());
    }

    fn configured(&mut self, configured: bool) {
        CONFIGURED.store(configured, Ordering::Relaxed);
        BUS_CHANGED.signal(());
    }

    fn suspended(&mut self, suspended: bool) {
        SUSPENDED.store(suspended, Ordering::Relaxed);
        BUS_CHANGED.signal(());
    }
}

/// Ends the transfers that the last host left unfinished. A bus reset does not, nor does the driver, which would wait
/// for them for ever.
fn end_transfers() {
    for endpoint in 0..usb_endpoints() {
        let control = pac::USB_OTG_FS.diepctl(endpoint);
        if control.read().epena() {
            control.modify(|register| {
                register.set_snak(true);
                register.set_epdis(true);
            });
        }
    }
}

/// IN endpoints in use: control, notification, data.
const fn usb_endpoints() -> usize {
    3
}

/// Runs the bus.
#[embassy_executor::task]
pub async fn run(mut device: UsbDevice<'static, Core>) {
    loop {
        // The driver does not look at the bus while it carries out a control transfer. A cable pulled then would leave
        // it waiting for the rest of that transfer for ever.
        match select(device.run(), bus_is_ignored()).await {
            Either::First(never) => never,
            Either::Second(()) => {
                defmt::warn!("USB: a control transfer was cut off");
                device.disable().await;
            }
        }
    }
}

/// Waits until a reset or a suspended bus has gone unnoticed for a while.
async fn bus_is_ignored() {
    let mut seen_before = false;
    loop {
        Timer::after(LOOK_EVERY).await;
        let waiting = pac::USB_OTG_FS.gintsts().read();
        let seen = waiting.usbrst() || waiting.enumdne() || waiting.usbsusp();
        if seen && seen_before {
            return;
        }
        seen_before = seen;
    }
}

/// Passes received bytes on.
#[embassy_executor::task]
pub async fn receive(mut receiver: Receiver<'static, Core>, mut link: ReceiveEnd) {
    let mut bytes = [0; PACKET_BYTES];
    RUNS.wait().await;
    loop {
        receiver.wait_connection().await;
        link.restart();
        while let Ok(count) = receiver.read_packet(&mut bytes).await {
            link.accept(&bytes[..count]).await;
        }
        // Until the next reset has been dealt with, the endpoint may still be enabled.
        Timer::after_millis(1).await;
    }
}

/// Sends what the board has to say while somebody listens.
#[embassy_executor::task]
pub async fn send(mut sender: Sender<'static, Core>, control: ControlChanged<'static>, mut link: SendEnd) {
    loop {
        until(&control, true).await;
        link.connect();
        // A write that is dropped half way has either written the whole packet or nothing.
        select(transfer(&mut sender, &mut link), until(&control, false)).await;
        link.disconnect();
    }
}

/// Waits until the port is open, or closed.
async fn until(control: &ControlChanged<'static>, open: bool) {
    loop {
        let is_open = CONFIGURED.load(Ordering::Relaxed) && !SUSPENDED.load(Ordering::Relaxed) && control.dtr();
        if is_open == open {
            return;
        }
        select(control.control_changed(), BUS_CHANGED.wait()).await;
    }
}

/// Puts frames into packets and sends them.
async fn transfer(sender: &mut Sender<'static, Core>, link: &mut SendEnd) {
    let mut frames = Frames::new(link);
    let mut packet = [0; PACKET_BYTES];
    // The last frame of an earlier connection may have been cut short, and a damaged one costs the next one too.
    packet[0] = FRAME_END;
    let mut count = 1;
    loop {
        count += frames.fill(&mut packet[count..]);
        // A packet of full length goes on in the next one, so there must be one, even if it is empty.
        let ends_transfer = count < PACKET_BYTES;
        if count == 0 && frames.transfer_has_ended {
            frames.link.wait().await;
            continue;
        }
        match with_timeout(FETCH_TIMEOUT, sender.write_packet(&packet[..count])).await {
            Ok(Ok(())) => {
                frames.sent(ends_transfer);
                count = 0;
            }
            // The host is gone; the caller sees that too and drops this.
            Ok(Err(_)) => {
                frames.give_up();
                Timer::after_millis(1).await;
                count = 0;
            }
            Err(_) => {
                frames.give_up();
                packet[0] = FRAME_END;
                count = 1;
            }
        }
    }
}

/// Frames as a stream of bytes, and which of them are not known to be sent.
struct Frames<'a> {
    link: &'a mut SendEnd,
    frame: [u8; MAX_FRAME],
    length: usize,
    taken: usize,
    /// What the frame being taken carries.
    carries: Carries,
    /// Rows in frames of which something is still to be sent.
    unsent_rows: u32,
    /// Other messages in such frames.
    unsent_others: u32,
    /// Whether the host has seen the end of the last transfer, a packet of less than full length.
    transfer_has_ended: bool,
}

impl<'a> Frames<'a> {
    fn new(link: &'a mut SendEnd) -> Self {
        Self {
            link,
            frame: [0; MAX_FRAME],
            length: 0,
            taken: 0,
            carries: Carries::Other,
            unsent_rows: 0,
            unsent_others: 0,
            transfer_has_ended: true,
        }
    }

    /// As many bytes as there are and fit.
    fn fill(&mut self, packet: &mut [u8]) -> usize {
        let mut filled = 0;
        while filled < packet.len() {
            if self.taken == self.length {
                let Some((length, carries)) = self.link.try_next_frame(&mut self.frame) else { break };
                (self.length, self.taken, self.carries) = (length, 0, carries);
                match carries {
                    Carries::Row => self.unsent_rows += 1,
                    Carries::Other => self.unsent_others += 1,
                }
            }
            let rest = &self.frame[self.taken..self.length];
            let count = rest.len().min(packet.len() - filled);
            packet[filled..filled + count].copy_from_slice(&rest[..count]);
            self.taken += count;
            filled += count;
        }
        filled
    }

    /// The packet filled last is on its way.
    fn sent(&mut self, ends_transfer: bool) {
        self.transfer_has_ended = ends_transfer;
        let begun = u32::from(self.taken < self.length);
        (self.unsent_rows, self.unsent_others) = match self.carries {
            Carries::Row => (begun, 0),
            Carries::Other => (0, begun),
        };
    }

    /// What was taken and is not sent will not be sent, nor what waits behind it, which gets no younger.
    fn give_up(&mut self) {
        self.link.lost(self.unsent_rows, self.unsent_others);
        (self.unsent_rows, self.unsent_others) = (0, 0);
        (self.length, self.taken) = (0, 0);
        self.transfer_has_ended = true;
        self.link.discard();
    }
}

impl Drop for Frames<'_> {
    fn drop(&mut self) {
        self.link.lost(self.unsent_rows, self.unsent_others);
    }
}

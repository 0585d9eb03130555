//! Parameters in the last two sectors of the flash memory: registers under `shared::storage`.
//!
//! The program runs from bank 1 and the sectors are in bank 2, so instructions are fetched while a word is programmed or
//! a sector erased; only an access to bank 2 would wait. None is made meanwhile: the task below is the only one that
//! knows the sectors, and it sleeps until the controller is done. What is written when is decided in `shared::board`.
//!
//! The driver of embassy is not used: it stops the processor during an operation, and on chips of revision A, Y and 1 it
//! panics at every read while PA12 carries USB (erratum ES0206 2.2.14: such reads may be wrong). Here everything is read
//! at the start, before USB is; a store on such a chip may read back wrong and then fails by name.

use core::ptr::{addr_of, read_volatile, write_volatile};

use embassy_stm32::{pac, pac::flash::vals::Psize};
use embassy_time::{Duration, Instant, Timer};
use heapless::spsc::{Consumer, Producer, Queue};
use shared::{
    protocol::StoreFailure,
    storage::{ERASED, Flash, Found, Log, Parameters, SLOT_WORDS, Sector},
};

unsafe extern "C" {
    /// Start of the reserved sectors (see `memory.x`).
    static _parameters_start: u32;
}

/// RM0090, table 6: sectors 22 and 23.
const SECTOR_WORDS: usize = 128 * 1024 / 4;

/// Their numbers in the control register: sectors of bank 2 are 16 to 27 there (RM0090, 3.9.8).
const SECTOR_NUMBERS: [u8; 2] = [26, 27];

/// Opens the control register until it is locked again (RM0090, 3.6.1).
const UNLOCK_KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// A word takes 16 µs, at most 100 (DS9405, table 48).
const PROGRAM_TIMEOUT: Duration = Duration::from_millis(5);
const PROGRAM_POLL: Duration = Duration::from_ticks(1);

/// A sector takes 1 s, at most 2 with words of 32 bits.
const ERASE_TIMEOUT: Duration = Duration::from_millis(8000);
const ERASE_POLL: Duration = Duration::from_millis(5);

/// How often to look whether there is something to store.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Between control interrupt and task, in static memory. A queue of N holds N - 1.
pub struct Storage {
    orders: Queue<Option<Parameters>, 2>,
    results: Queue<Result<(), StoreFailure>, 2>,
}

impl Storage {
    /// With nothing to do.
    pub const fn new() -> Self {
        Self { orders: Queue::new(), results: Queue::new() }
    }

    /// The ends for the control interrupt and for the task.
    pub fn split(&'static mut self) -> (ControlEnd, TaskEnd) {
        let (order_producer, orders) = self.orders.split();
        let (result_producer, results) = self.results.split();
        (ControlEnd { orders: order_producer, results }, TaskEnd { orders, results: result_producer })
    }
}

/// The control interrupt's end.
pub struct ControlEnd {
    orders: Producer<'static, Option<Parameters>>,
    results: Consumer<'static, Result<(), StoreFailure>>,
}

impl ControlEnd {
    /// What came of the order, once it is done.
    pub fn result(&mut self) -> Option<Result<(), StoreFailure>> {
        self.results.dequeue()
    }

    /// Has something stored. The board gives no other order before it has heard the result of this one.
    pub fn order(&mut self, parameters: Option<Parameters>) {
        // So there is always room.
        let _ = self.orders.enqueue(parameters);
    }
}

/// The task's end.
pub struct TaskEnd {
    orders: Consumer<'static, Option<Parameters>>,
    results: Producer<'static, Result<(), StoreFailure>>,
}

/// Finds out what is stored.
pub fn open() -> (Log, Found) {
    Log::open(&Sectors)
}

/// Stores what the board orders.
#[embassy_executor::task]
pub async fn store(mut log: Log, mut end: TaskEnd) {
    // An operation that began before a restart goes on after it.
    let _ = until_ready(ERASE_POLL, ERASE_TIMEOUT).await;
    loop {
        Timer::after(LOOK_EVERY).await;
        let Some(parameters) = end.orders.dequeue() else { continue };
        let result = log.store(&mut Sectors, parameters.as_ref()).await;
        if let Err(StoreFailure::Controller { status }) = result {
            defmt::error!("flash controller status {:#06x}", status);
        }
        // There is room: the one result before was taken when this order was given.
        let _ = end.results.enqueue(result);
    }
}

/// The two sectors. No value of it but the one in [`store`] writes.
struct Sectors;

impl Sectors {
    fn address(sector: Sector, index: usize) -> *mut u32 {
        addr_of!(_parameters_start).cast_mut().wrapping_add(sector.index() * SECTOR_WORDS + index)
    }
}

impl Flash for Sectors {
    const SLOTS: usize = SECTOR_WORDS / SLOT_WORDS;

    fn word(&self, sector: Sector, index: usize) -> u32 {
        if index >= SECTOR_WORDS {
            return ERASED;
        }
        // SAFETY: within the reserved sectors, aligned, and readable always; volatile, because it changes by other means
        // than stores of this program.
        unsafe { read_volatile(Self::address(sector, index)) }
    }

    async fn program(&mut self, sector: Sector, index: usize, value: u32) -> Result<(), StoreFailure> {
        if index >= SECTOR_WORDS {
            return Ok(());
        }
        let unlocked = Unlocked::new();
        pac::FLASH.cr().write(|register| {
            register.set_psize(Psize::PSIZE32);
            register.set_pg(true);
        });
        // The register before the word.
        cortex_m::asm::dsb();
        // SAFETY: within the reserved sectors, which hold nothing of the program, and aligned. With PG set a store is
        // how a word is programmed.
        unsafe { write_volatile(Self::address(sector, index), value) };
        cortex_m::asm::dsb();
        unlocked.finish(PROGRAM_POLL, PROGRAM_TIMEOUT).await
    }

    async fn erase(&mut self, sector: Sector) -> Result<(), StoreFailure> {
        let unlocked = Unlocked::new();
        pac::FLASH.cr().write(|register| {
            register.set_psize(Psize::PSIZE32);
            register.set_ser(true);
            register.set_snb(SECTOR_NUMBERS[sector.index()]);
        });
        pac::FLASH.cr().modify(|register| register.set_strt(true));
        let result = unlocked.finish(ERASE_POLL, ERASE_TIMEOUT).await;
        forget_cached_data();
        result
    }
}

/// An open control register, locked again at the end of the one operation it is opened for.
struct Unlocked;

impl Unlocked {
    fn new() -> Self {
        if pac::FLASH.cr().read().lock() {
            UNLOCK_KEYS.into_iter().for_each(|key| pac::FLASH.keyr().write_value(key));
        }
        clear_errors();
        Self
    }

    async fn finish(self, poll: Duration, timeout: Duration) -> Result<(), StoreFailure> {
        until_ready(poll, timeout).await?;
        match errors() {
            0 => Ok(()),
            status => Err(StoreFailure::Controller { status }),
        }
    }
}

impl Drop for Unlocked {
    fn drop(&mut self) {
        pac::FLASH.cr().write(|register| register.set_lock(true));
    }
}

/// Bits of the status register that tell of an error: OPERR, WRPERR, PGAERR, PGPERR, PGSERR, RDERR (RM0090, 3.9.6).
const ERRORS: u32 = 0b1_1111_0010;

fn errors() -> u32 {
    pac::FLASH.sr().read().0 & ERRORS
}

/// Writing a one clears.
fn clear_errors() {
    pac::FLASH.sr().write(|register| register.0 = ERRORS);
}

async fn until_ready(poll: Duration, timeout: Duration) -> Result<(), StoreFailure> {
    let began = Instant::now();
    while pac::FLASH.sr().read().bsy() {
        if began.elapsed() > timeout {
            return Err(StoreFailure::Timeout { waited_ms: timeout.as_millis() as u16 });
        }
        Timer::after(poll).await;
    }
    Ok(())
}

/// What was erased may still be in the data cache (RM0090, 3.6.4), which can only be emptied while it is off.
fn forget_cached_data() {
    let control = pac::FLASH.acr();
    if control.read().dcen() {
        control.modify(|register| register.set_dcen(false));
        control.modify(|register| register.set_dcrst(true));
        control.modify(|register| register.set_dcrst(false));
        control.modify(|register| register.set_dcen(true));
    }
}

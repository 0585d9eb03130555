//! The flash memory behind its controller. The emulator models the controller's registers and how long an erasure takes,
//! but neither programs nor erases, nor lets the program write there.
//!
//! Modelled: words programmed bit by bit from 1 to 0 (RM0090, 3.6.4) in 16 µs, sectors erased at the end of the
//! emulator's erasure, and both left half way by a power cut. Everything the firmware must not do is told: other widths,
//! a locked controller, an operation during another, a place outside the two sectors for parameters. A debug probe's code
//! may write everywhere, and erase in whatever width; it does not wait, because an image would take minutes here. Left out:
//! that reading bank 2 waits during an operation, and caches.

use std::ops::Range;

use rigless::emulator::{Access, Host};
use rigless::mcu::Bare;
use rigless::soc::stm32f427::generated::FLASH;
use rigless::soc::stm32f427::generated::flash::{Register, cr, sr};
use rigless::soc::stm32f427::{CPU, MEMORY};
use rigless::soc::{Bus, Error, Region, Width};

use super::nucleo::Nucleo;

/// Where both sectors for the parameters are.
pub const PARAMETERS: Range<u64> = 0x081C_0000..0x0820_0000;

/// All of the flash memory.
pub const WHOLE: Range<u64> = 0x0800_0000..0x0820_0000;

const BANK_BYTES: u64 = 1 << 20;
const WORD_BYTES: u64 = 4;

/// In the number of a sector, which bank it is in.
const SECOND_BANK: u64 = 16;

/// Words of 32 bits in the control register.
const PSIZE_32: u64 = 2;

const CONTROL_REGISTER: u64 = FLASH.base + 0x10;

/// Typical time to program a word (DS9405, table 48).
const PROGRAM_NS: u64 = 16_000;

/// The memory map of the part, with a flash memory that can be written to by way of its controller. The emulator builds
/// its memory from this, once.
static WRITABLE: [Region; 5] = [MEMORY[0].programmed_by("FLASH"), MEMORY[1], MEMORY[2], MEMORY[3], MEMORY[4]];

/// What describes that memory map to the emulator. Nothing else asks it anything.
pub fn memory_map() -> Result<Bare, Error> {
    Bare::new(Bus::builder(CPU, &WRITABLE, [FLASH]))
}

/// What the firmware did to the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashOperation {
    /// Programmed a word.
    Program {
        /// Where.
        address: u64,
    },
    /// Erased a sector.
    Erase {
        /// Where it begins.
        address: u64,
    },
}

/// Whether an operation is carried out, or power fails in the middle of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Carried out.
    Whole,
    /// The number decides which bits are done.
    Torn(u64),
}

/// The memory's doings.
#[derive(Debug, Default)]
pub struct FlashArray {
    busy_until_ns: Option<u64>,
    erasing: Option<Range<u64>>,
    is_probed: bool,
}

impl FlashArray {
    /// Takes an access of the firmware to any register or place; says which operation began with it, or what was wrong.
    /// `fate` is asked once for each operation.
    pub fn observe(
        &mut self,
        board: &mut Nucleo,
        host: &mut dyn Host,
        access: &Access,
        fate: impl FnOnce() -> Fate,
    ) -> Option<Result<FlashOperation, String>> {
        let at_ns = access.virtual_time.0;
        let is_register = (FLASH.base..FLASH.base + FLASH.size).contains(&access.address);
        if !is_register && !WHOLE.contains(&access.address) {
            return None;
        }
        self.settle(board, host, at_ns);
        let is_write = access.kind == rigless::emulator::AccessKind::Write;
        if is_write && WHOLE.contains(&access.address) {
            return Some(self.program(board, host, access, fate));
        }
        // The emulator's controller has taken the write: it erases if it found nothing wrong.
        let control = board.flash_register(Register::Cr);
        let started = is_write && access.address == CONTROL_REGISTER && cr::STRT.is_set(control);
        if started && self.erasing.is_none() {
            let sector = sector(cr::SNB.get(control)).filter(|sector| self.may_change(sector.start));
            let (Some(sector), true, true) =
                (sector, cr::SER.is_set(control), self.is_probed || cr::PSIZE.get(control) == PSIZE_32)
            else {
                return Some(Err(format!("erasure with {control:#010x} in the control register at {at_ns} ns")));
            };
            let address = sector.start;
            match fate() {
                Fate::Whole if self.is_probed => {
                    erase(host, sector, Fate::Whole);
                    board.set_flash_register(Register::Cr, cr::STRT.set(control, 0));
                    let status = board.flash_register(Register::Sr);
                    board.set_flash_register(Register::Sr, sr::BSY.set(status, 0));
                }
                Fate::Whole => self.erasing = Some(sector),
                fate @ Fate::Torn(_) => erase(host, sector, fate),
            }
            return Some(Ok(FlashOperation::Erase { address }));
        }
        None
    }

    /// Ends what is over by now. Soon enough when the firmware looks: nothing else can tell.
    fn settle(&mut self, board: &mut Nucleo, host: &mut dyn Host, at_ns: u64) {
        if self.busy_until_ns.is_some_and(|until_ns| at_ns >= until_ns) {
            self.busy_until_ns = None;
            let status = board.flash_register(Register::Sr);
            board.set_flash_register(Register::Sr, sr::BSY.set(status, 0));
        }
        if !sr::BSY.is_set(board.flash_register(Register::Sr))
            && let Some(sector) = self.erasing.take()
        {
            erase(host, sector, Fate::Whole);
        }
    }

    /// Power failed: nothing goes on.
    pub fn power_failed(&mut self) {
        *self = Self { is_probed: self.is_probed, ..Self::default() };
    }

    /// A debug probe has hold of the core, or has let it go.
    pub fn set_probed(&mut self, is_probed: bool) {
        self.is_probed = is_probed;
    }

    fn may_change(&self, address: u64) -> bool {
        self.is_probed || PARAMETERS.contains(&address)
    }

    fn program(
        &mut self,
        board: &mut Nucleo,
        host: &mut dyn Host,
        access: &Access,
        fate: impl FnOnce() -> Fate,
    ) -> Result<FlashOperation, String> {
        let Access { address, width, value, virtual_time, .. } = *access;
        let control = board.flash_register(Register::Cr);
        let status = board.flash_register(Register::Sr);
        let is_right = self.may_change(address)
            && address.is_multiple_of(WORD_BYTES)
            && width == Width::W32
            && cr::PG.is_set(control)
            && cr::PSIZE.get(control) == PSIZE_32
            && !cr::LOCK.is_set(control)
            && !sr::BSY.is_set(status);
        if !is_right {
            return Err(format!(
                "store of {value:#x} ({width:?}) to {address:#010x} with control register {control:#010x} and status \
                 {status:#010x} at {} ns",
                virtual_time.0
            ));
        }
        let held = host.read(address, Width::W32).map_err(|error| error.to_string())?;
        let programmed = match fate() {
            Fate::Whole => held & value,
            Fate::Torn(number) => held & (value | scrambled(number)),
        };
        host.program(address, Width::W32, programmed).map_err(|error| error.to_string())?;
        if !self.is_probed {
            board.set_flash_register(Register::Sr, sr::BSY.set(status, 1));
            self.busy_until_ns = Some(virtual_time.0 + PROGRAM_NS);
        }
        Ok(FlashOperation::Program { address })
    }
}

/// Where the sector of that number is: in each bank four of 16 KiB, one of 64, seven of 128 (RM0090, table 6).
fn sector(number: u64) -> Option<Range<u64>> {
    let (bank, number) = (number / SECOND_BANK, number % SECOND_BANK);
    let (from, to) = match number {
        0..4 => (number << 14, (number + 1) << 14),
        4 => (1 << 16, 1 << 17),
        5..12 => ((number - 4) << 17, (number - 3) << 17),
        _ => return None,
    };
    let base = WHOLE.start + bank * BANK_BYTES;
    Some(base + from..base + to)
}

fn erase(host: &mut dyn Host, sector: Range<u64>, fate: Fate) {
    for address in sector.step_by(WORD_BYTES as usize) {
        let erased = match fate {
            Fate::Whole => u64::from(u32::MAX),
            Fate::Torn(number) => match host.read(address, Width::W32) {
                Ok(held) => held | scrambled(number ^ address),
                Err(_) => continue,
            },
        };
        // The map above makes all of it programmable.
        let _ = host.program(address, Width::W32, erased);
    }
}

/// 32 bits that depend on a number in no simple way (SplitMix64).
fn scrambled(number: u64) -> u64 {
    let mut bits = number.wrapping_add(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ bits >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    (bits ^ bits >> 31) & u64::from(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sectors_follow_each_other_and_the_last_two_hold_the_parameters() {
        let sectors: Vec<Range<u64>> = (0..2 * SECOND_BANK).filter_map(sector).collect();
        assert_eq!(sectors.len(), 24);
        assert_eq!((sectors[0].start, sectors[23].end), (WHOLE.start, WHOLE.end));
        assert!(sectors.windows(2).all(|two| two[0].end == two[1].start));
        assert_eq!(sectors[22].start, PARAMETERS.start);
    }
}

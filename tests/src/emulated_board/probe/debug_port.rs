//! The chip's debug port, its one access port, and the core's debug registers behind that (ARM IHI 0031 and DDI 0403,
//! chapter C1), over the emulator's debugger.
//!
//! Left out: breakpoints and watchpoints in hardware (the chip says that it has none), the floating-point registers, and
//! that a running core goes on during an access to memory: here it stands still, for no time at all.

use super::debugger::{Debugger, DebuggerError};

/// DPIDR of an STM32F4.
const DEBUG_PORT_ID: u32 = 0x2BA0_1477;

/// Registers of the debug port, and of the access port.
const CTRL_STAT: u16 = 0x4;
const SELECT: u16 = 0x8;
const AP_CSW: u8 = 0x00;
const AP_TAR: u8 = 0x04;
const AP_DRW: u8 = 0x0C;
const AP_BASE: u8 = 0xF8;
const AP_IDR: u8 = 0xFC;

/// Identification of an AHB access port, and where the chip's table of components is.
const AHB_AP: u32 = 0x2477_0011;
const COMPONENTS: u32 = 0xE00F_F003;
/// The access port can be used.
const DEVICE_ENABLED: u32 = 1 << 6;

/// Requests to power up, each acknowledged in the bit above it.
const POWER_UP_REQUESTS: u32 = 1 << 28 | 1 << 30;

/// Addresses of the core's registers that are about debugging.
const FLASH_PATCH: std::ops::Range<u32> = 0xE000_2000..0xE000_3000;
const AIRCR: u32 = 0xE000_ED0C;
const DHCSR: u32 = 0xE000_EDF0;
const DCRSR: u32 = 0xE000_EDF4;
const DCRDR: u32 = 0xE000_EDF8;
const DEMCR: u32 = 0xE000_EDFC;

const AIRCR_KEY: u32 = 0x05FA;
const RESET_REQUEST: u32 = 1 << 2;

const DHCSR_KEY: u32 = 0xA05F;
const C_DEBUGEN: u32 = 1 << 0;
const C_HALT: u32 = 1 << 1;
const C_STEP: u32 = 1 << 2;
const S_REGRDY: u32 = 1 << 16;
const S_HALT: u32 = 1 << 17;
const S_RETIRE_ST: u32 = 1 << 24;
const S_RESET_ST: u32 = 1 << 25;

const VC_CORERESET: u32 = 1 << 0;
const REGISTER_WRITE: u32 = 1 << 16;

/// What GDB's numbers are for registers that the core has others for: xPSR follows the sixteen, then sixteen double words
/// and their status word, then the rest.
const GDB_MAIN_STACK: usize = 34;
const GDB_PROCESS_STACK: usize = 35;
/// PRIMASK, BASEPRI, FAULTMASK, CONTROL: bytes of one register to the debug port, from the lowest.
const GDB_SPECIAL: [usize; 4] = [36, 37, 38, 39];

/// Debug port, access port and core.
pub struct DebugPort {
    debugger: Debugger,
    control: u32,
    select: u32,
    access_control: u32,
    transfer_address: u32,
    core_control: u32,
    core_data: u32,
    exceptions: u32,
    was_reset: bool,
}

impl DebugPort {
    /// A chip that nobody has debugged since its power came.
    pub fn new(debugger: Debugger) -> Self {
        Self {
            debugger,
            control: 0,
            select: 0,
            access_control: 0,
            transfer_address: 0,
            core_control: 0,
            core_data: 0,
            exceptions: 0,
            was_reset: false,
        }
    }

    /// Reads a register of the debug port.
    pub fn read(&self, register: u16) -> u32 {
        match register {
            0 => DEBUG_PORT_ID,
            CTRL_STAT if self.select & 0xF == 0 => self.control | (self.control & POWER_UP_REQUESTS) << 1,
            _ => 0,
        }
    }

    /// Writes one. An abort has nothing to end here.
    pub fn write(&mut self, register: u16, value: u32) {
        match register {
            CTRL_STAT if self.select & 0xF == 0 => self.control = value,
            SELECT => self.select = value,
            _ => {}
        }
    }

    /// Reads a register of an access port; those that the chip has not are zero.
    pub fn read_access_port(&mut self, port: u8, register: u8) -> Result<u32, DebuggerError> {
        Ok(match (port, register) {
            (0, AP_CSW) => self.access_control | DEVICE_ENABLED,
            (0, AP_TAR) => self.transfer_address,
            (0, AP_DRW) => {
                let mut word = [0; 4];
                self.read_memory(self.transfer_address, &mut word)?;
                u32::from_le_bytes(word)
            }
            (0, AP_BASE) => COMPONENTS,
            (0, AP_IDR) => AHB_AP,
            _ => 0,
        })
    }

    /// Writes one.
    pub fn write_access_port(&mut self, port: u8, register: u8, value: u32) -> Result<(), DebuggerError> {
        match (port, register) {
            (0, AP_CSW) => self.access_control = value,
            (0, AP_TAR) => self.transfer_address = value,
            (0, AP_DRW) => {
                self.write_memory(self.transfer_address, &value.to_le_bytes())?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Reads through the access port; false where nothing answers.
    pub fn read_memory(&mut self, address: u32, bytes: &mut [u8]) -> Result<bool, DebuggerError> {
        if let Ok(word) = <&mut [u8; 4]>::try_from(&mut *bytes)
            && let Some(value) = self.read_core_register(address)?
        {
            *word = value.to_le_bytes();
            return Ok(true);
        }
        self.debugger.read(address, bytes)
    }

    /// Writes through it; false where nothing takes it.
    pub fn write_memory(&mut self, address: u32, bytes: &[u8]) -> Result<bool, DebuggerError> {
        if let Ok(word) = <[u8; 4]>::try_from(bytes)
            && self.write_core_register(address, u32::from_le_bytes(word))?
        {
            return Ok(true);
        }
        self.debugger.write(address, bytes)
    }

    /// Resets the chip, by its pin or by the core's own request. The core stops before its first instruction if it is told to.
    pub fn reset(&mut self) -> Result<(), DebuggerError> {
        self.debugger.reset()?;
        self.was_reset = true;
        let is_caught = self.exceptions & VC_CORERESET != 0 && self.core_control & C_DEBUGEN != 0;
        if is_caught { Ok(()) } else { self.debugger.resume() }
    }

    /// The probe is taken away.
    pub fn disconnect(self) -> Result<(), DebuggerError> {
        self.debugger.detach()
    }

    fn read_core_register(&mut self, address: u32) -> Result<Option<u32>, DebuggerError> {
        Ok(Some(match address {
            DHCSR => {
                let mut status = self.core_control & (C_DEBUGEN | C_HALT | C_STEP) | S_REGRDY;
                status |= if self.debugger.is_running()? { S_RETIRE_ST } else { S_HALT };
                if std::mem::take(&mut self.was_reset) {
                    status |= S_RESET_ST;
                }
                status
            }
            DCRSR => 0,
            DCRDR => self.core_data,
            DEMCR => self.exceptions,
            _ if FLASH_PATCH.contains(&address) => 0,
            _ => return Ok(None),
        }))
    }

    /// False for an address that is no such register.
    fn write_core_register(&mut self, address: u32, value: u32) -> Result<bool, DebuggerError> {
        match address {
            AIRCR if value >> 16 == AIRCR_KEY && value & RESET_REQUEST != 0 => self.reset()?,
            DHCSR if value >> 16 == DHCSR_KEY => self.control_core(value & 0xFFFF)?,
            DHCSR => {}
            DCRSR => self.transfer(value)?,
            DCRDR => self.core_data = value,
            DEMCR => self.exceptions = value,
            _ if FLASH_PATCH.contains(&address) => {}
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn control_core(&mut self, control: u32) -> Result<(), DebuggerError> {
        self.core_control = control;
        let runs = self.debugger.is_running()?;
        if control & C_DEBUGEN == 0 || control & (C_HALT | C_STEP) == 0 {
            return if runs { Ok(()) } else { self.debugger.resume() };
        }
        if control & C_HALT != 0 {
            return self.debugger.halt();
        }
        if runs {
            self.debugger.halt()?;
        }
        self.debugger.step()
    }

    /// A register of the core to or from the data register.
    fn transfer(&mut self, selection: u32) -> Result<(), DebuggerError> {
        let writes = selection & REGISTER_WRITE != 0;
        let number = match selection & 0x7F {
            number @ 0..=16 => number as usize,
            17 => GDB_MAIN_STACK,
            18 => GDB_PROCESS_STACK,
            20 => return self.transfer_special(writes),
            _ => return Ok(()),
        };
        if writes {
            return self.debugger.set_register(number, self.core_data);
        }
        self.core_data = self.debugger.register(number)?;
        Ok(())
    }

    fn transfer_special(&mut self, writes: bool) -> Result<(), DebuggerError> {
        let mut bytes = self.core_data.to_le_bytes();
        for (number, byte) in GDB_SPECIAL.into_iter().zip(&mut bytes) {
            if writes {
                self.debugger.set_register(number, (*byte).into())?;
            } else {
                *byte = self.debugger.register(number)? as u8;
            }
        }
        self.core_data = u32::from_le_bytes(bytes);
        Ok(())
    }
}

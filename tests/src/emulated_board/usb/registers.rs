//! Registers of the OTG full-speed core in device mode, by their offsets (RM0090, 34.16), and the fields that the model
//! of the core uses.

/// Control and status, AHB and USB configuration, reset, interrupts.
pub const GOTGCTL: u64 = 0x000;
pub const GOTGINT: u64 = 0x004;
pub const GAHBCFG: u64 = 0x008;
pub const GUSBCFG: u64 = 0x00C;
pub const GRSTCTL: u64 = 0x010;
pub const GINTSTS: u64 = 0x014;
pub const GINTMSK: u64 = 0x018;
pub const GRXSTSR: u64 = 0x01C;
pub const GRXSTSP: u64 = 0x020;
pub const GRXFSIZ: u64 = 0x024;
/// Size of the transmit FIFO of endpoint 0; those of the others follow at 0x104.
pub const DIEPTXF0: u64 = 0x028;
pub const DIEPTXF1: u64 = 0x104;
pub const DIEPTXF3: u64 = 0x10C;
pub const GCCFG: u64 = 0x038;
pub const CID: u64 = 0x03C;
/// Hardware configuration: not in the manual, but in every core of this maker. The driver looks for the width of a PHY
/// that this core does not have.
pub const HWCFG4: u64 = 0x050;
pub const DCFG: u64 = 0x800;
pub const DCTL: u64 = 0x804;
pub const DSTS: u64 = 0x808;
pub const DIEPMSK: u64 = 0x810;
pub const DOEPMSK: u64 = 0x814;
pub const DAINT: u64 = 0x818;
pub const DAINTMSK: u64 = 0x81C;
pub const DIEPEMPMSK: u64 = 0x834;
/// IN endpoints, 0x20 apart: control 0x00, interrupts 0x08, size 0x10, space in the FIFO 0x18.
pub const IN_ENDPOINTS: u64 = 0x900;
/// OUT endpoints, likewise.
pub const OUT_ENDPOINTS: u64 = 0xB00;
/// FIFOs, one every 0x1000.
pub const FIFOS: u64 = 0x1000;

/// What CID reads on this part.
pub const CORE_ID: u32 = 0x0000_1200;

/// Unmasks the interrupt line (GAHBCFG).
pub const GINT: u32 = 1;
/// Forces device mode (GUSBCFG).
pub const FDMOD: u32 = 1 << 30;

/// GRSTCTL.
pub const RESET_AND_FLUSH: u32 = 0b11_0111;
pub const CSRST: u32 = 1;
pub const RXFFLSH: u32 = 1 << 4;
pub const TXFFLSH: u32 = 1 << 5;
pub const AHBIDL: u32 = 1 << 31;
/// The FIFO number that means all of them.
pub const ALL_FIFOS: u32 = 0x10;

/// GINTSTS and GINTMSK.
pub const SOF: u32 = 1 << 3;
pub const RXFLVL: u32 = 1 << 4;
pub const ESUSP: u32 = 1 << 10;
pub const USBSUSP: u32 = 1 << 11;
pub const USBRST: u32 = 1 << 12;
pub const ENUMDNE: u32 = 1 << 13;
pub const IEPINT: u32 = 1 << 18;
pub const OEPINT: u32 = 1 << 19;
pub const WKUPINT: u32 = 1 << 31;
/// Both non-periodic and periodic FIFO empty; unused in device mode, as out of reset.
pub const GINTSTS_AFTER_RESET: u32 = 0x0400_0020;

/// GCCFG: transceiver on, VBUS taken as present.
pub const PWRDWN: u32 = 1 << 16;
pub const NOVBUSSENS: u32 = 1 << 21;

/// Soft disconnect (DCTL).
pub const SDIS: u32 = 1 << 1;

/// DSTS.
pub const SUSPSTS: u32 = 1;
pub const FULL_SPEED: u32 = 0b11 << 1;
pub const FNSOF_SHIFT: u32 = 8;
pub const FNSOF_MASK: u32 = 0x3FFF;

/// Endpoint control.
pub const ENDPOINT_STORED: u32 = 0x03EC_87FF;
pub const USBAEP: u32 = 1 << 15;
pub const DPID: u32 = 1 << 16;
pub const NAKSTS: u32 = 1 << 17;
pub const STALL: u32 = 1 << 21;
pub const CNAK: u32 = 1 << 26;
pub const SNAK: u32 = 1 << 27;
pub const SD0PID: u32 = 1 << 28;
pub const SD1PID: u32 = 1 << 29;
pub const EPDIS: u32 = 1 << 30;
pub const EPENA: u32 = 1 << 31;

/// Endpoint interrupts.
pub const XFRC: u32 = 1;
pub const EPDISD: u32 = 1 << 1;
pub const STUP: u32 = 1 << 3;
pub const INEPNE: u32 = 1 << 6;
pub const TXFE: u32 = 1 << 7;

/// Endpoint size: packets.
pub const PKTCNT_SHIFT: u32 = 19;
pub const PKTCNT_MASK: u32 = 0x3FF << PKTCNT_SHIFT;
pub const XFRSIZ_MASK: u32 = 0x7_FFFF;

/// Kinds of entries in the receive FIFO (GRXSTSP, from bit 17).
pub const OUT_DATA: u32 = 2;
pub const OUT_DONE: u32 = 3;
pub const SETUP_DONE: u32 = 4;
pub const SETUP_DATA: u32 = 6;

//! How the board is told from everything else on USB. The udev rules of the host repeat both numbers.

/// USB vendor: the shared one of pid.codes, for open hardware.
pub const VENDOR_ID: u16 = 0x1209;

/// USB product. For tests only: pid.codes sets it aside for devices that do not leave the laboratory, so a product that
/// is handed to others needs a number of its own, here and in the udev rules.
pub const PRODUCT_ID: u16 = 0x0001;

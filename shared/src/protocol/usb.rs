//! How the board presents itself on USB, and how a host therefore finds it: a CDC-ACM serial port.

/// Vendor: pid.codes, which gives numbers to open hardware.
pub const VENDOR_ID: u16 = 0x1209;

/// Product: the first of the vendor's numbers for private tests. **It must be replaced by one of our own before boards
/// are given away**; here is the only place.
pub const PRODUCT_ID: u16 = 0x0001;

/// Name of the manufacturer, shown by the host's system. Together with [`PRODUCT`] it tells the board from other
/// devices under test that use the same numbers.
pub const MANUFACTURER: &str = "armid";

/// Name of the product, shown by the host's system.
pub const PRODUCT: &str = "armid controller board";

/// Characters of a [`serial_number`].
pub const SERIAL_NUMBER_LENGTH: usize = 24;

/// The serial number of a board: its chip's unique number in hexadecimal, so that one board keeps its name on every
/// port and two boards never share one.
pub fn serial_number(chip_id: &[u8; 12]) -> [u8; SERIAL_NUMBER_LENGTH] {
    const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    let mut digits = [b'0'; SERIAL_NUMBER_LENGTH];
    for (pair, byte) in digits.chunks_exact_mut(2).zip(chip_id) {
        for (digit, value) in pair.iter_mut().zip([byte >> 4, byte & 0xF]) {
            *digit = DIGITS.get(usize::from(value)).copied().unwrap_or(b'0');
        }
    }
    digits
}

//! The board as a state machine around a simulated arm: movements, faults, requests.

mod faults;
mod kept_faults;
mod load;
mod movements;
mod requests;
mod rig;
mod storing;
mod transfers;

/// The firmware's budget: 147 KB of rows and the board itself in the 192 KB of an STM32F429's main memory.
#[test]
fn it_fits_the_chip() {
    use shared::board::{Board, DEFAULT_SAMPLES};
    use shared::protocol::PackedSample;
    assert_eq!(size_of::<[PackedSample; DEFAULT_SAMPLES]>(), 147_000);
    assert!(size_of::<Board<&'static mut [PackedSample]>>() <= 13 * 1024);
}

//! The fault that is kept over a reset.

use shared::board::KeptFault;
use shared::protocol::*;

const PANIC: Fault = Fault::Panic { place: SourcePlace::UNKNOWN };

fn faults() -> Vec<Fault> {
    let joint = Joint::Third;
    vec![
        Fault::EmergencyStop,
        Fault::FollowingError { joint, error_counts: i32::MIN, limit_counts: i32::MAX },
        Fault::CurrentLimit { joint, limit_a: 12.5, held_ns: u64::MAX },
        Fault::LinkLost { silent_ns: u64::MAX, limit_ns: u64::MAX },
        Fault::Panic { place: SourcePlace::new("firmware/src/control_interrupt.rs", u32::MAX) },
        Fault::HardFault { program_counter: u32::MAX, status: u32::MAX },
        Fault::BusError { program_counter: u32::MAX, address: u32::MAX },
        Fault::UnexpectedInterrupt { number: -14 },
        Fault::Watchdog,
    ]
}

#[test]
fn every_fault_is_reported_at_every_start_until_power_is_lost() {
    for fault in faults() {
        let mut kept = KeptFault::new(&fault);
        assert_eq!(kept.at_start(ResetCause::Software), Some(fault));
        assert_eq!(kept.at_start(ResetCause::Pin), Some(fault));
        assert_eq!(kept.at_start(ResetCause::Pin), Some(fault));
    }
    assert_eq!({ KeptFault::NONE }.at_start(ResetCause::PowerOn), None);
}

#[test]
fn a_watchdog_reset_is_a_fault_unless_one_that_halts_explains_it() {
    let mut nothing = KeptFault::NONE;
    assert_eq!(nothing.at_start(ResetCause::Watchdog), Some(Fault::Watchdog));
    assert_eq!(nothing.at_start(ResetCause::Pin), Some(Fault::Watchdog), "and is kept");

    let mut explained = KeptFault::new(&PANIC);
    assert_eq!(explained.at_start(ResetCause::Watchdog), Some(PANIC));
    assert_eq!(explained.at_start(ResetCause::Watchdog), Some(Fault::Watchdog), "the next is another one");

    // The board ran on after it, so it does not explain why it stopped.
    let mut unrelated = KeptFault::new(&Fault::EmergencyStop);
    assert_eq!(unrelated.at_start(ResetCause::Watchdog), Some(Fault::Watchdog));
}

#[test]
fn the_processor_registers_tell_a_bus_error_from_other_faults() {
    // PRECISERR with a valid address, the same without, UNDEFINSTR (ARMv7-M B3.2.15).
    let (program_counter, address) = (0x0800_1234, 0x6000_0000);
    assert_eq!(Fault::of_processor(program_counter, 0x8200, address), Fault::BusError { program_counter, address });
    assert_eq!(Fault::of_processor(program_counter, 0x0400, address), Fault::BusError { program_counter, address: 0 });
    let undefined = Fault::of_processor(program_counter, 0x1_0000, address);
    assert_eq!(undefined, Fault::HardFault { program_counter, status: 0x1_0000 });
    let text = Fault::of_processor(program_counter, 0x8200, address).to_string();
    assert!(text.starts_with("bus-error: 0x60000000 did not answer the instruction at 0x08001234;"), "{text}");
}

#[test]
fn a_place_in_the_source_shows_the_end_of_its_path() {
    let shown = |path: &str| SourcePlace::new(path, 57).to_string();
    assert_eq!(shown("firmware/src/link.rs"), "src/link.rs:57");
    assert_eq!(shown("x.rs"), "x.rs:57");
    assert_eq!(shown("/a/long/path/to/somewhere/dma_bdma.rs"), "dma_bdma.rs:57");
    assert_eq!(shown("a_very_long_name_of_a_file.rs"), "ng_name_of_a_file.rs:57");
    assert_eq!(SourcePlace::UNKNOWN.to_string(), "a place that is not known");
}

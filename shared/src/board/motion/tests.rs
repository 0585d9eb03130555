//! What only a fault of the memory can bring about.

#[path = "../../../tests/protocol/samples.rs"]
#[expect(dead_code, reason = "only the configuration of it is used")]
mod samples;

use super::*;

/// Any bit of the counts to hold, or of their copy, is a fault in the next tick.
#[test]
fn a_flipped_bit_of_the_setpoint_is_a_fault_of_that_name() {
    let constants = Constants::new(&samples::configuration());
    let position_counts = [-1234, 5678];
    let inputs = Inputs { counts: [0; 2], current_code: [MID_SCALE; 2], emergency_stop: false, deadline_missed: false };
    let tick = Tick { inputs: &inputs, constants: &constants, position_counts, jump: None, trajectory: None };
    let mut motion = Motion::new();
    motion.arm(Link::Serial, position_counts);
    assert!(motion.step(&tick).is_ok(), "whole, it is none");
    let Path::Counts(held) = motion.path else { panic!("{:?}", motion.path) };
    for (joint, bit, copy) in (0..2).flat_map(|joint| (0..32).flat_map(move |bit| [(joint, bit, 0), (joint, bit, 1)])) {
        let mut damaged = held;
        damaged.flip(copy, joint, bit);
        motion.path = Path::Counts(damaged);
        let fault = motion.step(&tick).err();
        assert_eq!(fault, Some(Fault::MemoryCorrupted), "bit {bit} of joint {joint}, copy {copy}");
    }
}

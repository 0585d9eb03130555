//! Signature of every effect against a hand calculation.
mod robot;

use robot::{DEFAULT_GAINS, DELAY_S, PERIOD_S, laws, plant, reference, reference_counts};
use shared::control::SampledTiming;
use shared::effects::{Effects, ExtendedMachine, ExtendedPlant};
use shared::machine::Machine as _;
use shared::plant::State;
use shared::replay::{ClosedLoop, ReplaySettings};

fn settings(substeps: u32) -> ReplaySettings {
    let timing = SampledTiming { record_period_s: PERIOD_S, loop_period_s: PERIOD_S, command_delay_s: DELAY_S };
    ReplaySettings { timing, quantised: false, substeps }
}

#[test]
fn everything_off_is_the_plain_plant() {
    let extended = ExtendedMachine::new(&ExtendedPlant { plant: plant(), effects: Effects::OFF });
    let start = State::at_rest(reference(0.0).position_rad);
    let settings = settings(4);
    let mut plain = ClosedLoop::new(&plant(), laws(DEFAULT_GAINS, 0.0), &settings, start);
    let mut off = ClosedLoop::of(extended, laws(DEFAULT_GAINS, 0.0), &settings, extended.start(start, 0.0));
    let mut worst = 0.0_f64;
    for k in 0..5000 {
        let reference = reference_counts(f64::from(k) * PERIOD_S);
        let [a, b] = [plain.tick(reference, [0.0; 2]), off.tick(reference, [0.0; 2])];
        for joint in 0..2 {
            worst = worst.max((a.error_counts[joint] - b.error_counts[joint]).abs());
        }
    }
    println!("worst {worst}");
    assert!(worst < 1e-6, "{worst}");
}

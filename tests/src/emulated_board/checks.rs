//! What must be true of every run, whatever happened in it.

use shared::board::MID_SCALE;

use super::observations::Observations;

/// Registers that the firmware may touch although no model answers for them, each for a reason.
const UNMODELLED: [&str; 0] = [];

/// Off first, then mid-scale, within one run of the interrupt; both channels come up at code 0 for as long as it takes
/// to switch the second one on.
const LONGEST_OFF_CENTRE_NS: u64 = 5_000;

impl Observations {
    /// The amplifiers are enabled only with commands that were at mid-scale first; whenever they are not, be the board
    /// disarmed, reset, or stopped by a panic or a fault, the commands are at mid-scale or switched off. No register
    /// was touched that nothing answers for, and the flash memory was written to only with the amplifiers off.
    ///
    /// An output that is on leaves mid-scale only when the amplifiers are about to be enabled in the same run of the
    /// interrupt.
    pub fn check_always(&self) {
        assert_eq!(self.unmodelled, UNMODELLED);
        assert_eq!(self.flash_faults, [""; 0]);
        for used in &self.flash_uses {
            assert!(!used.amplifiers_enabled, "the flash memory was written to with the amplifiers on: {used:?}");
        }
        let mut mid_scale_was_written = false;
        for change in &self.outputs {
            let codes = change.outputs.command_code;
            // A reset switches the converter off.
            mid_scale_was_written = codes == [Some(MID_SCALE); 2] || mid_scale_was_written && codes != [None; 2];
            if change.outputs.amplifiers_enabled {
                assert!(mid_scale_was_written, "enabled before there was a command: {change:?}");
                assert!(codes.iter().all(Option::is_some), "enabled without a command: {change:?}");
            }
        }
        for (index, now) in self.outputs.iter().enumerate() {
            let off_centre = now.outputs.command_code.iter().flatten().any(|&code| code != MID_SCALE);
            if now.outputs.amplifiers_enabled || !off_centre {
                continue;
            }
            let next = self.outputs.get(index + 1);
            let lasts_ns = next.map_or(self.end_ns, |next| next.at_ns) - now.at_ns;
            let settles = next.is_some_and(|next| {
                next.outputs.amplifiers_enabled || next.outputs.command_code == [Some(MID_SCALE); 2]
            });
            assert!(
                settles && lasts_ns < LONGEST_OFF_CENTRE_NS,
                "off, but not at mid-scale for {lasts_ns} ns: {now:?}"
            );
        }
    }

    /// How long after an instant, at which they were on, the amplifiers went off.
    pub fn off_after_ns(&self, since_ns: u64) -> Option<u64> {
        let off = self.outputs.iter().find(|change| change.at_ns > since_ns && !change.outputs.amplifiers_enabled)?;
        Some(off.at_ns - since_ns)
    }

    /// Whether the run ended with the amplifiers off and both commands at mid-scale.
    pub fn ends_safe(&self) -> bool {
        self.outputs
            .last()
            .is_some_and(|last| !last.outputs.amplifiers_enabled && last.outputs.command_code == [Some(MID_SCALE); 2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulated_board::nucleo::Outputs;
    use crate::emulated_board::observations::OutputChange;

    const REST: ([Option<u16>; 2], bool) = ([Some(MID_SCALE); 2], false);
    const ON: ([Option<u16>; 2], bool) = ([Some(1000); 2], true);
    const RESET: ([Option<u16>; 2], bool) = ([None; 2], false);
    const OFF_CENTRE: ([Option<u16>; 2], bool) = ([Some(1000); 2], false);

    /// Microsecond by microsecond.
    fn passes(outputs: &[([Option<u16>; 2], bool)]) -> bool {
        let outputs = (0..).zip(outputs).map(|(index, &(command_code, amplifiers_enabled))| OutputChange {
            at_ns: 1000 * index,
            outputs: Outputs { command_code, amplifiers_enabled },
        });
        let outputs: Vec<OutputChange> = outputs.collect();
        let end_ns = 1_000_000;
        let observations = Observations { outputs, end_ns, ..Observations::default() };
        std::panic::catch_unwind(|| observations.check_always()).is_ok()
    }

    #[test]
    fn what_must_never_happen_is_noticed() {
        assert!(passes(&[RESET, REST, OFF_CENTRE, ON, OFF_CENTRE, REST, RESET, REST, ON]));
        assert!(!passes(&[RESET, ON]), "enabled before there was a command");
        assert!(!passes(&[RESET, REST, ON, RESET, ON]), "enabled before there was a command after a reset");
        assert!(!passes(&[RESET, REST, ([Some(1000), None], true)]), "enabled with half a command");
        assert!(!passes(&[RESET, REST, ON, OFF_CENTRE]), "off with a command that stays");
    }

    #[test]
    fn registers_that_nothing_answers_for_are_noticed() {
        let observations = Observations { unmodelled: vec!["RNG CR".into()], ..Observations::default() };
        assert!(std::panic::catch_unwind(|| observations.check_always()).is_err());
    }
}

//! Ctrl-C: ends a movement in an orderly way, lets what was recorded be written, and ends everything else at once. The
//! requests of the system to end count like it.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

use armid::client::{AskedBy, Interrupt};

use super::CommandError;
use super::common::advise;

/// What is going on, as [`PHASE`] has it: nothing that must not simply end.
const ENDABLE: u8 = 0;
/// Something that ends in an orderly way when asked to: a movement.
const MOVING: u8 = 1;
/// What was recorded is being written.
const WRITING: u8 = 2;
/// The same, and the end was asked for since.
const WRITING_THE_LAST: u8 = 3;

static PHASE: AtomicU8 = AtomicU8::new(ENDABLE);
static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();

/// What to tell whoever asks for the end while what was recorded is being written.
const FINISHING: &str = "writing what was recorded; press Ctrl-C again to end without it";

/// What asking for the end does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Answer {
    /// The program ends.
    End,
    /// It goes on, and has been told.
    GoOn(Option<&'static str>),
}

/// From now on Ctrl-C, and the request of the system to end, count in what is returned, with one of `advice` each time;
/// the first without advice left behind that ends the program, but never the very first.
///
/// A command calls this with one advice only.
pub fn watch(advice: &'static [&'static str]) -> Interrupt {
    let interrupt = INTERRUPT.get_or_init(|| {
        let interrupt = Interrupt::default();
        let counted = interrupt.clone();
        let handler = move |by: AskedBy| {
            let asked = counted.ask(by) as usize;
            match answer(&PHASE, advice, asked) {
                Answer::End => {
                    armid::release_outputs();
                    std::process::exit(by.exit_code().into());
                }
                Answer::GoOn(told) => told.into_iter().for_each(advise),
            }
        };
        if let Err(error) = on_signals(handler) {
            advise(format!("Ctrl-C will end this program without its recording: {error}"));
        }
        interrupt
    });
    PHASE.store(MOVING, Ordering::SeqCst);
    interrupt.clone()
}

/// What the end does that was asked for `asked` times by now.
fn answer(phase: &AtomicU8, advice: &[&'static str], asked: usize) -> Answer {
    match phase.load(Ordering::SeqCst) {
        MOVING => match advice.get(asked - 1) {
            None if asked > 1 => Answer::End,
            advice => Answer::GoOn(advice.copied()),
        },
        // However often it was asked for during the movement: the first time afterwards is no reason to lose it.
        WRITING => {
            // Where the writing has just ended it stays so.
            let _ = phase.compare_exchange(WRITING, WRITING_THE_LAST, Ordering::SeqCst, Ordering::SeqCst);
            Answer::GoOn(Some(FINISHING))
        }
        _ => Answer::End,
    }
}

/// Calls `handler` with every request to end, on a thread of its own.
#[cfg(unix)]
fn on_signals(handler: impl Fn(AskedBy) + Send + 'static) -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            handler(match signal {
                SIGTERM => AskedBy::Termination,
                SIGHUP => AskedBy::HangUp,
                _ => AskedBy::CtrlC,
            });
        }
    })?;
    Ok(())
}

/// Calls `handler` with every request to end, on a thread of its own.
#[cfg(not(unix))]
fn on_signals(handler: impl Fn(AskedBy) + Send + 'static) -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(move || handler(AskedBy::CtrlC))
}

/// The movement is over: as long as what is returned lives, the first Ctrl-C lets what was recorded be written.
#[must_use]
pub fn writing() -> Writing {
    PHASE.store(WRITING, Ordering::SeqCst);
    Writing
}

/// What was recorded is not written yet. Afterwards Ctrl-C ends the program.
pub struct Writing;

impl Drop for Writing {
    fn drop(&mut self) {
        PHASE.store(ENDABLE, Ordering::SeqCst);
    }
}

/// Nothing moves any more once the end was asked for.
pub fn check() -> Result<(), CommandError> {
    match INTERRUPT.get().and_then(Interrupt::asked_by) {
        Some(by) => Err(CommandError::Interrupted(by)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADVICE: [&str; 2] = ["stopping", "switching off"];

    #[test]
    fn the_first_ctrl_c_stops_the_second_switches_off_and_the_third_ends() {
        let phase = AtomicU8::new(MOVING);
        let answers = [1, 2, 3].map(|asked| answer(&phase, &ADVICE, asked));
        assert_eq!(answers, [Answer::GoOn(Some("stopping")), Answer::GoOn(Some("switching off")), Answer::End]);
        // Nobody needs to be told what a program does that shows nothing but a screen.
        assert_eq!([1, 2].map(|asked| answer(&phase, &[], asked)), [Answer::GoOn(None), Answer::End]);
    }

    #[test]
    fn the_first_ctrl_c_after_a_movement_lets_the_writing_finish_and_the_second_ends() {
        for asked_before in 0..3 {
            let phase = AtomicU8::new(WRITING);
            let answers = [1, 2].map(|more| answer(&phase, &ADVICE, asked_before + more));
            assert_eq!(answers, [Answer::GoOn(Some(FINISHING)), Answer::End], "after {asked_before}");
        }
        assert_eq!(answer(&AtomicU8::new(ENDABLE), &ADVICE, 1), Answer::End);
    }
}

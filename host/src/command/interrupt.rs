//! Ctrl-C: ends a movement in an orderly way, and everything else at once.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use armid::client::Interrupt;

use super::common::advise;

/// What a shell expects of a program that ended by Ctrl-C.
const INTERRUPTED: i32 = 130;

/// Whether something is going on that must not simply end.
static WATCHING: AtomicBool = AtomicBool::new(false);
static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();

/// From now on Ctrl-C, and the request of the system to end, count in what is returned, with one of `advice` each time;
/// the first without advice left behind that ends the program, but never the very first.
///
/// A command calls this with one advice only.
pub fn watch(advice: &'static [&'static str]) -> Interrupt {
    let interrupt = INTERRUPT.get_or_init(|| {
        let interrupt = Interrupt::default();
        let counted = interrupt.clone();
        let handler = move || {
            if !WATCHING.load(Ordering::SeqCst) {
                std::process::exit(INTERRUPTED);
            }
            let asked = counted.ask() as usize;
            match advice.get(asked - 1) {
                Some(advice) => advise(advice),
                None if asked == 1 => {}
                None => std::process::exit(INTERRUPTED),
            }
        };
        if let Err(error) = ctrlc::set_handler(handler) {
            advise(format!("Ctrl-C will end this program without its recording: {error}"));
        }
        interrupt
    });
    WATCHING.store(true, Ordering::SeqCst);
    interrupt.clone()
}

/// From now on Ctrl-C ends the program.
pub fn leave() {
    WATCHING.store(false, Ordering::SeqCst);
}

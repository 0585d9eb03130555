//! Progress bars: on a terminal only, on stderr, with a stated end.

use std::cell::RefCell;
use std::io::IsTerminal as _;

use armid::client::MovementProgress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar from 0 to `total` named `label`; hidden where stderr is not a terminal.
pub fn bar(label: &str, total: u64) -> ProgressBar {
    let target =
        if std::io::stderr().is_terminal() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    // The template is a constant; should it not parse, the default style does as well.
    if let Ok(style) = ProgressStyle::with_template("{prefix:28} {bar:30} {pos}/{len} {msg} [{elapsed}, {eta} left]") {
        bar.set_style(style);
    }
    bar.set_prefix(armid::shown::line(label));
    bar
}

/// Shows a movement's progress under `label`.
pub fn of_movement(label: &str) -> impl FnMut(MovementProgress) + use<> {
    let bar = RefCell::new(bar(label, 0));
    move |progress| {
        let bar = bar.borrow_mut();
        match progress {
            MovementProgress::Approaching => bar.set_message("going to the start"),
            MovementProgress::Running { rows, planned } => {
                bar.set_length(u64::from(planned));
                bar.set_position(u64::from(rows));
                bar.set_message("recording");
            }
            MovementProgress::Reading { rows, planned } => {
                bar.set_length(u64::from(planned));
                bar.set_position(u64::from(rows));
                bar.set_message("checking against the board's memory");
                if rows == planned {
                    bar.finish_and_clear();
                }
            }
        }
    }
}

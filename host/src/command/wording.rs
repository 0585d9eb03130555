//! What the joints are called in this run: the board's messages are shown with these names.

use std::sync::OnceLock;

use armid::joint_names;
use armid::robot::Robot;

/// Names of the joints of this run's robot: a run has one.
static NAMES: OnceLock<[String; 2]> = OnceLock::new();

/// Says what the joints are called from now on.
pub fn of_robot(robot: &Robot) {
    if let Some(names) = joint_names::of(robot) {
        NAMES.get_or_init(|| names);
    }
}

/// A message of the board with the names of the joints in it.
pub fn in_its_words(message: &str) -> String {
    NAMES.get().map_or_else(|| message.to_owned(), |names| joint_names::in_message(message, names))
}

//! Bytes that are said to be a recording, a robot file or a model file.
//!
//! The first byte says which. What must hold whatever comes: nothing panics, a model that is accepted is written and
//! reads back the same, and what is refused is refused with a message that names the file.
#![no_main]

use std::path::Path;
use std::sync::LazyLock;

use armid::model::Model;
use armid::recording::{ReadOptions, Recording};
use armid::robot::Robot;
use libfuzzer_sys::fuzz_target;

const NAME: &str = "fuzzed-file";

static PAPER: LazyLock<Robot> = LazyLock::new(Robot::paper);

fn refused(error: impl std::fmt::Display) {
    let message = error.to_string();
    assert!(message.contains(NAME), "{message}");
}

fuzz_target!(|data: &[u8]| {
    let Some((&kind, bytes)) = data.split_first() else { return };
    let path = Path::new(NAME);
    match kind % 4 {
        0 | 1 => match Recording::from_bytes(path, bytes, &PAPER, ReadOptions { allow_gaps: kind % 4 == 1 }, None) {
            Ok(recording) => assert!(recording.samples() > 0),
            Err(error) => refused(error),
        },
        2 => match Robot::from_bytes(path, bytes.to_vec()) {
            Ok(robot) => assert!(robot.joints.len() == 1 || robot.joints.len() == 2),
            Err(error) => refused(error),
        },
        _ => match Model::from_bytes(path, bytes.to_vec(), &PAPER) {
            Ok(model) => {
                let text = model.to_toml().expect("a model that was read can be written");
                let again = Model::from_bytes(path, text.into_bytes(), &PAPER).expect("and read again");
                assert_eq!(again.f, model.f);
            }
            Err(error) => refused(error),
        },
    }
});

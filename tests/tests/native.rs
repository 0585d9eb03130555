//! Every scenario on the simulated board of the host tool.

use armid_tests::scenarios::{NativeBoard, Setup};

fn switched_on() -> Option<impl Fn(Setup) -> NativeBoard> {
    Some(|setup: Setup| NativeBoard::with_setup(&setup))
}

armid_tests::test_every_scenario!(switched_on);

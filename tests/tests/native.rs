//! Every scenario on the simulated board of the host tool.

use armid_tests::scenarios::{NativeBoard, hidden, robot};

fn switched_on() -> Option<impl Fn() -> NativeBoard> {
    Some(|| NativeBoard::start(&robot(), hidden()))
}

armid_tests::test_every_scenario!(switched_on);

//! `armid doctor`.

use crate::bench::{Bench, FAILED};

#[test]
fn findings_have_states_and_remedies_and_decide_the_exit_code() {
    let bench = Bench::new();
    // An empty file system: nothing is connected, so that nothing of the machine that runs the tests counts.
    std::fs::create_dir(bench.path("root")).unwrap();
    let text = bench.done("doctor --root root --robot robot.toml --board sim");
    assert!(text.contains("ok    version: armid ") && text.contains("ok    firmware: "), "{text}");
    assert!(text.contains("warn  udev rule: ") && text.contains("→ sudo cp"), "{text}");
    assert!(text.contains("ok    robot file: ") && text.contains("ok    cache: none is kept"), "{text}");

    let found = bench.json("doctor --root root");
    let states: Vec<&str> =
        found["findings"].as_array().unwrap().iter().map(|finding| finding["state"].as_str().unwrap()).collect();
    assert!(states.contains(&"ok") && states.contains(&"warn") && !states.contains(&"fail"), "{found}");

    bench.spoil("robot.toml", "stiff.toml", |text| text.replace("_count = 0.036", "_count = 0.384"));
    for arguments in ["--robot stiff.toml", "--board tcp:127.0.0.1:1"] {
        let output = bench.run(&format!("doctor --root root {arguments}"));
        let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert_eq!(output.status.code(), Some(FAILED), "{stdout}{stderr}");
        assert!(stdout.contains("fail  ") && stderr.contains("1 of "), "{stdout}{stderr}");
    }
}

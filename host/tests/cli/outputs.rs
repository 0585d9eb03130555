//! What results are written over, and what they leave alone.

use crate::bench::{Bench, USAGE};

fn read(bench: &Bench, name: &str) -> Vec<u8> {
    std::fs::read(bench.path(name)).unwrap()
}

#[test]
fn a_result_replaces_only_a_file_of_its_own_kind() {
    let bench = Bench::new().with_recording();
    std::fs::write(bench.path("notes.txt"), "precious").unwrap();
    for name in ["other.csv", "third.csv"] {
        bench.done(&format!("simulate --settle 0 --out {name}"));
    }
    bench.done("new-robot --example emps --out axis.toml");
    bench.done("excite --generations 1 --duration 4 --out movement.toml --report page.html");
    bench.done("export truth.toml --out truth.json");
    let there = [
        ("other.csv", "is a recording"),
        ("other.toml", "is a recording's manifest"),
        ("axis.toml", "is a robot file"),
        ("truth.toml", "is a model"),
        ("movement.toml", "is a movement"),
        ("page.html", "is an HTML page"),
        ("truth.json", "is a model in JSON"),
        ("notes.txt", "is no file that armid knows"),
    ];
    let commands = [
        ("identify run.csv --out", "truth.toml"),
        ("identify run.csv --report", "page.html"),
        ("calibrate run.csv --out", "axis.toml"),
        ("excite --generations 1 --out", "movement.toml"),
        ("explain run.csv --out", "truth.toml"),
        ("explain run.csv --next", "movement.toml"),
        ("export run.csv --format csv --out", ""),
        ("export run.csv --format mcap --out", ""),
        ("compare run.csv third.csv --plot", ""),
    ];
    for (name, kind) in there {
        let before = read(&bench, name);
        for (command, _) in commands.into_iter().filter(|(command, own)| *own != name && !command.contains(name)) {
            bench.refused(USAGE, &format!("{command} {name}"), &[name, kind, "overwritten", "choose another name"]);
        }
        assert_eq!(read(&bench, name), before, "{name}");
    }
    // What they write themselves, and what is empty, they replace.
    std::fs::write(bench.path("empty.csv"), "").unwrap();
    for _ in 0..2 {
        for out in ["run.csv --out run.mcap", "run.csv --out empty.csv", "truth.toml --out truth.json"] {
            bench.done(&format!("export {out}"));
        }
        bench.done("export truth.toml --out arm.urdf");
        bench.done("calibrate run.csv --out axis.toml --report page.html");
        bench.done("compare run.csv other.csv --plot errors.svg");
    }
}

#[test]
fn a_model_or_robot_file_that_is_read_is_not_written_over() {
    let bench = Bench::new().with_recording();
    for (command, file) in [
        ("explain run.csv --model truth.toml --out truth.toml", "truth.toml"),
        ("calibrate run.csv --robot robot.toml --out ./robot.toml", "robot.toml"),
    ] {
        let before = read(&bench, file);
        bench.refused(USAGE, command, &[file, "is read by this command", "choose another --out"]);
        assert_eq!(read(&bench, file), before);
    }
}

#[test]
fn simulate_replaces_a_recording_only_when_that_is_asked_for() {
    let bench = Bench::new().with_recording();
    let before = read(&bench, "run.csv");
    bench.refused(USAGE, "simulate --seed 2 --out run.csv", &["run.csv exists", "--force"]);
    assert_eq!(read(&bench, "run.csv"), before);
    for truth in ["a.toml", "./a.toml", "a.csv"] {
        let parts = [truth, "both the truth and another result", "choose another --truth"];
        bench.refused(USAGE, &format!("simulate --out a.csv --truth {truth}"), &parts);
    }
    bench.done("simulate --settle 0 --seed 2 --out run.csv --force");
    assert_ne!(read(&bench, "run.csv"), before);
}

#[test]
fn a_demonstration_replaces_only_what_one_wrote() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("mine")).unwrap();
    for name in ["model.toml", "train1.toml"] {
        let file = format!("mine/{name}");
        std::fs::write(bench.path(&file), "precious").unwrap();
        bench.refused(USAGE, "demo --out mine", &[&file, "was written by no demonstration", "another --out"]);
        assert_eq!(read(&bench, &file), b"precious");
        assert_eq!(std::fs::read_dir(bench.path("mine")).unwrap().count(), 1);
        std::fs::remove_file(bench.path(&file)).unwrap();
    }
    // One demonstration's mark is no leave for the other's names.
    bench.done("demo --out mine");
    std::fs::write(bench.path("mine/load.svg"), "precious").unwrap();
    bench.refused(USAGE, "demo load --out mine", &["load.svg", "was written by no demonstration"]);
    bench.done("demo --out mine");
}

#[cfg(unix)]
#[test]
fn links_stay_and_pipes_are_written_into() {
    use std::os::unix::fs::symlink;
    let bench = Bench::new().with_recording();
    std::fs::create_dir(bench.path("elsewhere")).unwrap();
    for name in ["run.csv", "run.toml"] {
        std::fs::rename(bench.path(name), bench.path(&format!("elsewhere/{name}"))).unwrap();
        symlink(format!("elsewhere/{name}"), bench.path(name)).unwrap();
    }
    symlink("elsewhere/new.json", bench.path("new.json")).unwrap();
    let before = read(&bench, "elsewhere/run.csv");
    bench.done("simulate --settle 0 --seed 2 --out run.csv --force");
    bench.done("export truth.toml --out new.json");
    for name in ["run.csv", "run.toml", "new.json"] {
        assert!(bench.path(name).is_symlink() && bench.path(&format!("elsewhere/{name}")).is_file(), "{name}");
    }
    assert_ne!(read(&bench, "elsewhere/run.csv"), before);

    let made = std::process::Command::new("mkfifo").arg(bench.path("pipe")).status().unwrap();
    assert!(made.success());
    for (command, beginning) in [
        ("export truth.toml --format json --out pipe", "{"),
        ("simulate --settle 0 --out pipe", "tick,"),
        ("record --board sim --settle 0 --out pipe --report page.html", "tick,"),
    ] {
        let pipe = bench.path("pipe");
        let reader = std::thread::spawn(move || std::fs::read_to_string(pipe).unwrap());
        bench.done(command);
        let came = reader.join().unwrap();
        assert!(came.starts_with(beginning) && came.ends_with('\n'), "{command}: {came:.60}");
    }
    let pipes = std::fs::read_dir(bench.path(""))
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().starts_with("pipe"));
    assert_eq!(pipes.count(), 1, "nothing is put beside a pipe");
}

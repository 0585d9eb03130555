//! What results are written over, and what they leave alone.

use std::io::{Read as _, Write as _};
use std::process::{Child, Stdio};

use crate::bench::{Bench, FAILED, USAGE};

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

/// A program that is about to write a robot file to `out`, and waits for an answer until then.
fn waiting(bench: &Bench, out: &str) -> Child {
    let mut command = bench.command(&format!("new-robot --ask --set kind=two-link --out {out}"));
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    // Once it asks, it has made sure of its output.
    let mut question = [0; 12];
    child.stderr.as_mut().unwrap().read_exact(&mut question).unwrap();
    assert_eq!(&question, b"What is the ");
    child
}

#[test]
fn of_two_programs_that_write_one_file_the_second_is_refused() {
    let bench = Bench::new();
    let mut first = waiting(&bench, "arm.toml");
    let parts = ["arm.toml: is being written by another armid", "wait until", "another name"];
    for command in ["new-robot --example emps --out ./arm.toml", "simulate --settle 0 --out arm.csv"] {
        bench.refused(FAILED, command, &parts);
    }
    assert!(!bench.path("arm.csv").exists() && !bench.path("arm.toml").exists());
    // Another file in the same folder is nobody else's.
    bench.done("new-robot --example emps --out other.toml");
    // The first comes to its end as if nothing had been.
    let answers = ["arm", "", "", "", "", "0.35"].map(str::to_string).to_vec();
    let joint = |name: &str| {
        [name, "1", "65536", "2", "12", "", "0.02", "", "-1.9", "0.4", "6", "40"].map(str::to_string).to_vec()
    };
    let link = ["1", "0.1", "0", "0.06", "0.004"].map(str::to_string).to_vec();
    let loops = vec![String::new(); 4];
    let all = [answers, joint("a"), joint("b"), link.clone(), link, loops].concat().join("\n") + "\n";
    first.stdin.take().unwrap().write_all(all.as_bytes()).unwrap();
    let output = first.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(armid::robot::Robot::read(&bench.path("arm.toml")).unwrap().name, "arm");
    bench.done("new-robot --example emps --out arm.toml --force");
    let parts = std::fs::read_dir(bench.path("")).unwrap();
    let left = parts.filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().ends_with(".part"));
    assert_eq!(left.count(), 0, "something was left behind");
}

#[test]
fn what_a_killed_program_left_is_told_and_blocks_nobody() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("root")).unwrap();
    let mut killed = waiting(&bench, "arm.toml");
    let part = bench.path("arm.toml.armid.part");
    let doctor = || bench.done("doctor --root root");
    assert!(part.exists() && !doctor().contains("arm.toml.armid.part"), "it is in use");
    killed.kill().unwrap();
    killed.wait().unwrap();
    let told = doctor();
    assert!(told.contains("warn  unfinished results: ") && told.contains("arm.toml.armid.part"), "{told}");
    bench.done("new-robot --example emps --out arm.toml");
    assert!(!part.exists() && !doctor().contains("unfinished"));
}

#[test]
fn demonstrations_do_not_mix_in_one_folder() {
    let bench = Bench::new();
    let mut first = waiting(&bench, "shown/track-ctc.csv");
    bench.refused(FAILED, "demo --out shown", &["shown/track-ctc.csv: is being written by another armid"]);
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(!bench.path("shown/robot.toml").exists());
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

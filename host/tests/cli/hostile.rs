//! Files made to do harm: what they say reaches terminal, page and result as text that can be read.

use std::process::Output;

use armid::robot::Robot;

use crate::bench::{BAD_FILE, Bench, bounds, without_checksum};
use crate::page::Page;

/// It colours, goes back to the line's beginning, rings, colours again, and begins a line of its own.
const HOSTILE: &str = "ev\u{1b}[31mil\r\u{7}\u{9b}1m\nerror: forged";

/// What was printed, of which nothing does anything but end lines, and no line begins as [`HOSTILE`] would have it.
fn harmless(command: &str, output: &Output) -> String {
    let bytes = [output.stdout.as_slice(), output.stderr.as_slice()].concat();
    let text = String::from_utf8(bytes).unwrap();
    assert!(!text.contains(|letter: char| letter.is_control() && letter != '\n'), "{command}: {text:?}");
    assert!(!text.lines().any(|line| line.starts_with("error: forged")), "{command}: {text:?}");
    text
}

#[test]
fn nothing_in_a_file_steers_the_terminal_or_breaks_a_page() {
    let bench = Bench::new();
    let robot = Robot { name: HOSTILE.into(), ..Robot::paper() };
    robot.write(&bench.path("hostile.toml")).unwrap();
    std::fs::create_dir(bench.path("root")).unwrap();
    bench.done("simulate --robot hostile.toml --settle 0 --out run.csv --truth truth.toml");
    // Line by line, as somebody would write them by hand.
    bench.spoil("run.toml", "run.toml", |text| {
        let partial = "partial = \"cut\\nerror: forged \\u001b[1m\"\n[[joint]]";
        without_checksum(&text).replace("paper, T = 3.65 s", "a\\u001b[2Jb").replacen("[[joint]]", partial, 1)
    });
    bench.spoil("truth.toml", "other.toml", |text| {
        let identity = format!("robot_identity = \"{}\"", Robot::paper().identity());
        text.replace(&identity, "robot_identity = \"\\u001b[31m\"\nrobot = \"\\n\\r\"")
    });
    let quoted = "ev\\u{1b}[31mil\\r\\u{7}\\u{9b}1m\\nerror: forged";
    let spelt_out = "ev\\u{1b}[31mil\\u{d}\\u{7}\\u{9b}1m\\u{a}error: forged";
    for (command, part) in [
        ("doctor --root root --robot hostile.toml", quoted),
        ("calibrate run.csv", spelt_out),
        ("calibrate run.csv", "(cut\\u{a}error: forged \\u{1b}[1m)"),
        ("report --robot hostile.toml --model truth.toml run.csv --out page.html", "page.html"),
        ("identify --robot hostile.toml run.csv --report found.html", "f1"),
        ("compare other.toml truth.toml", "identity \\u{1b}[31m"),
        ("doctor --root root --robot hostile.toml --json", "forged"),
    ] {
        let text = harmless(command, &bench.run(command));
        assert!(text.contains(part), "{command}: no {part:?} in {text}");
    }
    let found = bench.json("doctor --root root --robot hostile.toml");
    assert!(found.to_string().contains("forged"), "{found}");
    // Pages are parsed as XML, which knows no such letters.
    assert!(Page::read(&bench, "page.html").text().contains("a\\u{1b}[2Jb"));
    assert!(Page::read(&bench, "found.html").text().contains("\\u{9b}1m"));
    let urdf = bench.done("export truth.toml --robot hostile.toml --format urdf");
    roxmltree::Document::parse(&urdf).unwrap();
}

#[cfg(unix)]
#[test]
fn nothing_in_the_name_of_a_file_steers_the_terminal_or_breaks_a_picture() {
    let bench = Bench::new().with_recording();
    let name = "x\u{1b}[31m\u{7}.csv";
    std::fs::copy(bench.path("run.csv"), bench.path(name)).unwrap();
    for (command, part) in [
        (format!("compare run.csv {name} --report page.html --plot errors.svg"), "x\\u{1b}[31m\\u{7}.csv"),
        (format!("compare run.csv {name} --json"), "x\\u001b[31m\\u0007.csv"),
        (format!("calibrate missing{name}"), "missingx\\u{1b}[31m\\u{7}.csv: cannot be read"),
    ] {
        let text = harmless(&command, &bench.run(&command));
        assert!(text.contains(part), "{command:?}: no {part:?} in {text}");
    }
    assert!(Page::read(&bench, "page.html").text().contains("x\\u{1b}[31m\\u{7}.csv"));
    let svg = std::fs::read_to_string(bench.path("errors.svg")).unwrap();
    roxmltree::Document::parse(&svg).unwrap();
}

#[test]
fn a_number_of_three_hundred_digits_is_shown_short_and_read_as_the_same() {
    let bench = Bench::new().with_recording();
    bench.spoil("robot.toml", "huge.toml", |text| text.replace("gravity_m_s2 = 9.81", "gravity_m_s2 = -1e300"));
    bench.refused(BAD_FILE, "record --board sim --robot huge.toml", &["gravity_m_s2 is -1e300, but must be below 100"]);
    bench.spoil("run.toml", "run.toml", |text| text.replace("seed = 1", "seed = 1e300"));
    bench.refused(BAD_FILE, "calibrate run.csv", &["floating point `1e300`"]);

    let huge = bounds(["link_2", "link_3"]).replace("mass_kg = [9, 10]", "mass_kg = [1, 1e300]");
    std::fs::write(bench.path("bounds.toml"), huge).unwrap();
    let ranges = bench.done("ranges bounds.toml");
    assert!(ranges.lines().all(|line| line.len() < 60), "{ranges}");
    let read: toml::Table = ranges.parse().unwrap();
    assert_eq!(read["search"]["f5"][1].as_float(), Some(0.5 * 1e300), "{ranges}");
}

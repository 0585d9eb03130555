//! What README.md shows, run as it stands there.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::bench::Bench;

const README: &str = include_str!("../../../README.md");

/// The `index`-th piece of code of `language` in the section `heading`.
pub fn code(heading: &str, language: &str, index: usize) -> &'static str {
    let section = README.split(&format!("## {heading}\n")).nth(1).expect("the section is there");
    let block = section.split(&format!("```{language}\n")).nth(1 + index).expect("it has code");
    block.split("```").next().unwrap()
}

/// Runs each command line of a section; those that need somebody to answer or a board are left to `skip`.
fn run(bench: &Bench, heading: &str, skip: &[&str]) {
    run_code(bench, code(heading, "sh", 0), skip);
}

fn run_code(bench: &Bench, code: &str, skip: &[&str]) {
    for line in code.lines() {
        let line = line.split(" #").next().unwrap().trim();
        let line = line.split(" > ").next().unwrap().replace("~/", "home/");
        if !skip.contains(&line.as_str()) {
            let arguments = line.strip_prefix("armid ").unwrap_or_else(|| panic!("{line}"));
            bench.done(arguments);
        }
    }
}

#[test]
fn the_commands_for_other_robots_and_programs_do_what_is_shown() {
    let bench = Bench::new();
    run(&bench, "Another robot", &["armid new-robot --out robot.toml"]);
    bench.done("simulate --settle 0 --out unused.csv --truth model.toml");
    // What `doctor` says depends on the computer; it has tests of its own.
    run(&bench, "To and from other programs", &["armid doctor"]);
    bench.done("export model.toml --out model.json");
    for file in ["swing.mcap", "swing_si.csv", "arm.urdf", "home/.local/share/man/man1/armid-identify.1"] {
        assert!(bench.path(file).is_file(), "{file}");
    }
    // The snippet names columns and keys that are there.
    let snippet = code("To and from other programs", "python", 0);
    let header = std::fs::read_to_string(bench.path("swing_si.csv")).unwrap().lines().next().unwrap().to_string();
    for column in ["time_s", "joint_elbow_error_counts"] {
        assert!(snippet.contains(&format!("\"{column}\"")) && header.split(',').any(|name| name == column), "{header}");
    }
    read_with_python(&bench);
}

#[test]
fn the_commands_of_the_overview_do_what_is_shown() {
    let bench = Bench::new();
    // `tests/run` installs it, and runs the first command of all.
    run(&bench, "Using it", &["cargo install --locked --path host"]);
    assert!(bench.path("gap.html").is_file());
    run_code(&bench, code("Using it", "sh", 1), &[]);
    assert!(bench.path("errors.svg").is_file());
    run(&bench, "Report", &[]);
    for page in ["report.html", "identified.html", "track.html", "load.html", "speed.html", "ctc.html"] {
        assert!(std::fs::read_to_string(bench.path(page)).unwrap().contains("<svg"), "{page}");
    }
}

/// What stands between backquotes or on a line of a shell, without its remark.
fn pieces() -> impl Iterator<Item = String> {
    let blocks = README.split("```sh\n").skip(1).filter_map(|block| block.split("```").next());
    let pieces = README.split('`').chain(blocks.flat_map(str::lines));
    pieces.map(|text| text.split(" #").next().unwrap().replace('\n', " "))
}

/// Those that need minutes or a board are not run here, but what they are called and their options are those of the parser.
#[test]
fn every_command_named_is_there_with_its_options() {
    const OPTIONS: &str = include_str!("../../OPTIONS.md");
    let mut named = 0;
    for text in pieces() {
        let command = ["armid ", "cargo run --release -- "].iter().find_map(|start| text.strip_prefix(start));
        let Some(command) = command else { continue };
        let is_name = |word: &&str| word.chars().all(|letter| letter.is_ascii_lowercase() || letter == '-');
        let words: Vec<&str> = command.split_whitespace().take_while(is_name).take(2).collect();
        let section = |words: &[&str]| OPTIONS.split(&format!("## `armid {}`\n", words.join(" "))).nth(1);
        let table = section(&words).or_else(|| section(words.get(..1)?)).unwrap_or_else(|| panic!("no {command}"));
        let table = table.split("\n## ").next().unwrap();
        for option in command.split_whitespace().filter(|word| word.starts_with("--") && *word != "--help") {
            assert!(table.contains(&format!("| `{option}")), "{command}: no {option}");
        }
        named += 1;
    }
    assert!(named > 60, "{named}");
}

/// What is not armid's own: packages, tests, programs and their options, stages of `tests/run`, the rule to install.
#[test]
fn every_other_command_names_what_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let text =
        |path: &Path| std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let stages = text(&root.join("tests/run"));
    let mut named = 0;
    for command in pieces() {
        // Behind variables, if any.
        let words: Vec<&str> = command.split_whitespace().skip_while(|word| word.starts_with("ARMID_")).collect();
        match words[..] {
            ["tests/run", stage, ..] => assert!(stages.contains(&format!("\n#   tests/run {stage} ")), "{command}"),
            ["hidden-effects", ..] => {
                let options = text(&root.join("tests/src/bin/hidden-effects.rs"));
                for option in words.iter().filter_map(|word| word.strip_prefix("--")) {
                    assert!(options.contains(&format!("    {option}: ")), "{command}: --{option}");
                }
            }
            ["cargo", alias] if alias.starts_with("run-") => {
                assert!(text(&root.join(".cargo/config.toml")).contains(&format!("\n{alias} = ")), "{command}");
            }
            ["cargo", ..] => of_cargo(&root, &words),
            _ => continue,
        }
        named += 1;
    }
    assert!(named > 12, "{named}");
    let install = include_str!("../../udev/60-armid.rules").lines().find_map(|line| line.strip_prefix("#   "));
    assert!(README.contains(install.expect("the rule says how it is installed")));
}

/// The package, test, benchmark or program of a command line of cargo, and the tests that it selects.
fn of_cargo(root: &Path, words: &[&str]) {
    let value = |option: &str| Some(words[words.iter().position(|word| *word == option)? + 1]);
    let folder = match value("-p").or_else(|| value("--path")) {
        Some("armid-tests") => root.join("tests"),
        Some("armid-shared") => root.join("shared"),
        _ => root.join("host"),
    };
    let there = |kind: &str, name: &str| -> PathBuf {
        let places = [format!("{kind}/{name}.rs"), format!("{kind}/{name}/main.rs")];
        let mut found = places.iter().map(|place| folder.join(place)).filter(|path| path.is_file());
        found.next().unwrap_or_else(|| panic!("{words:?}: no {name}"))
    };
    for (option, kind) in [("--bench", "benches"), ("--bin", "src/bin"), ("--test", "tests")] {
        let Some(name) = value(option) else { continue };
        let main = there(kind, name);
        let behind = words.iter().position(|word| *word == name).map_or(words.len(), |at| at + 1);
        let Some(filter) = words[behind..].first().filter(|word| option == "--test" && !word.starts_with('-')) else {
            continue;
        };
        let files = main.parent().into_iter().flat_map(|folder| folder.read_dir().unwrap()).flatten();
        let is_there = |text: String| text.lines().any(|line| line.starts_with("fn ") && line.contains(filter));
        let mut texts = files.filter_map(|file| std::fs::read_to_string(file.path()).ok());
        assert!(texts.any(is_there), "{words:?}: no test {filter}");
    }
}

#[test]
fn the_tutorial_names_the_effect_that_it_hides() {
    let bench = Bench::new();
    run(&bench, "From a strange rattle to a named effect", &[]);
    let extended = std::fs::read_to_string(bench.path("extended.toml")).unwrap();
    let extended: toml::Table = extended.parse().unwrap();
    let [effect] = &extended["effect"].as_array().unwrap()[..] else { panic!("{extended}") };
    assert_eq!((effect["name"].as_str(), effect["joint"].as_str()), (Some("backlash"), Some("3")));
    let gap_rad = effect["parameters"]["gap_rad"].as_float().unwrap();
    assert!((gap_rad / 0.001 - 1.0).abs() < 0.1, "{gap_rad}");
    assert!(std::fs::read_to_string(bench.path("gap.html")).unwrap().contains("backlash"));
}

/// Python's standard library reads what pandas reads in the snippet, and every other file.
fn read_with_python(bench: &Bench) {
    const SCRIPT: &str = "
import csv, json, tomllib
rows = list(csv.DictReader(open('swing_si.csv')))
recorded = list(csv.DictReader(open('swing.csv')))
assert len(rows) == len(recorded) > 50
for row, counts in zip(rows, recorded):
    assert float(row['joint_elbow_error_counts']) == float(counts['errelbow'])
    assert abs(float(row['time_s']) - 0.0007 * int(counts['tick'])) < 1e-9
for name in ['swing.toml', 'pendulum.toml', 'model.toml']:
    tomllib.load(open(name, 'rb'))
assert json.load(open('model.json'))['f']['f7']['unit'] == 'kg m²'
";
    let python = Command::new("python3").args(["-X", "utf8", "-c", SCRIPT]).current_dir(bench.path("")).output();
    match python {
        Ok(output) if output.status.success() => {}
        Ok(output) => {
            let told = String::from_utf8_lossy(&output.stderr);
            // Before 3.11 Python has no reader of TOML.
            assert!(told.contains("No module named 'tomllib'"), "{told}");
            return eprintln!("python3 is too old: its part was skipped");
        }
        Err(_) => return eprintln!("no python3 here: its part was skipped"),
    }
    // The snippet itself, to the letter.
    let snippet = code("To and from other programs", "python", 0);
    let checked = format!(
        "{snippet}
assert errors.abs().max() == counts['errelbow'].abs().max() > 0
assert manifest['mode'] == 'p' and len(robot['joint']) == 2 and model['unit'] == 'kg m²'"
    );
    let output =
        Command::new("python3").args(["-X", "utf8", "-c", &checked]).current_dir(bench.path("")).output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    if told.contains("No module named 'pandas'") {
        eprintln!("no pandas here: the snippet was skipped");
    } else {
        assert!(output.status.success(), "{told}");
    }
}

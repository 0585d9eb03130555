//! What is made from the parser: completions, manual pages and option tables.

use std::io::Write as _;
use std::process::{Command, Stdio};

use crate::bench::{Bench, USAGE};

/// Every command and those below it, as `--help` lists them: `bench ga` beside `bench`.
fn commands(bench: &Bench) -> Vec<String> {
    let listed = |command: &str| -> Vec<String> {
        let help = bench.done(&format!("{command} --help"));
        let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
        let names =
            lines.take_while(|line| !line.is_empty()).filter(|line| line.starts_with("  ") && &line[2..3] != " ");
        names
            .filter_map(|line| line.split_whitespace().next())
            .filter(|name| *name != "help")
            .map(String::from)
            .collect()
    };
    let mut all = Vec::new();
    for command in listed("") {
        let below = listed(&command).into_iter().map(|name| format!("{command} {name}"));
        all.extend(below.collect::<Vec<_>>());
        all.push(command);
    }
    assert!(all.len() > 20 && all.contains(&"bench ga".to_string()), "{all:?}");
    all
}

#[test]
fn every_command_has_a_manual_page() {
    let bench = Bench::new();
    bench.done("man --out pages");
    let page = |name: &str| std::fs::read_to_string(bench.path(&format!("pages/{name}.1"))).unwrap();
    assert!(page("armid").contains("Exit codes"));
    for command in commands(&bench) {
        let page = page(&format!("armid-{}", command.replace(' ', "-")));
        assert!(
            page.contains(".TH ") && page.contains(".SH NAME") && page.contains(".SH SYNOPSIS"),
            "{command}: {page}"
        );
    }
    bench.refused(USAGE, "man", &["--out"]);
}

/// The tables in the documentation are what the parser says. After a change of options, write them anew with
/// `ARMID_BLESS=1 cargo test -p armid --test cli option_tables`.
#[test]
#[cfg(feature = "flash")]
fn option_tables_are_those_of_the_parser() {
    let printed = Bench::new().done("man --tables");
    for part in ["## `armid bench ga`", "| `--out FOLDER` | `armid-out` |", "environment: `ARMID_BOARD`", "`ctc`: "] {
        assert!(printed.contains(part), "no {part} in {printed}");
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/OPTIONS.md");
    if std::env::var_os("ARMID_BLESS").is_some() {
        std::fs::write(path, &printed).unwrap();
    }
    let documented = std::fs::read_to_string(path).unwrap_or_default().replace("\r\n", "\n");
    let differing = printed.lines().zip(documented.lines()).find(|(printed, documented)| printed != documented);
    assert!(
        printed == documented,
        "host/OPTIONS.md is not what the parser says (ARMID_BLESS=1 writes it): {differing:?}"
    );
}

#[test]
fn completion_scripts_know_every_command() {
    let bench = Bench::new();
    let commands = commands(&bench);
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = bench.done(&format!("completions {shell}"));
        for command in &commands {
            let name = command.rsplit(' ').next().unwrap();
            assert!(script.contains(name), "{shell}: no {command}");
        }
        assert!(script.contains("allow-gaps"), "{shell}");
    }
    bench.refused(USAGE, "completions csh", &["csh", "bash", "zsh", "fish"]);
    // The script means something to the shell it is for, where that shell is.
    let check = Command::new("bash").arg("-n").stdin(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let Ok(mut bash) = check else {
        eprintln!("no bash here: its script was not parsed");
        return;
    };
    bash.stdin.take().unwrap().write_all(bench.done("completions bash").as_bytes()).unwrap();
    let parsed = bash.wait_with_output().unwrap();
    assert!(parsed.status.success(), "{}", String::from_utf8_lossy(&parsed.stderr));
}

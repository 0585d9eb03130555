//! The rule for udev, installed by the line of README.md into a folder that stands for a computer.

use std::env;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::bench::{Bench, use_as_program};
use crate::readme::code;

const RULE: &str = include_str!("../../udev/60-armid.rules");

/// Stands in for sudo: writes down what it is asked for, and copies to where nothing of this computer is.
const SUDO: &str = r#"#!/bin/sh
set -eu
echo "sudo $*" >>"$COMPUTER/asked"
case "$*" in
"cp "*" /etc/udev/rules.d/") cp "$2" "$COMPUTER/etc/udev/rules.d/" ;;
"udevadm control --reload" | "udevadm trigger") ;;
*)
    echo "sudo was not expected to run: $*" >&2
    exit 1
    ;;
esac
"#;

/// The line as it stands there.
fn line() -> &'static str {
    code("A real board", "sh", 1).trim()
}

#[test]
fn the_line_that_installs_the_rule_does() {
    let bench = Bench::new();
    fs::create_dir_all(bench.path("computer/etc/udev/rules.d")).unwrap();
    let before = bench.done("doctor --root computer");
    assert!(before.contains("warn  udev rule: ") && before.contains(line()), "{before}");

    // Whatever is not done by sudo would be done to this computer.
    assert!(line().split(" && ").all(|command| command.starts_with("sudo ")), "{}", line());
    fs::create_dir(bench.path("programs")).unwrap();
    fs::write(bench.path("programs/sudo"), SUDO).unwrap();
    use_as_program(&bench.path("programs/sudo"));
    let others = env::var_os("PATH").unwrap_or_default();
    let path = env::join_paths([bench.path("programs")].into_iter().chain(env::split_paths(&others))).unwrap();
    let output = Command::new("sh")
        .args(["-c", line()])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .env("PATH", path)
        .env("COMPUTER", bench.path("computer"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let asked = fs::read_to_string(bench.path("computer/asked")).unwrap();
    assert_eq!(asked.lines().collect::<Vec<_>>(), line().split(" && ").collect::<Vec<_>>());
    let after = bench.done("doctor --root computer");
    assert!(after.contains("ok    udev rule: /etc/udev/rules.d/60-armid.rules is installed"), "{after}");
}

/// Udev leaves out what it cannot read and goes on, so that a slip would be noticed on the day the board is.
#[test]
fn the_rule_is_made_of_statements_that_udev_reads() {
    let lines: Vec<&str> = RULE.lines().filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    assert!(lines.len() > 8, "{lines:?}");
    for line in lines {
        assert!(line.split(", ").all(is_statement), "{line}");
    }
    let slips = [r#"SUBSYSTEM="usb""#, r#"ATTR{idVendor}=="1209"#, r#"ATTR{idVendor=="1209""#, r#"TAGS+="uaccess""#];
    for slip in slips {
        assert!(!is_statement(slip), "{slip}");
    }
}

/// Whether `text` compares what a device is known by, or says what is done with it.
fn is_statement(text: &str) -> bool {
    let Some((asked, value)) = text.strip_suffix('"').and_then(|text| text.split_once('"')) else { return false };
    let of_attribute = |key: &str, operator: &str| {
        let name = asked.strip_prefix(key).and_then(|rest| rest.strip_suffix(operator));
        name.is_some_and(|name| !name.is_empty() && name.chars().all(|sign| sign.is_ascii_alphabetic() || sign == '_'))
    };
    let is_known = ["SUBSYSTEM==", "TAG+="].contains(&asked)
        || of_attribute("ATTR{", "}==")
        || of_attribute("ATTRS{", "}==")
        || of_attribute("ENV{", "}=");
    is_known && !value.is_empty() && !value.contains('"')
}

fn udevadm(arguments: &[&str]) -> std::io::Result<Output> {
    Command::new("udevadm").args(arguments).output()
}

/// As far as udev tells without running and without rights.
#[test]
fn udev_itself_reads_the_rule_and_knows_the_commands() {
    const ABLE_TO_VERIFY: u32 = 254;
    let Ok(version) = udevadm(&["--version"]) else { return eprintln!("no udevadm here: its part was skipped") };
    let version = String::from_utf8_lossy(&version.stdout);
    // A number of systemd's, perhaps with what a distribution adds; others that have the program count from 1.
    let number = version.split(|sign: char| !sign.is_ascii_digit()).next().and_then(|digits| digits.parse().ok());
    if number.is_none_or(|number: u32| number < ABLE_TO_VERIFY) {
        return eprintln!("udevadm {} verifies no rules, {ABLE_TO_VERIFY} does: its part was skipped", version.trim());
    }
    for command in line().split(" && ").filter_map(|command| command.strip_prefix("sudo udevadm ")) {
        let words: Vec<&str> = command.split_whitespace().collect();
        let help = udevadm(&[words[0], "--help"]).unwrap();
        let help = String::from_utf8_lossy(&help.stdout);
        assert!(help.contains(&format!("udevadm {}", words[0])), "{help}");
        assert!(words[1..].iter().all(|option| help.contains(&format!(" {option} "))), "{command}: {help}");
    }

    let bench = Bench::new();
    let verify = |rule: &str| {
        fs::write(bench.path("60-armid.rules"), rule).unwrap();
        udevadm(&["verify", bench.path("60-armid.rules").to_str().unwrap()]).unwrap()
    };
    let said = verify(RULE);
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    assert!(!verify(&RULE.replacen("SUBSYSTEM==", "SUBSYSTM==", 1)).status.success());
}

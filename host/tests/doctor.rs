//! Each fault that `armid doctor` knows, brought about in a file system of its own.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use armid::doctor::{Computer, Finding, State};
use tempfile::TempDir;

/// A computer as it should be: rule installed, board and probe connected, cache there.
struct Healthy(TempDir);

const BOARD: &str = "sys/devices/usb1/1-2";
const PROBE: &str = "sys/devices/usb1/1-3";

impl Healthy {
    fn new() -> Self {
        let computer = Self(tempfile::tempdir().unwrap());
        computer.put("etc/udev/rules.d/60-armid.rules", include_str!("../udev/60-armid.rules"));
        computer.put("etc/group", "root:x:0:\ndialout:x:20:user\n");
        for (folder, vendor, product, bus, device) in [(BOARD, "1209", "0001", 1, 5), (PROBE, "0483", "374b", 1, 6)] {
            let put = |file: &str, text: String| computer.put(&format!("{folder}/{file}"), &(text + "\n"));
            put("idVendor", vendor.into());
            put("idProduct", product.into());
            put("busnum", bus.to_string());
            put("devnum", device.to_string());
            computer.put(&format!("dev/bus/usb/{bus:03}/{device:03}"), "");
            fs::create_dir_all(computer.path("sys/bus/usb/devices")).unwrap();
            let name = folder.rsplit('/').next().unwrap();
            symlink(computer.path(folder), computer.path(&format!("sys/bus/usb/devices/{name}"))).unwrap();
        }
        computer.put(&format!("{BOARD}/product"), "armid controller board\n");
        computer.put(&format!("{BOARD}/serial"), "ABC\n");
        fs::create_dir_all(computer.path(&format!("{BOARD}/1-2:1.0"))).unwrap();
        fs::create_dir_all(computer.path("sys/class/tty/ttyACM0")).unwrap();
        symlink(computer.path(&format!("{BOARD}/1-2:1.0")), computer.path("sys/class/tty/ttyACM0/device")).unwrap();
        computer.put("dev/ttyACM0", "");
        computer.put("proc/1/comm", "init\n");
        computer.put("proc/77/comm", "bash\n");
        fs::create_dir_all(computer.path("home/user/.cache")).unwrap();
        computer
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn forbid(&self, name: &str) {
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(0o000)).unwrap();
    }

    fn computer(&self) -> Computer {
        // Whoever runs the tests may be root, who may everything: a file without permissions is forbidden here.
        let allowed = |path: &Path| fs::metadata(path).is_ok_and(|found| found.permissions().mode() & 0o600 == 0o600);
        Computer::at(self.0.path().into()).with_permissions(allowed)
    }

    fn findings(&self) -> Vec<Finding> {
        self.computer().check(Some(&self.path("home/user/.cache/armid")))
    }

    /// Expects that `check` alone is not as it should be; gives what is said of it.
    fn only(&self, check: &str, state: State) -> (String, String) {
        let mut wrong: Vec<Finding> =
            self.findings().into_iter().filter(|finding| finding.state != State::Ok).collect();
        assert_eq!(wrong.len(), 1, "{wrong:?}");
        let wrong = wrong.remove(0);
        assert_eq!((wrong.check, wrong.state), (check, state), "{wrong:?}");
        (wrong.found, wrong.remedy.unwrap())
    }
}

#[test]
fn nothing_is_said_against_a_computer_as_it_should_be() {
    let healthy = Healthy::new();
    let findings = healthy.findings();
    assert!(findings.iter().all(|finding| finding.state == State::Ok && finding.remedy.is_none()), "{findings:?}");
    let checks: Vec<&str> = findings.iter().map(|finding| finding.check).collect();
    assert_eq!(checks, ["udev rule", "board", "debug probe", "ModemManager", "cache"]);
    assert_eq!(healthy.computer().usable_boards(), 1);
    assert!(findings[1].found.contains("usb:ABC at /dev/ttyACM0"), "{findings:?}");
}

#[test]
fn a_rule_that_is_missing_or_old_is_told() {
    let healthy = Healthy::new();
    fs::remove_file(healthy.path("etc/udev/rules.d/60-armid.rules")).unwrap();
    assert!(healthy.only("udev rule", State::Warn).1.contains("sudo cp host/udev/60-armid.rules"));
    // Elsewhere it counts as well; without its remarks too.
    let rules = include_str!("../udev/60-armid.rules").replace("# The board's own", "# The");
    healthy.put("usr/lib/udev/rules.d/60-armid.rules", &rules);
    assert!(healthy.findings().iter().all(|finding| finding.state == State::Ok));
    healthy.put("etc/udev/rules.d/60-armid.rules", "SUBSYSTEM==\"tty\"\n");
    assert!(healthy.only("udev rule", State::Warn).0.contains("not the one of this version"));
}

#[test]
fn a_board_that_may_not_be_opened_is_a_fault() {
    let healthy = Healthy::new();
    healthy.forbid("dev/ttyACM0");
    let (found, remedy) = healthy.only("board", State::Fail);
    assert!(found.contains("/dev/ttyACM0") && remedy.contains("plug it in again"), "{found}: {remedy}");
    assert_eq!(healthy.computer().usable_boards(), 0);
    // Without the rule, the rule is the remedy.
    fs::remove_file(healthy.path("etc/udev/rules.d/60-armid.rules")).unwrap();
    let board = healthy.findings().into_iter().find(|finding| finding.check == "board").unwrap();
    assert!(board.remedy.unwrap().contains("60-armid.rules"));
}

#[test]
fn a_device_without_its_file_is_a_fault() {
    let healthy = Healthy::new();
    fs::remove_file(healthy.path("dev/ttyACM0")).unwrap();
    assert!(healthy.only("board", State::Fail).0.contains("/dev/ttyACM0 is missing"));
}

#[test]
fn another_device_with_the_same_numbers_is_no_board() {
    let healthy = Healthy::new();
    healthy.put(&format!("{BOARD}/product"), "something else under test\n");
    assert!(healthy.only("board", State::Warn).0.contains("none"));
}

#[test]
fn a_missing_or_forbidden_probe_is_told() {
    let healthy = Healthy::new();
    healthy.forbid("dev/bus/usb/001/006");
    assert!(healthy.only("debug probe", State::Fail).0.contains("/dev/bus/usb/001/006"));
    fs::remove_file(healthy.path("sys/bus/usb/devices/1-3")).unwrap();
    assert!(healthy.only("debug probe", State::Warn).1.contains("armid flash"));
}

/// The probe that is connected becomes another one.
fn with_probe(vendor: &str, product: &str) -> Healthy {
    let healthy = Healthy::new();
    healthy.put(&format!("{PROBE}/idVendor"), vendor);
    healthy.put(&format!("{PROBE}/idProduct"), product);
    healthy
}

fn probe(healthy: &Healthy) -> Finding {
    healthy.findings().into_iter().find(|finding| finding.check == "debug probe").unwrap()
}

#[test]
fn other_probes_are_known_and_their_permissions_looked_at() {
    for (vendor, product, name) in [
        ("1366", "0105", "J-Link"),
        ("0403", "6014", "FTDI"),
        ("15ba", "002a", "Olimex"),
        ("1a86", "55dd", "CH347"),
        ("20b7", "9db1", "Glasgow"),
        ("0483", "3742", "ST-LINK"),
    ] {
        let healthy = with_probe(vendor, product);
        let found = probe(&healthy);
        assert_eq!(found.state, State::Ok, "{found:?}");
        assert!(found.found.contains(name) && found.found.contains(product), "{found:?}");
        healthy.forbid("dev/bus/usb/001/006");
        assert!(healthy.only("debug probe", State::Fail).0.contains("/dev/bus/usb/001/006"));
    }
    // A mouse is none.
    assert!(probe(&with_probe("046d", "c077")).found.contains("none on USB"));
}

#[test]
fn a_cmsis_dap_probe_is_told_by_its_interfaces() {
    let healthy = with_probe("2e8a", "000c");
    healthy.put(&format!("{PROBE}/1-3:1.0/bInterfaceClass"), "03\n");
    healthy.put(&format!("{PROBE}/1-3:1.0/interface"), "CMSIS-DAP v1 Interface\n");
    let (found, remedy) = healthy.only("debug probe", State::Warn);
    assert!(found.contains("over HID alone") && remedy.contains("newer firmware"), "{found}: {remedy}");
    healthy.put(&format!("{PROBE}/1-3:1.1/bInterfaceClass"), "ff\n");
    healthy.put(&format!("{PROBE}/1-3:1.1/interface"), "CMSIS-DAP v2 Interface\n");
    let found = probe(&healthy);
    assert!(found.state == State::Ok && found.found.contains("CMSIS-DAP 2e8a:000c"), "{found:?}");
}

#[test]
fn a_black_magic_probe_is_used_through_its_serial_port() {
    let healthy = with_probe("1d50", "6018");
    fs::create_dir_all(healthy.path(&format!("{PROBE}/1-3:1.0"))).unwrap();
    fs::create_dir_all(healthy.path("sys/class/tty/ttyACM1")).unwrap();
    symlink(healthy.path(&format!("{PROBE}/1-3:1.0")), healthy.path("sys/class/tty/ttyACM1/device")).unwrap();
    healthy.put("dev/ttyACM1", "");
    let found = probe(&healthy);
    assert!(found.state == State::Ok && found.found.contains("/dev/ttyACM1"), "{found:?}");
    healthy.forbid("dev/ttyACM1");
    assert!(healthy.only("debug probe", State::Fail).0.contains("/dev/ttyACM1"));
}

/// Whatever `doctor` looks at the permissions of, the rule gives.
#[test]
fn the_rule_names_every_vendor_that_is_known() {
    let rules = include_str!("../udev/60-armid.rules");
    for vendor in ["1209", "0483", "1366", "0403", "15ba", "1a86", "20b7", "1d50"] {
        assert!(rules.contains(&format!("idVendor}}==\"{vendor}\"")), "{vendor}");
    }
    assert!(rules.contains("*CMSIS[-_]DAP*"));
}

#[test]
fn modem_manager_is_a_fault_where_no_rule_stops_it() {
    let healthy = Healthy::new();
    healthy.put("proc/99/comm", "ModemManager\n");
    assert!(healthy.findings().iter().all(|finding| finding.state == State::Ok));
    let rules = include_str!("../udev/60-armid.rules").replace("ID_MM_DEVICE_IGNORE", "SOMETHING");
    healthy.put("etc/udev/rules.d/60-armid.rules", &rules);
    let state =
        |findings: Vec<Finding>| findings.into_iter().find(|finding| finding.check == "ModemManager").unwrap().state;
    assert_eq!(state(healthy.findings()), State::Fail);
    // Without a board nothing is disturbed yet.
    fs::remove_dir_all(healthy.path("sys/class/tty")).unwrap();
    assert_eq!(state(healthy.findings()), State::Warn);
}

#[test]
fn a_cache_that_cannot_be_written_is_told() {
    let healthy = Healthy::new();
    healthy.forbid("home/user/.cache");
    assert!(healthy.only("cache", State::Warn).1.contains("ARMID_CACHE"));
    let without = healthy.computer().check(None);
    assert!(without.iter().all(|finding| finding.state == State::Ok));
    // A file where the folder should be.
    let cache = healthy.path("etc/group");
    assert!(healthy.computer().check(Some(&cache)).iter().any(|finding| finding.state == State::Warn));
}

#[test]
fn a_computer_that_shows_no_usb_is_not_called_healthy() {
    let empty = tempfile::tempdir().unwrap();
    let findings = Computer::at(empty.path().into()).check(None);
    assert!(findings.iter().any(|finding| finding.check == "board" && finding.found.contains("cannot be looked at")));
}

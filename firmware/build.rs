//! Hands the linker the memory map at the root of the workspace and the scripts of cortex-m-rt and defmt.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

fn main() {
    let manifest_directory = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    let output_directory = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));

    // Copied, because the directory of the original may not be searched: a second `memory.x` somewhere in it
    // would silently win.
    let memory_map = manifest_directory.join("../memory.x");
    fs::copy(&memory_map, output_directory.join("memory.x"))
        .unwrap_or_else(|error| panic!("cannot copy {} for the linker: {error}", memory_map.display()));
    println!("cargo:rerun-if-changed={}", memory_map.display());
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-link-search={}", output_directory.display());

    // Flash is not paged: without --nmagic the linker pads segments to pages and the image grows.
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");

    println!("cargo:rustc-env=ARMID_GIT_REVISION={}", git_revision(&manifest_directory));
}

/// What an image is made of, relative to this package; the rest of the checkout may differ from the revision.
const SOURCES: [&str; 6] = ["src", "Cargo.toml", "../shared", "../memory.x", "../Cargo.toml", "../Cargo.lock"];

/// The short revision the image is built from, with `-dirty` where its sources differ from it; `unknown` outside a
/// checkout.
fn git_revision(directory: &Path) -> String {
    let run_git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(directory).args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    // HEAD names the branch, its log grows with every commit: together they change whenever the revision does.
    let head = ["HEAD", "logs/HEAD"]
        .into_iter()
        .filter_map(|file| run_git(&["rev-parse", "--path-format=absolute", "--git-path", file]))
        .map(PathBuf::from);
    for path in SOURCES.into_iter().map(|source| directory.join(source)).chain(head) {
        // Named while it does not exist, a file would make every build start anew.
        if path.exists() {
            println!("cargo:rerun-if-changed={}", path.display());
        }
    }
    let Some(revision) = run_git(&["rev-parse", "--short=12", "HEAD"]) else { return "unknown".to_owned() };
    let changes = run_git(&[&["status", "--porcelain", "--"][..], &SOURCES].concat());
    let mark = if changes.is_some_and(|changes| changes.is_empty()) { "" } else { "-dirty" };
    format!("{revision}{mark}")
}

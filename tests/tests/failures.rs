//! What the README says of failures: every test that it names is there.

use std::fs;
use std::path::Path;

/// All sources of the crates beside this one.
fn sources(folder: &Path, text: &mut String) {
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, text);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            *text += &fs::read_to_string(&path).unwrap();
        }
    }
}

#[test]
fn every_test_named_for_a_failure_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut code = String::new();
    for folder in ["host/src", "host/tests", "shared/src", "shared/tests", "tests/src", "tests/tests"] {
        sources(&root.join(folder), &mut code);
    }
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    let section = readme.split("\n## What can fail\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows: Vec<&str> = section.lines().filter(|line| line.starts_with("| ")).skip(1).collect();
    assert!(rows.len() >= 15, "{} failures", rows.len());
    for row in rows {
        let shown_by = row.trim_end_matches('|').rsplit('|').next().unwrap();
        let names: Vec<&str> = shown_by.split('`').skip(1).step_by(2).filter(|name| !name.contains('.')).collect();
        assert!(!names.is_empty() || shown_by.contains("a lint"), "nothing shows {row}");
        for name in names {
            let plain = format!("fn {name}(");
            let scenario = format!("fn {name}<");
            assert!(code.contains(&plain) || code.contains(&scenario), "there is no test {name}");
        }
    }
}

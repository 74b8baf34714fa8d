//! Captures of the generator of faults (`tests/faults`), judged by the program under test.

use std::fs;
use std::process::{Command, Output};

use crate::support::{self, skip, workspace};

/// The generator needs Python 3.11 without packages; `None` if there is none.
fn run_generator(arguments: &[&str]) -> Option<Output> {
    let python = support::python().unwrap_or_else(|| "python3".into());
    let has_toml = Command::new(&python).args(["-c", "import tomllib"]).output();
    if !has_toml.is_ok_and(|output| output.status.success()) {
        skip("python", "no Python 3.11 for the generator of faults");
        return None;
    }
    let mut command = Command::new(python);
    Some(command.current_dir(workspace()).arg("tests/faults").args(arguments).output().unwrap())
}

#[test]
fn a_seed_gives_the_same_bytes() {
    let Some(output) = run_generator(&["digest", "--seeds", "1-20"]) else { return };
    let digests = fs::read_to_string(workspace().join("tests/faults/digests.txt")).unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), digests);
}

#[test]
fn figures_are_not_worse() {
    let program = env!("CARGO_BIN_EXE_cobscope");
    let arguments = [
        "score",
        "--program",
        program,
        "--seeds",
        "1-40",
        "--compare",
        "tests/faults/figures.json",
        "--list",
    ];
    let Some(output) = run_generator(&arguments) else { return };
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(text.lines().count(), 40, "{text}");
}

//! Example programs of the library: runs each one as its first lines describe, and compares its output with
//! `examples/`.
//!
//! `COBSCOPE_BLESS=1` writes the output; review it before you commit it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::support::workspace;

/// Program of an example; cargo builds all examples with the tests.
fn program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().unwrap();
    let profile = tests.parent().and_then(|folder| folder.parent()).unwrap();
    let path = profile.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(path.exists(), "{}: cargo build --workspace --examples", path.display());
    path
}

/// Arguments after `--` in the command in the first lines of the example.
fn arguments(source: &str) -> Vec<String> {
    let command = source.lines().find_map(|line| line.strip_prefix("//! `cargo run ")).unwrap();
    let words = command.trim_end_matches('`').split_once(" -- ").map_or("", |(_, words)| words);
    let parts = words.split('"').enumerate();
    let words =
        parts.flat_map(|(at, part)| if at % 2 == 1 { vec![part] } else { part.split_whitespace().collect() });
    words.map(str::to_owned).collect()
}

#[test]
fn each_prints_what_is_expected() {
    let mut names = Vec::new();
    for entry in fs::read_dir(workspace().join("decoder/examples")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        // A tool of the benchmarks.
        if name == "generate_machine" {
            continue;
        }
        let source = fs::read_to_string(&path).unwrap();
        let output =
            Command::new(program(&name)).args(arguments(&source)).current_dir(workspace()).output().unwrap();
        let stated = String::from_utf8_lossy(&output.stderr);
        let status = output.status.code().unwrap();
        let text = format!("{}{stated}exit status {status}\n", String::from_utf8_lossy(&output.stdout));
        let path = workspace().join("tests/decoder/examples").join(format!("{name}.txt"));
        if std::env::var_os("COBSCOPE_BLESS").is_some() {
            fs::write(&path, &text).unwrap();
        }
        assert_eq!(text, fs::read_to_string(&path).unwrap_or_default(), "{}", path.display());
        names.push(name);
    }
    names.sort();
    assert_eq!(names, ["count_events", "findings", "live_frames", "print_events", "signal_table"]);
}

//! Helpers of the tests of both crates: locations of optional parts, and the report of skipped tests.

#![allow(dead_code, reason = "each test binary uses a part")]
#![allow(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]

pub mod code;
pub mod modules;

use std::env;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder of the workspace.
pub fn workspace() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_path_buf()
}

/// Captures of other projects: `COBSCOPE_CORPUS`, else `shared/corpus` next to the workspace.
pub fn corpus() -> PathBuf {
    let beside = || workspace().join("..").join("shared").join("corpus");
    env::var_os("COBSCOPE_CORPUS").map_or_else(beside, PathBuf::from)
}

/// Step between the cases of a long test: 1 with `COBSCOPE_FULL`, else `usual`.
pub fn step(usual: usize) -> usize {
    if env::var_os("COBSCOPE_FULL").is_some() { 1 } else { usual }
}

/// Captures in candump text in and below a folder of the workspace, in order.
pub fn captures_below(folder: &str) -> Vec<String> {
    files_below(folder, "log")
}

/// Files with a suffix in and below a folder of the workspace, in order.
pub fn files_below(folder: &str, suffix: &str) -> Vec<String> {
    let (mut folders, mut found) = (vec![workspace().join(folder)], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == suffix) {
                found.push(path.to_str().unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

/// Whether this build can read a file: without the feature `gzip`, compressed captures are unsupported.
pub fn is_readable(name: &str) -> bool {
    cfg!(feature = "gzip") || !name.to_ascii_lowercase().ends_with(".gz")
}

/// A Python with `tests/oracles/requirements.txt`: `COBSCOPE_PYTHON`, else `.venv` of the workspace.
pub fn python() -> Option<PathBuf> {
    let own = || workspace().join(".venv").join("bin").join("python");
    let path = env::var_os("COBSCOPE_PYTHON").map_or_else(own, PathBuf::from);
    path.exists().then_some(path)
}

/// Reports that a test skips `part` (corpus, python, tshark, guest): on stderr, past the harness, and in
/// `target/skipped.txt`, so that skipped tests are visible.
///
/// # Panics
/// If `COBSCOPE_REQUIRE`, a comma-separated list, contains `part`.
pub fn skip(part: &str, why: &str) {
    let required = env::var("COBSCOPE_REQUIRE").unwrap_or_default();
    assert!(!required.split(',').any(|name| name.trim() == part), "{part} is required: {why}");
    let line = format!("skipped {part}: {why}\n");
    // A failed report must not fail the test.
    let _ = std::io::stderr().write_all(line.as_bytes());
    let target = workspace().join("target");
    let _ = fs::create_dir_all(&target);
    if let Ok(mut file) = OpenOptions::new().create(true).append(true).open(target.join("skipped.txt")) {
        let _ = file.write_all(line.as_bytes());
    }
}

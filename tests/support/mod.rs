//! What the tests of both crates share: where things that are not in the repository are, and how a test
//! says that it needs one of them.

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

/// Captures of other projects: `COBSCOPE_CORPUS`, else `shared/corpus` beside the workspace.
pub fn corpus() -> PathBuf {
    let beside = || workspace().join("..").join("shared").join("corpus");
    env::var_os("COBSCOPE_CORPUS").map_or_else(beside, PathBuf::from)
}

/// Whether this build can read a file: one without the feature `gzip` reads no compressed captures.
pub fn is_readable(name: &str) -> bool {
    cfg!(feature = "gzip") || !name.to_ascii_lowercase().ends_with(".gz")
}

/// A Python that has `tests/oracles/requirements.txt`: `COBSCOPE_PYTHON`, else `.venv` of the workspace.
pub fn python() -> Option<PathBuf> {
    let own = || workspace().join(".venv").join("bin").join("python");
    let path = env::var_os("COBSCOPE_PYTHON").map_or_else(own, PathBuf::from);
    path.exists().then_some(path)
}

/// Says that a test leaves out `part` (corpus, python, tshark, guest): on stderr, past the harness, and in
/// `target/skipped.txt`, so that a run that tested less does not look like one that tested all.
///
/// # Panics
/// If `part` is named in `COBSCOPE_REQUIRE` (a list with commas).
pub fn skip(part: &str, why: &str) {
    let required = env::var("COBSCOPE_REQUIRE").unwrap_or_default();
    assert!(!required.split(',').any(|name| name.trim() == part), "{part} is required: {why}");
    let line = format!("skipped {part}: {why}\n");
    // Failing to say so must not fail the test.
    let _ = std::io::stderr().write_all(line.as_bytes());
    let target = workspace().join("target");
    let _ = fs::create_dir_all(&target);
    if let Ok(mut file) = OpenOptions::new().create(true).append(true).open(target.join("skipped.txt")) {
        let _ = file.write_all(line.as_bytes());
    }
}

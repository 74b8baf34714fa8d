//! Rules about the sources themselves.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::workspace;

/// Which folders and files of `decoder/src` may name which: the data flows from left to right, and
/// `decoder.rs` alone knows every stage; `samples/` runs it. `lib.rs` only lists them.
const LAYERS: &[(&str, &[&str])] = &[
    ("words", &[]),
    ("ascii", &[]),
    ("frame", &[]),
    ("capture", &["words", "ascii", "frame"]),
    ("wire", &["words", "frame"]),
    ("profile", &["words", "frame", "wire"]),
    ("event", &["words", "frame", "wire", "profile"]),
    ("finding", &["words", "frame", "wire", "profile", "event"]),
    ("bus_file", &["words", "frame", "wire", "profile"]),
    ("session", &["words", "frame", "wire", "profile", "event", "bus_file"]),
    ("query", &["words", "frame", "wire", "profile", "event", "session"]),
    ("statistics", &["words", "frame", "wire", "profile", "event", "session", "query"]),
    (
        "rules",
        &[
            "words",
            "frame",
            "wire",
            "profile",
            "event",
            "finding",
            "bus_file",
            "session",
            "query",
            "statistics",
        ],
    ),
    (
        "sink",
        &[
            "words",
            "ascii",
            "frame",
            "capture",
            "wire",
            "profile",
            "event",
            "finding",
            "session",
            "query",
            "statistics",
            "rules",
        ],
    ),
    ("why", &["words", "frame", "wire", "profile", "event", "session", "query", "statistics", "sink"]),
    (
        "decoder",
        &["words", "frame", "capture", "wire", "profile", "event", "session", "query", "statistics", "sink"],
    ),
    ("replay", &["words", "frame", "wire", "capture", "event", "session", "statistics", "sink", "decoder"]),
    ("samples", &["words", "bus_file", "frame", "capture", "wire", "profile", "event", "session", "decoder"]),
];

/// Longest file in lines, tests at its foot apart.
const LONGEST_FILE: usize = 600;

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

fn all(folders: &[&str]) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for folder in folders {
        sources(&workspace().join(folder), &mut found);
    }
    found.sort();
    let name = |path: &Path| path.strip_prefix(workspace()).unwrap().display().to_string();
    found.iter().map(|path| (name(path), fs::read_to_string(path).unwrap())).collect()
}

/// The part of a file before its tests.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text)
}

#[test]
fn every_layer_imports_only_from_the_left() {
    let layers: BTreeMap<_, _> = LAYERS.iter().copied().collect();
    let mut report = String::new();
    for (name, text) in all(&["decoder/src"]) {
        let path = name.trim_start_matches("decoder/src/");
        let layer = path.split('/').next().unwrap().trim_end_matches(".rs");
        if layer == "lib" {
            continue;
        }
        let Some(allowed) = layers.get(layer) else {
            writeln!(report, "{name}: {layer} is not in the table of layers").unwrap();
            continue;
        };
        for (_, rest) in
            without_tests(&text).match_indices("crate::").map(|(at, _)| text[..].split_at(at + 7))
        {
            let used: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if used != layer && !allowed.contains(&used.as_str()) {
                writeln!(report, "{name}: {layer} must not know {used}").unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn files_are_short_and_say_what_they_are_for() {
    let mut report = String::new();
    for (name, text) in all(&["decoder/src", "tui/src"]) {
        let lines = without_tests(&text).lines().count();
        if lines > LONGEST_FILE {
            writeln!(report, "{name}: {lines} lines").unwrap();
        }
        if !text.starts_with("//!") {
            writeln!(report, "{name}: does not begin with //!").unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn nothing_is_left_for_later() {
    let marks = ["TODO", "FIXME", "XXX", "todo!(", "unimplemented!("];
    let mut report = String::new();
    for (name, text) in all(&["decoder/src", "tui/src", "decoder/benches", "decoder/examples"]) {
        for (number, line) in text.lines().enumerate() {
            if marks.iter().any(|mark| line.contains(mark)) {
                writeln!(report, "{name}:{}: {line}", number + 1).unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

/// A sequence of fixture captures needs its provenance.
#[test]
fn every_fixture_is_described() {
    let readme = fs::read_to_string(workspace().join("fixtures/README.md")).unwrap();
    let mut missing = Vec::new();
    for folder in ["canopen", "devices", "dialects", "uds", "j1939"] {
        for entry in fs::read_dir(workspace().join("fixtures").join(folder)).unwrap() {
            let name = entry.unwrap().file_name().to_string_lossy().into_owned();
            let stem = name.split('.').next().unwrap().to_owned();
            let suffix = name.rsplit('.').next().unwrap();
            let is_capture = suffix == "log" || (folder == "dialects" && suffix == "txt");
            if is_capture && !readme.contains(&format!("`{name}`")) && !readme.contains(&format!("`{stem}`"))
            {
                missing.push(name);
            }
        }
    }
    assert!(missing.is_empty(), "{missing:?}");
}

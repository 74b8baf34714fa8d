//! Checks of the source code.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use regex::Regex;

use crate::support::code::{CodePart, parts};
use crate::support::modules::Modules;
use crate::support::workspace;

/// Permitted imports of folders and files of `decoder/src`: data flows from left to right; only `decoder.rs`
/// imports every stage, and `samples/` runs it. `lib.rs` only lists the modules.
const LAYERS: &[(&str, &[&str])] = &[
    ("words", &[]),
    ("ascii", &[]),
    ("marked_line", &[]),
    ("escape", &[]),
    ("figures", &[]),
    ("frame", &[]),
    ("capture", &["words", "ascii", "frame"]),
    ("series", &["frame", "capture"]),
    ("wire", &["words", "frame"]),
    ("profile", &["words", "marked_line", "frame", "wire"]),
    ("event", &["words", "frame", "wire", "profile"]),
    ("finding", &["words", "figures", "frame", "wire", "profile", "event"]),
    ("bus_file", &["words", "frame", "wire", "profile"]),
    ("standard_tables", &["frame", "wire", "profile"]),
    ("session", &["words", "frame", "wire", "profile", "event", "bus_file", "standard_tables"]),
    ("suggestion", &["frame", "wire", "profile", "session"]),
    ("observation", &["words", "frame", "wire", "event", "session"]),
    ("conclusion", &["words", "frame", "wire", "profile", "event", "finding", "session", "observation"]),
    ("query", &["words", "marked_line", "frame", "wire", "profile", "event", "standard_tables", "session"]),
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
            "suggestion",
            "observation",
            "conclusion",
            "query",
            "statistics",
        ],
    ),
    ("diagnosis", &["words", "figures", "frame", "wire", "profile", "event", "finding", "conclusion"]),
    (
        "sink",
        &[
            "figures",
            "diagnosis",
            "escape",
            "words",
            "ascii",
            "frame",
            "capture",
            "wire",
            "profile",
            "event",
            "finding",
            "standard_tables",
            "session",
            "query",
            "statistics",
            "rules",
        ],
    ),
    (
        "comparison",
        &[
            "figures",
            "diagnosis",
            "finding",
            "escape",
            "words",
            "frame",
            "wire",
            "profile",
            "event",
            "bus_file",
            "session",
            "query",
            "statistics",
            "sink",
        ],
    ),
    (
        "why",
        &[
            "diagnosis",
            "finding",
            "escape",
            "words",
            "frame",
            "wire",
            "profile",
            "event",
            "session",
            "suggestion",
            "query",
            "statistics",
            "sink",
        ],
    ),
    (
        "decoder",
        &["words", "frame", "capture", "wire", "profile", "event", "session", "query", "statistics", "sink"],
    ),
    (
        "replay",
        &[
            "escape",
            "words",
            "frame",
            "wire",
            "capture",
            "profile",
            "event",
            "session",
            "statistics",
            "sink",
            "decoder",
        ],
    ),
    (
        "reading",
        &[
            "escape",
            "words",
            "frame",
            "capture",
            "wire",
            "profile",
            "event",
            "finding",
            "bus_file",
            "session",
            "query",
            "statistics",
            "rules",
            "diagnosis",
            "sink",
            "comparison",
            "why",
            "decoder",
            "replay",
        ],
    ),
    (
        "answers",
        &[
            "words",
            "ascii",
            "escape",
            "figures",
            "frame",
            "wire",
            "profile",
            "event",
            "finding",
            "bus_file",
            "standard_tables",
            "session",
            "suggestion",
            "statistics",
            "diagnosis",
            "sink",
            "comparison",
            "why",
            "replay",
            "reading",
        ],
    ),
    (
        "report",
        &[
            "figures",
            "escape",
            "words",
            "frame",
            "capture",
            "wire",
            "profile",
            "event",
            "finding",
            "bus_file",
            "session",
            "statistics",
            "diagnosis",
            "sink",
            "comparison",
            "why",
            "reading",
            "answers",
        ],
    ),
    ("samples", &["words", "bus_file", "frame", "capture", "wire", "profile", "event", "session", "decoder"]),
];

/// Max lines of a file without the tests at its end.
const LONGEST_FILE: usize = 600;

/// Folders that decide by types: if a word that is printed changes, the compiler must name each place that depends on it.
const DECIDED_BY_TYPES: &[&str] = &[
    "decoder/src/comparison",
    "decoder/src/diagnosis",
    "decoder/src/event",
    "decoder/src/finding",
    "decoder/src/replay",
    "decoder/src/report",
    "decoder/src/rules",
    "decoder/src/session",
    "decoder/src/statistics",
    "decoder/src/why",
    "tui/src/panes",
];

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
    let report = Modules::read("decoder/src").violations(LAYERS);
    assert!(report.is_empty(), "\n{report}");
}

/// Calls that belong to the pass, and files outside of `reading/` that contain them, with the reason.
const CALLS_OF_THE_PASS: &[(&str, &[&str])] = &[
    ("RuleEngine::new", &[]),
    // A baseline decides after the pass which findings the text has.
    ("Diagnosis::diagnose_findings", &["decoder/src/sink/findings/text.rs"]),
    // Statistics of all buses call those of one.
    (".withdraw_canopen(", &["decoder/src/statistics/mod.rs"]),
];

/// Maximum number of implementations of `Observer`.
const MOST_OBSERVERS: usize = 12;

#[test]
fn only_the_pass_runs_rules_and_combines_observers() {
    let mut report = String::new();
    let mut observers = Vec::new();
    for (name, text) in all(&["decoder/src", "tui/src", "bindings"]) {
        let text = without_tests(&text);
        for (call, others) in CALLS_OF_THE_PASS {
            let is_permitted = name.starts_with("decoder/src/reading/") || others.contains(&name.as_str());
            if text.contains(call) && !is_permitted && !name.contains("/tests") {
                writeln!(report, "{name}: {call}").unwrap();
            }
        }
        let own = text.lines().filter(|line| line.starts_with("impl") && line.contains(" Observer for "));
        observers.extend(own.map(|line| format!("{name}: {line}")));
    }
    assert!(report.is_empty(), "\n{report}");
    assert!(observers.len() <= MOST_OBSERVERS, "{}\n{}", observers.len(), observers.join("\n"));
}

/// Files of the program and the page that parse JSON of others: requests, the index of a lake, schemas of tools.
const READERS_OF_JSON: &[&str] = &[
    "bindings/web/src/session.rs",
    "tui/src/cmd/mcp/arguments.rs",
    "tui/src/cmd/mcp/rpc.rs",
    "tui/src/run/lake_index.rs",
];

/// An answer is typed: it is not printed and parsed again.
#[test]
fn no_output_is_parsed_again() {
    let parses = |(name, text): &(String, String)| {
        without_tests(text).contains("serde_json::from_")
            && !name.contains("/tests")
            && !READERS_OF_JSON.contains(&name.as_str())
    };
    let found: Vec<_> =
        all(&["tui/src", "bindings"]).into_iter().filter(parses).map(|(name, _)| name).collect();
    assert_eq!(found, Vec::<String>::new());
}

/// A folder without circular imports can be read and moved together with its dependencies. A `mod.rs` counts
/// as a file: if its submodules use its definitions and it uses theirs, they all form one file.
#[test]
fn no_folder_has_a_circle_of_imports() {
    let cycles = Modules::read("decoder/src").cycles();
    let shown: Vec<_> = cycles.iter().map(|cycle| format!("{}: {}", cycle.folder, cycle.chain)).collect();
    assert!(shown.is_empty(), "\n{}", shown.join("\n"));
}

#[test]
fn a_circle_is_found_behind_re_exports_and_beside_tests() {
    let circles = |files: &[(&str, &str)]| -> Vec<String> {
        let files = files.iter().map(|(file, text)| ((*file).to_owned(), (*text).to_owned()));
        let cycles = Modules::of(files).cycles();
        cycles.iter().filter_map(|cycle| cycle.chain.lines().next().map(str::to_owned)).collect()
    };
    let user = ("a/user.rs", "use super::{Kept, other::*};\nfn f(_: Kept) { crate::a::keeper::g(); }");
    let keeper =
        ("a/keeper.rs", "pub struct Kept; // super::user\n#[cfg(test)]\nmod tests { use crate::a::user; }");
    let other = ("a/other.rs", "const PATH: &str = \"super::user::f\";");
    let lists = ("a/mod.rs", "mod keeper;\npub(crate) use keeper::{self, Kept};\nuse user::f as called;");
    assert_eq!(circles(&[user, keeper, other, lists]), [""; 0]);
    let defines = ("a/mod.rs", "mod user;\npub use user::f;\npub struct Kept;\nfn g() { f(Kept) }");
    assert_eq!(circles(&[user, keeper, other, defines]), ["mod.rs → user → mod.rs"]);
    let back = ("a/keeper.rs", "pub(in crate::a::user) struct Kept;\nfn g() { super::user::f(Kept); }");
    assert_eq!(circles(&[user, back, other, lists]), ["keeper → user → keeper"]);
}

#[test]
fn files_are_short_and_say_what_they_are_for() {
    let mut report = String::new();
    for (name, text) in all(&[
        "decoder/src",
        "tui/src",
        "bindings/adapters/src",
        "bindings/fake/src",
        "bindings/python/src",
        "bindings/web/src",
    ]) {
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

/// Lines that decide by a word: comparisons with it or with its start or end, patterns of it, and
/// lists of words that are searched.
fn decisions_by_word(text: &str) -> Vec<usize> {
    // Each string with a letter becomes `"w"`; bytes and strings without letters decide about data.
    let has_letter = |text: &str| text.replace(r"\r", "").replace(r"\n", "").contains(char::is_alphabetic);
    let mut code = String::new();
    for (_, part) in parts(without_tests(text)) {
        match part {
            CodePart::Code(part) => code.push_str(part),
            CodePart::String(part) if part.starts_with('"') && has_letter(part) => {
                code.push_str("\"w\"");
                code.extend(part.matches('\n'));
            }
            CodePart::String(part) => code.extend(part.matches('\n')),
            CodePart::Comment | CodePart::Character => {}
        }
    }
    let words = [
        r#"[=!]=\s*&?(\w+\()*"w""#,
        r#""w"\)*\s*[=!]="#,
        r#"(?m)^([ |\w:(),&"]|\.\.)*"w"[^\n;{}=]*=>"#,
        r#"(?m)^\s*\|\s[\w:(&]*"w""#,
        r#"matches!\(([^()]|\(([^()]|\([^()]*\))*\))*"w""#,
        r#"\[\s*("w",?\s*)+\]\s*\.contains"#,
        r#"(contains|(starts|ends)_with)\("w""#,
    ];
    let mut lines: Vec<usize> = Vec::new();
    for expression in words {
        let found = Regex::new(expression).unwrap();
        lines.extend(found.find_iter(&code).map(|it| code[..it.end()].matches('\n').count() + 1));
    }
    lines.sort_unstable();
    lines.dedup();
    lines
}

#[test]
fn decisions_are_made_by_types() {
    let mut report = String::new();
    for (name, text) in all(DECIDED_BY_TYPES).iter().filter(|(name, _)| !name.ends_with("/tests.rs")) {
        for line in decisions_by_word(text) {
            writeln!(report, "{name}:{line}: {}", text.lines().nth(line - 1).unwrap().trim()).unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn decisions_by_word_are_found_and_other_words_are_not() {
    for decision in [
        "if by == \"heartbeat\" {}",
        "if by != Some(\"heartbeat\") {}",
        "if \"heartbeat\" == by {}",
        "match by {\n    \"heartbeat\" => 1,\n}",
        "match by {\n    (1, Some(\"heartbeat\")) if x => 1,\n}",
        "match by {\n    \"a\"\n    | \"b\" => 1,\n}",
        "matches!(f(by), \"heartbeat\" | \"guarding\")",
        "[\"heartbeat\", \"guarding\"].contains(&by)",
        "if by.starts_with(\"heartbeat\") {}",
    ] {
        assert!(!decisions_by_word(decision).is_empty(), "{decision}");
    }
    for other in [
        "// if by == \"heartbeat\"",
        "match by {\n    Heartbeat => \"heartbeat\",\n    Guarding => \"guarding\",\n}",
        "if by.contains(HEARTBEAT) { text.push_str(\"heartbeat\") }",
        "if text == \"\" || text == \"-0\" || data == b\"save\" {}",
        "if matches!(by, Heartbeat) { \"heartbeat\" } else { \"guarding\" }",
        "let by = if by == 1 { \"heartbeat\" } else { \"guarding\" };",
        "#[cfg(test)]\nmod tests { fn f() { assert!(by == \"heartbeat\") } }",
    ] {
        assert_eq!(decisions_by_word(other), [0; 0], "{other}");
    }
}

#[test]
fn nothing_is_left_for_later() {
    let marks = ["TODO", "FIXME", "XXX", "todo!(", "unimplemented!("];
    let mut report = String::new();
    for (name, text) in all(&["decoder/src", "tui/src", "bindings", "decoder/benches", "decoder/examples"]) {
        for (number, line) in text.lines().enumerate() {
            if marks.iter().any(|mark| line.contains(mark)) {
                writeln!(report, "{name}:{}: {line}", number + 1).unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

/// The provenance of each fixture capture is documented.
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

/// Maximum number of methods of a type, in all its `impl` blocks without a trait.
const MOST_METHODS: usize = 50;

/// Crates whose types stay below [`MOST_METHODS`].
const TYPES_WITHIN_LIMIT: &[&str] = &["decoder/src"];

/// Types and the number of their methods, in files with their names.
fn methods_of_types(files: &[(String, String)]) -> BTreeMap<String, usize> {
    let method = Regex::new(r"^    (pub(\([^)]*\))? )?(const )?(async )?(unsafe )?fn ").unwrap();
    let name = Regex::new(r"^impl(<[^<>]*(<[^<>]*>[^<>]*)*>)? (\w+)").unwrap();
    let mut counts = BTreeMap::new();
    for (_, text) in files {
        let mut current = None;
        for line in without_tests(text).lines() {
            match line {
                "}" => current = None,
                _ if line.starts_with("impl") && !line.contains(" for ") => {
                    current = name.captures(line).map(|found| found[3].to_owned());
                }
                _ if method.is_match(line) => {
                    if let Some(current) = &current {
                        *counts.entry(current.clone()).or_default() += 1;
                    }
                }
                _ => {}
            }
        }
    }
    counts
}

/// A type with more methods has several tasks; a part of its state is a type of its own.
#[test]
fn no_type_has_too_many_methods() {
    for folder in TYPES_WITHIN_LIMIT {
        let counts = methods_of_types(&all(&[folder]));
        let large: Vec<_> = counts.iter().filter(|(_, count)| **count > MOST_METHODS).collect();
        assert!(large.is_empty(), "{folder}: {large:?}");
    }
    let file = "impl<'a, T: Copy> Big<'a, T> {\n    pub(crate) const fn f() {}\n    fn g() {\n    }\n}\n\
                impl Other for Big<'_> {\n    fn h() {}\n}\nimpl Big<'_> {\n    pub fn i() {}\n}\n";
    let counts = methods_of_types(&[(String::new(), file.to_owned())]);
    assert_eq!(counts.into_iter().collect::<Vec<_>>(), [("Big".to_owned(), 3)]);
}

/// Maximum number of files directly in a folder.
const MOST_FILES: usize = 25;

/// Folders whose files and subfolders stay below [`MOST_FILES`] per folder.
const FOLDERS_WITHIN_LIMIT: &[&str] = &["decoder/src/session"];

#[test]
fn no_folder_has_too_many_files() {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for (name, _) in all(FOLDERS_WITHIN_LIMIT) {
        let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
        *counts.entry(folder.to_owned()).or_default() += 1;
    }
    counts.retain(|_, count| *count > MOST_FILES);
    assert!(counts.is_empty(), "{counts:?}");
}

//! Text of the repository, divided into passages with a file and a line.

use std::fs;
use std::path::Path;

use crate::support::code::{CodePart, parts};
use crate::support::workspace;

/// A text with its position.
#[derive(Clone)]
pub struct Passage {
    /// The file, relative to the workspace.
    pub file: String,
    /// The first line, from 1; 0 if the passage has no single line.
    pub line: usize,
    pub text: String,
}

/// Files with this extension below a folder of the workspace, sorted by name.
pub fn files(folder: &str, extension: &str) -> Vec<(String, String)> {
    let mut names = Vec::new();
    collect(&workspace().join(folder), extension, &mut names);
    names.sort();
    let read = |name: String| {
        let text = fs::read_to_string(workspace().join(&name)).unwrap();
        (name, text)
    };
    names.into_iter().map(read).collect()
}

fn collect(folder: &Path, extension: &str, names: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, extension, names);
        } else if path.extension().is_some_and(|found| found == extension) {
            names.push(path.strip_prefix(workspace()).unwrap().display().to_string());
        }
    }
}

/// Comment lines of Rust files: trimmed lines that start with `//`.
pub fn comment_lines(folder: &str) -> Vec<Passage> {
    let mut lines = Vec::new();
    for (file, text) in files(folder, "rs") {
        for (at, line) in text.lines().enumerate() {
            if line.trim().starts_with("//") {
                lines.push(Passage { file: file.clone(), line: at + 1, text: line.trim().to_owned() });
            }
        }
    }
    lines
}

/// First lines of doc comments, without their slashes.
pub fn doc_comment_starts(folder: &str) -> Vec<Passage> {
    let is_doc = |text: &str| text.starts_with("///") || text.starts_with("//!");
    let lines = comment_lines(folder);
    let continues = |at: usize| {
        at.checked_sub(1).and_then(|at| lines.get(at)).is_some_and(|before| {
            before.file == lines[at].file && before.line + 1 == lines[at].line && is_doc(&before.text)
        })
    };
    let starts = lines.iter().enumerate().filter(|(at, line)| is_doc(&line.text) && !continues(*at));
    let text = |line: &Passage| line.text.trim_start_matches(['/', '!']).trim().to_owned();
    starts.map(|(_, line)| Passage { text: text(line), ..line.clone() }).collect()
}

/// String literals outside tests.
pub fn string_literals(folder: &str) -> Vec<Passage> {
    let mut literals = Vec::new();
    for (file, text) in files(folder, "rs") {
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(&text);
        for (at, part) in parts(code) {
            if let CodePart::String(literal) = part {
                let line = code[..at].matches('\n').count() + 1;
                literals.push(Passage { file: file.clone(), line, text: joined(literal) });
            }
        }
    }
    literals
}

/// A literal as one line: `\` at the end of a line joins it with the next one.
fn joined(literal: &str) -> String {
    let lines: Vec<_> = literal.lines().map(|line| line.trim().trim_end_matches('\\')).collect();
    lines.join(" ").replace("\\n", " ")
}

/// Doc comments of the files that define the command line, which clap prints as help.
pub fn help_lines() -> Vec<Passage> {
    let defining: Vec<_> = files("tui/src", "rs")
        .into_iter()
        .filter(|(_, text)| ["Args)]", "Parser)]", "Subcommand)]"].iter().any(|derive| text.contains(derive)))
        .map(|(file, _)| file)
        .collect();
    assert!(defining.len() > 20, "{defining:?}");
    let is_help = |line: &Passage| defining.contains(&line.file);
    comment_lines("tui/src")
        .into_iter()
        .filter(|line| is_help(line) && line.text.starts_with("///"))
        .collect()
}

/// Texts in the TOML files below a folder.
pub fn toml_strings(folder: &str) -> Vec<Passage> {
    let mut texts = Vec::new();
    for (file, text) in files(folder, "toml") {
        let table: toml::Table = toml::from_str(&text).unwrap();
        for text in strings_in(&toml::Value::Table(table)) {
            texts.push(Passage { file: file.clone(), line: 0, text });
        }
    }
    texts
}

fn strings_in(value: &toml::Value) -> Vec<String> {
    match value {
        toml::Value::String(text) => vec![text.clone()],
        toml::Value::Array(values) => values.iter().flat_map(strings_in).collect(),
        toml::Value::Table(table) => table.values().flat_map(strings_in).collect(),
        _ => Vec::new(),
    }
}

/// Complete documents.
pub fn documents() -> Vec<Passage> {
    let mut names = vec!["README.md".to_owned(), "decoder/profiles/README.md".to_owned()];
    names.extend(files("docs", "md").into_iter().map(|(name, _)| name));
    let read = |file: String| {
        let text = fs::read_to_string(workspace().join(&file)).unwrap();
        Passage { file, line: 0, text }
    };
    names.into_iter().map(read).collect()
}

/// Names that Rust files define with one of these keywords, including tests.
pub fn defined_names(folder: &str, keywords: &[&str]) -> Vec<Passage> {
    let mut names = Vec::new();
    for (file, text) in files(folder, "rs") {
        let code = crate::support::code::blanked(&text);
        let words: Vec<&str> = code.split_whitespace().collect();
        for pair in words.windows(2) {
            if keywords.contains(&pair[0]) {
                let end = pair[1].find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(pair[1].len());
                names.push(Passage { file: file.clone(), line: 0, text: pair[1][..end].to_owned() });
            }
        }
    }
    names
}

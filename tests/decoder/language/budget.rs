//! The expressions that are counted, and the limits of each: `budget.toml`.

use std::fs;

use regex::{Regex, RegexBuilder};
use serde::Deserialize;

use super::shares::NameShares;
use crate::support::workspace;

/// `budget.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Occurrences of all expressions per 1,000 words of a document.
    pub document_limit: f64,
    #[serde(rename = "expression")]
    pub expressions: Vec<Expression>,
    pub doc_comment_start: DocCommentStart,
    pub names: Names,
    /// Highest shares of names.
    pub name_limits: NameShares,
    #[serde(default)]
    pub allowed: Vec<Allowed>,
}

/// An expression to avoid.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expression {
    pub name: String,
    #[serde(deserialize_with = "regex")]
    pattern: Regex,
    #[serde(default, deserialize_with = "optional_regex")]
    except: Option<Regex>,
    /// Occurrences per 1,000 comment lines.
    pub limit: f64,
    pub in_strings: bool,
}

/// First words that a doc comment should not have.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DocCommentStart {
    pub name: String,
    pub words: Vec<String>,
    /// Occurrences per 1,000 comment lines.
    pub limit: f64,
}

/// Words that names must not contain.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Names {
    pub in_types: Vec<String>,
    pub last_in_types: Vec<String>,
    pub first_in_types: Vec<String>,
    pub functions: Vec<String>,
    pub function_prefixes: Vec<String>,
}

/// A text in which a counted expression is correct.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Allowed {
    /// The file, from the workspace on.
    pub file: String,
    pub text: String,
    /// The reason, or the source of a quotation.
    pub reason: String,
}

impl Budget {
    pub fn read() -> Self {
        let text = fs::read_to_string(workspace().join("tests/decoder/language/budget.toml")).unwrap();
        toml::from_str(&text).unwrap()
    }

    /// The text without the parts that the allow list has for this file.
    pub fn without_allowed(&self, file: &str, text: &str) -> String {
        let entries = self.allowed.iter().filter(|entry| entry.file == file);
        entries.fold(text.to_owned(), |text, entry| text.replace(&entry.text, ""))
    }
}

impl Expression {
    /// Occurrences in the text.
    pub fn count(&self, text: &str) -> usize {
        match &self.except {
            Some(except) => self.pattern.find_iter(&except.replace_all(text, "")).count(),
            None => self.pattern.find_iter(text).count(),
        }
    }
}

impl Names {
    /// The rule that the name of a type breaks.
    pub fn error_in_type(&self, name: &str) -> Option<String> {
        let words = camel_case_words(name);
        let (first, last) = (words.first()?, words.last()?);
        let is_compound = words.len() > 1;
        words.iter().enumerate().find_map(|(at, word)| {
            let has = |list: &[String]| list.iter().any(|entry| entry == word);
            let is_last = at + 1 == words.len();
            if has(&self.in_types) {
                Some(format!("`{word}` is not allowed in the name of a type"))
            } else if has(&self.last_in_types) && !(is_compound && is_last) {
                Some(format!("`{word}` must be the last part of a compound, not of `{first}…`"))
            } else if has(&self.first_in_types) && !(is_compound && at == 0) {
                Some(format!("`{word}` must be the first part of a compound, not of `…{last}`"))
            } else {
                None
            }
        })
    }

    /// The rule that the name of a function breaks.
    pub fn error_in_function(&self, name: &str) -> Option<String> {
        let padded = format!("_{name}_");
        let word = self.functions.iter().find(|word| padded.contains(&format!("_{word}_")));
        let prefix = self.function_prefixes.iter().find(|prefix| name.starts_with(*prefix));
        word.or(prefix).map(|word| format!("`{word}` is not allowed in the name of a function"))
    }
}

/// `NoticesSent` as `Notices`, `Sent`.
fn camel_case_words(name: &str) -> Vec<&str> {
    let mut starts: Vec<usize> =
        name.char_indices().filter(|(_, c)| c.is_ascii_uppercase()).map(|(at, _)| at).collect();
    starts.push(name.len());
    starts.windows(2).map(|pair| &name[pair[0]..pair[1]]).collect()
}

fn regex<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Regex, D::Error> {
    let pattern = String::deserialize(deserializer)?;
    RegexBuilder::new(&pattern).case_insensitive(true).build().map_err(serde::de::Error::custom)
}

fn optional_regex<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<Regex>, D::Error> {
    regex(deserializer).map(Some)
}

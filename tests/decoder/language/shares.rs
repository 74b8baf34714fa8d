//! Shares of names that are not unique, have one word, or are a bare participle.

use std::collections::BTreeMap;

use regex::Regex;
use serde::Deserialize;

use super::sources;

const FOLDERS: [&str; 3] = ["decoder/src", "tui/src", "bindings"];
const SKIPPED_FOLDERS: [&str; 6] = ["target", "tests", "benches", "fuzz", "examples", "node_modules"];
/// Functions whose names are fixed by traits of the standard library, or by custom.
const FIXED: [&str; 14] = [
    "new", "fmt", "default", "from", "into", "drop", "clone", "eq", "next", "hash", "cmp", "try_from",
    "deref", "from_str",
];
/// Words that end like a participle.
const NOUNS: [&str; 2] = ["embed", "speed"];

/// Shares in per cent.
#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
pub struct NameShares {
    /// Definitions of types whose name has another definition, of all types.
    pub repeated_types: f64,
    /// Types with one word, of all types.
    pub short_types: f64,
    /// Functions with one word, of all functions with a free name.
    pub short_functions: f64,
    /// Functions named with one word that ends in `ed`, of all functions with a free name.
    pub bare_participles: f64,
}

/// Names of types and functions outside tests.
pub struct DefinedNames {
    types: Vec<String>,
    functions: Vec<String>,
}

impl DefinedNames {
    /// Names in a source text.
    pub fn find(code: &str) -> Self {
        let end = Regex::new(r"#\[cfg\(test\)\]\s*\n\s*mod ").unwrap();
        let code = end.find(code).map_or(code, |found| &code[..found.start()]);
        let names = |pattern: &str| {
            let pattern = format!(r"(?m)^\s*(?:pub(?:\([^)]*\))?\s+)?{pattern}\s+(\w+)");
            let found = Regex::new(&pattern).unwrap();
            found.captures_iter(code).map(|names| names[1].to_owned()).collect()
        };
        Self { types: names("(?:struct|enum|trait)"), functions: names("(?:const )?(?:async )?fn") }
    }

    /// Names in the sources of all crates.
    pub fn read() -> Self {
        let mut all = Self { types: Vec::new(), functions: Vec::new() };
        for (file, code) in FOLDERS.iter().flat_map(|folder| sources::files(folder, "rs")) {
            let mut parts: Vec<_> = file.split(['/', '\\']).collect();
            let name = parts.pop().unwrap_or_default();
            if matches!(name, "tests.rs" | "test.rs")
                || parts.iter().any(|part| SKIPPED_FOLDERS.contains(part))
            {
                continue;
            }
            let Self { types, functions } = Self::find(&code);
            all.types.extend(types);
            all.functions.extend(functions);
        }
        all
    }

    /// The shares, and the names that cause each of them, most frequent first.
    pub fn measure(&self) -> (NameShares, String) {
        let words = |name: &str| name.chars().filter(char::is_ascii_uppercase).count();
        let (types, functions) = (counts(&self.types), counts(&self.functions));
        let free: BTreeMap<_, _> = functions.into_iter().filter(|(name, _)| !FIXED.contains(name)).collect();
        let is_short = |name: &str| !name.contains('_');
        let is_participle =
            |name: &str| is_short(name) && name.ends_with("ed") && name.len() > 4 && !NOUNS.contains(&name);
        let shares = NameShares {
            repeated_types: share(&types, |_, count| count > 1),
            short_types: share(&types, |name, _| words(name) <= 1),
            short_functions: share(&free, |name, _| is_short(name)),
            bare_participles: share(&free, |name, _| is_participle(name)),
        };
        let report = format!(
            "types: {}\nfunctions: {}\n",
            most(&types, |_, count| count > 1),
            most(&free, |name, _| is_short(name)),
        );
        (shares, report)
    }
}

fn counts(names: &[String]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    for name in names {
        *counts.entry(name.as_str()).or_default() += 1;
    }
    counts
}

/// Per cent of the definitions whose name is selected.
fn share(counts: &BTreeMap<&str, usize>, is_selected: impl Fn(&str, usize) -> bool) -> f64 {
    let selected: usize =
        counts.iter().filter(|(name, count)| is_selected(name, **count)).map(|(_, count)| *count).sum();
    100.0 * super::number(selected) / super::number(counts.values().sum::<usize>().max(1))
}

/// The most frequent selected names with their number of definitions.
fn most(counts: &BTreeMap<&str, usize>, is_selected: impl Fn(&str, usize) -> bool) -> String {
    let mut found: Vec<_> = counts.iter().filter(|(name, count)| is_selected(name, **count)).collect();
    found.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
    let texts: Vec<_> = found.iter().take(30).map(|(name, count)| format!("{name} ({count})")).collect();
    texts.join(", ")
}

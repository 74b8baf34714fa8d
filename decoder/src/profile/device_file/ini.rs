//! Splits an EDS into sections and keywords (CiA 306-1 §4), with any kind of line ends.

use std::collections::{HashMap, HashSet};

use foldhash::fast::RandomState;
use memchr::memchr2;

use super::LONGEST_VALUE;
use super::problem::DescriptionProblems;
use crate::profile::quoted::quote_start;

/// Sections of a file in their order.
#[derive(Debug, Default)]
pub(super) struct IniFile<'a> {
    /// All sections, including those with a duplicate name.
    pub(super) sections: Vec<IniSection<'a>>,
    by_name: HashMap<String, usize, RandomState>,
}

/// Section `[name]` with its keywords.
#[derive(Debug)]
pub(super) struct IniSection<'a> {
    /// Name as written.
    pub(super) name: &'a str,
    /// Name in lower case without spaces.
    pub(super) key: String,
    /// Line, from 1.
    pub(super) line: usize,
    /// Keywords in file order; keys are unique.
    pub(super) entries: Vec<IniEntry<'a>>,
}

/// Entry `keyword=value`.
#[derive(Debug)]
pub(super) struct IniEntry<'a> {
    /// Keyword as written.
    pub(super) name: &'a str,
    /// Keyword in lower case without spaces, because some editors write `Supported Objects`.
    pub(super) key: String,
    /// Trimmed value; can be empty or end with a comment.
    pub(super) value: &'a str,
    /// Line, from 1.
    pub(super) line: usize,
}

impl<'a> IniFile<'a> {
    /// Parses all lines; reports those that are neither section, keyword nor comment.
    pub(super) fn parse(text: &'a str, problems: &mut DescriptionProblems) -> Self {
        let mut ini = Self::default();
        let mut keys = HashSet::<String, RandomState>::default();
        for (line, text) in split_lines(text) {
            let text = text.trim();
            if text.is_empty() || text.starts_with([';', '#']) {
                continue;
            }
            if let Some(name) = text.strip_prefix('[') {
                ini.sections.push(parse_section(name, line, problems));
                // A new set, because clearing a large one takes time in proportion to its capacity.
                keys = HashSet::default();
                continue;
            }
            let Some((name, value)) = text.split_once('=') else {
                problems.add_problem(line, format!("{}: expected keyword=value", quote_start(text)));
                continue;
            };
            let Some(section) = ini.sections.last_mut() else {
                problems
                    .add_problem(line, format!("{} precedes the first section; skipped", quote_start(text)));
                continue;
            };
            let (key, name, value) = (normalise_name(name), name.trim(), value.trim());
            if keys.insert(key.clone()) {
                section.entries.push(IniEntry { name, key, value, line });
            } else {
                problems.add_problem(
                    line,
                    format!(
                        "{}: duplicate keyword in this section; the first one is used",
                        quote_start(text)
                    ),
                );
            }
        }
        for (at, section) in ini.sections.iter().enumerate() {
            ini.by_name.entry(section.key.clone()).or_insert(at);
        }
        ini
    }

    /// First section with a name, given in lower case.
    pub(super) fn parse_section(&self, key: &str) -> Option<&IniSection<'a>> {
        self.sections.get(*self.by_name.get(key)?)
    }

    /// Whether the section at this index is the first with its name.
    pub(super) fn is_first(&self, at: usize) -> bool {
        self.sections.get(at).and_then(|section| self.by_name.get(&section.key)) == Some(&at)
    }
}

impl<'a> IniSection<'a> {
    /// Entry with a keyword, given in lower case.
    pub(super) fn entry(&self, key: &str) -> Option<&IniEntry<'a>> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    /// Value of a keyword; `None` if missing or empty.
    pub(super) fn value(&self, key: &str) -> Option<&'a str> {
        self.entry(key).map(|entry| entry.value).filter(|value| !value.is_empty())
    }

    /// Entries with a number as keyword, as in lists.
    pub(super) fn numbered_entries(&self) -> impl Iterator<Item = (u64, &IniEntry<'a>)> {
        self.entries.iter().filter_map(|entry| Some((entry.key.parse().ok()?, entry)))
    }
}

/// Lines with their numbers; line ends are LF, CR LF or CR.
fn split_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut rest = Some(text);
    let mut number = 0_usize;
    std::iter::from_fn(move || {
        let text = rest.take()?;
        number = number.saturating_add(1);
        let Some((line, after)) =
            memchr2(b'\n', b'\r', text.as_bytes()).and_then(|at| text.split_at_checked(at))
        else {
            return Some((number, text));
        };
        rest = after.strip_prefix("\r\n").or_else(|| after.get(1..));
        Some((number, line))
    })
}

/// Parses the text after `[`. Without a closing bracket, the name extends to the end of the line.
fn parse_section<'a>(text: &'a str, line: usize, problems: &mut DescriptionProblems) -> IniSection<'a> {
    let (name, rest) = text.split_once(']').unwrap_or_else(|| {
        problems.add_problem(line, format!("{}: expected ] after the section name", quote_start(text)));
        (text, "")
    });
    let rest = rest.trim();
    if !rest.is_empty() && !rest.starts_with([';', '#']) {
        problems.add_problem(line, format!("{} after the section name; ignored", quote_start(rest)));
    }
    let name = name.trim();
    let name = name.char_indices().nth(LONGEST_VALUE).map_or(name, |(at, _)| name.split_at(at).0);
    IniSection { name, key: normalise_name(name), line, entries: Vec::new() }
}

fn normalise_name(name: &str) -> String {
    name.chars().filter(|letter| !letter.is_whitespace()).map(|letter| letter.to_ascii_lowercase()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> (IniFile<'_>, Vec<String>) {
        let mut problems = DescriptionProblems::default();
        let ini = IniFile::parse(text, &mut problems);
        (ini, problems.finish().iter().map(ToString::to_string).collect())
    }

    #[test]
    fn every_line_end_counts_one_line() {
        let found: Vec<_> = split_lines("a\r\nb\rc\n\nd").collect();
        assert_eq!(found, [(1, "a"), (2, "b"), (3, "c"), (4, ""), (5, "d")]);
        assert_eq!(split_lines("").count(), 1);
    }

    #[test]
    fn sections_and_keywords_in_any_spelling() {
        let (ini, problems) =
            parse("; c\n[Device Info] # c\n Vendor Name = ACME = 1 \n# c\n[1003SUB0a]\nx=\n");
        assert!(problems.is_empty(), "{problems:?}");
        let section = ini.parse_section("deviceinfo").unwrap();
        assert_eq!((section.line, section.value("vendorname")), (2, Some("ACME = 1")));
        let section = ini.parse_section("1003sub0a").unwrap();
        assert_eq!((section.value("x"), section.entry("x").map(|entry| entry.line)), (None, Some(6)));
    }

    #[test]
    fn an_invalid_line_of_an_eds_is_reported_and_skipped() {
        let (ini, problems) = parse("lost=1\n[a\nx=1\nno equals sign\nX = 2\n[b] what\n[a]\ny=1");
        assert_eq!(
            problems,
            [
                "line 1: \"lost=1\" precedes the first section; skipped",
                "line 2: \"a\": expected ] after the section name",
                "line 4: \"no equals sign\": expected keyword=value",
                "line 5: \"X = 2\": duplicate keyword in this section; the first one is used",
                "line 6: \"what\" after the section name; ignored",
            ]
        );
        assert_eq!(ini.parse_section("a").unwrap().value("x"), Some("1"));
        assert_eq!((ini.is_first(0), ini.is_first(2), ini.is_first(9)), (true, false, false));
    }
}

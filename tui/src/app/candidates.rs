//! Words that complete a filter: fields, operators, and values of the captures with their counts.

use std::collections::BTreeMap;
use std::path::Path;

use cobscope_decoder::event::Kind;
use cobscope_decoder::finding::{CaptureFindings, Severity};
use cobscope_decoder::query::fields::{FieldTarget, FieldType};
use cobscope_decoder::query::{ExpectedWord, complete_filter};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::wire::NodeId;

use super::added::is_file;
use crate::panes::last_world;
use crate::state::UiState;

/// A word that completes the input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Candidate {
    /// The word as it is written in a filter.
    pub(super) text: String,
    /// Number of frames, events or findings with this value; None if counting is expensive.
    pub(super) count: Option<u64>,
}

impl Candidate {
    pub(super) fn new(text: &str, count: Option<u64>) -> Self {
        Self { text: text.to_owned(), count }
    }
}

/// Content of the row above a prompt.
#[derive(Debug, Default)]
pub(super) struct PromptRow {
    /// Byte offset of the word to complete.
    pub(super) start: usize,
    pub(super) candidates: Vec<Candidate>,
    /// The candidate in the text, after Tab.
    pub(super) chosen: Option<usize>,
    /// Text of a row without candidates.
    pub(super) text: String,
}

/// Offset of the word at the end of `before`, the words that complete it, and a text if there are none.
pub(super) fn find_candidates(core: &UiState, before: &str) -> (usize, Vec<Candidate>, String) {
    let Some(found) = complete_filter(before) else { return (before.len(), Vec::new(), String::new()) };
    let typed = before.get(found.start..).unwrap_or_default().to_lowercase();
    let mut words = match &found.expected {
        ExpectedWord::Value(targets) => value_candidates(core, targets, &found.expected.possible_words()),
        other => other.possible_words().into_iter().map(|word| Candidate::new(word, None)).collect(),
    };
    words.retain(|word| word.text.to_lowercase().starts_with(&typed));
    // A complete word needs no completion.
    if matches!(words.as_slice(), [only] if only.text == typed)
        && !matches!(found.expected, ExpectedWord::Field)
    {
        words.clear();
    }
    let text = match &found.expected {
        ExpectedWord::Value(targets) => field_meaning(targets),
        _ => String::new(),
    };
    (found.start, words, text)
}

/// The meaning of a field.
fn field_meaning(targets: &[FieldTarget]) -> String {
    targets.first().map_or(String::new(), |target| format!("{}: {}", target.field.key, target.field.doc))
}

/// Values of a field: those of the captures, most frequent first, then the other possible ones.
fn value_candidates(core: &UiState, targets: &[FieldTarget], fixed: &[&str]) -> Vec<Candidate> {
    let key = targets.first().map_or("", |target| target.field.key.as_str());
    let counted = match last_world(core) {
        Some(world) => value_counts(core, key, targets, &world),
        None => BTreeMap::new(),
    };
    let mut found: Vec<_> = counted.iter().map(|(text, count)| Candidate::new(text, Some(*count))).collect();
    if key != "node" {
        found.sort_by_key(|candidate| std::cmp::Reverse(candidate.count));
    }
    let others = fixed.iter().map(|word| (*word).to_owned()).chain(other_rules(core, key));
    let others = others.filter(|word| !counted.contains_key(word));
    found.extend(others.map(|text| Candidate { text, count: None }));
    found
}

/// Names of all rules for the field `rule`.
fn other_rules(core: &UiState, key: &str) -> Vec<String> {
    let survey = core.timeline.survey();
    let rules = survey.findings.iter().filter(|_| key == "rule").flat_map(|findings| &findings.rules);
    rules.filter(|rule| rule.is_on).map(|rule| quote_value(&rule.name)).collect()
}

fn value_counts(
    core: &UiState,
    key: &str,
    targets: &[FieldTarget],
    world: &ReplayState,
) -> BTreeMap<String, u64> {
    let survey = core.timeline.survey();
    let rows = world.identifiers().rows().iter();
    let is_id = targets.iter().any(|target| target.value() == FieldType::Id);
    match key {
        "kind" => {
            let kinds = Kind::ALL.iter().zip(&survey.overview.kinds).filter(|(_, count)| **count > 0);
            kinds.map(|(kind, count)| (kind.name().to_owned(), *count)).collect()
        }
        "severity" => {
            let Some(findings) = &survey.findings else { return BTreeMap::new() };
            let all = [Severity::Error, Severity::Warning, Severity::Note];
            let count = |severity: Severity| findings.reported_count(severity) as u64;
            all.into_iter().map(|severity| (severity.name().to_owned(), count(severity))).collect()
        }
        "rule" => {
            let groups = survey.findings.iter().flat_map(CaptureFindings::reported_groups);
            sum_counts(groups.map(|group| (Some(quote_value(&group.rule)), 1)))
        }
        "bus" => {
            let name =
                |row: &IdentifierRow| Some(quote_value(world.buses().get(usize::from(row.bus.0))?.name()));
            sum_counts(rows.map(|row| (name(row), row.count)))
        }
        "node" => {
            // Two digits sort before three.
            let number = |row: &IdentifierRow| match row.node {
                Some(NodeId::Canopen(id)) => Some(id),
                _ => None,
            };
            let nodes = rows.filter_map(|row| Some((number(row)?, row.count)));
            sum_counts(nodes.map(|(node, count)| (Some(node.to_string()), count)))
        }
        "pdo" => sum_counts(rows.map(|row| (row.pdo.map(|pdo| pdo.to_string()), row.count))),
        _ if is_id => sum_counts(rows.map(|row| (Some(format!("0x{:03X}", row.id.number())), row.count))),
        _ => BTreeMap::new(),
    }
}

fn sum_counts(values: impl Iterator<Item = (Option<String>, u64)>) -> BTreeMap<String, u64> {
    let mut counts = BTreeMap::new();
    for (text, count) in values.filter_map(|(text, count)| Some((text?, count))) {
        let sum: &mut u64 = counts.entry(text).or_default();
        *sum = sum.saturating_add(count);
    }
    counts
}

/// A text as a value in a filter; in quotes if it is not a plain word.
fn quote_value(text: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || matches!(letter, '_' | '-' | ':');
    let filter = format!("bus == {text}").parse::<cobscope_decoder::query::Filter>();
    if text.chars().all(is_plain) && filter.is_ok() { text.to_owned() } else { format!("{text:?}") }
}

/// Maximum number of entries read from a folder.
const MOST_ENTRIES: usize = 1_000;

/// Profiles and files that complete a text.
pub(super) fn assignable_names(core: &UiState, before: &str) -> Vec<Candidate> {
    let typed = before.to_lowercase();
    let mut words = core.timeline.options().catalogue.ids();
    words.sort();
    words.retain(|id| id.starts_with(&typed) && *id != typed);
    words.extend(matching_files(before));
    words.into_iter().map(|word| Candidate::new(&word, None)).collect()
}

/// Paths of device files, databases and folders that complete a path.
fn matching_files(before: &str) -> Vec<String> {
    // On Windows both slashes separate, and a folder keeps its last one: `C:` alone is another folder than `C:\`.
    let name = before.rsplit_once(std::path::is_separator).map_or(before, |(_, name)| name);
    let shown = before.get(..before.len() - name.len()).unwrap_or_default();
    let path = if shown.is_empty() { "." } else { shown };
    let Ok(entries) = std::fs::read_dir(Path::new(path)) else { return Vec::new() };
    let mut found = Vec::new();
    for entry in entries.flatten().take(MOST_ENTRIES) {
        // Other names than UTF-8 cannot be typed.
        let Ok(entry_name) = entry.file_name().into_string() else { continue };
        if !entry_name.starts_with(name) || (name.is_empty() && entry_name.starts_with('.')) {
            continue;
        }
        if entry.path().is_dir() {
            found.push(format!("{shown}{entry_name}/"));
        } else if is_file(&entry_name) && entry_name != name {
            found.push(format!("{shown}{entry_name}"));
        }
    }
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_completed_folder_by_folder() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("devices")).unwrap();
        for name in ["pump.eds", "pump.txt", "valve.DBC", ".hidden.eds"] {
            std::fs::write(root.path().join("devices").join(name), "").unwrap();
        }
        let root = root.path().to_str().unwrap();
        let rest = |text: &str| -> Vec<String> {
            let found = matching_files(&format!("{root}{text}"));
            found.iter().map(|path| path.strip_prefix(root).unwrap().to_owned()).collect()
        };
        assert_eq!(rest("/dev"), ["/devices/"]);
        assert_eq!(rest("/devices/"), ["/devices/pump.eds", "/devices/valve.DBC"]);
        assert_eq!(rest("/devices/p"), ["/devices/pump.eds"]);
        assert_eq!(rest("/none/p"), [""; 0]);
    }

    #[test]
    fn values_that_are_not_words_are_quoted() {
        assert_eq!(quote_value("can0"), "can0");
        assert_eq!(quote_value("rexroth-sydfec:eeprom-wear"), "rexroth-sydfec:eeprom-wear");
        assert_eq!(quote_value("bus 1"), "\"bus 1\"");
        assert_eq!(quote_value("and"), "\"and\"");
        assert_eq!(quote_value(""), "\"\"");
    }
}

//! Lines of the table files, indexed at the first question.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use super::definition::{GroupDefinition, parse_groups};
use super::field::{ValueTable, ValueTables};
use super::kind::KindColumn;

/// A file of `decoder/standards/`.
pub(super) struct TableFile {
    pub(super) name: &'static str,
    pub(super) text: &'static str,
    index: OnceLock<TableIndex>,
}

/// All files, in the order of [`super::Standard`]; the names are last.
pub(super) static FILES: [TableFile; 4] = [
    TableFile::new("j1939.tsv", include_str!("../../standards/j1939.tsv")),
    TableFile::new("nmea2000.tsv", include_str!("../../standards/nmea2000.tsv")),
    TableFile::new("rv-c.tsv", include_str!("../../standards/rv-c.tsv")),
    TableFile::new("names.tsv", include_str!("../../standards/names.tsv")),
];

/// Groups and value tables of a file.
#[derive(Default)]
pub(super) struct TableIndex {
    groups: BTreeMap<u32, GroupEntry>,
    /// Ranges of proprietary groups: first and last group.
    ranges: Vec<(u32, u32, GroupEntry)>,
    values: ValueTables,
    text: &'static str,
    parameters: OnceLock<BTreeMap<u32, NamedParameter<'static>>>,
}

/// Name and unit of a suspect parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedParameter<'a> {
    /// Name of the parameter.
    pub name: &'a str,
    /// Unit; empty if there is none.
    pub unit: &'a str,
}

/// Lines of a group, and its variants after its first message.
struct GroupEntry {
    lines: &'static str,
    variants: OnceLock<Vec<GroupDefinition>>,
}

impl TableFile {
    const fn new(name: &'static str, text: &'static str) -> Self {
        Self { name, text, index: OnceLock::new() }
    }

    pub(super) fn index(&'static self) -> &'static TableIndex {
        self.index.get_or_init(|| TableIndex::index_text(self.text))
    }
}

impl GroupEntry {
    const fn new(lines: &'static str) -> Self {
        Self { lines, variants: OnceLock::new() }
    }

    fn variants(&'static self, tables: &'static ValueTables) -> &'static [GroupDefinition] {
        self.variants.get_or_init(|| parse_groups(self.lines, tables))
    }
}

impl TableIndex {
    fn index_text(text: &'static str) -> Self {
        let mut index = Self { text, ..Self::default() };
        // The group that the present lines belong to: its key, and where its lines start.
        let mut open: Option<(&'static str, usize)> = None;
        let mut start: usize = 0;
        for line in text.split_inclusive('\n') {
            // Lines of fields are most lines, and have no mark.
            if line.starts_with('%') {
                let mut columns = line.trim_end().split('\t');
                match (columns.next(), columns.next()) {
                    (Some("%G" | "%R"), Some(key)) if open.is_none_or(|(present, _)| present != key) => {
                        index.close_group(text, open, start);
                        open = Some((key, start));
                    }
                    (Some("%L" | "%B" | "%K"), Some(name)) => {
                        index.values.insert(name, ValueTable::new(line.trim_end()));
                    }
                    _ => {}
                }
            }
            start = start.saturating_add(line.len());
        }
        index.close_group(text, open, start);
        index
    }

    fn close_group(&mut self, text: &'static str, open: Option<(&'static str, usize)>, end: usize) {
        let Some((key, start)) = open else { return };
        let entry = GroupEntry::new(text.get(start..end).unwrap_or_default());
        match key.split_once('-') {
            Some((first, last)) => {
                if let (Ok(first), Ok(last)) = (first.parse(), last.parse()) {
                    self.ranges.push((first, last, entry));
                }
            }
            None => {
                if let Ok(number) = key.parse() {
                    self.groups.insert(number, entry);
                }
            }
        }
    }

    /// Variants of a group in order of precedence; empty for an unknown group.
    pub(super) fn variants_of(&'static self, number: u32) -> &'static [GroupDefinition] {
        self.groups.get(&number).map_or(&[], |entry| entry.variants(&self.values))
    }

    /// Definition of the range that contains a group.
    pub(super) fn range_of(&'static self, number: u32) -> Option<&'static GroupDefinition> {
        let mut ranges = self.ranges.iter().filter(|(first, last, _)| (*first..=*last).contains(&number));
        ranges.next()?.2.variants(&self.values).first()
    }

    /// Suspect parameter with this number.
    pub(super) fn parameter(&self, spn: u32) -> Option<NamedParameter<'static>> {
        let all = self.parameters.get_or_init(|| {
            let named = self.text.lines().filter_map(|line| {
                let mut columns = line.split('\t');
                let (name, kind) = (columns.next()?, columns.next()?);
                let spn = KindColumn::parse_column(kind)?.spn?;
                Some((spn, NamedParameter { name, unit: columns.nth(2).unwrap_or_default() }))
            });
            named.collect()
        });
        all.get(&spn).copied()
    }

    /// Value table with this name.
    pub(super) fn values(&self, name: &str) -> Option<&ValueTable> {
        self.values.get(name)
    }

    /// Numbers of all groups, ascending.
    #[cfg(test)]
    pub(super) fn numbers(&self) -> impl Iterator<Item = u32> {
        self.groups.keys().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_of_a_table_is_read() {
        for file in &FILES {
            let index = file.index();
            let lines = file.text.lines().filter(|line| !line.starts_with('#'));
            let groups =
                lines.clone().filter(|line| line.starts_with("%G\t") || line.starts_with("%R\t")).count();
            let values =
                lines.filter(|line| matches!(line.split('\t').next(), Some("%L" | "%B" | "%K"))).count();
            let ranges: usize =
                index.ranges.iter().map(|(.., entry)| entry.variants(&index.values).len()).sum();
            let variants: usize = index.numbers().map(|number| index.variants_of(number).len()).sum();
            assert_eq!(variants + ranges, groups, "{}", file.name);
            assert_eq!(index.values.len(), values, "{}", file.name);
        }
    }

    #[test]
    fn every_field_refers_to_a_table_that_exists() {
        for file in &FILES {
            for line in file.text.lines().filter(|line| {
                !matches!(line.split('\t').next(), Some("%G" | "%R" | "%L" | "%B" | "%K" | "%*"))
            }) {
                let Some(name) = line.split('\t').nth(5) else { continue };
                assert!(file.index().values(name).is_some(), "{}: {line}", file.name);
            }
        }
    }
}

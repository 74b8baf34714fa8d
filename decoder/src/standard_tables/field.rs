//! Fields of a group, and the texts, bits and keys of their numbers.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, OnceLock};

use foldhash::fast::FixedState;

use super::kind::KindColumn;
use crate::profile::{BitName, BitNames, ObjectMeaning, ValueNames};

/// Value tables of a file by name.
pub(super) type ValueTables = HashMap<&'static str, ValueTable, FixedState>;

/// A field of a group.
#[derive(Debug)]
pub(super) struct FieldDefinition {
    pub(super) name: &'static str,
    pub(super) column: KindColumn,
    pub(super) factor: f64,
    pub(super) offset: f64,
    pub(super) unit: &'static str,
    /// Texts of the numbers, bits or keys.
    pub(super) table: Option<&'static ValueTable>,
    /// Meaning of the field outside repetitions.
    pub(super) meaning: OnceLock<Arc<ObjectMeaning>>,
}

/// A line with the texts of numbers, bits or keys, and its content after its first use.
#[derive(Debug)]
pub(super) struct ValueTable {
    line: &'static str,
    names: OnceLock<Arc<ValueNames>>,
    bits: OnceLock<Arc<BitNames>>,
    keys: OnceLock<BTreeMap<u64, FieldDefinition>>,
}

impl FieldDefinition {
    /// A field with the columns name, kind, factor, offset, unit, table; `None` for a gap without a kind.
    pub(super) fn parse_columns(
        mut columns: impl Iterator<Item = &'static str>,
        tables: &'static ValueTables,
    ) -> Option<Self> {
        let name = columns.next()?;
        let column = KindColumn::parse_column(columns.next()?)?;
        let mut number = |default: f64| columns.next().and_then(|text| text.parse().ok()).unwrap_or(default);
        let (factor, offset) = (number(1.0), number(0.0));
        let unit = columns.next().unwrap_or_default();
        let table = columns.next().and_then(|name| tables.get(name));
        Some(Self { name, column, factor, offset, unit, table, meaning: OnceLock::new() })
    }
}

impl ValueTable {
    pub(super) const fn new(line: &'static str) -> Self {
        Self { line, names: OnceLock::new(), bits: OnceLock::new(), keys: OnceLock::new() }
    }

    /// Number and text of each entry.
    fn entries(&self) -> impl Iterator<Item = (u64, &'static str)> {
        let entries = self.line.split('\t').skip(2).filter_map(|entry| entry.split_once('='));
        entries.filter_map(|(number, text)| Some((number.parse().ok()?, text)))
    }

    /// Texts by number; of a key, the name of its field.
    pub(super) fn names(&self) -> &Arc<ValueNames> {
        let is_of_keys = self.line.starts_with("%K");
        self.names.get_or_init(|| {
            let named = self.entries().filter_map(|(number, text)| {
                let name = text.split_once(':').filter(|_| is_of_keys).map_or(text, |(name, _)| name);
                Some((i64::try_from(number).ok()?, name.to_owned()))
            });
            Arc::new(ValueNames(named.collect()))
        })
    }

    /// Text of one number, without reading the whole table.
    pub(super) fn find_text(&self, number: u64) -> Option<&'static str> {
        self.entries().find(|(known, _)| *known == number).map(|(_, text)| text)
    }

    /// Names by bit.
    pub(super) fn bits(&self) -> &Arc<BitNames> {
        self.bits.get_or_init(|| {
            let named = self.entries().filter_map(|(bit, text)| {
                Some(BitName {
                    bit: u8::try_from(bit).ok()?,
                    width: 1,
                    name: to_kebab_case(text),
                    text: Some(text.to_owned()),
                    off: None,
                    values: None,
                    reserved: false,
                })
            });
            Arc::new(BitNames { list: named.collect() })
        })
    }

    /// Field that a key selects.
    pub(super) fn key_entry(
        &'static self,
        key: u64,
        tables: &'static ValueTables,
    ) -> Option<&'static FieldDefinition> {
        let keys = self.keys.get_or_init(|| {
            self.entries()
                .filter_map(|(key, text)| {
                    Some((key, FieldDefinition::parse_columns(text.split(':'), tables)?))
                })
                .collect()
        });
        keys.get(&key)
    }
}

/// Name in JSON: `Check Engine` becomes `check-engine`.
fn to_kebab_case(text: &str) -> String {
    let mut name = String::new();
    for letter in text.chars() {
        if letter.is_ascii_alphanumeric() {
            name.push(letter.to_ascii_lowercase());
        } else if !name.is_empty() && !name.ends_with('-') {
            name.push('-');
        }
    }
    name.trim_end_matches('-').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_bits_are_kebab_case() {
        assert_eq!(to_kebab_case("Check Engine"), "check-engine");
        assert_eq!(to_kebab_case("Over-temp (oil)"), "over-temp-oil");
    }
}

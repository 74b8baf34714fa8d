//! Field table: every key of an event with its type, meaning and Wireshark names.
//!
//! `fields.toml` is the only list of fields; a test compares it with [`super::record::visit_event`]. Filters, the
//! JSON schema and the reference documentation are derived from it.

use std::sync::OnceLock;

use serde::Deserialize;

use crate::event::KindSet;

/// Data type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FieldType {
    /// Number, text or bytes, depending on the data type of the object.
    Any,
    /// `true` or `false`.
    Bool,
    /// Unsigned integer.
    Unsigned,
    /// Signed integer.
    Integer,
    /// Number with a fraction.
    Real,
    /// Text of any length.
    Text,
    /// Seconds with nanosecond resolution.
    Seconds,
    /// Number in hex with `0x`.
    Code,
    /// CAN identifier in hex.
    Id,
    /// Index and sub-index of an object.
    Object,
    /// Bytes in hex pairs.
    Bytes,
    /// Group of nested fields, without a value of its own.
    Group,
}

impl FieldType {
    /// Name of the type in error messages, with article.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Any => "a value",
            Self::Bool => "true or false",
            Self::Unsigned | Self::Integer | Self::Real => "a number",
            Self::Text => "text",
            Self::Seconds => "a number of seconds",
            Self::Code => "a code",
            Self::Id => "an identifier",
            Self::Object => "an object",
            Self::Bytes => "bytes",
            Self::Group => "a group of fields",
        }
    }
}

/// Definition of one field for some kinds of events.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldDefinition {
    /// Key; dotted for nested fields.
    pub key: String,
    /// Data type of the value.
    #[serde(rename = "type")]
    pub value: FieldType,
    /// Event kinds that can have the field.
    #[serde(default = "all_kinds")]
    pub kinds: KindSet,
    /// Whether the field is a list.
    #[serde(default)]
    pub list: bool,
    /// Whether the value can be null (unknown).
    #[serde(default)]
    pub null: bool,
    /// All possible texts; empty if unrestricted.
    #[serde(default)]
    pub values: Vec<String>,
    /// Description in one line, with unit.
    pub doc: String,
    /// Names of the field in Wireshark.
    #[serde(default)]
    pub alias: Vec<String>,
}

const fn all_kinds() -> KindSet {
    KindSet::ALL
}

/// Part of an object address that a filter can compare separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectPart {
    /// Index, 16 bits.
    Index,
    /// Sub-index, 8 bits.
    Sub,
}

/// Part of an object field that has its own name in filters.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NestedField {
    /// Dotted name in filters.
    pub key: String,
    /// Key of the object field.
    pub of: String,
    /// Part of the object address.
    pub part: ObjectPart,
    /// Description in one line.
    pub doc: String,
    /// Names of the part in Wireshark.
    #[serde(default)]
    pub alias: Vec<String>,
}

/// Contents of `fields.toml`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldTable {
    /// All fields in output order.
    #[serde(rename = "field")]
    pub fields: Vec<FieldDefinition>,
    /// Parts of object fields.
    #[serde(rename = "part")]
    pub parts: Vec<NestedField>,
}

/// A field, or part of one, that a name in a filter can refer to.
#[derive(Debug, Clone, Copy)]
pub struct FieldTarget {
    /// Definition of the field.
    pub field: &'static FieldDefinition,
    /// Part of the object address; `None` for the whole field.
    pub part: Option<ObjectPart>,
}

impl FieldTarget {
    /// Data type of the compared value.
    pub fn value(self) -> FieldType {
        if self.part.is_some() { FieldType::Code } else { self.field.value }
    }
}

/// Field table, parsed on first use.
pub fn field_table() -> &'static FieldTable {
    static TABLE: OnceLock<FieldTable> = OnceLock::new();
    // The fallback is unreachable: a test parses the file.
    TABLE.get_or_init(|| toml::from_str(include_str!("fields.toml")).unwrap_or_default())
}

/// All fields with this key or Wireshark name; empty for an unknown name.
pub fn resolve_name(name: &str) -> Vec<FieldTarget> {
    let is_meant = |key: &str, alias: &[String]| key == name || alias.iter().any(|other| other == name);
    let fields = field_table().fields.iter();
    let own = fields.filter(|field| is_meant(&field.key, &field.alias)).map(|field| (field, None));
    let parts = field_table().parts.iter().filter(|part| is_meant(&part.key, &part.alias));
    let of_parts = parts.flat_map(|part| {
        let whole = field_table().fields.iter().filter(|field| field.key == part.of);
        whole.map(|field| (field, Some(part.part)))
    });
    own.chain(of_parts).map(|(field, part)| FieldTarget { field, part }).collect()
}

/// Known name most similar to `name`, for suggestions.
pub fn nearest_name(name: &str) -> Option<&'static str> {
    let fields =
        field_table().fields.iter().flat_map(|field| std::iter::once(&field.key).chain(&field.alias));
    let parts = field_table().parts.iter().flat_map(|part| std::iter::once(&part.key).chain(&part.alias));
    nearest_candidate(name, &fields.chain(parts).map(String::as_str))
}

/// Max length of a text to find suggestions for, in bytes.
const LONGEST_GUESS: usize = 60;

/// Most similar candidate: the shortest with this prefix, else one within three edits, else the shortest
/// with this suffix.
pub(super) fn nearest_candidate<'a>(
    text: &str,
    candidates: &(impl Iterator<Item = &'a str> + Clone),
) -> Option<&'a str> {
    if text.is_empty() || text.len() > LONGEST_GUESS {
        return None;
    }
    let text = text.to_ascii_lowercase();
    let shortest = |alike: &dyn Fn(&str) -> bool| {
        candidates.clone().filter(|name| text.len() > 1 && alike(name)).min_by_key(|name| name.len())
    };
    let by_slip = || {
        let slips =
            candidates.clone().map(|name| (edit_distance(&text, name), name)).min_by_key(|(slips, _)| *slips);
        slips.filter(|(slips, _)| *slips <= text.chars().count().div_ceil(3).min(3)).map(|(_, name)| name)
    };
    shortest(&|name| name.starts_with(&text))
        .or_else(by_slip)
        .or_else(|| shortest(&|name| name.ends_with(&text)))
}

/// Levenshtein distance: letters to insert, remove or replace.
pub fn edit_distance(from: &str, to: &str) -> usize {
    let mut row: Vec<usize> = (0..=to.chars().count()).collect();
    for (line, letter) in from.chars().enumerate() {
        let mut diagonal = line;
        let mut left = line + 1;
        if let Some(first) = row.first_mut() {
            *first = left;
        }
        for (cell, other) in row.iter_mut().skip(1).zip(to.chars()) {
            let above = *cell;
            left = (diagonal + usize::from(letter != other)).min(above + 1).min(left + 1);
            diagonal = above;
            *cell = left;
        }
    }
    row.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_read() {
        if let Err(error) = toml::from_str::<FieldTable>(include_str!("fields.toml")) {
            panic!("{error}");
        }
        assert!(field_table().fields.len() > 90);
    }

    #[test]
    fn a_key_has_one_meaning_a_kind() {
        for (place, field) in field_table().fields.iter().enumerate() {
            assert!(!field.doc.is_empty() && !field.doc.ends_with('.'), "{}", field.key);
            for other in field_table().fields.iter().skip(place + 1).filter(|other| other.key == field.key) {
                assert_eq!(field.kinds.and(other.kinds), KindSet::NONE, "{}", field.key);
            }
        }
        for part in &field_table().parts {
            let mut whole = field_table().fields.iter().filter(|field| field.key == part.of);
            assert!(whole.all(|field| field.value == FieldType::Object), "{}", part.key);
            assert!(!resolve_name(&part.key).is_empty(), "{}", part.key);
        }
    }

    #[test]
    fn names_of_wireshark_are_understood() {
        let keys =
            |name| resolve_name(name).iter().map(|target| target.field.key.clone()).collect::<Vec<_>>();
        assert_eq!(keys("canopen.node_id"), ["node"]);
        assert_eq!(keys("can.id"), ["cob_id", "cob_ids", "id", "ids", "ids"]);
        assert_eq!(keys("canopen.sdo.main_idx"), ["object"; 4]);
        assert!(keys("canopen.nod_id").is_empty());
    }

    #[test]
    fn slips_are_recognised() {
        assert_eq!(nearest_name("nod"), Some("node"));
        assert_eq!(nearest_name("canopen.nodeid"), Some("canopen.node_id"));
        assert_eq!(nearest_name("abort_code"), Some("abort.code"));
        assert_eq!(nearest_name("quite something else"), None);
        assert_eq!(nearest_name(&"n".repeat(4_000)), None);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
    }
}

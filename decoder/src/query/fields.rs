//! The field table: every key an event can have, with its type, meaning and Wireshark's name for it.
//!
//! `fields.toml` is the only list of fields. [`super::record::visit`] is held to it by a test; filters,
//! the JSON schema and the reference are made from it.

use std::sync::OnceLock;

use serde::Deserialize;

use super::kinds::KindSet;

/// What the values of a field are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FieldType {
    /// A number, text or bytes, as the object's type says.
    Any,
    /// True or false.
    Bool,
    /// A number without sign.
    Unsigned,
    /// A number with sign.
    Integer,
    /// A number with a fraction.
    Real,
    /// Text.
    Text,
    /// Seconds, exact to the nanosecond.
    Seconds,
    /// A number written in hex with `0x`.
    Code,
    /// A CAN identifier, written in hex.
    Id,
    /// Index and sub-index.
    Object,
    /// Bytes, written as hex pairs.
    Bytes,
    /// No value of its own: fields inside it.
    Group,
}

impl FieldType {
    /// What it is called in messages.
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

/// One field, of some kinds of events.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// Key, dotted where it is nested.
    pub key: String,
    /// What its values are.
    #[serde(rename = "type")]
    pub value: FieldType,
    /// Kinds of events that can have it.
    #[serde(default = "all_kinds")]
    pub kinds: KindSet,
    /// Several values in order.
    #[serde(default)]
    pub list: bool,
    /// Its value can be null: known to be unknown.
    #[serde(default)]
    pub null: bool,
    /// The only texts there are; empty where any is possible.
    #[serde(default)]
    pub values: Vec<String>,
    /// One line, with units.
    pub doc: String,
    /// Wireshark's names.
    #[serde(default)]
    pub alias: Vec<String>,
}

const fn all_kinds() -> KindSet {
    KindSet::ALL
}

/// Which part of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// Index.
    Index,
    /// Sub-index.
    Sub,
}

/// A part of an object field, under a name of its own in filters.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartField {
    /// Name.
    pub key: String,
    /// Key of the object field.
    pub of: String,
    /// Which part of it.
    pub part: Part,
    /// One line.
    pub doc: String,
    /// Wireshark's names.
    #[serde(default)]
    pub alias: Vec<String>,
}

/// The whole table.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldTable {
    /// Every field, in the order of output.
    #[serde(rename = "field")]
    pub fields: Vec<Field>,
    /// Parts of them.
    #[serde(rename = "part")]
    pub parts: Vec<PartField>,
}

/// One thing a name in a filter can mean.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// The field.
    pub field: &'static Field,
    /// The part of it that is meant.
    pub part: Option<Part>,
}

impl Target {
    /// What is compared.
    pub fn value(self) -> FieldType {
        if self.part.is_some() { FieldType::Code } else { self.field.value }
    }
}

/// The table, parsed when it is first asked for.
pub fn table() -> &'static FieldTable {
    static TABLE: OnceLock<FieldTable> = OnceLock::new();
    // Broken data ships in no build: a test parses the file, so the fallback is never taken.
    TABLE.get_or_init(|| toml::from_str(include_str!("fields.toml")).unwrap_or_default())
}

/// Everything a name can mean, by key or by Wireshark's name; nothing if there is no such field.
pub fn resolve(name: &str) -> Vec<Target> {
    let is_meant = |key: &str, alias: &[String]| key == name || alias.iter().any(|other| other == name);
    let fields = table().fields.iter();
    let own = fields.filter(|field| is_meant(&field.key, &field.alias)).map(|field| (field, None));
    let parts = table().parts.iter().filter(|part| is_meant(&part.key, &part.alias));
    let of_parts = parts.flat_map(|part| {
        let whole = table().fields.iter().filter(|field| field.key == part.of);
        whole.map(|field| (field, Some(part.part)))
    });
    own.chain(of_parts).map(|(field, part)| Target { field, part }).collect()
}

/// The name most like `name`, if one is.
pub fn nearest_name(name: &str) -> Option<&'static str> {
    let fields = table().fields.iter().flat_map(|field| std::iter::once(&field.key).chain(&field.alias));
    let parts = table().parts.iter().flat_map(|part| std::iter::once(&part.key).chain(&part.alias));
    nearest(name, &fields.chain(parts).map(String::as_str))
}

/// Texts longer than this resemble nothing.
const LONGEST_GUESS: usize = 60;

/// The candidate most like `text`: the shortest one that begins with it, else one that a slip in three
/// letters makes of it, else one that ends with it.
pub(super) fn nearest<'a>(
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
            candidates.clone().map(|name| (distance(&text, name), name)).min_by_key(|(slips, _)| *slips);
        slips.filter(|(slips, _)| *slips <= text.chars().count().div_ceil(3).min(3)).map(|(_, name)| name)
    };
    shortest(&|name| name.starts_with(&text))
        .or_else(by_slip)
        .or_else(|| shortest(&|name| name.ends_with(&text)))
}

/// Letters to insert, remove or replace to get from one text to the other (Levenshtein).
pub fn distance(from: &str, to: &str) -> usize {
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
        assert!(table().fields.len() > 90);
    }

    #[test]
    fn a_key_has_one_meaning_a_kind() {
        for (place, field) in table().fields.iter().enumerate() {
            assert!(!field.doc.is_empty() && !field.doc.ends_with('.'), "{}", field.key);
            for other in table().fields.iter().skip(place + 1).filter(|other| other.key == field.key) {
                assert_eq!(field.kinds.and(other.kinds), KindSet::NONE, "{}", field.key);
            }
        }
        for part in &table().parts {
            let mut whole = table().fields.iter().filter(|field| field.key == part.of);
            assert!(whole.all(|field| field.value == FieldType::Object), "{}", part.key);
            assert!(!resolve(&part.key).is_empty(), "{}", part.key);
        }
    }

    #[test]
    fn names_of_wireshark_are_understood() {
        let keys = |name| resolve(name).iter().map(|target| target.field.key.clone()).collect::<Vec<_>>();
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
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
    }
}

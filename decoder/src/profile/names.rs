//! Names of values and bits, as written in a profile.

use std::collections::BTreeMap;

use serde::Deserialize;

/// Names by raw value.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "BTreeMap<String, String>")]
pub struct ValueNames(pub BTreeMap<i64, String>);

impl ValueNames {
    /// Name of a value.
    pub fn get(&self, value: i64) -> Option<&str> {
        self.0.get(&value).map(String::as_str)
    }
}

impl TryFrom<BTreeMap<String, String>> for ValueNames {
    type Error = String;

    fn try_from(table: BTreeMap<String, String>) -> Result<Self, String> {
        let entry = |(key, name): (String, String)| parse_integer(&key).map(|key| (key, name));
        table.into_iter().map(entry).collect::<Result<_, _>>().map(Self)
    }
}

/// Parses a key such as `0`, `-3`, `0x1000`.
fn parse_integer(text: &str) -> Result<i64, String> {
    let number = match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|_| format!("'{text}' is not a number; expected e.g. 0, -3 or 0x1000"))
}

/// One bit or several adjacent bits of a word.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BitName {
    /// Lowest bit, from 0.
    pub bit: u8,
    /// Number of bits.
    #[serde(default = "one")]
    pub width: u8,
    /// Name in JSON, in kebab-case.
    #[serde(default)]
    pub name: String,
    /// Text in event lines if set.
    #[serde(default)]
    pub text: Option<String>,
    /// Text in event lines if clear.
    #[serde(default)]
    pub off: Option<String>,
    /// Names of the number in several bits.
    #[serde(default)]
    pub values: Option<ValueNames>,
    /// Whether the bits have no meaning.
    #[serde(default)]
    pub reserved: bool,
}

const fn one() -> u8 {
    1
}

impl BitName {
    /// Number in these bits of `word`.
    pub fn bits_of(&self, word: u64) -> u64 {
        let mask = if self.width >= 64 { u64::MAX } else { (1 << self.width) - 1 };
        word.checked_shr(u32::from(self.bit)).unwrap_or(0) & mask
    }
}

/// Named bits of a word.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BitNames {
    /// Bits in any order.
    pub list: Vec<BitName>,
}

/// A definition, or the name of a table with a shared definition.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "expected a table or the name of a table")]
pub enum SharedDefinition<T> {
    /// Name of the shared table.
    Named(String),
    /// Definition in place.
    Here(T),
}

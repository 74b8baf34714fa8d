//! Names of values and of bits, as a profile writes them.

use std::collections::BTreeMap;

use serde::Deserialize;

/// An enumeration: raw value to its name.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(try_from = "BTreeMap<String, String>")]
pub struct Names(pub BTreeMap<i64, String>);

impl Names {
    /// Name of a value.
    pub fn get(&self, value: i64) -> Option<&str> {
        self.0.get(&value).map(String::as_str)
    }
}

impl TryFrom<BTreeMap<String, String>> for Names {
    type Error = String;

    fn try_from(table: BTreeMap<String, String>) -> Result<Self, String> {
        let entry = |(key, name): (String, String)| integer(&key).map(|key| (key, name));
        table.into_iter().map(entry).collect::<Result<_, _>>().map(Self)
    }
}

/// A key such as `0`, `-3`, `0x1000`.
fn integer(text: &str) -> Result<i64, String> {
    let number = match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|_| format!("'{text}' is no number: write 0, -3 or 0x1000"))
}

/// One bit, or a few together, of a word.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BitName {
    /// Lowest bit, from 0.
    pub bit: u8,
    /// How many.
    #[serde(default = "one")]
    pub width: u8,
    /// The word in JSON, in kebab-case.
    #[serde(default)]
    pub name: String,
    /// Words for a line when set.
    #[serde(default)]
    pub text: Option<String>,
    /// Words for a line when clear.
    #[serde(default)]
    pub off: Option<String>,
    /// Names of the number several bits form.
    #[serde(default)]
    pub values: Option<Names>,
    /// Without meaning.
    #[serde(default)]
    pub reserved: bool,
}

const fn one() -> u8 {
    1
}

impl BitName {
    /// The number these bits form in `word`.
    pub fn of(&self, word: u64) -> u64 {
        let mask = if self.width >= 64 { u64::MAX } else { (1 << self.width) - 1 };
        word.checked_shr(u32::from(self.bit)).unwrap_or(0) & mask
    }
}

/// Bits of a word.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BitNames {
    /// In any order.
    pub list: Vec<BitName>,
}

/// Something defined here, or the name of a table that defines it for several.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a table, or the name of one")]
pub enum Shared<T> {
    /// Name of the table.
    Named(String),
    /// Defined here.
    Here(T),
}

//! Objects as a profile's author writes them: keys of `profiles/README.md`, section "Objects".

use std::sync::Arc;

use serde::Deserialize;

use super::names::{BitNames, Names};
use super::one_or_many::OneOrMany;
use super::reference::Reference;

/// How a number is read by people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// Decimal.
    #[default]
    Decimal,
    /// Hexadecimal, as wide as the type.
    Hex,
    /// A PDO mapping entry: object and width in bits.
    Mapping,
    /// Bytes as characters: the signatures "save" and "load".
    Ascii,
}

/// Access by SDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Access {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
    /// Write only.
    Wo,
    /// Never changes.
    Const,
}

impl Access {
    /// The word in output: `ro`, `rw`, `wo`, `const`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ro => "ro",
            Self::Rw => "rw",
            Self::Wo => "wo",
            Self::Const => "const",
        }
    }
}

/// What keeps a value over a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Storage {
    /// Lost at reset.
    Volatile,
    /// Every write goes to non-volatile memory.
    EachWrite,
    /// Kept after its store object was written.
    Save,
    /// Never changes.
    Fixed,
    /// Not said.
    #[default]
    Unknown,
}

impl Storage {
    /// What becomes of a value just written, as output names it.
    pub const fn persists(self) -> &'static str {
        match self {
            Self::Volatile => "no",
            Self::EachWrite | Self::Fixed => "yes",
            Self::Save => "needs-save",
            Self::Unknown => "unknown",
        }
    }
}

/// When a write acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effect {
    /// At the confirming message.
    AtOnce,
    /// At the next SYNC with the node's own identifier.
    AtSync,
    /// After NMT reset communication, and every stronger reset.
    ResetCommunication,
    /// After NMT reset node, and power-on.
    ResetNode,
    /// After power-on only.
    PowerOn,
    /// Accepted, but without effect.
    Never,
    /// Not said.
    #[default]
    Unknown,
}

impl Effect {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::AtOnce => "at-once",
            Self::AtSync => "at-sync",
            Self::ResetCommunication => "reset-communication",
            Self::ResetNode => "reset-node",
            Self::PowerOn => "power-on",
            Self::Never => "never",
            Self::Unknown => "unknown",
        }
    }

    /// When, in words behind what happens then.
    pub const fn when(self) -> &'static str {
        match self {
            Self::AtOnce => "at once",
            Self::AtSync => "at the next SYNC",
            Self::ResetCommunication => "after reset communication",
            Self::ResetNode => "after reset node",
            Self::PowerOn => "after power-on",
            Self::Never => "never: accepted without effect",
            Self::Unknown => "at a time not known",
        }
    }

    /// Whether the new value holds only from a restart on.
    pub const fn waits(self) -> bool {
        matches!(self, Self::ResetCommunication | Self::ResetNode | Self::PowerOn)
    }
}

/// What an object is for the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Control word or byte.
    Control,
    /// Status word or byte.
    Status,
    /// A commanded value.
    SetPoint,
    /// A measured value.
    Actual,
    /// A mode of operation.
    Mode,
    /// The node-ID.
    NodeId,
    /// The bit rate.
    BitRate,
    /// Counts up.
    Counter,
}

impl Role {
    /// The name used in profiles.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Control => "control",
            Self::Status => "status",
            Self::SetPoint => "set-point",
            Self::Actual => "actual",
            Self::Mode => "mode",
            Self::NodeId => "node-id",
            Self::BitRate => "bit-rate",
            Self::Counter => "counter",
        }
    }
}

/// Raw number to quantity.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(
    untagged,
    expecting = "a number, { raw = 16383, value = 100 } or { raw = 16383, object = \"5208:02\" }"
)]
pub enum Scale {
    /// value = raw × factor.
    Factor(f64),
    /// `raw` is `value`.
    Anchor {
        /// Raw number.
        raw: f64,
        /// Quantity.
        value: f64,
    },
    /// `raw` is the value of `object`.
    ByObject {
        /// Raw number.
        raw: f64,
        /// Object that holds the quantity.
        object: Reference,
    },
}

/// One number or several.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a number or a list of numbers")]
pub enum Numbers {
    /// One.
    One(i64),
    /// Any of them.
    Any(Vec<i64>),
}

impl Numbers {
    /// Whether `value` is among them.
    pub fn contains(&self, value: i64) -> bool {
        match self {
            Self::One(one) => *one == value,
            Self::Any(any) => any.contains(&value),
        }
    }
}

/// A condition on the value of another object.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct When {
    /// The object.
    pub object: Reference,
    /// Its raw value.
    pub equals: Numbers,
}

/// Variants an entry belongs to; all if empty.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(from = "OneOrMany<String>")]
pub struct Only(pub Vec<String>);

impl Only {
    /// Whether it holds for a variant.
    pub fn allows(&self, variant: &str) -> bool {
        self.0.is_empty() || self.0.iter().any(|only| only == variant)
    }
}

impl From<OneOrMany<String>> for Only {
    fn from(list: OneOrMany<String>) -> Self {
        Self(list.into_vec())
    }
}

/// Equal entries at a distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Repeat {
    /// How many.
    pub count: u16,
    /// Distance of their indexes.
    pub stride: u16,
    /// Number of the first, for names and channels.
    #[serde(default = "first")]
    pub first: u16,
    /// Whether the number is that of an output of the device.
    #[serde(default)]
    pub channel: bool,
}

const fn first() -> u16 {
    1
}

/// No repeat: one entry.
pub(crate) const ONCE: Repeat = Repeat { count: 1, stride: 0, first: 1, channel: false };

impl Default for Repeat {
    fn default() -> Self {
        ONCE
    }
}

/// A default as written.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "a number or a text")]
pub enum Given {
    /// Raw number.
    Number(i64),
    /// A real number.
    Real(f64),
    /// Text.
    Text(String),
}

/// How a value is read: keys that may differ by mode.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Look {
    /// Name; `{n}` stands for the number of the repeat.
    pub name: Option<String>,
    /// The word for it in lines.
    pub short: Option<String>,
    /// Unit of the scaled value.
    pub unit: Option<String>,
    /// Raw number to quantity.
    pub scale: Option<Scale>,
    /// Added after scaling.
    pub offset: Option<f64>,
    /// Digits after the point.
    pub decimals: Option<u8>,
    /// Permitted raw values.
    pub range: Option<[i64; 2]>,
    /// Permitted values in `unit`.
    pub limits: Option<[f64; 2]>,
    /// Enumeration.
    pub values: Option<Arc<Names>>,
    /// Raw values that are no quantity.
    pub special: Option<Arc<Names>>,
    /// Named bits.
    pub bits: Option<Arc<BitNames>>,
    /// What it is for the device.
    pub role: Option<Role>,
    /// Of an actual value the set point it follows.
    pub of: Option<Reference>,
}

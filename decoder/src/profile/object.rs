//! Keys of objects in a profile: see `profiles/README.md`, section "Objects".

use std::sync::Arc;

use serde::Deserialize;
use strum::IntoStaticStr;

use super::names::{BitNames, ValueNames};
use super::one_or_many::OneOrMany;
use super::reference::ObjectReference;

/// Number format in output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NumberFormat {
    /// Decimal number.
    #[default]
    Decimal,
    /// Hexadecimal number, padded to the length of the type.
    Hex,
    /// PDO mapping entry: object and length in bits.
    Mapping,
    /// Characters, as in the signatures "save" and "load"; a number if they are not printable.
    Ascii,
    /// Entry of the error history: EMCY code in bits 0 to 15.
    Emcy,
    /// Consumer heartbeat time: node-ID in bits 16 to 23, time in ms in bits 0 to 15.
    HeartbeatConsumer,
    /// Two decimal digits in each byte, as in messages of DSC; not for profiles.
    #[serde(skip)]
    DecimalPairs,
    /// Days since 1970-01-01; not for profiles.
    #[serde(skip)]
    Date,
    /// Time since midnight; not for profiles.
    #[serde(skip)]
    TimeOfDay,
    /// Number of a parameter group; not for profiles.
    #[serde(skip)]
    ParameterGroup,
}

/// Access by SDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SdoAccess {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
    /// Write only.
    Wo,
    /// Constant.
    Const,
}

impl SdoAccess {
    /// Name in output: `ro`, `rw`, `wo`, `const`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ro => "ro",
            Self::Rw => "rw",
            Self::Wo => "wo",
            Self::Const => "const",
        }
    }
}

/// Persistence of a value over a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ValueStorage {
    /// Lost at reset.
    Volatile,
    /// Stored in non-volatile memory by every write.
    EachWrite,
    /// Stored by a write to its store object.
    Save,
    /// Constant.
    Fixed,
    /// Not stated.
    #[default]
    Unknown,
}

impl ValueStorage {
    /// Persistence of a written value; `None` if unknown.
    pub const fn persistence_text(self) -> Option<Persistence> {
        match self {
            Self::Volatile => Some(Persistence::No),
            Self::EachWrite | Self::Fixed => Some(Persistence::Yes),
            Self::Save => Some(Persistence::NeedsSave),
            Self::Unknown => None,
        }
    }
}

/// Whether a value survives a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Persistence {
    /// It survives.
    Yes,
    /// It is lost.
    No,
    /// Survives if its store object is written later.
    NeedsSave,
    /// Not stored since it was written.
    NotStored,
}

impl Persistence {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Time at which a write takes effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WriteEffect {
    /// Immediately.
    AtOnce,
    /// At the next SYNC with the identifier configured in the node.
    AtSync,
    /// After NMT reset communication or a stronger reset.
    ResetCommunication,
    /// After NMT reset node or power-on.
    ResetNode,
    /// After power-on only.
    PowerOn,
    /// Never: accepted without effect.
    Never,
    /// Not stated.
    #[default]
    Unknown,
}

impl WriteEffect {
    /// Name in all output.
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

    /// Time as text, to be placed after the description of the effect.
    pub const fn time_text(self) -> &'static str {
        match self {
            Self::AtOnce => "at once",
            Self::AtSync => "at the next SYNC",
            Self::ResetCommunication => "after reset communication",
            Self::ResetNode => "after reset node",
            Self::PowerOn => "after power-on",
            Self::Never => "never: accepted without effect",
            Self::Unknown => "at an unknown time",
        }
    }

    /// Whether the new value takes effect only after a restart.
    pub const fn needs_restart(self) -> bool {
        matches!(self, Self::ResetCommunication | Self::ResetNode | Self::PowerOn)
    }
}

/// Function of an object in the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectRole {
    /// Control word or byte.
    Control,
    /// Status word or byte.
    Status,
    /// Commanded value.
    SetPoint,
    /// Measured value.
    Actual,
    /// Mode of operation.
    Mode,
    /// Node-ID.
    NodeId,
    /// Bit rate.
    BitRate,
    /// Ascending counter.
    Counter,
}

impl ObjectRole {
    /// Name in profiles.
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

/// Conversion of a raw number to a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, { raw = 16383, value = 100 }, { raw = 16383, object = \"5208:02\" } or { reciprocal = 131000 }"
)]
pub enum RawScale {
    /// value = raw × factor.
    Factor(f64),
    /// Proportional, with a known pair of raw number and quantity.
    Anchor {
        /// Raw number of the pair.
        raw: f64,
        /// Quantity of the pair.
        value: f64,
    },
    /// Proportional, with the quantity of the pair in another object.
    ByObject {
        /// Raw number of the pair.
        raw: f64,
        /// Object that contains the quantity.
        object: ObjectReference,
    },
    /// value = numerator / raw.
    Reciprocal {
        /// Quantity of raw number 1.
        reciprocal: f64,
    },
}

/// One or several numbers.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "expected a number or a list of numbers")]
pub enum NumberList {
    /// A single number.
    One(i64),
    /// Several alternative numbers.
    Any(Vec<i64>),
}

impl NumberList {
    /// Whether `value` is one of the numbers.
    pub fn contains(&self, value: i64) -> bool {
        match self {
            Self::One(one) => *one == value,
            Self::Any(any) => any.contains(&value),
        }
    }
}

/// Condition on the value of another object.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectCondition {
    /// Object to compare.
    pub object: ObjectReference,
    /// Raw values to compare with.
    pub equals: NumberList,
}

/// Variants that an entry applies to; all if empty.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(from = "OneOrMany<String>")]
pub struct VariantFilter(pub Vec<String>);

impl VariantFilter {
    /// Whether the entry applies to a variant.
    pub fn allows_variant(&self, variant: &str) -> bool {
        self.0.is_empty() || self.0.iter().any(|only| only == variant)
    }
}

impl From<OneOrMany<String>> for VariantFilter {
    fn from(list: OneOrMany<String>) -> Self {
        Self(list.into_vec())
    }
}

/// Repetition of equal entries at a constant distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EntryRepetition {
    /// Number of repeats.
    pub count: u16,
    /// Distance of their indexes.
    pub stride: u16,
    /// Number of the first repeat, for names and channels.
    #[serde(default = "first")]
    pub first: u16,
    /// Whether the repeat number is a channel of the device.
    #[serde(default)]
    pub channel: bool,
}

const fn first() -> u16 {
    1
}

/// No repetition: a single entry.
pub(crate) const ONCE: EntryRepetition = EntryRepetition { count: 1, stride: 0, first: 1, channel: false };

impl Default for EntryRepetition {
    fn default() -> Self {
        ONCE
    }
}

/// Default as written in a profile.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected a number or a text")]
pub enum DefaultValue {
    /// Raw integer.
    Number(i64),
    /// Floating-point number.
    Real(f64),
    /// Text or formula.
    Text(String),
}

/// Interpretation of a value: keys that can depend on the mode.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ValueInterpretation {
    /// Name; `{n}` is replaced by the repeat number.
    pub name: Option<String>,
    /// Short name in event lines.
    pub short: Option<String>,
    /// Unit of the scaled value.
    pub unit: Option<String>,
    /// Conversion of the raw number to a quantity.
    pub scale: Option<RawScale>,
    /// Offset of the quantity, added after scaling.
    pub offset: Option<f64>,
    /// Decimals in output.
    pub decimals: Option<u8>,
    /// Permitted raw values: minimum and maximum.
    pub range: Option<[i64; 2]>,
    /// Permitted values in `unit`: minimum and maximum.
    pub limits: Option<[f64; 2]>,
    /// Names of enumeration values.
    pub values: Option<Arc<ValueNames>>,
    /// Names of raw values other than quantities.
    pub special: Option<Arc<ValueNames>>,
    /// Names of bits.
    pub bits: Option<Arc<BitNames>>,
    /// Function of the object in the device.
    pub role: Option<ObjectRole>,
    /// Set point that an actual value follows.
    pub of: Option<ObjectReference>,
}

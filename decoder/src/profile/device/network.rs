//! What a profile says of the device on the network: identity, EMCY, aborts, NMT, monitoring.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::profile::object::Only;
use crate::profile::one_or_many::OneOrMany;
use crate::profile::reference::{ObjectRange, Reference};
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// What assigns the profile by itself; every key given must fit.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Identity {
    /// 1018:01.
    pub vendor_id: Option<u32>,
    /// 1018:02.
    pub product_code: Option<u32>,
    /// 1018:03.
    pub revision: Option<u32>,
    /// 1000:00.
    pub device_type: Option<u32>,
    /// Lower half of 1000:00: the number of the device profile (CiA 301 §7.5.2.1).
    pub profile_number: Option<u16>,
    /// 1008:00 begins with it.
    pub device_name: Option<String>,
    /// Variant it stands for.
    pub variant: Option<String>,
}

/// Behaviour that suggests a device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hint {
    /// For the reader.
    pub text: String,
    /// What is looked for.
    pub sign: Sign,
    /// Of sign `pdo`: which.
    #[serde(default)]
    pub pdo: Option<String>,
    /// Of sign `pdo`: its length in bytes.
    #[serde(default)]
    pub length: Option<u8>,
    /// Variants it stands for.
    #[serde(default)]
    pub only: Only,
}

/// A sign of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// An EMCY without data.
    ReadyTelegram,
    /// A PDO of a certain length.
    Pdo,
}

/// EMCY of a device.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EmcySpec {
    /// Byte order of the code.
    pub byte_order: Option<Order>,
    /// What 0000 says.
    pub cleared: Cleared,
    /// What a node without error sends at its start.
    pub at_boot: AtBoot,
    /// Fields of bytes 3 to 7.
    pub vendor: Vec<VendorField>,
    /// Codes.
    pub code: Vec<ErrorCode>,
    /// Section.
    pub source: String,
}

/// Byte order of the error code, fixed or by an object.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "\"lsb-first\", \"msb-first\" or { object, equals, default }")]
pub enum Order {
    /// Always the same.
    Fixed(OrderName),
    /// As an object says.
    ByObject {
        /// The object.
        object: Reference,
        /// Its raw values.
        equals: BTreeMap<String, OrderName>,
        /// As delivered.
        default: OrderName,
    },
}

/// `lsb-first` or `msb-first`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrderName {
    /// Least significant byte first.
    LsbFirst,
    /// Most significant byte first.
    MsbFirst,
}

impl OrderName {
    /// The order on the wire.
    pub const fn order(self) -> ByteOrder {
        match self {
            Self::LsbFirst => ByteOrder::LsbFirst,
            Self::MsbFirst => ByteOrder::MsbFirst,
        }
    }
}

impl Order {
    /// The object that decides, if one does.
    pub const fn object(&self) -> Option<ObjectAddress> {
        match self {
            Self::Fixed(_) => None,
            Self::ByObject { object, .. } => Some(object.object),
        }
    }

    /// The order with a known value of the object.
    pub fn of(&self, value: Option<i64>) -> ByteOrder {
        match self {
            Self::Fixed(order) => order.order(),
            Self::ByObject { equals, default, .. } => {
                let named = value.and_then(|value| equals.get(&value.to_string()));
                named.unwrap_or(default).order()
            }
        }
    }
}

/// What code 0000 says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cleared {
    /// One error went (CiA 301: the register says whether any is left).
    #[default]
    Each,
    /// All errors are gone.
    AllGone,
}

/// What a node without error sends at its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AtBoot {
    /// Nothing.
    #[default]
    Nothing,
    /// An EMCY without data (CiA 301 version 3).
    ReadyTelegram,
    /// Code 0000.
    NoError,
}

/// A field of the manufacturer's bytes.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VendorField {
    /// First byte of the message, 3 to 7.
    pub byte: u8,
    /// How many.
    pub bytes: u8,
    /// Name in kebab-case.
    pub name: String,
}

/// An error code of a device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorCode {
    /// The code.
    pub code: u16,
    /// Bits expected in the error register.
    #[serde(default)]
    pub register: Option<u8>,
    /// Meaning.
    pub text: String,
    /// What the device does.
    #[serde(default)]
    pub reaction: Option<String>,
    /// Where NMT goes by itself.
    #[serde(default)]
    pub nmt: Option<NmtName>,
    /// What to check, likeliest first.
    #[serde(default)]
    pub causes: Vec<String>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
}

/// NMT states by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NmtName {
    /// Initialising.
    Initialising,
    /// Pre-operational.
    PreOperational,
    /// Operational.
    Operational,
    /// Stopped.
    Stopped,
}

impl NmtName {
    /// The state.
    pub const fn state(self) -> NmtState {
        match self {
            Self::Initialising => NmtState::Initialising,
            Self::PreOperational => NmtState::PreOperational,
            Self::Operational => NmtState::Operational,
            Self::Stopped => NmtState::Stopped,
        }
    }
}

/// A device's own meaning of an SDO abort code.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AbortText {
    /// The code.
    pub code: u32,
    /// Meaning.
    pub text: String,
    /// Only for these objects, if any are named.
    #[serde(default)]
    pub objects: Vec<ObjectRange>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
}

/// NMT as the device has it.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NmtSpec {
    /// States it has; all if empty.
    pub states: Vec<NmtName>,
    /// Commands it obeys; all if empty.
    pub commands: Vec<String>,
    /// How it announces itself.
    pub boot: Boot,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section.
    pub source: String,
}

/// How a device announces itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Boot {
    /// Boot-up message after every start (CiA 301).
    #[default]
    BootUp,
    /// Boot-up message promised after power-on only.
    BootUpAfterPowerOn,
    /// An EMCY without data, or an EMCY if an error is present.
    ReadyTelegram,
}

/// Monitoring as the device has it, and as delivered.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Monitoring {
    /// Node guarding.
    pub guarding: Option<GuardingSpec>,
    /// Heartbeat.
    pub heartbeat: Option<HeartbeatSpec>,
    /// `heartbeat` or `guarding`, where both are on.
    pub wins: Option<String>,
    /// Whether it watches others' heartbeats.
    pub consumer: bool,
    /// Code of life guarding's EMCY.
    pub life_guard_emcy: Option<u16>,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section.
    pub source: String,
}

/// Guarding as delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GuardingSpec {
    /// Guard time in ms.
    #[serde(default)]
    pub time: u16,
    /// Life time factor.
    #[serde(default)]
    pub factor: u8,
}

/// Heartbeat as delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeartbeatSpec {
    /// Producer time in ms.
    #[serde(default)]
    pub default: u16,
    /// Steps in ms.
    #[serde(default)]
    pub step: Option<u16>,
}

/// What a node-ID change does and leaves.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IdentityChange {
    /// PDOs whose identifiers stay.
    pub cob_ids_stay: Vec<String>,
    /// Objects that fall back to their defaults.
    pub resets: Vec<ObjectRange>,
    /// Section.
    pub source: String,
}

/// Where the tool of the maker puts what into PDOs.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Key of the list in the bus file.
    pub name: String,
    /// PDOs it is sliced into, in order.
    pub pdos: Vec<String>,
    /// Bytes in all.
    pub bytes: u16,
    /// Widths an entry may have.
    pub entry_bytes: Vec<u8>,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
}

/// Strings, one or several.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(from = "OneOrMany<String>")]
pub struct Words(pub Vec<String>);

impl From<OneOrMany<String>> for Words {
    fn from(list: OneOrMany<String>) -> Self {
        Self(list.into_vec())
    }
}

//! Network properties of a device: identity, EMCY, aborts, NMT, monitoring.

use std::collections::BTreeMap;

use serde::Deserialize;
use strum::IntoStaticStr;

use crate::profile::data_type::little_endian;
use crate::profile::object::VariantFilter;
use crate::profile::one_or_many::OneOrMany;
use crate::profile::reference::{ObjectRange, ObjectReference};
use crate::wire::canopen::emcy::EmcyByteOrder;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Identity data that assign the profile automatically; all keys must match.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceIdentity {
    /// Vendor-ID, object 1018:01.
    pub vendor_id: Option<u32>,
    /// Product code, object 1018:02.
    pub product_code: Option<u32>,
    /// Revision number, object 1018:03.
    pub revision: Option<u32>,
    /// Device type, object 1000:00.
    pub device_type: Option<u32>,
    /// Device profile number: lower half of 1000:00 (CiA 301 §7.5.2.1).
    pub profile_number: Option<u16>,
    /// Prefix of the manufacturer device name, object 1008:00.
    pub device_name: Option<String>,
    /// Variant that these data identify.
    pub variant: Option<String>,
}

/// Behaviour that suggests a device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileHint {
    /// Explanation for the user.
    pub text: String,
    /// Kind of behaviour.
    pub sign: HintSign,
    /// PDO for sign `pdo`.
    #[serde(default)]
    pub pdo: Option<String>,
    /// PDO length in bytes for sign `pdo`.
    #[serde(default)]
    pub length: Option<u8>,
    /// Indexes of objects for signs `mapped`, all of which must be mapped, and `objects`.
    #[serde(default)]
    pub objects: Vec<u16>,
    /// Minimum number of these objects for sign `objects`.
    #[serde(default)]
    pub at_least: Option<usize>,
    /// EMCY codes for sign `emcy`; one of them is enough.
    #[serde(default)]
    pub codes: Vec<u16>,
    /// Counts only together with another hint: many other devices behave the same.
    #[serde(default)]
    pub not_alone: bool,
    /// Variants that it suggests; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
}

/// Kind of behaviour that suggests a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HintSign {
    /// EMCY message without data.
    ReadyTelegram,
    /// PDO of a certain length.
    Pdo,
    /// Objects mapped in PDOs.
    Mapped,
    /// Objects that the node has: read or written by SDO without abort, or mapped in PDOs.
    Objects,
    /// EMCY codes.
    Emcy,
}

impl HintSign {
    /// Whether other devices may share the behaviour by chance, so that it suggests a device only together with another
    /// hint, or in detailed output.
    pub const fn is_weak(self) -> bool {
        matches!(self, Self::Pdo | Self::Emcy)
    }
}

/// EMCY behaviour of a device.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EmcySpec {
    /// Byte order of the error code; CiA 301 order if `None`.
    pub byte_order: Option<ErrorCodeOrder>,
    /// Meaning of code 0000.
    pub cleared: ClearMeaning,
    /// EMCY that a node without error sends at start.
    pub at_boot: AtBoot,
    /// Fields in bytes 3 to 7.
    pub vendor: Vec<VendorField>,
    /// Error codes.
    pub code: Vec<DeviceErrorCode>,
    /// Section of the manual.
    pub source: String,
}

/// Byte order of the error code, fixed or by an object.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "expected \"lsb-first\", \"msb-first\" or { object, equals, default }")]
pub enum ErrorCodeOrder {
    /// Fixed order.
    Fixed(OrderName),
    /// Order selected by an object.
    ByObject {
        /// Object that selects the order.
        object: ObjectReference,
        /// Orders by raw value of the object.
        equals: BTreeMap<String, OrderName>,
        /// Factory default.
        default: OrderName,
    },
}

/// Byte order as written in profiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrderName {
    /// Least significant byte first.
    LsbFirst,
    /// Most significant byte first.
    MsbFirst,
}

impl OrderName {
    /// Corresponding byte order of the decoder.
    pub const fn order(self) -> EmcyByteOrder {
        match self {
            Self::LsbFirst => EmcyByteOrder::LsbFirst,
            Self::MsbFirst => EmcyByteOrder::MsbFirst,
        }
    }
}

impl ErrorCodeOrder {
    /// Object that selects the order, if any.
    pub const fn object(&self) -> Option<ObjectAddress> {
        match self {
            Self::Fixed(_) => None,
            Self::ByObject { object, .. } => Some(object.object),
        }
    }

    /// Order for a known value of the object; the default if `None`.
    pub fn order_for(&self, value: Option<i64>) -> EmcyByteOrder {
        match self {
            Self::Fixed(order) => order.order(),
            Self::ByObject { equals, default, .. } => {
                let named = value.and_then(|value| equals.get(&value.to_string()));
                named.unwrap_or(default).order()
            }
        }
    }
}

/// Meaning of code 0000.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClearMeaning {
    /// One error was removed (CiA 301: the error register shows whether others remain).
    #[default]
    Each,
    /// All errors were removed.
    AllGone,
}

/// EMCY that a node without error sends at start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AtBoot {
    /// No EMCY.
    #[default]
    Nothing,
    /// EMCY without data (CiA 301 version 3).
    ReadyTelegram,
    /// EMCY with code 0000.
    NoError,
}

/// Field in the manufacturer-specific bytes of an EMCY.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VendorField {
    /// First byte in the message, 3 to 7.
    pub byte: u8,
    /// Length in bytes.
    pub bytes: u8,
    /// Name in kebab-case.
    pub name: String,
}

impl VendorField {
    /// Number in the manufacturer-specific bytes; `None` if the message is too short.
    pub fn vendor_number(&self, vendor: &[u8]) -> Option<u64> {
        /// Bytes before the manufacturer-specific field (CiA 301 §7.2.7.1).
        const BEFORE: usize = 3;
        let first = usize::from(self.byte).checked_sub(BEFORE)?;
        let end = first.checked_add(usize::from(self.bytes))?;
        vendor.get(first..end).map(little_endian)
    }
}

/// Error code of a device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceErrorCode {
    /// EMCY error code.
    pub code: u16,
    /// Bits expected in the error register.
    #[serde(default)]
    pub register: Option<u8>,
    /// Meaning in the manual.
    pub text: String,
    /// Reaction of the device.
    #[serde(default)]
    pub reaction: Option<String>,
    /// NMT state that the device enters by itself.
    #[serde(default)]
    pub nmt: Option<NmtName>,
    /// Points to check, most likely first.
    #[serde(default)]
    pub causes: Vec<String>,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}

/// NMT state as written in profiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NmtName {
    /// Initialisation.
    Initialising,
    /// Pre-operational.
    PreOperational,
    /// Operational.
    Operational,
    /// Stopped.
    Stopped,
}

impl NmtName {
    /// Corresponding NMT state of the decoder.
    pub const fn state(self) -> NmtState {
        match self {
            Self::Initialising => NmtState::Initialising,
            Self::PreOperational => NmtState::PreOperational,
            Self::Operational => NmtState::Operational,
            Self::Stopped => NmtState::Stopped,
        }
    }
}

/// Device-specific meaning of an SDO abort code.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AbortText {
    /// SDO abort code.
    pub code: u32,
    /// Meaning in the manual.
    pub text: String,
    /// Objects it applies to; all if empty.
    #[serde(default)]
    pub objects: Vec<ObjectRange>,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}

/// NMT behaviour of a device.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NmtSpec {
    /// Supported NMT states; all if empty.
    pub states: Vec<NmtName>,
    /// Supported NMT commands; all if empty.
    pub commands: Vec<String>,
    /// Boot sign of the device.
    pub boot: BootSign,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section of the manual.
    pub source: String,
}

/// Boot sign: boot-up message, or the message that the device sends in its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BootSign {
    /// Boot-up message after every start (CiA 301).
    #[default]
    BootUp,
    /// Boot-up message guaranteed only after power-on.
    BootUpAfterPowerOn,
    /// EMCY without data, or EMCY with the error that is present.
    ReadyTelegram,
}

/// Error control by which a node is monitored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, IntoStaticStr)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum MonitoringMethod {
    /// Heartbeats of the node.
    Heartbeat,
    /// Responses to guarding requests.
    Guarding,
}

impl MonitoringMethod {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The message that is expected from the node, for people.
    pub const fn message(self) -> &'static str {
        match self {
            Self::Heartbeat => "heartbeat",
            Self::Guarding => "guarding response",
        }
    }
}

/// NMT error control of a device, with factory settings.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Monitoring {
    /// Node guarding; `None` if not supported.
    pub guarding: Option<GuardingSpec>,
    /// Heartbeat; `None` if not supported.
    pub heartbeat: Option<HeartbeatSpec>,
    /// Service that takes precedence if both are enabled.
    pub wins: Option<MonitoringMethod>,
    /// Whether the device is a heartbeat consumer.
    pub consumer: bool,
    /// EMCY code of an expired life guarding.
    pub life_guard_emcy: Option<u16>,
    /// Assumption or defect of the manual.
    pub note: String,
    /// Section of the manual.
    pub source: String,
}

/// Factory settings of node guarding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GuardingSpec {
    /// Guard time in ms, object 100C.
    #[serde(default)]
    pub time: u16,
    /// Life time factor, object 100D.
    #[serde(default)]
    pub factor: u8,
}

/// Factory settings of the heartbeat producer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeartbeatSpec {
    /// Producer heartbeat time in ms, object 1017.
    #[serde(default)]
    pub default: u16,
    /// Resolution of the time in ms.
    #[serde(default)]
    pub step: Option<u16>,
}

/// Effects of a node-ID change.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IdentityChange {
    /// PDOs that keep their COB-ID.
    pub cob_ids_stay: Vec<String>,
    /// Objects that are reset to their defaults.
    pub resets: Vec<ObjectRange>,
    /// Section of the manual.
    pub source: String,
}

/// Area that the manufacturer's tool divides into PDOs.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoArea {
    /// Key of the list in the bus file.
    pub name: String,
    /// PDOs that carry the area, in order.
    pub pdos: Vec<String>,
    /// Total length in bytes.
    pub bytes: u16,
    /// Permitted lengths of an entry, in bytes.
    pub entry_bytes: Vec<u8>,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}

/// One string or a list of strings.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(from = "OneOrMany<String>")]
pub struct TextList(pub Vec<String>);

impl From<OneOrMany<String>> for TextList {
    fn from(list: OneOrMany<String>) -> Self {
        Self(list.into_vec())
    }
}

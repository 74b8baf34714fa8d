//! Settings of one bus, or of every bus.

use std::str::FromStr;

use super::initial::{InitialState, InitialValue};
use super::uds::UdsPair;
use crate::frame::CanId;
use crate::profile::IdentifierOwner;
use crate::profile::SpannedText;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::SpnConversion;

/// Accepted bit rates, in bit/s.
pub(super) const BIT_RATES: std::ops::RangeInclusive<u32> = 1_000..=10_000_000;

/// Protocol that the traffic is treated as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProtocolChoice {
    /// Detected by evidence.
    #[default]
    Auto,
    /// CANopen on 11-bit identifiers without evidence; the protocol on 29 bits is detected.
    Canopen,
    /// J1939 on 29-bit identifiers without evidence; the protocol on 11 bits is detected.
    J1939,
    /// No protocol: frames are not decoded.
    None,
}

/// Settings of one bus, or of every bus.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BusSettings {
    /// Protocol of the bus; `None` if not stated.
    pub protocol: Option<ProtocolChoice>,
    /// Nodes listed, with or without a name or profile.
    pub nodes: Vec<NodeId>,
    /// Bit rate in bit/s.
    pub bit_rate: Option<u32>,
    /// Time zone of the recorder, as a name of the IANA database.
    pub time_zone: Option<SpannedText>,
    /// Name of the NMT master.
    pub master: Option<String>,
    /// User-defined node names.
    pub names: Vec<(NodeId, String)>,
    /// Services of CAN identifiers.
    pub owners: Vec<(CanId, IdentifierOwner)>,
    /// Values of objects.
    pub objects: Vec<InitialValue>,
    /// States of nodes before the first frame.
    pub states: Vec<(NodeId, InitialState)>,
    /// Profiles by node.
    pub devices: Vec<(NodeId, SpannedText)>,
    /// EDS, DCF or XDD files by node, relative to the bus file.
    pub device_files: Vec<(NodeId, String)>,
    /// Areas set in the manufacturer's tool, by node and area name.
    pub areas: Vec<(NodeId, String, Vec<AreaEntry>)>,
    /// Units selected in the manufacturer's tool, by node.
    pub units: Vec<(NodeId, ObjectAddress, String)>,
    /// Message databases (DBC, JSON), relative to the bus file; an earlier file overrides a later one.
    pub databases: Vec<String>,
    /// SPN conversion versions of J1939 devices that set the conversion method bit.
    pub conversions: Vec<(NodeId, SpnConversion)>,
    /// Identifiers of UDS servers.
    pub uds: Vec<UdsPair>,
}

/// One entry of an area that is configured in the manufacturer's tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AreaEntry {
    /// Address of the mapped object.
    pub object: ObjectAddress,
    /// Length in bytes, 1 to 8.
    pub bytes: u8,
}

/// Parses the form `2F10/4`.
impl FromStr for AreaEntry {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, &'static str> {
        let wrong = "invalid area entry; expected OBJECT/BYTES with 1 to 8 bytes, such as 2F10/4";
        let (object, bytes) = text.split_once('/').ok_or(wrong)?;
        let bytes = bytes.parse().ok().filter(|bytes| (1..=8).contains(bytes)).ok_or(wrong)?;
        let object = object.parse().map_err(|_| wrong)?;
        Ok(Self { object, bytes })
    }
}

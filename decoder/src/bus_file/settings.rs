//! What the file says of one bus, or of all.

use std::str::FromStr;

use super::uds::UdsPair;
use super::written::Written;
use crate::frame::CanId;
use crate::profile::Owner;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::SpnConversion;

/// Slowest and fastest bit rate believed, in bit/s.
pub(super) const BIT_RATES: std::ops::RangeInclusive<u32> = 1_000..=10_000_000;

/// What is known of one bus, or of all.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Settings {
    /// Bits a second.
    pub bit_rate: Option<u32>,
    /// Name of the NMT master.
    pub master: Option<String>,
    /// Names of nodes by node.
    pub names: Vec<(NodeId, String)>,
    /// What identifiers mean.
    pub owners: Vec<(CanId, Owner)>,
    /// Values of objects by node.
    pub objects: Vec<(NodeId, ObjectAddress, ObjectValue)>,
    /// Profiles by node.
    pub devices: Vec<(NodeId, Written)>,
    /// EDS, DCF or XDD files by node, relative to the bus file.
    pub device_files: Vec<(NodeId, String)>,
    /// What the maker's tool put into areas, by node and name of the area.
    pub areas: Vec<(NodeId, String, Vec<AreaEntry>)>,
    /// Units chosen in the maker's tool, by node.
    pub units: Vec<(NodeId, ObjectAddress, String)>,
    /// Databases of messages, relative to the bus file; what an earlier one tells goes before a later one.
    pub databases: Vec<String>,
    /// How J1939 devices code SPNs whose conversion method bit is set.
    pub conversions: Vec<(NodeId, SpnConversion)>,
    /// Identifiers of UDS servers.
    pub uds: Vec<UdsPair>,
}

/// A value of an object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ObjectValue {
    /// As it is sent.
    Bytes(Vec<u8>),
    /// A number as wide as the object of the node's profile, which the file does not know.
    Number(i64),
}

/// One entry of an area of the maker's tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AreaEntry {
    /// The object.
    pub object: ObjectAddress,
    /// Bytes it takes.
    pub bytes: u8,
}

/// `2F10/4`.
impl FromStr for AreaEntry {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, &'static str> {
        let wrong = "an entry of an area is written 2F10/4: object / bytes, 1 to 8";
        let (object, bytes) = text.split_once('/').ok_or(wrong)?;
        let bytes = bytes.parse().ok().filter(|bytes| (1..=8).contains(bytes)).ok_or(wrong)?;
        let object = object.parse().map_err(|_| wrong)?;
        Ok(Self { object, bytes })
    }
}

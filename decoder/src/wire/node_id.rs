//! Node of a bus: CANopen node-ID or J1939 address. Both can occur on one bus.

use std::fmt;
use std::str::FromStr;

/// A node, identified by its present node-ID or address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum NodeId {
    /// CANopen node-ID, 1..=127 (CiA 301 §7.3.3).
    Canopen(u8),
    /// J1939 address, 0..=253 (SAE J1939-81 §4.3).
    J1939(u8),
}

/// Size of a table with one slot per node.
pub const NODE_PLACES: usize = 128 + 256;

/// Highest address of a device (J1939-81 §4.3): 254 is the null address, 255 addresses all.
const LAST_ADDRESS: u8 = 253;

impl NodeId {
    /// Node-ID or address as a plain number.
    pub const fn number(self) -> u8 {
        match self {
            Self::Canopen(number) | Self::J1939(number) => number,
        }
    }

    /// Node-ID; `None` for a J1939 node.
    pub const fn canopen(self) -> Option<u8> {
        match self {
            Self::Canopen(id) => Some(id),
            Self::J1939(_) => None,
        }
    }

    /// Address; `None` for a CANopen node.
    pub const fn j1939(self) -> Option<u8> {
        match self {
            Self::Canopen(_) => None,
            Self::J1939(address) => Some(address),
        }
    }

    /// Whether the number is in the range allowed for a node.
    pub const fn is_valid(self) -> bool {
        match self {
            Self::Canopen(id) => id >= 1 && id <= 127,
            Self::J1939(address) => address <= LAST_ADDRESS,
        }
    }

    /// Label in output lines: `32/20`, `SA80`.
    pub fn label(self) -> String {
        match self {
            Self::Canopen(id) => format!("{id}/{id:02X}"),
            Self::J1939(address) => format!("SA{address:02X}"),
        }
    }

    /// Label within a sentence: `node 32/20`, `SA80`.
    pub fn sentence_label(self) -> String {
        match self {
            Self::Canopen(_) => format!("node {}", self.label()),
            Self::J1939(_) => self.label(),
        }
    }

    /// Slot in a table of [`NODE_PLACES`]; [`NODE_PLACES`] itself if the number is not valid.
    pub const fn table_place(self) -> usize {
        match self {
            Self::Canopen(id) if self.is_valid() => id as usize,
            Self::J1939(address) if self.is_valid() => 128 + address as usize,
            _ => NODE_PLACES,
        }
    }

    /// Node-ID or address of a slot in such a table; `None` for an unused slot.
    pub(crate) fn of_place(place: usize) -> Option<Self> {
        let id = match place.checked_sub(128) {
            Some(address) => Self::J1939(u8::try_from(address).ok()?),
            None => Self::Canopen(u8::try_from(place).ok()?),
        };
        id.is_valid().then_some(id)
    }

    /// All valid node-IDs, then all valid addresses.
    pub fn all_ids() -> impl Iterator<Item = Self> {
        (1..=127).map(Self::Canopen).chain((0..=LAST_ADDRESS).map(Self::J1939))
    }
}

/// Converts a CANopen node-ID.
impl From<u8> for NodeId {
    fn from(id: u8) -> Self {
        Self::Canopen(id)
    }
}

/// Writes `32` or `sa:0x80`, the form that options and bus files use.
impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Canopen(id) => write!(f, "{id}"),
            Self::J1939(address) => write!(f, "sa:0x{address:02X}"),
        }
    }
}

/// Parses `5`, `0x20`, `sa:128` or `sa:0x80`.
impl FromStr for NodeId {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (number, is_address) = match text.strip_prefix("sa:") {
            Some(number) => (number, true),
            None => (text, false),
        };
        let number = match number.strip_prefix("0x") {
            Some(digits) => u8::from_str_radix(digits, 16).ok(),
            None => number.parse().ok(),
        };
        let id = number.map(if is_address { Self::J1939 } else { Self::Canopen });
        id.filter(|id| id.is_valid()).ok_or("expected a node-ID 1 to 127 or a J1939 address sa:0 to sa:253")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_the_user() {
        assert_eq!("32".parse(), Ok(NodeId::Canopen(32)));
        assert_eq!("0x20".parse(), Ok(NodeId::Canopen(32)));
        assert_eq!("sa:0x80".parse(), Ok(NodeId::J1939(0x80)));
        assert_eq!("sa:0".parse(), Ok(NodeId::J1939(0)));
        for wrong in ["0", "128", "sa:254", "sa:", "sa:0x100", "-1", ""] {
            assert!(wrong.parse::<NodeId>().is_err(), "{wrong}");
        }
        assert_eq!(NodeId::J1939(0x80).to_string(), "sa:0x80");
    }

    #[test]
    fn every_node_has_a_place_of_its_own() {
        let mut places: Vec<_> = NodeId::all_ids().map(NodeId::table_place).collect();
        let count = places.len();
        places.dedup();
        assert_eq!((places.len(), count), (127 + 254, 127 + 254));
        assert!(places.iter().all(|place| *place < NODE_PLACES));
        assert!((0..=NODE_PLACES).filter_map(NodeId::of_place).eq(NodeId::all_ids()), "in the same order");
        for invalid in [NodeId::Canopen(0), NodeId::Canopen(128), NodeId::J1939(254)] {
            assert_eq!(invalid.table_place(), NODE_PLACES);
        }
    }
}

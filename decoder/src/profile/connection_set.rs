//! The predefined connection set (CiA 301 §7.3.3): default meaning of 11-bit identifiers.

use std::sync::OnceLock;

use serde::Deserialize;

use super::embedded::parse_embedded;
use super::layout::{PdoDirection, PdoName};
use crate::wire::canopen::sdo::SdoSide;

/// Service and node of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum IdentifierOwner {
    /// Unknown to the connection set.
    Unclassified,
    /// Service without a decoder: GFC, SRDO, flying master.
    Named(&'static str),
    /// NMT node control.
    Nmt,
    /// SYNC message.
    Sync,
    /// TIME message.
    Time,
    /// EMCY of a node.
    Emcy(u8),
    /// PDO of a node.
    Pdo(PdoName, u8),
    /// Default SDO channel of a node.
    Sdo(SdoSide, u8),
    /// NMT error control of a node: boot-up, heartbeat, guarding.
    ErrorControl(u8),
    /// LSS; `true` for messages of the master.
    Lss(bool),
    /// Markers of CiA's conformance test tool.
    TestMarker,
}

impl IdentifierOwner {
    /// Node-ID of the owner; `None` for a service of the whole network.
    pub const fn node(self) -> Option<u8> {
        match self {
            Self::Emcy(node) | Self::Pdo(_, node) | Self::Sdo(_, node) | Self::ErrorControl(node) => {
                Some(node)
            }
            _ => None,
        }
    }

    /// The same service of another node.
    const fn of_node(self, node: u8) -> Self {
        match self {
            Self::Emcy(_) => Self::Emcy(node),
            Self::Pdo(name, _) => Self::Pdo(name, node),
            Self::Sdo(side, _) => Self::Sdo(side, node),
            Self::ErrorControl(_) => Self::ErrorControl(node),
            other => other,
        }
    }
}

/// Owners of all 2,048 identifiers of 11 bits.
pub struct ConnectionSet {
    owners: Box<[IdentifierOwner]>,
    restricted: Vec<(u16, u16, &'static str)>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ConnectionSetFile {
    #[serde(rename = "id", default)]
    _id: String,
    #[serde(rename = "title", default)]
    _title: String,
    #[serde(rename = "source", default)]
    _source: String,
    cob: Vec<CobEntry>,
    restricted: Vec<RestrictedRange>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CobEntry {
    base: u16,
    #[serde(default)]
    to: Option<u16>,
    nodes: bool,
    service: String,
    #[serde(default)]
    number: u16,
    #[serde(default)]
    side: String,
    #[serde(default, rename = "name")]
    _name: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RestrictedRange {
    from: u16,
    to: u16,
    r#use: String,
}

impl ConnectionSet {
    /// Owner of an 11-bit identifier.
    pub fn owner_of(&self, id: u16) -> IdentifierOwner {
        self.owners.get(usize::from(id)).copied().unwrap_or(IdentifierOwner::Unclassified)
    }

    /// Reason why an identifier is restricted (CiA 301 §7.3.5); `None` if configurable.
    pub fn restriction_reason(&self, id: u16) -> Option<&'static str> {
        self.restricted.iter().find(|(from, to, _)| (*from..=*to).contains(&id)).map(|(_, _, why)| *why)
    }
}

/// Owner of the identifiers of an entry, for node 0.
fn entry_owner(cob: &CobEntry) -> IdentifierOwner {
    let node = 0;
    let pdo = |direction| IdentifierOwner::Pdo(PdoName { direction, number: cob.number }, node);
    match cob.service.as_str() {
        "nmt" => IdentifierOwner::Nmt,
        "sync" => IdentifierOwner::Sync,
        "time" => IdentifierOwner::Time,
        "emcy" => IdentifierOwner::Emcy(node),
        "tpdo" => pdo(PdoDirection::Transmit),
        "rpdo" => pdo(PdoDirection::Receive),
        "sdo" => {
            IdentifierOwner::Sdo(if cob.side == "client" { SdoSide::Client } else { SdoSide::Server }, node)
        }
        "error-control" => IdentifierOwner::ErrorControl(node),
        "test-marker" => IdentifierOwner::TestMarker,
        "lss" => IdentifierOwner::Lss(cob.side == "master"),
        other => IdentifierOwner::Named(other.to_owned().leak()),
    }
}

/// The predefined connection set, loaded on first use.
pub fn connection_set() -> &'static ConnectionSet {
    static SET: OnceLock<ConnectionSet> = OnceLock::new();
    SET.get_or_init(|| {
        let file: ConnectionSetFile = parse_embedded("standard/predefined.toml");
        let mut owners = vec![IdentifierOwner::Unclassified; 2048].into_boxed_slice();
        for cob in &file.cob {
            let last = if cob.nodes { cob.base + 127 } else { cob.to.unwrap_or(cob.base) };
            let first = if cob.nodes { cob.base + 1 } else { cob.base };
            let owner = entry_owner(cob);
            for id in first..=last {
                let node = u8::try_from(id - cob.base).unwrap_or(0);
                if let Some(slot) = owners.get_mut(usize::from(id)) {
                    *slot = owner.of_node(node);
                }
            }
        }
        let leak = |entry: RestrictedRange| (entry.from, entry.to, &*entry.r#use.leak());
        ConnectionSet { owners, restricted: file.restricted.into_iter().map(leak).collect() }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_of_node_5() {
        let set = connection_set();
        assert_eq!(set.owner_of(0x000), IdentifierOwner::Nmt);
        assert_eq!(set.owner_of(0x080), IdentifierOwner::Sync);
        assert_eq!(set.owner_of(0x085), IdentifierOwner::Emcy(5));
        assert_eq!(set.owner_of(0x100), IdentifierOwner::Time);
        let tpdo2 = PdoName { direction: PdoDirection::Transmit, number: 2 };
        assert_eq!(set.owner_of(0x285), IdentifierOwner::Pdo(tpdo2, 5));
        assert_eq!(set.owner_of(0x585), IdentifierOwner::Sdo(SdoSide::Server, 5));
        assert_eq!(set.owner_of(0x605), IdentifierOwner::Sdo(SdoSide::Client, 5));
        assert_eq!(set.owner_of(0x705), IdentifierOwner::ErrorControl(5));
        assert_eq!(set.owner_of(0x7E5), IdentifierOwner::Lss(true));
        assert_eq!(set.owner_of(0x001), IdentifierOwner::Named("gfc"));
        assert_eq!(set.owner_of(0x780), IdentifierOwner::Unclassified);
        assert_eq!(set.owner_of(0x600), IdentifierOwner::Unclassified);
    }

    #[test]
    fn restricted_identifiers() {
        assert_eq!(connection_set().restriction_reason(0x6E5), Some("reserved"));
        assert_eq!(connection_set().restriction_reason(0x1A0), None);
    }
}

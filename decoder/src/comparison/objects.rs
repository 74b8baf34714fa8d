//! `objects.toml`: objects that are not parameters, and objects of the identity.

use std::sync::OnceLock;

use serde::Deserialize;

use crate::profile::object::SdoAccess;
use crate::profile::{ObjectMeaning, ObjectRole};
use crate::session::{Node, OriginKind, StoredObject};
use crate::wire::canopen::ObjectAddress;

/// First index of the manufacturer-specific area (CiA 301 §7.4.1).
const MANUFACTURER: u16 = 0x2000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectsFile {
    identity: Vec<IdentityRow>,
    never: Vec<NeverRow>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct IdentityRow {
    object: String,
    name: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NeverRow {
    first: String,
    last: String,
    #[serde(rename = "reason")]
    _reason: String,
}

/// Objects by their part in a comparison.
#[derive(Debug, Default)]
pub(super) struct ObjectComparison {
    /// Objects of the identity with their names.
    pub(super) identity: Vec<(ObjectAddress, String)>,
    never: Vec<(u16, u16)>,
}

fn parse_hex(text: &str) -> Option<u16> {
    u16::from_str_radix(text, 16).ok()
}

fn parse_address(text: &str) -> Option<ObjectAddress> {
    let (index, sub) = text.split_once(':')?;
    Some(ObjectAddress::new(parse_hex(index)?, u8::from_str_radix(sub, 16).ok()?))
}

/// The table, parsed once.
pub(super) fn object_table() -> &'static ObjectComparison {
    static OBJECTS: OnceLock<ObjectComparison> = OnceLock::new();
    OBJECTS.get_or_init(|| {
        // A unit test checks that the file is valid; an invalid file would yield an empty table.
        let Ok(file) = toml::from_str::<ObjectsFile>(include_str!("objects.toml")) else {
            return ObjectComparison::default();
        };
        let identity =
            file.identity.into_iter().filter_map(|row| Some((parse_address(&row.object)?, row.name)));
        let never = file.never.iter().filter_map(|row| Some((parse_hex(&row.first)?, parse_hex(&row.last)?)));
        ObjectComparison { identity: identity.collect(), never: never.collect() }
    })
}

/// Whether a value of the store is a parameter: configured by SDO, or readable and writable in the dictionary of the
/// node. Process data, actual values, counters and the error history are not.
pub(super) fn is_parameter(
    node: &Node,
    object: ObjectAddress,
    entry: &StoredObject,
    meaning: Option<&ObjectMeaning>,
) -> bool {
    let is_never = object_table().never.iter().any(|(first, last)| (*first..=*last).contains(&object.index));
    let is_process = meaning.and_then(|meaning| meaning.role).is_some_and(|role| {
        matches!(
            role,
            ObjectRole::Control
                | ObjectRole::Status
                | ObjectRole::SetPoint
                | ObjectRole::Actual
                | ObjectRole::Counter
        )
    });
    if is_never || is_process {
        return false;
    }
    match entry.origin.kind {
        OriginKind::Download => true,
        OriginKind::Upload => {
            match node.device().dictionary.find_object(object).and_then(|found| found.entry?.access) {
                Some(access) => access == SdoAccess::Rw,
                None => object.index < MANUFACTURER,
            }
        }
        OriginKind::Pdo | OriginKind::BusFile | OriginKind::DeviceFile => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_valid() {
        toml::from_str::<ObjectsFile>(include_str!("objects.toml")).unwrap();
        assert_eq!((object_table().identity.len(), object_table().never.len()), (7, 8));
        assert!(object_table().never.contains(&(0x1018, 0x1018)));
    }
}

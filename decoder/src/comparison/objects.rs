//! `objects.toml`: objects that are not parameters, and objects of the identity.

use std::sync::OnceLock;

use serde::Deserialize;

use crate::profile::object::Access;
use crate::profile::{Meaning, Role};
use crate::session::{Entry, Node, OriginKind};
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
pub(super) struct Objects {
    /// Objects of the identity with their names.
    pub(super) identity: Vec<(ObjectAddress, String)>,
    never: Vec<(u16, u16)>,
}

fn hex(text: &str) -> Option<u16> {
    u16::from_str_radix(text, 16).ok()
}

fn address(text: &str) -> Option<ObjectAddress> {
    let (index, sub) = text.split_once(':')?;
    Some(ObjectAddress::new(hex(index)?, u8::from_str_radix(sub, 16).ok()?))
}

/// The table, parsed once.
pub(super) fn objects() -> &'static Objects {
    static OBJECTS: OnceLock<Objects> = OnceLock::new();
    OBJECTS.get_or_init(|| {
        // A unit test checks that the file is valid; an invalid file would yield an empty table.
        let Ok(file) = toml::from_str::<ObjectsFile>(include_str!("objects.toml")) else {
            return Objects::default();
        };
        let identity = file.identity.into_iter().filter_map(|row| Some((address(&row.object)?, row.name)));
        let never = file.never.iter().filter_map(|row| Some((hex(&row.first)?, hex(&row.last)?)));
        Objects { identity: identity.collect(), never: never.collect() }
    })
}

/// Whether a value of the store is a parameter: configured by SDO, or readable and writable in the dictionary of the
/// node. Process data, actual values, counters and the error history are not.
pub(super) fn is_parameter(
    node: &Node,
    object: ObjectAddress,
    entry: &Entry,
    meaning: Option<&Meaning>,
) -> bool {
    let is_never = objects().never.iter().any(|(first, last)| (*first..=*last).contains(&object.index));
    let is_process = meaning.and_then(|meaning| meaning.role).is_some_and(|role| {
        matches!(role, Role::Control | Role::Status | Role::SetPoint | Role::Actual | Role::Counter)
    });
    if is_never || is_process {
        return false;
    }
    match entry.origin.kind {
        OriginKind::Download => true,
        OriginKind::Upload => {
            match node.device().dictionary.find(object).and_then(|found| found.entry?.access) {
                Some(access) => access == Access::Rw,
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
        assert_eq!((objects().identity.len(), objects().never.len()), (7, 8));
        assert!(objects().never.contains(&(0x1018, 0x1018)));
    }
}

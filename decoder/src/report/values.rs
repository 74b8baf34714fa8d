//! Object values of the nodes of a claim when it began.

use std::fmt::Write as _;

use super::claims::describe_node as label;
use super::model::{NodeValues, ObjectRow};
use crate::profile::DecodedValue;
use crate::session::{Bus, Node, OriginKind, StoredObject};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Maximum number of objects listed per node.
const SHOWN_OBJECTS: usize = 16;

/// First index of manufacturer-specific and profile objects (CiA 301 §7.4.1).
const FIRST_OF_DEVICE: u16 = 0x2000;

/// Maximum number of bytes printed per value.
const SHOWN_BYTES: usize = 16;

/// Values of a node: objects that the findings name, then written and read ones of the device, the latest
/// first. `None` without a known value.
pub(super) fn node_values(
    bus: &Bus,
    id: NodeId,
    subjects: &[ObjectAddress],
    frame: u64,
) -> Option<NodeValues> {
    let node = bus.node(id)?;
    let all = node.store().sorted();
    let total = all.len();
    let mut all: Vec<_> = all
        .into_iter()
        .map(|(object, entry)| (sort_key(subjects.contains(&object), object, entry), object, entry))
        .collect();
    all.sort_by_key(|(rank, object, _)| (*rank, *object));
    all.truncate(SHOWN_OBJECTS);
    all.sort_by_key(|(_, object, _)| *object);
    let row = |(_, object, entry): (_, ObjectAddress, &StoredObject)| {
        object_row(node, object, entry, subjects.contains(&object))
    };
    let rows: Vec<_> = all.into_iter().map(row).collect();
    (!rows.is_empty()).then(|| NodeValues {
        who: label(bus, id),
        at: format!("after {{{frame}}}"),
        total,
        rows,
    })
}

/// Sort key: lower ones are listed.
fn sort_key(is_subject: bool, object: ObjectAddress, entry: &StoredObject) -> (u8, std::cmp::Reverse<u64>) {
    let is_read = matches!(entry.origin.kind, OriginKind::Download | OriginKind::Upload);
    let group = match (is_subject, entry.origin.kind) {
        (true, _) => 0,
        // Objects of the device precede communication parameters (CiA 301: 1000 to 1FFF).
        (_, OriginKind::Download | OriginKind::Upload) if object.index >= FIRST_OF_DEVICE => 1,
        (_, OriginKind::BusFile | OriginKind::DeviceFile) => 2,
        _ if is_read => 3,
        _ => 4,
    };
    (group, std::cmp::Reverse(entry.origin.frame))
}

fn object_row(node: &Node, object: ObjectAddress, entry: &StoredObject, is_subject: bool) -> ObjectRow {
    let known = node.meaning(object);
    let mut value = match known.as_ref().map(|known| (known, known.decode(&entry.value))) {
        Some((_, DecodedValue::Bytes(_))) | None => String::new(),
        Some((known, value)) => known.format_value(&value),
    };
    let mut bytes = String::new();
    for byte in entry.value.iter().take(SHOWN_BYTES) {
        let _ = write!(bytes, "{}{byte:02X}", if bytes.is_empty() { "" } else { " " });
    }
    if entry.size > SHOWN_BYTES as u64 {
        let _ = write!(bytes, " … {} bytes", entry.size);
    }
    if entry.stale {
        let marked = if value.is_empty() { &mut bytes } else { &mut value };
        marked.push('?');
    }
    ObjectRow {
        is_stale: entry.stale,
        object: object.to_string(),
        name: known.map_or_else(String::new, |known| known.name.clone()),
        value,
        bytes,
        origin: entry.origin.kind.origin_text(),
        frame: entry.origin.frame,
        is_subject,
    }
}

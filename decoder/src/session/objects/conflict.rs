//! Contradictions between bus and device file of a node: other device, other type, other configuration.

use std::hash::BuildHasher as _;

use foldhash::fast::FixedState;

use crate::event::{EventKind, EvictedState, SourceConflict};
use crate::frame::Frame;
use crate::profile::device_file::{DeviceFile, DeviceObject, EntryAccess};
use crate::profile::{DataType, little_endian};
use crate::session::bus::{Bus, IdentifierService, OriginKind};
use crate::session::context::MachineContext;
use crate::session::limits::{CONFLICT_LIMIT, OBJECT_LIMIT};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::words::count_noun;

/// Objects with the identity of a device, which never change (CiA 301 §7.5.2.1, §7.5.2.21).
const DEVICE_TYPE: ObjectAddress = ObjectAddress::new(0x1000, 0);
const IDENTITY: u16 = 0x1018;

/// Store and restore: a write is a command, a read returns the capabilities.
const COMMANDS: [u16; 2] = [0x1010, 0x1011];

/// Emits a contradiction between a value read from the node and its device file.
pub(in crate::session) fn check_device_file(
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    kind: OriginKind,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(import) = cx.bus.node(id).and_then(|node| node.device.file.clone()) else { return };
    let Some(described) = import.file.find_object(object) else { return };
    if kind != OriginKind::Upload {
        let is_wanted = described.value.is_some();
        let node = cx.bus.nodes.node_mut(id).filter(|node| node.conflicts.written.len() < OBJECT_LIMIT);
        if let Some(node) = node.filter(|_| is_wanted) {
            node.conflicts.written.insert(object);
        }
        return;
    }
    let source = import.file.kind.name();
    let found = wrong_size(described, value, source)
        .or_else(|| other_device(&import.file, described, value, id))
        .or_else(|| not_configured(&cx.bus, described, value, id));
    let Some((stated, text)) = found else { return };
    if !is_new_conflict(id, object, value, frame, cx) {
        return;
    }
    let name = cx.bus.nodes.meaning(id, object).map(|meaning| meaning.name).unwrap_or_default();
    let sources = [(source, stated), (kind.name(), value.to_vec())].into_iter();
    let sources =
        sources.filter(|(_, data)| !data.is_empty()).map(|(who, data)| (who.into(), data)).collect();
    let conflict = SourceConflict { object, name, sources, text };
    cx.emit_event(frame, id, false, EventKind::Conflict(Box::new(conflict)));
}

/// Whether this object and value were not reported yet; false over the limit.
fn is_new_conflict(
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) -> bool {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return false };
    let conflicts = &mut node.conflicts;
    if conflicts.reported.len() < CONFLICT_LIMIT {
        return conflicts.reported.insert((object, FixedState::default().hash_one(value)));
    }
    if !std::mem::replace(&mut conflicts.is_full, true) {
        cx.emit_event(frame, id, false, EventKind::Evicted { what: EvictedState::Conflict, count: 1 });
    }
    false
}

/// Configured value in the DCF, unless the object was written since, or a PDO contains it.
fn not_configured(bus: &Bus, object: &DeviceObject, value: &[u8], id: NodeId) -> Option<(Vec<u8>, String)> {
    let wanted = object.configured_bytes(id.number())?;
    let node = bus.node(id)?;
    let is_constant = matches!(object.access, Some(EntryAccess::Ro | EntryAccess::Const));
    let is_stated = is_constant
        || COMMANDS.contains(&object.address.index)
        || node.conflicts.written.contains(&object.address)
        || equals_unpadded(&wanted, value, object.data_type)
        || is_in_pdo(bus, id, object.address);
    (!is_stated).then(|| (wanted, "value differs from the configuration in the file".to_owned()))
}

/// Whether a PDO of the node, received so far, contains an object.
fn is_in_pdo(bus: &Bus, id: NodeId, object: ObjectAddress) -> bool {
    bus.routes.layouts().any(|(service, layout)| {
        matches!(service, IdentifierService::Pdo(_, node) if node == id)
            && layout.fields.iter().any(|field| field.object() == Some(object))
    })
}

/// Compares the size with that of the data type; an expedited transfer without indicated size is zero-padded.
fn wrong_size(object: &DeviceObject, value: &[u8], source: &str) -> Option<(Vec<u8>, String)> {
    let data_type = object.data_type?;
    let length = usize::from(data_type.bits()?.div_ceil(8));
    let fits =
        value.split_at_checked(length).is_some_and(|(_, padding)| padding.iter().all(|byte| *byte == 0));
    let bytes = |count: usize| count_noun(count, "byte");
    let text = format!(
        "{} received, {} expected ({} in the {source})",
        bytes(value.len()),
        bytes(length),
        data_type.name()
    );
    (!fits).then_some((Vec::new(), text))
}

/// Compares the identity of the node with that in the device file.
fn other_device(
    file: &DeviceFile,
    object: &DeviceObject,
    value: &[u8],
    node: NodeId,
) -> Option<(Vec<u8>, String)> {
    let header = match (object.address.index, object.address.sub) {
        _ if object.address == DEVICE_TYPE => None,
        (IDENTITY, 1) => file.vendor_id,
        (IDENTITY, 2) => file.product_code,
        (IDENTITY, 3) => file.revision,
        _ => return None,
    };
    let data_type = object.data_type?;
    let given = [&object.value, &object.default].into_iter().flatten();
    let stated = given.filter_map(|given| given.encode_value(data_type, node.number()));
    // Editors write 0 if no number was entered.
    let stated =
        stated.chain(header.map(|number| number.to_le_bytes().to_vec())).find(|it| little_endian(it) != 0)?;
    let text = match object.address.sub {
        3 => "the file is for another revision",
        _ => "the file is for another device",
    };
    (!equals_unpadded(&stated, value, Some(data_type))).then(|| (stated, text.to_owned()))
}

/// Whether two values are equal except for padding.
fn equals_unpadded(wanted: &[u8], value: &[u8], data_type: Option<DataType>) -> bool {
    match data_type {
        Some(data_type) => data_type.decode(wanted) == data_type.decode(value),
        None => wanted == value,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::event::Event;
    use crate::frame::BusIndex;
    use crate::profile::{device_file, imported};
    use crate::session::BusDecoder;
    use crate::session::learning::learn_object;
    use crate::session::objects::ObjectTransfer;
    use crate::session::{AssignedBy, Assignment, SessionOptions};

    const FILE: &str = "[DeviceInfo]\nVendorNumber=1\nProductNumber=2\nRevisionNumber=3\n\
        [1000]\nParameterName=a\nDataType=7\nAccessType=ro\nDefaultValue=0\n\
        [1018]\nParameterName=a\nObjectType=9\n\
        [1018sub1]\nParameterName=a\nDataType=7\nAccessType=ro\nDefaultValue=1\n\
        [1018sub3]\nParameterName=a\nDataType=7\nAccessType=ro\nDefaultValue=0\n\
        [2000]\nParameterName=a\nDataType=6\nAccessType=rw\nParameterValue=5\n\
        [2001]\nParameterName=a\nDataType=6\nAccessType=ro\nParameterValue=5\n\
        [1010]\nParameterName=a\nObjectType=9\n[1010sub1]\nParameterName=a\nDataType=7\nAccessType=rw\nParameterValue=5\n";

    fn bus() -> BusDecoder {
        let file = Arc::new(device_file::parse_device_file(FILE.as_bytes()).unwrap());
        let device = Arc::new(imported::describe_device(&file, "a.dcf"));
        let assignment =
            Assignment { bus: None, node: NodeId::Canopen(5), device, by: AssignedBy::DeviceFile };
        let options = SessionOptions { assignments: vec![assignment], ..SessionOptions::default() };
        BusDecoder::new(BusIndex(0), "can0", Arc::new(options))
    }

    /// Texts of the conflicts after reading these values.
    fn read(bus: &mut BusDecoder, values: &[(u16, u8, &[u8])]) -> Vec<String> {
        let mut texts = Vec::new();
        for (index, sub, value) in values {
            let object = ObjectAddress::new(*index, *sub);
            let transfer = ObjectTransfer {
                node: NodeId::Canopen(5),
                object,
                value: value.to_vec(),
                kind: OriginKind::Upload,
            };
            let mut observer = |event: &Event, _: &Bus| match &event.kind {
                EventKind::Conflict(conflict) => texts.push(conflict.text.clone()),
                EventKind::Evicted { what, .. } => texts.push(format!("evicted {}", what.name())),
                _ => {}
            };
            learn_object(transfer, &Frame::EMPTY, &mut bus.lend_context(&mut observer));
        }
        texts
    }

    #[test]
    fn an_empty_number_is_ignored() {
        // 1000:00 and 1018:03 are 0 in the file; the file header contains the revision.
        let values: [(u16, u8, &[u8]); 4] = [
            (0x1000, 0, &[9, 0, 0, 0]),
            (0x1018, 1, &[1, 0, 0, 0]),
            (0x1018, 3, &[3, 0, 0, 0]),
            (0x1018, 3, &[4, 0, 0, 0]),
        ];
        assert_eq!(read(&mut bus(), &values), ["the file is for another revision"]);
    }

    #[test]
    fn what_is_measured_or_a_command_is_no_configuration() {
        let values: [(u16, u8, &[u8]); 3] =
            [(0x2001, 0, &[9, 0]), (0x1010, 1, &[1, 0, 0, 0]), (0x2000, 0, &[5, 0, 0, 0])];
        assert!(read(&mut bus(), &values).is_empty());
        assert_eq!(
            read(&mut bus(), &[(0x2000, 0, &[9, 0])]),
            ["value differs from the configuration in the file"]
        );
        let text = "3 bytes received, 2 bytes expected (UNSIGNED16 in the dcf)";
        assert_eq!(read(&mut bus(), &[(0x2000, 0, &[9, 0, 1])]), [text]);
    }

    #[test]
    fn conflicts_are_reported_up_to_a_limit() {
        let values: Vec<[u8; 2]> = (0..300_u16).map(|number| (1000 + number).to_le_bytes()).collect();
        let values: Vec<(u16, u8, &[u8])> =
            values.iter().map(|value| (0x2000, 0, value.as_slice())).collect();
        let reported = read(&mut bus(), &values);
        assert_eq!(reported.len(), CONFLICT_LIMIT + 1);
        assert_eq!(reported.last().unwrap(), "evicted conflict");
    }
}

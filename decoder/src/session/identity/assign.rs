//! Device of a node: assigned by the user, or identified by its objects.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::messages::refresh_messages;
use crate::event::{AssignedBy, EventKind, NodeIdentified};
use crate::frame::Frame;
use crate::profile::imported::DescriptionImport;
use crate::profile::{DeviceProfile, ReportedIdentity, little_endian};
use crate::session::bus::Node;
use crate::session::context::MachineContext;
use crate::session::objects::take_delivered;
use crate::session::options::{Assignment, ProtocolChoice};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Objects that identify a device (CiA 301 §7.5.2.1, §7.5.2.8, §7.5.2.19).
const INTRODUCING: [ObjectAddress; 5] = [
    ObjectAddress::new(0x1000, 0),
    ObjectAddress::new(0x1008, 0),
    ObjectAddress::new(0x1018, 1),
    ObjectAddress::new(0x1018, 2),
    ObjectAddress::new(0x1018, 3),
];

/// Assigns a device to a node.
pub(in crate::session) fn assign_device(
    id: NodeId,
    device: &Arc<DeviceProfile>,
    by: AssignedBy,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    node.device = Arc::clone(device);
    node.assigned = Some(by);
    if id.canopen().is_some() {
        take_delivered(&mut cx.bus, id, by);
    }
    cx.bus.routes.refresh_pdos_of(id);
    let is_detected = matches!(by, AssignedBy::Identity | AssignedBy::DeviceType);
    if cx.bus.protocols.choice != ProtocolChoice::None {
        cx.bus.protocols.named.add_node(id, is_detected);
    }
    if id.j1939().is_some() {
        if is_detected {
            cx.bus.protocols.j1939.add_evidence();
        }
        refresh_messages(cx);
    }
}

/// Tries to identify a node, after an identity object was learnt, if the user assigned no profile.
pub(in crate::session) fn identify_node(
    id: NodeId,
    object: ObjectAddress,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    if !INTRODUCING.contains(&object) {
        return;
    }
    // A device file only describes objects, and a device type only the class of device: a profile can still
    // be added.
    let is_open = |node: &&Node| {
        matches!(node.assigned, None | Some(AssignedBy::DeviceType)) || node.device.is_file_alone()
    };
    let Some(node) = cx.bus.node(id).filter(is_open) else { return };
    let seen = |object| node.store().seen_value(object).map(|entry| entry.value.as_slice());
    let number = |object| {
        let value = seen(object).filter(|value| !value.is_empty())?;
        u32::try_from(little_endian(value)).ok().filter(|_| value.len() <= 8)
    };
    let introduction = ReportedIdentity {
        vendor_id: number(ObjectAddress::new(0x1018, 1)),
        product_code: number(ObjectAddress::new(0x1018, 2)),
        revision: number(ObjectAddress::new(0x1018, 3)),
        device_type: number(ObjectAddress::new(0x1000, 0)),
        device_name: seen(ObjectAddress::new(0x1008, 0)).map(|value| {
            let characters = value.iter().take_while(|byte| **byte != 0);
            characters.map(|byte| char::from(*byte)).collect()
        }),
    };
    // This identity was already compared with all devices.
    if node.introduction.as_deref() == Some(&introduction) {
        return;
    }
    assign_matching(id, &introduction, frame, cx);
    if let Some(node) = cx.bus.nodes.node_mut(id) {
        node.introduction = Some(Arc::new(introduction));
    }
}

/// Assigns the matching device; several matching ones are only reported.
pub(in crate::session) fn assign_matching(
    id: NodeId,
    introduction: &ReportedIdentity,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let options = Arc::clone(&cx.bus.options);
    let file = cx.bus.node(id).and_then(|node| node.device.file.clone());
    let is_assigned = cx.bus.node(id).is_some_and(|node| node.assigned.is_some());
    let mut candidates = options.catalogue.identify_node(introduction);
    // A generic profile for the device type is used only if no device is assigned.
    candidates.retain(|candidate| !is_assigned || !options.catalogue.is_generic(candidate));
    if file.is_some() {
        candidates.retain(|candidate| !options.catalogue.is_device_file(candidate));
    }
    let device = match candidates.as_slice() {
        [] => return,
        [one] => match options.catalogue.device(one) {
            Ok(device) => file.map_or(Arc::clone(&device), |import| Arc::new(device.fill_from(&import.file))),
            Err(error) => return cx.emit_note(frame, error.to_string()),
        },
        several => {
            let known = cx.bus.node(id).is_some_and(|node| node.ambiguous);
            if !known {
                if let Some(node) = cx.bus.nodes.node_mut(id) {
                    node.ambiguous = true;
                }
                let names = several.join(", ");
                let first = several.first().map_or("", String::as_str);
                let text = format!(
                    "node {id} matches several profiles: {names}; select one with --node {id}={first}"
                );
                cx.emit_note(frame, text);
            }
            return;
        }
    };
    let is_generic = options.catalogue.is_generic(&device.id);
    let by = if is_generic { AssignedBy::DeviceType } else { AssignedBy::Identity };
    let identified = NodeIdentified { device: device.full_id.clone(), title: device.title.clone(), by };
    assign_device(id, &device, by, cx);
    cx.emit_event(frame, id, false, EventKind::NodeIdentified(Box::new(identified)));
}

/// Devices assigned by the user to the nodes of a bus. The last profile of a node wins, and the last device
/// file; a device file adds the objects missing from the profile.
pub(in crate::session) fn given_devices(
    assignments: &[Assignment],
    bus: &str,
) -> Vec<(NodeId, Arc<DeviceProfile>, AssignedBy)> {
    let mut nodes: BTreeMap<NodeId, (Option<&Assignment>, Option<&DescriptionImport>)> = BTreeMap::new();
    for assignment in assignments.iter().filter(|it| it.bus.as_deref().is_none_or(|name| name == bus)) {
        let (device, file) = nodes.entry(assignment.node).or_default();
        match assignment.device.file.as_ref().filter(|_| assignment.device.is_file_alone()) {
            Some(import) => {
                *file = Some(import);
                if device.is_none_or(|device| device.device.is_file_alone()) {
                    *device = Some(assignment);
                }
            }
            None => *device = Some(assignment),
        }
    }
    let given = |(node, (assignment, file)): (NodeId, (Option<&Assignment>, Option<&DescriptionImport>))| {
        let assignment = assignment?;
        let device = match file {
            Some(import) if !assignment.device.is_file_alone() => {
                Arc::new(assignment.device.fill_from(&import.file))
            }
            _ => Arc::clone(&assignment.device),
        };
        Some((node, device, assignment.by))
    };
    nodes.into_iter().filter_map(given).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::{Catalogue, device_file, imported};

    fn of(bus: Option<&str>, device: &Arc<DeviceProfile>, by: AssignedBy) -> Assignment {
        Assignment { bus: bus.map(Into::into), node: NodeId::Canopen(5), device: Arc::clone(device), by }
    }

    #[test]
    fn a_profile_goes_before_a_device_file_which_fills_the_rest() {
        let profile = Catalogue::default().device("rexroth-sydfec").unwrap();
        let file = |product: &str| {
            let text = format!(
                "[DeviceInfo]\nVendorName=A\nProductName={product}\n[2FFF]\nParameterName=Extra\nDataType=5"
            );
            let file = Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap());
            Arc::new(imported::describe_device(&file, "a.eds"))
        };
        let (first, second) = (file("b"), file("c"));
        let given = |assignments: &[Assignment], bus| {
            let given = given_devices(assignments, bus);
            let [(NodeId::Canopen(5), device, by)] = &given[..] else { panic!("{given:?}") };
            let knows = device.dictionary.find_object(ObjectAddress::new(0x2FFF, 0)).is_some();
            (device.id.clone(), by.name(), knows)
        };
        let files = [of(None, &first, AssignedBy::DeviceFile), of(None, &second, AssignedBy::DeviceFile)];
        assert_eq!(given(&files, "can0"), ("a-c".into(), "device-file", true));
        let both = [of(Some("can0"), &profile, AssignedBy::Option), files[0].clone()];
        assert_eq!(given(&both, "can0"), ("rexroth-sydfec".into(), "option", true));
        assert_eq!(given(&both, "can1"), ("a-b".into(), "device-file", true));
    }
}

//! Delivery state of a device, or its configuration by a DCF: identifiers and values not seen on the bus.
//!
//! Values from the bus and from the user override them.

use std::sync::Arc;

use super::parameters::apply_object;
use crate::event::AssignedBy;
use crate::frame::CanId;
use crate::profile::{IdentifierOwner, PdoDirection, PdoName, evaluate_formula};
use crate::session::bus::RouteOrigin;
use crate::session::bus::{Bus, IdentifierService, cob_identifier};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Number of the default SDO channel if it has other identifiers; in addition to those of 1200 and up.
const MOVED_CHANNEL: u16 = 1;

/// Applies identifiers and DCF values of a device that was assigned to the node.
pub(in crate::session) fn take_delivered(bus: &mut Bus, id: NodeId, by: AssignedBy) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    if let Some(import) = &node.device.file {
        // A DCF found by identity may belong to another node with the same type of device.
        let is_its = by != AssignedBy::Identity || import.file.node_id.is_none_or(|own| own == id.number());
        if is_its {
            let values = import
                .file
                .objects
                .iter()
                .filter_map(|object| Some((object.address, object.configured_bytes(id.number())?)));
            Arc::make_mut(&mut node.store).set_expected(values);
        }
    }
    forget_delivered(bus, id);
    route_delivered(bus, id);
    let wanted = bus.node(id).map(|node| node.store.all_wanted()).unwrap_or_default();
    for object in wanted {
        apply_wanted(bus, id, object);
    }
}

/// Applies the delivered or configured value of an object whose present value is unknown again.
pub(in crate::session) fn revert_to_delivered(bus: &mut Bus, id: NodeId, object: ObjectAddress) {
    if bus.node(id).is_some_and(|node| node.store.get(object).is_some()) {
        apply_wanted(bus, id, object);
    } else {
        route_delivered(bus, id);
    }
}

/// Updates identifiers that depend on the node-ID after a change, except those that the manual excludes.
pub(in crate::session) fn move_delivered(bus: &mut Bus, id: NodeId) {
    forget_delivered(bus, id);
    route_delivered(bus, id);
}

/// Applies a value of the DCF. The heartbeat time is not used: the measured intervals are reliable.
fn apply_wanted(bus: &mut Bus, id: NodeId, object: ObjectAddress) {
    let Some(node) = bus.node(id).filter(|node| node.store.seen_value(object).is_none()) else { return };
    let number = node.store.number(object).unwrap_or(0);
    let is_taken = match (object.index, object.sub) {
        (0x1017, 0) => true,
        (0x1400..=0x15FF, 1) => {
            cob_identifier(number).is_some_and(|can_id| is_sent_by_another(bus, can_id, id))
        }
        _ => false,
    };
    if !is_taken {
        apply_object(bus, id, object);
    }
}

/// Removes the identifiers of the delivery state.
fn forget_delivered(bus: &mut Bus, id: NodeId) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let stays: Vec<PdoName> =
        node.device.identity_change.cob_ids_stay.iter().filter_map(|name| name.parse().ok()).collect();
    for can_id in std::mem::take(&mut node.delivered_ids) {
        let service = bus.routes.learnt_at(can_id);
        let is_its = match service {
            Some(IdentifierService::Pdo(name, node)) => node == id && !stays.contains(&name),
            Some(IdentifierService::Emcy(node)) => node == id,
            Some(IdentifierService::Sdo(_, channel)) => bus.channels.server_node(channel) == id.canopen(),
            _ => false,
        };
        if let Some(service) = service.filter(|_| is_its) {
            let default = bus.default_service(can_id);
            bus.routes.forget_service(can_id, service, default);
        }
    }
}

/// Routes the identifiers of the delivery state, for services without another identifier.
fn route_delivered(bus: &mut Bus, id: NodeId) {
    let Some(node) = bus.node(id) else { return };
    let device = Arc::clone(&node.device);
    for pdo in &device.pdos {
        let cob_id = pdo.cob_id.as_deref().and_then(|text| evaluate_formula(text, Some(id.number())));
        if let Some(can_id) = cob_id.and_then(cob_identifier) {
            apply_defaults(bus, id, IdentifierService::Pdo(pdo.pdo, id), can_id);
        }
    }
    for object in device.dictionary.defaults(is_cob_id) {
        let Some(can_id) = delivered_id(bus, id, object) else { continue };
        match (object.index, object.sub) {
            (0x1005, 0) => deliver_sync(bus, id, can_id),
            (0x1014, 0) => apply_defaults(bus, id, IdentifierService::Emcy(id), can_id),
            (0x1200, 1) => deliver_channel(bus, id, can_id),
            (_, 1) => {
                if let Some(name) = PdoName::of_parameter(object.index) {
                    apply_defaults(bus, id, IdentifierService::Pdo(name, id), can_id);
                }
            }
            _ => {}
        }
    }
}

/// Delivered identifier of an object; `None` if it is marked invalid, or the object value is known.
fn delivered_id(bus: &Bus, id: NodeId, object: ObjectAddress) -> Option<CanId> {
    let node = bus.node(id).filter(|node| node.store.get(object).is_none())?;
    let entry = node.device.dictionary.find_object(object)?.entry?;
    cob_identifier(u64::try_from(entry.default_number(Some(id.number()))?).ok()?)
}

fn apply_defaults(bus: &mut Bus, id: NodeId, service: IdentifierService, can_id: CanId) {
    let receives =
        matches!(service, IdentifierService::Pdo(name, _) if name.direction == PdoDirection::Receive);
    if bus.routes.is_placed(service)
        || present_service(bus, can_id) == Some(service)
        || receives && is_sent_by_another(bus, can_id, id)
    {
        return;
    }
    learn_delivered(bus, id, can_id, service);
}

fn learn_delivered(bus: &mut Bus, id: NodeId, can_id: CanId, service: IdentifierService) {
    bus.routes.learn_service(can_id, service);
    if let Some(node) = bus.nodes.node_mut(id) {
        node.delivered_ids.push(can_id);
    }
}

/// Sets the SYNC that a node uses; other nodes may use another one.
fn deliver_sync(bus: &mut Bus, id: NodeId, can_id: CanId) {
    if let Some(node) = bus.nodes.node_mut(id) {
        node.sync = can_id;
    }
    if present_service(bus, can_id) != Some(IdentifierService::Sync) {
        bus.routes.learn_service(can_id, IdentifierService::Sync);
    }
}

/// Routes the default SDO channel if it has other than the predefined identifiers (CiA 301 §7.5.2.33).
fn deliver_channel(bus: &mut Bus, id: NodeId, request: CanId) {
    let Some(response) = delivered_id(bus, id, ObjectAddress::new(0x1200, 2)) else { return };
    let predefined = [0x600, 0x580].map(|base: u16| CanId::from_standard(base + u16::from(id.number())));
    if [request, response] == predefined {
        return;
    }
    if let Some(channel) = bus.channels.add_channel(id.number(), MOVED_CHANNEL, request, response, None) {
        bus.routes.route_channel(channel, request, response);
        if let Some(node) = bus.nodes.node_mut(id) {
            node.delivered_ids.extend([request, response]);
        }
    }
}

/// Whether the identifier belongs to a TPDO of another node: then this node only receives it.
fn is_sent_by_another(bus: &Bus, can_id: CanId, id: NodeId) -> bool {
    matches!(present_service(bus, can_id), Some(IdentifierService::Pdo(name, node)) if node != id && name.direction == PdoDirection::Transmit)
}

/// Present service of an identifier, if a device can be delivered with this service.
fn present_service(bus: &Bus, can_id: CanId) -> Option<IdentifierService> {
    match bus.routes.route_origin(can_id) {
        RouteOrigin::Learnt(service) => Some(service),
        RouteOrigin::Default(IdentifierOwner::Pdo(name, node)) => {
            Some(IdentifierService::Pdo(name, node.into()))
        }
        RouteOrigin::Default(IdentifierOwner::Emcy(node)) => Some(IdentifierService::Emcy(node.into())),
        RouteOrigin::Default(IdentifierOwner::Sync) => Some(IdentifierService::Sync),
        RouteOrigin::Default(_) | RouteOrigin::J1939(_) => None,
    }
}

/// Objects with the identifiers of a node's own services.
const fn is_cob_id(object: ObjectAddress) -> bool {
    matches!(
        (object.index, object.sub),
        (0x1005 | 0x1014, 0) | (0x1200 | 0x1400..=0x15FF | 0x1800..=0x19FF, 1)
    )
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;
    use crate::event::{Event, EventKind, NodeIdSource};
    use crate::frame::{BusIndex, Frame, Timestamp};
    use crate::profile::{LayoutOrigin, device_file, imported};
    use crate::session::BusDecoder;
    use crate::session::identity::change_node_id;
    use crate::session::{Assignment, SessionOptions};

    /// A bus whose nodes have device files with these COB-IDs, as default or, after `=`, as configured value.
    fn bus(nodes: &[(u8, &[(&str, &str)])]) -> BusDecoder {
        let assignments = nodes.iter().map(|(node, objects)| {
            let mut text = String::new();
            for (object, value) in *objects {
                let index = object.split("sub").next().unwrap();
                if index != *object {
                    write!(text, "[{index}]\nParameterName=a\nObjectType=9\n").unwrap();
                }
                let (key, value) = match value.strip_prefix('=') {
                    Some(value) => ("ParameterValue", value),
                    None => ("DefaultValue", *value),
                };
                write!(text, "[{object}]\nParameterName=a\nDataType=7\nAccessType=rw\n{key}={value}\n")
                    .unwrap();
            }
            let file = Arc::new(device_file::parse_device_file(text.as_bytes()).unwrap());
            let device = Arc::new(imported::describe_device(&file, "a.eds"));
            Assignment { bus: None, node: (*node).into(), device, by: AssignedBy::DeviceFile }
        });
        let options = SessionOptions { assignments: assignments.collect(), ..SessionOptions::default() };
        BusDecoder::new(BusIndex(0), "can0", Arc::new(options))
    }

    /// Meaning of frames with these identifiers.
    fn seen(bus: &mut BusDecoder, ids: &[u16]) -> Vec<String> {
        let mut seen = Vec::new();
        for (number, id) in (1..).zip(ids) {
            let mut frame = Frame::data_frame(CanId::from_standard(*id), &[0; 8]);
            (frame.number, frame.time) = (number, Some(Timestamp(i64::try_from(number).unwrap())));
            bus.push(&frame, &mut |_: &Event, _: &Bus| {});
        }
        seen.extend(ids.iter().map(|id| {
            let slot = bus
                .bus()
                .routes
                .find_slot(CanId::from_standard(*id))
                .and_then(|slot| bus.bus().routes.slot(slot));
            match slot.unwrap().service {
                IdentifierService::Pdo(name, node) => format!("{name} of {node}"),
                IdentifierService::Emcy(node) => format!("EMCY of {node}"),
                IdentifierService::Sdo(side, channel) => {
                    format!("SDO {side:?} of {}", bus.bus().channels.server_node(channel).unwrap())
                }
                other => format!("{other:?}"),
            }
        }));
        seen
    }

    const NODE_5: &[(&str, &str)] = &[
        ("1005", "0x400000A0"),
        ("1014", "$NODEID+0x6A0"),
        ("1200sub1", "$NODEID+0x640"),
        ("1200sub2", "$NODEID+0x5C0"),
        ("1400sub1", "$NODEID+0x200"),
        ("1800sub1", "$NODEID+0x400001C0"),
        ("1801sub1", "$NODEID+0x80000300"),
    ];

    #[test]
    fn identifiers_by_default_are_routed_where_they_are_not_the_predefined_ones() {
        let mut bus = bus(&[(5, NODE_5)]);
        let found = seen(&mut bus, &[0x0A0, 0x6A5, 0x645, 0x5C5, 0x205, 0x1C5, 0x305, 0x285]);
        let expected = [
            "Sync",
            "EMCY of 5",
            "SDO Client of 5",
            "SDO Server of 5",
            "RPDO1 of 5",
            "TPDO1 of 5",
            // Marked invalid: the predefined connection set applies.
            "RPDO2 of 5",
            "TPDO2 of 5",
        ];
        assert_eq!(found, expected);
        assert_eq!(bus.bus().node(5).unwrap().sync, CanId::from_standard(0xA0));
    }

    #[test]
    fn who_listens_does_not_take_the_identifier_of_who_sends() {
        // Node 5 receives TPDO1 of node 4, and its TPDO2, which has another identifier.
        let listener: &[(&str, &str)] =
            &[("1400sub1", "=0x184"), ("1401sub1", "0x3A0"), ("1402sub1", "=0x3A1")];
        let sender: &[(&str, &str)] = &[("1801sub1", "0x3A0")];
        for order in [[(4, sender), (5, listener)], [(5, listener), (4, sender)]] {
            let found = seen(&mut bus(&order), &[0x184, 0x3A0, 0x3A1]);
            assert_eq!(found[..2], ["TPDO1 of 4", "TPDO2 of 4"]);
        }
        let unassigned = seen(&mut bus(&[(5, &[("1402sub1", "=0x6B1")])]), &[0x6B1]);
        assert_eq!(unassigned, ["RPDO3 of 5"]);
    }

    /// An expedited upload of four bytes.
    fn upload(bus: &mut BusDecoder, node: u8, object: (u16, u8), value: u32) -> Vec<Event> {
        let [low, high] = object.0.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        let request = [0x40, low, high, object.1, 0, 0, 0, 0];
        let response = [0x43, low, high, object.1, a, b, c, d];
        let mut events = Vec::new();
        for (base, data) in [(0x600, request), (0x580, response)] {
            let mut frame = Frame::data_frame(CanId::from_standard(base + u16::from(node)), &data);
            frame.number = bus.bus().last_frame + 1;
            frame.time = Some(Timestamp(1_000_000 * i64::try_from(frame.number).unwrap()));
            bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
        }
        events
    }

    #[test]
    fn what_the_wire_tells_goes_before_it() {
        let mut bus = bus(&[(5, &[("1800sub1", "$NODEID+0x1C0")])]);
        assert_eq!(seen(&mut bus, &[0x1C5]), ["TPDO1 of 5"]);
        upload(&mut bus, 5, (0x1800, 1), 0x4000_01B5);
        assert_eq!(seen(&mut bus, &[0x1B5, 0x1C5]), ["TPDO1 of 5", "TPDO1 of 69"]);
    }

    #[test]
    fn identifiers_follow_the_node_id() {
        let mut bus = bus(&[(5, &[("1800sub1", "$NODEID+0x1C0"), ("1801sub1", "0x2F0")])]);
        seen(&mut bus, &[0x1C5]);
        let mut observer = |_: &Event, _: &Bus| {};
        change_node_id(
            Some(5.into()),
            6.into(),
            NodeIdSource::Lss,
            &Frame::EMPTY,
            &mut bus.lend_context(&mut observer),
        );
        assert_eq!(seen(&mut bus, &[0x1C5, 0x1C6, 0x2F0]), ["TPDO1 of 69", "TPDO1 of 6", "TPDO2 of 6"]);
    }

    #[test]
    fn a_wanted_value_holds_until_the_wire_tells_another() {
        let mut bus = bus(&[(5, &[("1017", "=500"), ("1A00sub0", "=1"), ("1A00sub1", "=0x20000010")])]);
        let layout = |bus: &mut BusDecoder| {
            let mut layout = None;
            let mut frame = Frame::data_frame(CanId::from_standard(0x185), &[1, 2]);
            frame.number = 50;
            bus.push(&frame, &mut |event: &Event, _: &Bus| {
                if let EventKind::Pdo(pdo) = &event.kind {
                    layout.clone_from(&pdo.layout);
                }
            });
            let layout = layout.unwrap();
            (layout.origin, layout.assumed, layout.fields[0].object().unwrap().index)
        };
        assert_eq!(layout(&mut bus), (LayoutOrigin::Dcf, true, 0x2000));
        // The heartbeat time follows from the intervals.
        assert_eq!(bus.bus().node(5).unwrap().heartbeat.configured, None);
        upload(&mut bus, 5, (0x1A00, 0), 1);
        assert_eq!(layout(&mut bus), (LayoutOrigin::Wire, true, 0x2000));
        upload(&mut bus, 5, (0x1A00, 1), 0x2001_0010);
        assert_eq!(layout(&mut bus), (LayoutOrigin::Wire, false, 0x2001));
    }
}

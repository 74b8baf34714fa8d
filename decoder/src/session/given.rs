//! Applies the user's options and bus file to a bus before its first frame.

use std::sync::Arc;

use crate::bus_file::{AreaEntry, ObjectValue, encode};
use crate::frame::CanId;
use crate::profile::device::PdoField;
use crate::profile::{Owner, Reference};
use crate::session::bus::{Bus, Origin, OriginKind, Pairs, Service};
use crate::session::context::Context;
use crate::session::identity::{assign, given_devices};
use crate::session::objects::apply_object;
use crate::session::options::{ProtocolChoice, SessionOptions};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::Side;

/// Number of the SDO channel in the bus file, in addition to those of objects 1200 and up.
const GIVEN_CHANNEL: u16 = 0;

/// Applies the bus file. Identifiers are applied first, because they override those in objects.
pub(in crate::session) fn apply_given(cx: &mut Context<'_>) {
    let options = Arc::clone(&cx.bus.options);
    let name = Arc::clone(&cx.bus.name);
    let owners: Vec<(CanId, Owner)> = options.bus_file.owners(&name).collect();
    for (id, owner) in &owners {
        let service = match owner {
            Owner::Sdo(_, node) => given_channel(&mut cx.bus, *node, &owners),
            _ => None,
        };
        let service = match (owner, service) {
            (Owner::Sdo(side, _), Some(channel)) => Service::Sdo(*side, channel),
            _ => cx.bus.service_of(*owner),
        };
        cx.bus.routes.give(*id, service);
    }
    if cx.bus.protocol != ProtocolChoice::None {
        name_nodes(&mut cx.bus, &options);
    }
    let pairs = Pairs::new(options.bus_file.uds(&name).cloned().collect());
    for (id, link) in pairs.links() {
        cx.bus.routes.name(id, link);
    }
    cx.bus.uds_pairs = Arc::new(pairs);
    for (node, device, by) in given_devices(&options.assignments, &name) {
        assign(node, &device, by, cx);
    }
    for (id, address, value) in options.bus_file.objects(&name) {
        give_object(&mut cx.bus, *id, *address, value);
    }
    give_areas(&mut cx.bus, &options, &name);
    for (id, conversion) in options.bus_file.conversions(&name) {
        if let Some(node) = cx.bus.node_mut(id) {
            node.j1939_state().conversion = Some(conversion);
        }
    }
    for (id, address, unit) in options.bus_file.units(&name) {
        if let Some(node) = cx.bus.node_mut(*id) {
            Arc::make_mut(&mut node.store).give_unit(*address, unit);
        }
    }
}

/// Settles the protocol of the nodes that the user named, or that a database describes.
fn name_nodes(bus: &mut Bus, options: &SessionOptions) {
    for (node, is_own) in options.named_nodes(&bus.name) {
        bus.named.add(node, is_own);
    }
    for node in bus.database.canopen_nodes() {
        bus.named.add(NodeId::Canopen(node), false);
    }
}

/// Splits the areas listed in the bus file into PDOs of eight bytes, in order.
fn give_areas(bus: &mut Bus, options: &SessionOptions, name: &str) {
    for node in &mut bus.nodes {
        let mut pdos = Vec::new();
        for area in &node.device.areas {
            let entries = options.bus_file.area(name, node.id, &area.name).unwrap_or_default();
            let names = area.pdos.iter().filter_map(|name| name.parse().ok());
            pdos.extend(names.zip(slices(entries)));
        }
        node.given_pdos = Arc::new(pdos);
    }
}

/// Stores an object value from the bus file; a number has the size of its object.
fn give_object(bus: &mut Bus, id: NodeId, address: ObjectAddress, value: &ObjectValue) {
    const ORIGIN: Origin = Origin { kind: OriginKind::BusFile, frame: 0, time: None };
    let Some(node) = bus.node_mut(id) else { return };
    let bytes = match value {
        ObjectValue::Bytes(bytes) => bytes.clone(),
        ObjectValue::Number(number) => {
            let data_type = node.device.dictionary.data_type(address);
            match encode(*number, data_type).or_else(|_| encode(*number, None)) {
                Ok(bytes) => bytes,
                Err(_) => return,
            }
        }
    };
    // If the store is full, the value is ignored: no real file lists that many objects.
    if Arc::make_mut(&mut node.store).set(address, &bytes, ORIGIN).is_ok() {
        apply_object(bus, id, address);
    }
}

/// SDO channel of a node with the identifiers in the bus file; a missing identifier has its default value.
fn given_channel(bus: &mut Bus, node: u8, owners: &[(CanId, Owner)]) -> Option<u16> {
    let find = |side, base: u16| {
        let given = owners.iter().find(|(_, owner)| *owner == Owner::Sdo(side, node));
        given.map_or(CanId::standard(base + u16::from(node)), |(id, _)| *id)
    };
    let (request, response) = (find(Side::Client, 0x600), find(Side::Server, 0x580));
    bus.channels.add(node, GIVEN_CHANNEL, request, response, None)
}

/// Splits the entries of an area into PDOs of eight bytes. An entry that continues in the next PDO is not
/// decoded: both its parts are placeholders.
fn slices(entries: &[AreaEntry]) -> Vec<Vec<PdoField>> {
    const PDO_BITS: u16 = 64;
    let mut pdos = vec![Vec::new()];
    let mut free = PDO_BITS;
    for entry in entries {
        let mut bits = u16::from(entry.bytes) * 8;
        let whole = bits <= free;
        while bits > 0 {
            let taken = bits.min(free);
            let object = whole.then_some(Reference { object: entry.object, step: Some(0) });
            if let Some(pdo) = pdos.last_mut() {
                pdo.push(PdoField { object, bits: taken, constant: None });
            }
            bits -= taken;
            free -= taken;
            if free == 0 {
                pdos.push(Vec::new());
                free = PDO_BITS;
            }
        }
    }
    pdos
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus_file::BusFile;
    use crate::event::{Event, EventKind};
    use crate::frame::{BusIndex, Frame, Timestamp};
    use crate::profile::{PdoDirection, PdoName};
    use crate::session::BusDecoder;
    use crate::session::SessionOptions;
    use crate::wire::canopen::ObjectAddress;

    fn bus(text: &str) -> BusDecoder {
        let bus_file = BusFile::parse(text).unwrap();
        BusDecoder::new(
            BusIndex(0),
            "can0",
            Arc::new(SessionOptions { bus_file, ..SessionOptions::default() }),
        )
    }

    fn events(bus: &mut BusDecoder, frames: &[(CanId, &[u8])]) -> Vec<Event> {
        let mut events = Vec::new();
        for (number, (id, data)) in (1..).zip(frames) {
            let mut frame = Frame::data_frame(*id, data);
            frame.number = number;
            frame.time = Some(Timestamp(1_000_000 * i64::try_from(number).unwrap()));
            bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
        }
        events
    }

    #[test]
    fn an_area_is_sliced_in_order() {
        let entry = |index, bytes| AreaEntry { object: ObjectAddress::new(index, 0), bytes };
        let pdos = slices(&[entry(0x2001, 4), entry(0x2002, 2), entry(0x2003, 4), entry(0x2004, 2)]);
        let shown: Vec<Vec<_>> = pdos
            .iter()
            .map(|pdo| pdo.iter().map(|it| (it.object.map(|of| of.object.index), it.bits)).collect())
            .collect();
        assert_eq!(shown[0], [(Some(0x2001), 32), (Some(0x2002), 16), (None, 16)]);
        assert_eq!(shown[1], [(None, 16), (Some(0x2004), 16)]);
    }

    #[test]
    fn an_sdo_channel_on_29_bits() {
        let mut bus = bus(r#"
            [[id]]
            id = 0x18DA05F1
            service = "sdo-request"
            node = 5
            [[id]]
            id = 0x18DAF105
            service = "sdo-response"
            node = 5
        "#);
        let (request, response) = (CanId::extended(0x18DA_05F1), CanId::extended(0x18DA_F105));
        let events = events(
            &mut bus,
            &[
                (request, &[0x40, 0x17, 0x10, 0, 0, 0, 0, 0]),
                (response, &[0x4B, 0x17, 0x10, 0, 0xE8, 3, 0, 0]),
            ],
        );
        let transfer = events.iter().find_map(|event| match &event.kind {
            EventKind::SdoTransfer(transfer) => Some(transfer),
            _ => None,
        });
        let transfer = transfer.unwrap();
        assert_eq!(transfer.object, Some(ObjectAddress::new(0x1017, 0)));
        assert_eq!((transfer.request, transfer.response), (request, response));
    }

    #[test]
    fn what_is_given_goes_before_what_is_learnt() {
        let tpdo2 = PdoName { direction: PdoDirection::Transmit, number: 2 };
        let mut bus = bus("[[id]]\nid = 0x1A0\nservice = \"tpdo2\"\nnode = 7\n");
        // 1800:01 of node 5 sets the COB-ID of its TPDO1 to 1A0.
        let events = events(
            &mut bus,
            &[
                (CanId::standard(0x605), &[0x23, 0x00, 0x18, 1, 0xA0, 1, 0, 0]),
                (CanId::standard(0x585), &[0x60, 0x00, 0x18, 1, 0, 0, 0, 0]),
                (CanId::standard(0x1A0), &[1]),
            ],
        );
        let pdos = events.iter().filter_map(|event| match &event.kind {
            EventKind::Pdo(pdo) => Some((pdo.name, event.node)),
            _ => None,
        });
        assert_eq!(pdos.collect::<Vec<_>>(), [(tpdo2, Some(7.into()))]);
    }

    #[test]
    fn objects_that_are_given_make_layouts() {
        let mut bus = bus(r#"
            [[node.5.object]]
            object = "1A00:01"
            value = 0x60410010
            [[node.5.object]]
            object = "1A00:00"
            value = 1
        "#);
        let events = events(&mut bus, &[(CanId::standard(0x185), &[0x37, 0x02])]);
        let layout = events.iter().find_map(|event| match &event.kind {
            EventKind::Pdo(pdo) => pdo.layout.clone(),
            _ => None,
        });
        let layout = layout.unwrap();
        assert_eq!(
            (layout.origin, layout.fields[0].object()),
            ("bus-file", Some(ObjectAddress::new(0x6041, 0)))
        );
    }
}

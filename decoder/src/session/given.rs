//! Applies the user's options and bus file to a bus before its first frame.

use std::sync::Arc;

use crate::bus_file::{
    AreaEntry, InitialState, InitialValue, ObjectValue, PendingReset, ValueOrigin, ValueRole, encode_number,
};
use crate::event::{EventKind, StateCause, StateCertainty, StateChange};
use crate::frame::{CanId, Frame};
use crate::profile::device::PdoField;
use crate::profile::{IdentifierOwner, ObjectReference, WriteEffect, little_endian};
use crate::session::bus::{
    Bus, IdentifierService, MachineState, NmtStatus, OriginKind, PendingValue, RestartType, StoredOrigin,
    UdsPairs,
};
use crate::session::context::MachineContext;
use crate::session::identity::{assign_device, given_devices, identify_node};
use crate::session::objects::apply_object;
use crate::session::options::{ProtocolChoice, SessionOptions};
use crate::wire::NodeId;
use crate::wire::canopen::sdo::SdoSide;

/// Number of the SDO channel in the bus file, in addition to those of objects 1200 and up.
const GIVEN_CHANNEL: u16 = 0;

/// Applies the bus file. Identifiers are applied first, because they override those in objects.
pub(in crate::session) fn apply_given(cx: &mut MachineContext<'_>) {
    let options = Arc::clone(&cx.bus.options);
    let name = Arc::clone(&cx.bus.name);
    let owners: Vec<(CanId, IdentifierOwner)> = options.bus_file.owners(&name).collect();
    for (id, owner) in &owners {
        let service = match owner {
            IdentifierOwner::Sdo(_, node) => given_channel(&mut cx.bus, *node, &owners),
            _ => None,
        };
        let service = match (owner, service) {
            (IdentifierOwner::Sdo(side, _), Some(channel)) => IdentifierService::Sdo(*side, channel),
            _ => cx.bus.service_of(*owner),
        };
        cx.bus.routes.set_service(*id, service);
    }
    if cx.bus.protocols.choice != ProtocolChoice::None {
        name_nodes(&mut cx.bus, &options);
    }
    let pairs = UdsPairs::new(options.bus_file.uds(&name).cloned().collect());
    for (id, link) in pairs.identifier_links() {
        cx.bus.routes.assign_named_link(id, link);
    }
    cx.bus.uds_pairs = Arc::new(pairs);
    for (node, device, by) in given_devices(&options.assignments, &name) {
        assign_device(node, &device, by, cx);
    }
    for object in options.bus_file.objects(&name) {
        give_object(&mut cx.bus, object);
    }
    for object in options.bus_file.objects(&name).filter(|object| object.origin.is_some()) {
        // The observer never receives the event: the earlier capture contained it.
        identify_node(object.node, object.address, &Frame::EMPTY, cx);
    }
    for (id, state) in options.bus_file.states(&name) {
        give_state(&mut cx.bus, *id, state);
        cx.bus.has_given_states |= state.nmt.is_some();
    }
    give_areas(&mut cx.bus, &options, &name);
    for (id, conversion) in options.bus_file.conversions(&name) {
        if let Some(node) = cx.bus.nodes.node_mut(id) {
            node.j1939_state().conversion = Some(conversion);
        }
    }
    for (id, address, unit) in options.bus_file.units(&name) {
        if let Some(node) = cx.bus.nodes.node_mut(*id) {
            Arc::make_mut(&mut node.store).give_unit(*address, unit);
        }
    }
}

/// Settles the protocol of the nodes that the user named, or that a database describes.
fn name_nodes(bus: &mut Bus, options: &SessionOptions) {
    for (node, is_own) in options.named_nodes(&bus.name) {
        bus.protocols.named.add_node(node, is_own);
    }
    for node in bus.database.canopen_nodes() {
        bus.protocols.named.add_node(NodeId::Canopen(node), false);
    }
}

/// Splits the areas listed in the bus file into PDOs of eight bytes, in order.
fn give_areas(bus: &mut Bus, options: &SessionOptions, name: &str) {
    for node in bus.nodes.all_mut() {
        let mut pdos = Vec::new();
        for area in &node.device.areas {
            let entries = options.bus_file.area_entries(name, node.id, &area.name).unwrap_or_default();
            let names = area.pdos.iter().filter_map(|name| name.parse().ok());
            pdos.extend(names.zip(split_area(entries)));
        }
        node.given_pdos = Arc::new(pdos);
    }
}

/// Stores an object value from the bus file; a number has the size of its object.
fn give_object(bus: &mut Bus, object: &InitialValue) {
    let (id, address) = (object.node, object.address);
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let entry = node.device.dictionary.find_object(address).and_then(|found| found.entry);
    let bytes = match &object.value {
        ObjectValue::Bytes(bytes) => bytes.clone(),
        ObjectValue::Number(number) => {
            let data_type = entry.and_then(|entry| entry.data_type);
            match encode_number(*number, data_type).or_else(|_| encode_number(*number, None)) {
                Ok(bytes) => bytes,
                Err(_) => return,
            }
        }
    };
    let kind = match object.origin {
        None => OriginKind::BusFile,
        Some(ValueOrigin::Download) => OriginKind::Download,
        Some(ValueOrigin::Upload) => OriginKind::Upload,
        Some(ValueOrigin::Pdo) => OriginKind::Pdo,
    };
    // Frames of the earlier capture have no number in this one.
    let origin = StoredOrigin { kind, frame: 0, time: None };
    let effect = entry.map_or(WriteEffect::Unknown, |entry| entry.effect);
    let store = Arc::make_mut(&mut node.store);
    match object.role {
        ValueRole::Pending => store.add_waiting(address, PendingValue { value: bytes, effect, origin }),
        ValueRole::Stored => store.set_kept(address, bytes),
        ValueRole::Process if bytes.len() <= 8 => {
            node.behaviour.note_value(address, little_endian(&bytes));
        }
        ValueRole::Process => {}
        ValueRole::Effective => {
            // If the store is full, the value is ignored: no real file lists that many objects.
            if store.set(address, &bytes, origin).is_ok() {
                if object.is_assumed {
                    store.mark_doubtful(address);
                }
                apply_object(bus, id, address);
            }
        }
    }
}

/// Emits the states in the bus file at the first frame, so that observers know them.
#[cold]
pub(in crate::session) fn emit_given_states(frame: &Frame, cx: &mut MachineContext<'_>) {
    cx.bus.has_given_states = false;
    let now = cx.bus.clock.now();
    let given = cx.bus.nodes.all_mut().iter_mut().filter_map(|node| {
        let nmt = node.nmt.as_mut().filter(|nmt| matches!(nmt.cause, StateCause::BusFile { .. }))?;
        nmt.since = now;
        Some((node.id, *nmt))
    });
    for (id, nmt) in given.collect::<Vec<_>>() {
        let change = StateChange {
            from: None,
            to: nmt.state,
            cause: nmt.cause,
            cause_frame: frame.number,
            after: None,
            certainty: nmt.certainty,
        };
        cx.emit_event(frame, id, true, EventKind::NmtState(change));
    }
}

/// Sets the state of a node before its first frame.
fn give_state(bus: &mut Bus, id: NodeId, state: &InitialState) {
    let since = bus.clock.now();
    let Some(node) = bus.nodes.node_mut(id) else { return };
    node.nmt = state.nmt.map(|nmt| NmtStatus {
        state: nmt.state,
        certainty: if nmt.is_assumed { StateCertainty::Presumed } else { StateCertainty::Confirmed },
        cause: StateCause::BusFile { is_reported: nmt.is_reported },
        frame: 0,
        since,
    });
    if let Some(name) = state.name {
        node.j1939_state().name = Some(name);
    }
    node.reset_frame = state.reset.map(|reset| match reset {
        PendingReset::Communication => (0, RestartType::Communication),
        PendingReset::Node => (0, RestartType::Node),
    });
    node.was_present = true;
    node.lost = state.is_lost;
    node.saved = state.is_saved;
    for code in &state.errors {
        node.errors.raise_error(*code);
    }
    node.refresh_attention();
    let device = Arc::clone(&node.device);
    let known = device.machines.iter().zip(&state.device).map(|(machine, name)| {
        let place = machine.states.iter().position(|state| state.name == *name);
        let state = place.and_then(|place| u8::try_from(place).ok());
        let control = node.behaviour.last_word(machine.control.object.object);
        MachineState { state, since, control, control_since: since, ..MachineState::default() }
    });
    node.behaviour.machines = known.collect();
}

/// SDO channel of a node with the identifiers in the bus file; a missing identifier has its default value.
fn given_channel(bus: &mut Bus, node: u8, owners: &[(CanId, IdentifierOwner)]) -> Option<u16> {
    let find = |side, base: u16| {
        let given = owners.iter().find(|(_, owner)| *owner == IdentifierOwner::Sdo(side, node));
        given.map_or(CanId::from_standard(base + u16::from(node)), |(id, _)| *id)
    };
    let (request, response) = (find(SdoSide::Client, 0x600), find(SdoSide::Server, 0x580));
    bus.channels.add_channel(node, GIVEN_CHANNEL, request, response, None)
}

/// Splits the entries of an area into PDOs of eight bytes. An entry that continues in the next PDO is not
/// decoded: both its parts are placeholders.
fn split_area(entries: &[AreaEntry]) -> Vec<Vec<PdoField>> {
    const PDO_BITS: u16 = 64;
    let mut pdos = vec![Vec::new()];
    let mut free = PDO_BITS;
    for entry in entries {
        let mut bits = u16::from(entry.bytes) * 8;
        let whole = bits <= free;
        while bits > 0 {
            let taken = bits.min(free);
            let object = whole.then_some(ObjectReference { object: entry.object, step: Some(0) });
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
    use crate::event::Event;
    use crate::frame::{BusIndex, Frame, Timestamp};
    use crate::profile::{LayoutOrigin, PdoDirection, PdoName};
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
        let pdos = split_area(&[entry(0x2001, 4), entry(0x2002, 2), entry(0x2003, 4), entry(0x2004, 2)]);
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
        let (request, response) = (CanId::from_extended(0x18DA_05F1), CanId::from_extended(0x18DA_F105));
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
                (CanId::from_standard(0x605), &[0x23, 0x00, 0x18, 1, 0xA0, 1, 0, 0]),
                (CanId::from_standard(0x585), &[0x60, 0x00, 0x18, 1, 0, 0, 0, 0]),
                (CanId::from_standard(0x1A0), &[1]),
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
        let events = events(&mut bus, &[(CanId::from_standard(0x185), &[0x37, 0x02])]);
        let layout = events.iter().find_map(|event| match &event.kind {
            EventKind::Pdo(pdo) => pdo.layout.clone(),
            _ => None,
        });
        let layout = layout.unwrap();
        assert_eq!(
            (layout.origin, layout.fields[0].object()),
            (LayoutOrigin::BusFile, Some(ObjectAddress::new(0x6041, 0)))
        );
    }
}

//! Effect of communication parameters: COB-IDs, PDO mappings, timers, SDO channels.

use crate::profile::PdoName;
use crate::session::bus::{Bus, IdentifierService, cob_identifier, predefined_identifier};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Bit 31 of a PDO's COB-ID: the PDO does not exist.
const INVALID: u64 = 1 << 31;

/// Default identifier of SYNC (CiA 301 §7.5.2.5).
const SYNC: u64 = 0x80;

/// Indices of the objects that have an effect here.
const PARAMETERS: std::ops::RangeInclusive<u16> = 0x1005..=0x1BFF;

pub(in crate::session) fn apply_object(bus: &mut Bus, id: NodeId, address: ObjectAddress) {
    if !PARAMETERS.contains(&address.index) {
        return;
    }
    let Some(number) = bus.nodes.object_number(id, address) else { return };
    match (address.index, address.sub) {
        (0x1005, 0) => own_sync(bus, id, number),
        (0x1012, 0) => route_to(bus, IdentifierService::Time, number & !0xC000_0000),
        (0x1014, 0) => route_to(bus, IdentifierService::Emcy(id), number),
        (0x1017, 0) => heartbeat_time(bus, id, number),
        (0x1200..=0x127F, _) => learn_channel(bus, id, address.index),
        (0x1280..=0x12FF, _) => learn_client(bus, id, address.index),
        (0x1400..=0x1BFF, _) => learn_pdo(bus, id, address),
        _ => {}
    }
}

/// Changes the identifier of a service; the old one returns to its default service.
fn route_to(bus: &mut Bus, service: IdentifierService, cob_id: u64) {
    let new = cob_identifier(cob_id);
    if let Some(old) = bus.routes.learnt_id(service).filter(|old| Some(*old) != new) {
        let default = bus.default_service(old);
        bus.routes.forget_service(old, service, default);
    }
    if let Some(id) = new.filter(|id| id.number() != 0 && bus.default_service(*id) != service) {
        bus.routes.learn_service(id, service);
    }
}

fn heartbeat_time(bus: &mut Bus, id: NodeId, milliseconds: u64) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let nanoseconds = i64::try_from(milliseconds).unwrap_or(0).saturating_mul(1_000_000);
    node.heartbeat.configured = Some(nanoseconds);
    if nanoseconds == 0 {
        node.heartbeat.deadline = None;
    }
}

/// SDO server parameter 1201 and up: client to server in sub 1, server to client in sub 2.
fn learn_channel(bus: &mut Bus, id: NodeId, index: u16) {
    if index == 0x1200 {
        return;
    }
    let ids = [1, 2]
        .map(|sub| bus.nodes.object_number(id, ObjectAddress::new(index, sub)).and_then(cob_identifier));
    let client =
        bus.nodes.object_number(id, ObjectAddress::new(index, 3)).and_then(|id| u8::try_from(id).ok());
    if let [Some(request), Some(response)] = ids
        && let Some(channel) = bus.channels.add_channel(id.number(), index, request, response, client)
    {
        bus.routes.route_channel(channel, request, response);
    }
}

/// SDO client parameter 1280 and up: server that the node accesses, and the identifiers.
fn learn_client(bus: &mut Bus, id: NodeId, index: u16) {
    let number = |sub| bus.nodes.object_number(id, ObjectAddress::new(index, sub));
    let ids = [number(1).and_then(cob_identifier), number(2).and_then(cob_identifier)];
    let server = number(3).and_then(|server| u8::try_from(server).ok());
    if let ([Some(request), Some(response)], Some(server @ 1..=127)) = (ids, server)
        && let Some(channel) = bus.channels.of_client(server, index, request, response, id.number())
    {
        bus.routes.route_channel(channel, request, response);
    }
}

/// Applies a PDO parameter. The identifier takes effect when it becomes valid. The mapping takes effect when
/// the PDO becomes valid again; if it stayed valid, with the number of entries.
fn learn_pdo(bus: &mut Bus, id: NodeId, address: ObjectAddress) {
    let Some(name) = PdoName::of_parameter(address.index) else { return };
    let service = IdentifierService::Pdo(name, id);
    let cob_id = bus.nodes.object_number(id, ObjectAddress::new(name.communication_index(), 1));
    let is_valid = cob_id.is_none_or(|cob_id| cob_id & INVALID == 0);
    if address == ObjectAddress::new(name.communication_index(), 1)
        && let Some(cob_id) = cob_id
    {
        // While bit 31 is set, frames on the old identifier still belong to the PDO: it should not be sent.
        if is_valid {
            route_to(bus, service, cob_id);
        }
        route_predefined(bus, name, id);
        bus.nodes.refresh_pdo_users();
    }
    let is_mapping = address.index == name.mapping_index();
    if is_valid && (is_mapping || address.sub == 1) {
        bus.routes.refresh_pdo(name, id);
    }
}

/// Updates the service of the predefined identifier of a TPDO: after the TPDO moved to another identifier, its
/// producer is unknown.
fn route_predefined(bus: &mut Bus, name: PdoName, id: NodeId) {
    let Some(default) = predefined_identifier(name, id).filter(|_| name.is_sent()) else { return };
    let service = bus.default_service(default);
    let is_old = matches!(bus.routes.service_of(default), Some(IdentifierService::Pdo(of, node)) if (of, node) == (name, id));
    let is_orphan = bus.routes.service_of(default) == Some(IdentifierService::Unclassified);
    if (is_old || is_orphan)
        && bus.routes.learnt_at(default).is_none()
        && bus.routes.service_of(default) != Some(service)
    {
        bus.routes.reroute(default, service);
    }
}

/// Returns identifiers and times to their defaults after an object value became unknown.
pub(in crate::session) fn revert_object(bus: &mut Bus, id: NodeId, address: ObjectAddress) {
    match (address.index, address.sub) {
        (0x1005, 0) => own_sync(bus, id, SYNC),
        (0x1014, 0) => forget_route(bus, IdentifierService::Emcy(id)),
        (0x1017, 0) => {
            if let Some(node) = bus.nodes.node_mut(id) {
                node.heartbeat.configured = None;
            }
        }
        (0x1400..=0x1BFF, 1) => {
            if let Some(name) = PdoName::of_parameter(address.index) {
                forget_route(bus, IdentifierService::Pdo(name, id));
                route_predefined(bus, name, id);
                bus.nodes.refresh_pdo_users();
            }
        }
        _ => {}
    }
}

fn forget_route(bus: &mut Bus, service: IdentifierService) {
    if let Some(old) = bus.routes.learnt_id(service) {
        let default = bus.default_service(old);
        bus.routes.forget_service(old, service, default);
    }
}

/// Sets the SYNC that a node uses; identifiers of other SYNCs stay, because other nodes may use them.
fn own_sync(bus: &mut Bus, id: NodeId, cob_id: u64) {
    let Some(sync) = cob_identifier(cob_id & !0xC000_0000) else { return };
    if let Some(node) = bus.nodes.node_mut(id) {
        node.sync = sync;
    }
    if sync.number() != 0 && bus.default_service(sync) != IdentifierService::Sync {
        bus.routes.learn_service(sync, IdentifierService::Sync);
    }
}

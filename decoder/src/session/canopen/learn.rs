//! What an object tells of the bus: COB-IDs, PDO mappings, timers, SDO channels.

use crate::frame::CanId;
use crate::profile::PdoName;
use crate::session::Bus;
use crate::session::routes::Service;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Bit 31 of a PDO's COB-ID: it does not exist. Bit 29 of any COB-ID: it has 29 bits.
const INVALID: u64 = 1 << 31;
const EXTENDED: u64 = 1 << 29;

/// Default identifier of SYNC (CiA 301 §7.5.2.5).
const SYNC: u64 = 0x80;

/// The identifier in a COB-ID object; `None` while it is marked invalid.
#[expect(clippy::cast_possible_truncation, reason = "masked to the identifier's width")]
fn identifier(cob_id: u64) -> Option<CanId> {
    if cob_id & INVALID != 0 {
        return None;
    }
    Some(if cob_id & EXTENDED != 0 { CanId::extended(cob_id as u32) } else { CanId::standard(cob_id as u16) })
}

impl Bus {
    pub(in crate::session) fn take_effect(&mut self, id: NodeId, address: ObjectAddress) {
        let Some(number) = self.number(id, address) else { return };
        match (address.index, address.sub) {
            (0x1005, 0) => self.own_sync(id, number),
            (0x1012, 0) => self.route_to(Service::Time, number & !0xC000_0000),
            (0x1014, 0) => self.route_to(Service::Emcy(id), number),
            (0x1017, 0) => self.heartbeat_time(id, number),
            (0x1200..=0x127F, _) => self.learn_channel(id, address.index),
            (0x1280..=0x12FF, _) => self.learn_client(id, address.index),
            (0x1400..=0x1BFF, _) => self.learn_pdo(id, address),
            _ => {}
        }
    }

    /// A number in the store of a node.
    pub(in crate::session) fn number(&self, id: NodeId, address: ObjectAddress) -> Option<u64> {
        self.node(id)?.store().number(address)
    }

    /// The identifier of a service changed: the old one goes back to its default, unless another uses it.
    fn route_to(&mut self, service: Service, cob_id: u64) {
        let new = identifier(cob_id);
        if let Some(old) = self.routes.learnt_id(service).filter(|old| Some(*old) != new) {
            let default = self.default_service(old);
            self.routes.forget(old, service, default);
        }
        if let Some(id) = new.filter(|id| id.number() != 0 && self.default_service(*id) != service) {
            self.routes.learn(id, service);
        }
    }

    /// What an identifier is where nothing was learnt of it.
    pub(in crate::session) fn default_service(&mut self, id: CanId) -> Service {
        let CanId::Standard(id) = id else { return Service::Unclassified };
        let owner = crate::profile::connection_set().owner(id);
        self.service_of(owner)
    }

    fn heartbeat_time(&mut self, id: NodeId, milliseconds: u64) {
        let Some(node) = self.node_mut(id) else { return };
        let nanoseconds = i64::try_from(milliseconds).unwrap_or(0).saturating_mul(1_000_000);
        node.heartbeat.configured = Some(nanoseconds);
        if nanoseconds == 0 {
            node.heartbeat.deadline = None;
        }
    }

    /// SDO server parameter 1201 and up: client to server in sub 1, server to client in sub 2.
    fn learn_channel(&mut self, id: NodeId, index: u16) {
        if index == 0x1200 {
            return;
        }
        let ids = [1, 2].map(|sub| self.number(id, ObjectAddress::new(index, sub)).and_then(identifier));
        let client = self.number(id, ObjectAddress::new(index, 3)).and_then(|id| u8::try_from(id).ok());
        if let [Some(request), Some(response)] = ids
            && let Some(channel) = self.channels.add(id.number(), index, request, response, client)
        {
            self.route_channel(channel, request, response);
        }
    }

    /// SDO client parameter 1280 and up: whom this node asks, and on which identifiers.
    fn learn_client(&mut self, id: NodeId, index: u16) {
        let number = |sub| self.number(id, ObjectAddress::new(index, sub));
        let ids = [number(1).and_then(identifier), number(2).and_then(identifier)];
        let server = number(3).and_then(|server| u8::try_from(server).ok());
        if let ([Some(request), Some(response)], Some(server @ 1..=127)) = (ids, server)
            && let Some(channel) = self.channels.of_client(server, index, request, response, id.number())
        {
            self.route_channel(channel, request, response);
        }
    }

    /// A PDO parameter changed. The identifier takes effect when it becomes valid, the mapping when the
    /// PDO becomes valid again, or at once with the number of entries if it never was invalid.
    fn learn_pdo(&mut self, id: NodeId, address: ObjectAddress) {
        let Some(name) = PdoName::of_parameter(address.index) else { return };
        let service = Service::Pdo(name, id);
        let cob_id = self.number(id, ObjectAddress::new(name.communication_index(), 1));
        let is_valid = cob_id.is_none_or(|cob_id| cob_id & INVALID == 0);
        if address == ObjectAddress::new(name.communication_index(), 1)
            && let Some(cob_id) = cob_id
        {
            self.route_to(service, cob_id);
        }
        let is_mapping = address.index == name.mapping_index();
        if is_valid && (is_mapping || address.sub == 1) {
            self.routes.refresh_pdo(name, id);
        }
    }

    /// An object fell back to something unknown: identifiers and times are the default ones again.
    pub(in crate::session) fn forget_effect(&mut self, id: NodeId, address: ObjectAddress) {
        match (address.index, address.sub) {
            (0x1005, 0) => self.own_sync(id, SYNC),
            (0x1014, 0) => self.forget_route(Service::Emcy(id)),
            (0x1017, 0) => {
                if let Some(node) = self.node_mut(id) {
                    node.heartbeat.configured = None;
                }
            }
            (0x1400..=0x1BFF, 1) => {
                if let Some(name) = PdoName::of_parameter(address.index) {
                    self.forget_route(Service::Pdo(name, id));
                }
            }
            _ => {}
        }
    }

    fn forget_route(&mut self, service: Service) {
        if let Some(old) = self.routes.learnt_id(service) {
            let default = self.default_service(old);
            self.routes.forget(old, service, default);
        }
    }

    /// The SYNC a node obeys; others may obey another one, so none is given up.
    fn own_sync(&mut self, id: NodeId, cob_id: u64) {
        let Some(sync) = identifier(cob_id & !0xC000_0000) else { return };
        if let Some(node) = self.node_mut(id) {
            node.sync = sync;
        }
        if sync.number() != 0 && self.default_service(sync) != Service::Sync {
            self.routes.learn(sync, Service::Sync);
        }
    }
}

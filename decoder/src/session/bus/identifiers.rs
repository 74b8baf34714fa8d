//! What identifiers mean now, and which nodes a frame concerns.

use super::cob_id::{nonzero_identifier, predefined};
use super::link::Link;
use super::routes::Service;
use super::state::Bus;
use crate::frame::{CanId, Frame};
use crate::profile::PdoName;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::Side;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Who has to do with a frame.
enum Concern {
    /// A node, as its sender or receiver.
    Node(NodeId),
    /// One sends to another.
    Between(NodeId, NodeId),
    /// Every CANopen node of the bus.
    Everybody,
    /// Nobody that is known.
    Nobody,
}

impl Bus {
    /// What an identifier means now, for people: `TPDO1 of 5`, `SDO response of 15`.
    pub fn describe_id(&self, id: CanId) -> String {
        match self.routes.find(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service) {
            Some(Service::IsoTp(link)) => self.uds_pairs.describe(link),
            Some(Service::J1939(_)) if !self.j1939.is_rejected() => self.describe_group(id),
            _ if !self.canopen.is_confirmed() => String::new(),
            None | Some(Service::Unclassified | Service::J1939(_)) => String::new(),
            Some(Service::Named(name)) => name.to_owned(),
            Some(Service::Nmt) => "NMT".to_owned(),
            Some(Service::Sync) => "SYNC".to_owned(),
            Some(Service::Time) => "TIME".to_owned(),
            Some(Service::Emcy(node)) => format!("EMCY of {}", node.number()),
            Some(Service::Pdo(name, node)) => format!("{name} of {}", node.number()),
            Some(Service::ErrorControl(node)) => format!("heartbeat, guarding of {}", node.number()),
            Some(Service::TestMarker) => "conformance test".to_owned(),
            Some(Service::Lss(true)) => "LSS master".to_owned(),
            Some(Service::Lss(false)) => "LSS slave".to_owned(),
            Some(Service::Sdo(side, channel)) => {
                let server = self.channels.server(channel).unwrap_or(0);
                match side {
                    Side::Client => format!("SDO request to {server}"),
                    Side::Server => format!("SDO response of {server}"),
                }
            }
        }
    }

    /// The filter that shows the events of an identifier.
    pub fn filter_of_id(&self, id: CanId) -> String {
        let service = self.routes.find(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service);
        let is_believed = self.canopen.is_confirmed();
        match service {
            Some(Service::J1939(id)) if !self.j1939.is_rejected() => filter_of_group(id),
            Some(Service::Nmt) if is_believed => "kind == \"nmt-command\"".to_owned(),
            Some(Service::Sync) if is_believed => "kind == \"sync\"".to_owned(),
            Some(Service::Time) if is_believed => "kind == \"time\"".to_owned(),
            Some(Service::Lss(_)) if is_believed => "kind == \"lss\"".to_owned(),
            Some(Service::TestMarker) => "kind == \"test-case\"".to_owned(),
            Some(Service::ErrorControl(node)) if is_believed => {
                const KINDS: &str = r#""heartbeat", "guard-request", "guard-reply", "boot-up", "nmt-state""#;
                format!("node == {} && kind in {{{KINDS}, \"node-lost\", \"node-back\"}}", node.number())
            }
            _ => format!("can.id == 0x{id}"),
        }
    }

    /// The node a frame is from or for, as far as its identifier tells by now: of a J1939 message who sends it.
    pub fn node_of(&self, frame: &Frame) -> Option<NodeId> {
        match self.concern(frame) {
            Concern::Node(node) | Concern::Between(node, _) => Some(node),
            Concern::Everybody | Concern::Nobody => None,
        }
    }

    /// Whether a frame is from a node or for it: SYNC, TIME and commands to all nodes are for each CANopen node, J1939
    /// messages to all are from their sender only.
    pub fn concerns(&self, frame: &Frame, node: NodeId) -> bool {
        match self.concern(frame) {
            Concern::Node(known) => known == node,
            Concern::Between(one, other) => one == node || other == node,
            Concern::Everybody => node.canopen().is_some(),
            Concern::Nobody => false,
        }
    }

    /// Identifier of a PDO of a node, and whether the bus or the user told it; `None` where it has none.
    pub fn pdo_identifier(&self, id: NodeId, name: PdoName) -> Option<(CanId, bool)> {
        let node = self.node(id)?;
        let object = ObjectAddress::new(name.communication_index(), 1);
        if let Some(entry) = node.store.get(object) {
            return Some((nonzero_identifier(node.store.number(object)?)?, !entry.stale));
        }
        let learnt = self.routes.learnt_id(Service::Pdo(name, id));
        let entry = node.device.dictionary.find(object).and_then(|found| found.entry);
        let delivered = entry.and_then(|entry| entry.default_number(Some(id.number())));
        let can_id = match (learnt, delivered) {
            (Some(learnt), _) => Some(learnt),
            (None, Some(delivered)) => nonzero_identifier(u64::try_from(delivered).ok()?),
            (None, None) => predefined(name, id),
        };
        can_id.map(|can_id| (can_id, false))
    }

    fn concern(&self, frame: &Frame) -> Concern {
        let slot = self.routes.find(frame.id).and_then(|slot| self.routes.slot(slot));
        let address = |address: u16| u8::try_from(address).map(NodeId::J1939);
        match slot.map(|slot| slot.service) {
            Some(Service::Emcy(node) | Service::Pdo(_, node) | Service::ErrorControl(node)) => {
                Concern::Node(node)
            }
            Some(Service::Sdo(_, channel)) => self
                .channels
                .server(channel)
                .map_or(Concern::Nobody, |node| Concern::Node(NodeId::Canopen(node))),
            Some(Service::Nmt) => match frame.data().get(1) {
                None | Some(0) => Concern::Everybody,
                Some(node) => Concern::Node(NodeId::Canopen(*node)),
            },
            Some(Service::Sync | Service::Time | Service::Lss(_)) => Concern::Everybody,
            Some(Service::J1939(id)) if id.destination == ALL => Concern::Node(NodeId::J1939(id.source)),
            Some(Service::J1939(id)) => {
                Concern::Between(NodeId::J1939(id.source), NodeId::J1939(id.destination))
            }
            Some(Service::IsoTp(Link::Addressed { source, target, .. })) => {
                match (address(source), address(target)) {
                    (Ok(source), Ok(target)) => Concern::Between(source, target),
                    (Ok(node), _) | (_, Ok(node)) => Concern::Node(node),
                    _ => Concern::Nobody,
                }
            }
            None
            | Some(Service::Unclassified | Service::Named(_) | Service::TestMarker | Service::IsoTp(_)) => {
                Concern::Nobody
            }
        }
    }
}

/// Messages of management and transport are events of a kind, with the group they are about.
fn filter_of_group(id: J1939Id) -> String {
    let sender = format!("source_address == 0x{:02X}", id.source);
    let kind = match id.pgn {
        Pgn::ACKNOWLEDGEMENT => "acknowledgement",
        Pgn::REQUEST => "j1939-request",
        Pgn::TP_CM | Pgn::TP_DT | Pgn::ETP_CM | Pgn::ETP_DT => "j1939-transfer",
        Pgn::ADDRESS_CLAIMED => "address-claim",
        Pgn::COMMANDED_ADDRESS => "commanded-address",
        pgn => return format!("pgn == {} && {sender}", pgn.number()),
    };
    format!("kind == \"{kind}\" && {sender}")
}

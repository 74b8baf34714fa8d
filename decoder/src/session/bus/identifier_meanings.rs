//! Present meaning of identifiers, and the nodes that a frame concerns.

use super::identifiers::{IdentifierService, SRDO, UdsLink};
use super::objects::{nonzero_identifier, predefined_identifier};
use super::state::Bus;
use crate::event::EventKind;
use crate::frame::{CanId, Frame};
use crate::profile::PdoName;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::SdoSide;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Nodes that a frame concerns.
enum ConcernedNodes {
    /// A single node, as sender or receiver.
    Node(NodeId),
    /// Sender and receiver.
    Between(NodeId, NodeId),
    /// Every CANopen node of the bus.
    Everybody,
    /// No known node.
    NoNode,
}

impl Bus {
    /// Present meaning of an identifier as text: `TPDO1 of 5`, `SDO response of 15`.
    pub fn describe_id(&self, id: CanId) -> String {
        match self.routes.find_slot(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service) {
            Some(IdentifierService::IsoTp(link)) => self.uds_pairs.link_text(link),
            Some(IdentifierService::J1939(_)) if !self.protocols.j1939.is_rejected() => {
                self.describe_group(id)
            }
            service if !self.protocols.settles_service(service, &self.channels) => String::new(),
            Some(IdentifierService::Unclassified) if self.nodes.other_users(id).is_some() => {
                "no known producer".to_owned()
            }
            None | Some(IdentifierService::Unclassified | IdentifierService::J1939(_)) => String::new(),
            Some(IdentifierService::Named(name)) if self.routes.is_lone(id, name) => String::new(),
            Some(IdentifierService::Named(name)) => name.to_owned(),
            Some(IdentifierService::Nmt) => "NMT".to_owned(),
            Some(IdentifierService::Sync) => "SYNC".to_owned(),
            Some(IdentifierService::Time) => "TIME".to_owned(),
            Some(IdentifierService::Emcy(node)) => format!("EMCY of {}", node.number()),
            Some(IdentifierService::Pdo(name, node)) => self.describe_pdo(id, name, node),
            Some(IdentifierService::ErrorControl(node)) => format!("NMT error control of {}", node.number()),
            Some(IdentifierService::TestMarker) => "conformance test".to_owned(),
            Some(IdentifierService::Lss(true)) => "LSS master".to_owned(),
            Some(IdentifierService::Lss(false)) => "LSS slave".to_owned(),
            Some(IdentifierService::Sdo(side, channel)) => {
                let server = self.channels.server_node(channel).unwrap_or(0);
                match side {
                    SdoSide::Client => format!("SDO request to {server}"),
                    SdoSide::Server => format!("SDO response of {server}"),
                }
            }
        }
    }

    /// `TPDO1 of 5`. The predefined connection set does not name a producer or consumer that was never seen, or
    /// that uses another identifier.
    fn describe_pdo(&self, id: CanId, name: PdoName, node: NodeId) -> String {
        let is_placed = self.routes.is_placed(IdentifierService::Pdo(name, node));
        let is_away = self.nodes.other_users(id).is_some_and(|users| !users.contains(&(name, node)));
        match (self.node(node).is_some() || is_placed) && !is_away {
            true => format!("{name} of {}", node.number()),
            false if name.is_sent() => "no known producer".to_owned(),
            false => self.nodes.consumers_text(id),
        }
    }

    /// Whether frames of an identifier may be expected at intervals: not for requests, responses, commands and
    /// faults, which follow an event.
    pub fn is_periodic(&self, id: CanId) -> bool {
        match self.routes.find_slot(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service) {
            Some(IdentifierService::IsoTp(_) | IdentifierService::TestMarker) => false,
            Some(IdentifierService::J1939(id)) if !self.protocols.j1939.is_rejected() => {
                event_of_group(id.pgn).is_none()
            }
            Some(IdentifierService::Named(name)) => name == SRDO || !self.protocols.is_settled(None),
            service @ Some(
                IdentifierService::Nmt
                | IdentifierService::Emcy(_)
                | IdentifierService::Sdo(..)
                | IdentifierService::Lss(_),
            ) => !self.protocols.settles_service(service, &self.channels),
            _ => true,
        }
    }

    /// Filter expression that matches the events of an identifier.
    pub fn filter_of_id(&self, id: CanId) -> String {
        let service =
            self.routes.find_slot(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service);
        let is_believed = self.protocols.settles_service(service, &self.channels);
        match service {
            Some(IdentifierService::J1939(id)) if !self.protocols.j1939.is_rejected() => filter_of_group(id),
            Some(IdentifierService::Nmt) if is_believed => "kind == \"nmt-command\"".to_owned(),
            Some(IdentifierService::Sync) if is_believed => "kind == \"sync\"".to_owned(),
            Some(IdentifierService::Time) if is_believed => "kind == \"time\"".to_owned(),
            Some(IdentifierService::Lss(_)) if is_believed => "kind == \"lss\"".to_owned(),
            Some(IdentifierService::TestMarker) => "kind == \"test-case\"".to_owned(),
            Some(IdentifierService::ErrorControl(node)) if is_believed => {
                const KINDS: &str = r#""heartbeat", "guard-request", "guard-reply", "boot-up", "nmt-state""#;
                format!("node == {} && kind in {{{KINDS}, \"node-lost\", \"node-back\"}}", node.number())
            }
            _ => format!("can.id == 0x{id}"),
        }
    }

    /// Sender or receiver of a frame by its identifier; the sender of a J1939 message. `None` if unknown.
    pub fn node_of(&self, frame: &Frame) -> Option<NodeId> {
        match self.concerned_nodes(frame) {
            ConcernedNodes::Node(node) | ConcernedNodes::Between(node, _) => Some(node),
            ConcernedNodes::Everybody | ConcernedNodes::NoNode => None,
        }
    }

    /// Whether a node is sender or receiver of a frame. SYNC, TIME and commands to all concern every CANopen
    /// node; J1939 messages to all concern only their sender.
    pub fn concerns_node(&self, frame: &Frame, node: NodeId) -> bool {
        match self.concerned_nodes(frame) {
            ConcernedNodes::Node(known) => known == node,
            ConcernedNodes::Between(one, other) => one == node || other == node,
            ConcernedNodes::Everybody => node.canopen().is_some(),
            ConcernedNodes::NoNode => false,
        }
    }

    /// Identifier of a PDO, and whether a message or the user confirmed it; `None` if there is no identifier.
    pub fn pdo_identifier(&self, id: NodeId, name: PdoName) -> Option<(CanId, bool)> {
        let node = self.node(id)?;
        let object = ObjectAddress::new(name.communication_index(), 1);
        if let Some(entry) = node.store.get(object) {
            return Some((nonzero_identifier(node.store.number(object)?)?, !entry.stale));
        }
        let learnt = self.routes.learnt_id(IdentifierService::Pdo(name, id));
        let entry = node.device.dictionary.find_object(object).and_then(|found| found.entry);
        let delivered = entry.and_then(|entry| entry.default_number(Some(id.number())));
        let can_id = match (learnt, delivered) {
            (Some(learnt), _) => Some(learnt),
            (None, Some(delivered)) => nonzero_identifier(u64::try_from(delivered).ok()?),
            (None, None) => predefined_identifier(name, id),
        };
        can_id.map(|can_id| (can_id, false))
    }

    /// Identifier of the RPDO with the control word of a machine.
    pub fn control_identifier(&self, node: NodeId, machine: usize) -> Option<CanId> {
        let slot = self.node(node)?.behaviour.machines.get(machine)?.slot?;
        match &self.routes.slot(slot)?.prepared.as_deref()?.kind {
            EventKind::Pdo(pdo) => Some(pdo.cob_id),
            _ => None,
        }
    }

    fn concerned_nodes(&self, frame: &Frame) -> ConcernedNodes {
        let slot = self.routes.find_slot(frame.id).and_then(|slot| self.routes.slot(slot));
        let address = |address: u16| u8::try_from(address).map(NodeId::J1939);
        match slot.map(|slot| slot.service) {
            Some(
                IdentifierService::Emcy(node)
                | IdentifierService::Pdo(_, node)
                | IdentifierService::ErrorControl(node),
            ) => ConcernedNodes::Node(node),
            Some(IdentifierService::Sdo(_, channel)) => self
                .channels
                .server_node(channel)
                .map_or(ConcernedNodes::NoNode, |node| ConcernedNodes::Node(NodeId::Canopen(node))),
            Some(IdentifierService::Nmt) => match frame.data().get(1) {
                None | Some(0) => ConcernedNodes::Everybody,
                Some(node) => ConcernedNodes::Node(NodeId::Canopen(*node)),
            },
            Some(IdentifierService::Sync | IdentifierService::Time | IdentifierService::Lss(_)) => {
                ConcernedNodes::Everybody
            }
            Some(IdentifierService::J1939(id)) if id.destination == ALL => {
                ConcernedNodes::Node(NodeId::J1939(id.source))
            }
            Some(IdentifierService::J1939(id)) => {
                ConcernedNodes::Between(NodeId::J1939(id.source), NodeId::J1939(id.destination))
            }
            Some(IdentifierService::IsoTp(UdsLink::Addressed { source, target, .. })) => {
                match (address(source), address(target)) {
                    (Ok(source), Ok(target)) => ConcernedNodes::Between(source, target),
                    (Ok(node), _) | (_, Ok(node)) => ConcernedNodes::Node(node),
                    _ => ConcernedNodes::NoNode,
                }
            }
            None
            | Some(
                IdentifierService::Unclassified
                | IdentifierService::Named(_)
                | IdentifierService::TestMarker
                | IdentifierService::IsoTp(_),
            ) => ConcernedNodes::NoNode,
        }
    }
}

/// Filter by event kind for management and transport messages, by PGN for all others.
fn filter_of_group(id: J1939Id) -> String {
    let sender = format!("source_address == 0x{:02X}", id.source);
    match event_of_group(id.pgn) {
        Some(kind) => format!("kind == \"{kind}\" && {sender}"),
        None => format!("pgn == {} && {sender}", id.pgn.number()),
    }
}

/// Event kind of a management or transport message; `None` for all others.
const fn event_of_group(pgn: Pgn) -> Option<&'static str> {
    Some(match pgn {
        Pgn::ACKNOWLEDGEMENT => "acknowledgement",
        Pgn::REQUEST => "j1939-request",
        Pgn::TP_CM | Pgn::TP_DT | Pgn::ETP_CM | Pgn::ETP_DT => "j1939-transfer",
        Pgn::ADDRESS_CLAIMED => "address-claim",
        Pgn::COMMANDED_ADDRESS => "commanded-address",
        _ => return None,
    })
}

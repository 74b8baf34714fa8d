//! COB-IDs of PDOs as written or read in 14xx:01 and 18xx:01, and the PDOs that share one.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::node::Node;
use crate::frame::CanId;
use crate::profile::PdoName;
use crate::session::bus::objects::{OriginKind, nonzero_identifier, predefined_identifier};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// PDOs with an identifier.
type Users = Vec<(PdoName, NodeId)>;

/// Identifiers for which the predefined connection set does not name all users.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct PdoUsers(Arc<BTreeMap<CanId, Users>>);

impl PdoUsers {
    /// Users of all identifiers by the configuration of the nodes.
    #[cold]
    pub(super) fn of_nodes(nodes: &[Node]) -> Self {
        let mut users: BTreeMap<CanId, Users> = BTreeMap::new();
        let mut left = Vec::new();
        for node in nodes {
            for (name, cob_id) in node.configured_pdos() {
                let configured = nonzero_identifier(cob_id);
                if let Some(id) = configured {
                    users.entry(id).or_default().push((name, node.id()));
                }
                left.extend(
                    predefined_identifier(name, node.id()).filter(|default| Some(*default) != configured),
                );
            }
        }
        for id in &left {
            users.entry(*id).or_default();
        }
        users.retain(|id, all| all.len() != 1 || left.contains(id));
        Self(Arc::new(users))
    }

    /// Other configured users of the identifier of a PDO. `None` if only its own node is known and the
    /// configuration does not contradict that.
    pub(super) fn other_users(&self, id: CanId) -> Option<&[(PdoName, NodeId)]> {
        if self.0.is_empty() {
            return None;
        }
        self.0.get(&id).map(Vec::as_slice)
    }
}

impl Node {
    /// Configured COB-ID of a PDO, written or read and not doubtful since; bit 31 marks it as not valid.
    pub(crate) fn configured_cob_id(&self, name: PdoName) -> Option<u64> {
        let object = ObjectAddress::new(name.communication_index(), 1);
        let entry = self.store.seen_value(object)?;
        let is_certain = !entry.stale && entry.origin.kind != OriginKind::Pdo;
        is_certain.then(|| self.store.number(object)).flatten()
    }

    /// PDOs with a configured COB-ID.
    pub(super) fn configured_pdos(&self) -> impl Iterator<Item = (PdoName, u64)> {
        let objects = self.store.sorted().into_iter().map(|(object, _)| object);
        objects.filter(|object| object.sub == 1).filter_map(|object| {
            let name = PdoName::of_parameter(object.index)?;
            let is_cob_id = name.communication_index() == object.index;
            Some((name, is_cob_id.then(|| self.configured_cob_id(name)).flatten()?))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Event, EventKind};
    use crate::frame::{BusIndex, Frame, Timestamp};
    use crate::profile::Catalogue;
    use crate::session::{AssignedBy, Assignment, Bus, BusDecoder, SessionOptions};

    const PROFILE: &str = r#"
        id = "acme-pump"
        extends = ["cia301"]
        [[object]]
        index = 0x2000
        name = "set point"
        type = "INTEGER16"
        role = "set-point"
        [[pdo]]
        pdo = "RPDO1"
        mapping = "fixed"
        fields = [{ object = "2000:00", bits = 16 }]
        [[gate]]
        name = "operational"
        open = { nmt = "operational" }
    "#;

    /// Bus after frames, 1 ms apart, with node 11 as a pump; and the gate of each set point event.
    fn decoded(frames: &[(u16, &[u8])], look: &mut dyn FnMut(&Bus)) -> Vec<(u64, &'static str)> {
        let mut catalogue = Catalogue::default();
        catalogue.add_text("pump.toml", PROFILE).unwrap();
        let device = catalogue.device("acme-pump").unwrap();
        let assignment = Assignment { bus: None, node: NodeId::Canopen(11), device, by: AssignedBy::Option };
        let options = SessionOptions { assignments: vec![assignment], ..SessionOptions::default() };
        let mut bus = BusDecoder::new(BusIndex(0), "can0", Arc::new(options));
        let mut points = Vec::new();
        for (number, (id, data)) in (1..).zip(frames) {
            let mut frame = Frame::data_frame(CanId::from_standard(*id), data);
            frame.number = number;
            frame.time = Some(Timestamp(1_000_000 * i64::try_from(number).unwrap()));
            bus.push(&frame, &mut |event: &Event, bus: &Bus| {
                if let EventKind::SetPoint(point) = &event.kind {
                    points.push((number, point.effective.name()));
                }
                look(bus);
            });
        }
        points
    }

    /// Closed gate of node 11 after the last frame.
    fn closed_gate(frames: &[(u16, &[u8])]) -> Option<String> {
        let mut last = None;
        decoded(frames, &mut |bus| {
            let gates = bus.gates(NodeId::Canopen(11));
            last = gates.into_iter().find(|gate| gate.gate == "RPDO COB-ID").map(|gate| gate.detail);
        });
        last
    }

    const START: [(u16, &[u8]); 3] = [(0x70B, &[0]), (0x000, &[1, 11]), (0x70B, &[5])];
    const COMMAND: (u16, &[u8]) = (0x20B, &[1, 0]);

    /// Upload of 1400:01, or a download (`0x22`), with its confirmation.
    fn cob_id(request: u8, value: [u8; 4], confirmed: &mut [u8; 16]) -> [(u16, &[u8]); 2] {
        let [a, b, c, d] = value;
        let response = if request == 0x40 { 0x43 } else { 0x60 };
        *confirmed = [request, 0, 0x14, 1, a, b, c, d, response, 0, 0x14, 1, a, b, c, d];
        let (request, response) = confirmed.split_at(8);
        [(0x60B, request), (0x58B, response)]
    }

    #[test]
    fn commands_on_another_cob_id_have_no_effect() {
        let mut bytes = [0; 16];
        let read = cob_id(0x40, [0x0A, 2, 0, 0], &mut bytes);
        let frames = [&START[..], &[COMMAND], &read].concat();
        let expected = "1400:01 = 20Ah, commands arrive on 20Bh, no known consumer";
        assert_eq!(closed_gate(&frames).as_deref(), Some(expected));
        // The set point was effective until the COB-ID was read.
        assert_eq!(decoded(&frames, &mut |_| ()), [(4, "yes"), (6, "no")]);
        // Commands on the configured identifier: those on the other one are not for this node.
        let other = [&START[..], &read, &[(0x20A, &[1, 0][..]), COMMAND]].concat();
        assert_eq!(closed_gate(&other), None);
    }

    #[test]
    fn bit_31_closes_the_gate_and_a_new_cob_id_only_that_of_later_commands() {
        let (mut first, mut second) = ([0; 16], [0; 16]);
        let invalid = cob_id(0x22, [0x0B, 2, 0, 0x80], &mut first);
        let frames = [&START[..], &[COMMAND], &invalid].concat();
        assert_eq!(decoded(&frames, &mut |_| ()), [(4, "yes"), (6, "no")]);
        assert!(closed_gate(&frames).unwrap().starts_with("1400:01 = 8000020Bh (bit 31: not valid)"));
        let moved = cob_id(0x22, [0x44, 4, 0, 0], &mut second);
        let frames = [&START[..], &[COMMAND], &moved].concat();
        assert_eq!(closed_gate(&frames), None, "received while its identifier was valid");
        let frames = [&frames[..], &[COMMAND]].concat();
        assert_eq!(decoded(&frames, &mut |_| ()), [(4, "yes"), (7, "no")]);
    }

    #[test]
    fn a_predefined_identifier_names_no_absent_node() {
        let mut seen = Vec::new();
        let mut bytes = [0; 16];
        let [request, response] = cob_id(0x22, [0xC5, 1, 0, 0], &mut bytes);
        // 1800:01 of node 11 is set to 1C5.
        let moved = |frame: (u16, &[u8])| {
            let mut data = frame.1.to_vec();
            if let Some(byte) = data.get_mut(2) {
                *byte = 0x18;
            }
            (frame.0, data)
        };
        let [request, response] = [moved(request), moved(response)];
        let tpdo: &[u8] = &[1];
        let frames: [(u16, &[u8]); 8] = [
            START[0],
            START[1],
            START[2],
            (0x286, tpdo),
            (request.0, &request.1),
            (response.0, &response.1),
            (0x1C5, tpdo),
            (0x18B, tpdo),
        ];
        decoded(&frames, &mut |bus| {
            let describe = |id| bus.describe_id(CanId::from_standard(id));
            seen = vec![describe(0x286), describe(0x1C5), describe(0x18B)];
            assert!(bus.node(NodeId::Canopen(6)).is_none());
        });
        assert_eq!(seen, ["no known producer", "TPDO1 of 11", "no known producer"]);
    }
}

//! SDO requests to nodes that are not on the bus: a scan, or a node that is switched on later.

use std::collections::BTreeSet;

use super::FindingLedger;
use crate::finding::{FindingGroup, Severity};
use crate::frame::CanId;
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::words::count_noun;

/// Rule about requests without response.
const NO_RESPONSE: &str = "sdo-no-response";

/// Node-IDs without any frame, from which requests to them are a scan.
const SCANNED: usize = 5;

const SCAN: &str = "scan: no SDO server with this node-ID";
const LATER: &str = "the node was not on the bus yet";

impl FindingLedger {
    /// Lowers the severity of requests without response to nodes that are not on the bus. Returns a statement about a scan.
    pub(super) fn lower_absent(&mut self, bus: &Bus) -> Option<String> {
        let is_asked = |group: &&mut FindingGroup| {
            group.key.bus == bus.index() && *group.rule == *NO_RESPONSE && group.severity > Severity::Note
        };
        // First frame of the node; 0 for none.
        let first_frame =
            |group: &FindingGroup| group.key.node.and_then(|node| bus.node(node)).map_or(0, Node::first_seen);
        let asked: Vec<&mut FindingGroup> = self.groups.iter_mut().filter(is_asked).collect();
        let absent = asked.iter().filter(|group| first_frame(group) == 0).filter_map(|group| group.key.node);
        let absent: BTreeSet<_> = absent.collect();
        let is_scan = absent.len() >= SCANNED;
        for group in asked {
            let last = group.last.back().or(group.first.last()).map_or(u64::MAX, |at| at.frames.last);
            let reason = match first_frame(group) {
                _ if is_scan && !has_server(group, bus) => SCAN,
                first if first > last => LATER,
                _ => continue,
            };
            group.severity = Severity::Note;
            group.downgraded.get_or_insert_with(|| reason.to_owned());
        }
        is_scan.then(|| format!("scan: no answer on {}", count_noun(absent.len() as u64, "node-ID")))
    }
}

/// Whether the node sent a response on the predefined SDO channel (CiA 301 §7.3.3).
fn has_server(group: &FindingGroup, bus: &Bus) -> bool {
    let Some(NodeId::Canopen(id)) = group.key.node else { return false };
    bus.identifiers().find_slot(CanId::from_standard(0x580 + u16::from(id))).is_some()
}

//! How a capture begins: before the power-on of the CANopen nodes, at an NMT reset, or in operation.

use super::{BusStatistics, FirstFrame};
use crate::wire::NodeId;

/// Time from the start of the capture in which a running node is expected to send: twice the usual heartbeat
/// time, in ns. A node that is first heard later may have been connected later.
const EXPECTED_WITHIN: i64 = 2_000_000_000;

/// How the capture of a bus begins for its CANopen nodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaptureBeginning {
    /// Nodes that were running before the capture; if others start in it, only those heard at its start.
    pub running: Vec<NodeId>,
    /// Nodes whose first frame is a boot sign.
    pub starting: Vec<NodeId>,
    /// The first boot signs follow an NMT reset.
    pub is_reset: bool,
}

impl CaptureBeginning {
    /// Name in JSON output: `power-on`, `nmt-reset` or `operation`.
    pub const fn name(&self) -> &'static str {
        match (self.running.is_empty(), self.is_reset) {
            (false, _) => "operation",
            (true, true) => "nmt-reset",
            (true, false) => "power-on",
        }
    }
}

impl BusStatistics {
    /// How the capture begins; `None` without a CANopen node.
    pub fn capture_beginning(&self) -> Option<CaptureBeginning> {
        let first = self.nodes().filter_map(|(id, node)| Some((id, node.first_frame?)));
        let (mut running, starting): (Vec<_>, Vec<_>) =
            first.partition(|(_, (first, _))| *first == FirstFrame::Running);
        if running.is_empty() && starting.is_empty() {
            return None;
        }
        let began = self.nodes().filter_map(|(_, node)| node.first_frame?.1).min();
        if !starting.is_empty() {
            let is_late = |at: Option<i64>| {
                at.zip(began).is_some_and(|(at, began)| at.saturating_sub(began) > EXPECTED_WITHIN)
            };
            running.retain(|(_, (_, at))| !is_late(*at));
        }
        Some(CaptureBeginning {
            is_reset: starting.iter().all(|(_, (first, _))| *first == FirstFrame::Reset),
            running: running.into_iter().map(|(id, _)| id).collect(),
            starting: starting.into_iter().map(|(id, _)| id).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capture_beginning(first: &[FirstFrame]) -> Option<CaptureBeginning> {
        let mut bus = BusStatistics::default();
        for (id, first) in (1..).zip(first) {
            let first_frame = Some((*first, Some(i64::from(id) * 1_000_000_000)));
            bus.nodes.entry(NodeId::Canopen(id)).unwrap().first_frame = first_frame;
        }
        bus.capture_beginning()
    }

    #[test]
    fn a_running_node_decides() {
        use FirstFrame::{PowerOn, Reset, Running};
        let name = |first: &[FirstFrame]| capture_beginning(first).map(|it| it.name());
        assert_eq!(name(&[]), None);
        assert_eq!(name(&[PowerOn, PowerOn]), Some("power-on"));
        assert_eq!(name(&[PowerOn, Reset]), Some("power-on"));
        assert_eq!(name(&[Reset, Reset]), Some("nmt-reset"));
        let mixed = capture_beginning(&[PowerOn, Running]).unwrap();
        assert_eq!((mixed.name(), mixed.running.len(), mixed.starting.len()), ("operation", 1, 1));
        // Node 4 is first heard 3 s after node 1.
        assert_eq!(name(&[PowerOn, Reset, Reset, Running]), Some("power-on"));
        assert_eq!(capture_beginning(&[Running; 5]).unwrap().running.len(), 5);
    }
}

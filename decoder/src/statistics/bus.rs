//! Figures of one bus: identifiers, load, nodes, the NMT master.

use std::collections::BTreeMap;

use super::{Intervals, Load, NodeStatistics};
use crate::event::{Event, EventKind};
use crate::frame::{CanId, Frame, FrameFlags};
use crate::wire::NodeId;
use crate::wire::canopen::nmt::NmtService;

/// Identifiers of a bus that are counted one by one.
pub(crate) const MOST_IDS: usize = 4096;

/// One identifier.
#[derive(Debug, Clone, Default)]
pub struct IdStatistics {
    /// Frames.
    pub frames: u64,
    /// Time between them.
    pub intervals: Intervals,
}

/// What the NMT master does; CAN does not tell who that is.
#[derive(Debug, Clone, Default)]
pub struct MasterStatistics {
    /// NMT commands by service.
    pub commands: Vec<(NmtService, u64)>,
    /// Time between SYNCs.
    pub sync: Intervals,
    /// SYNCs.
    pub syncs: u64,
    /// Gaps in the SYNC counter.
    pub sync_gaps: u64,
    /// TIME messages.
    pub times: u64,
    /// Guarding requests.
    pub guard_requests: u64,
}

/// Figures of one bus.
#[derive(Debug, Clone, Default)]
pub struct BusStatistics {
    /// Identifiers that were seen, with remote frames (`true`) apart.
    pub ids: BTreeMap<(CanId, bool), IdStatistics>,
    /// Frames of identifiers beyond the first 4,096.
    pub other_ids: u64,
    /// Load.
    pub load: Load,
    /// Nodes by node-ID.
    pub nodes: BTreeMap<NodeId, NodeStatistics>,
    /// The NMT master and SYNC producer.
    pub master: MasterStatistics,
    /// Frames no protocol explains.
    pub undecoded: u64,
    /// Malformed messages.
    pub malformed: u64,
}

impl BusStatistics {
    /// Takes a frame.
    pub fn frame(&mut self, frame: &Frame) {
        let time = frame.time.map(|time| time.0);
        self.load.add(frame, time);
        if frame.flags.contains(FrameFlags::ERROR) {
            return;
        }
        let key = (frame.id, frame.flags.contains(FrameFlags::REMOTE));
        let fits = self.ids.len() < MOST_IDS || self.ids.contains_key(&key);
        if !fits {
            self.other_ids += 1;
            return;
        }
        let id = self.ids.entry(key).or_default();
        id.frames += 1;
        if let Some(time) = time {
            id.intervals.add(time);
        }
    }

    /// Takes an event.
    pub fn event(&mut self, event: &Event) {
        match &event.kind {
            EventKind::NmtCommand { service, .. } => {
                let commands = &mut self.master.commands;
                match commands.iter_mut().find(|(known, _)| known == service) {
                    Some((_, count)) => *count += 1,
                    None => commands.push((*service, 1)),
                }
            }
            EventKind::Sync { expected, .. } => {
                self.master.syncs += 1;
                self.master.sync_gaps += u64::from(expected.is_some());
                if let Some(time) = event.time {
                    self.master.sync.add(time.0);
                }
            }
            EventKind::Time { .. } => self.master.times += 1,
            EventKind::Frame(frame) => self.undecoded += u64::from(frame.message.is_none()),
            EventKind::Malformed { .. } => self.malformed += 1,
            _ => {}
        }
        if matches!(event.kind, EventKind::GuardRequest) {
            self.master.guard_requests += 1;
        }
        if let Some(node) = event.node {
            self.nodes.entry(node).or_default().event(event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_beyond_the_limit_are_counted_together() {
        let mut bus = BusStatistics::default();
        for id in 0..5_000 {
            bus.frame(&Frame::data_frame(CanId::extended(id), &[]));
        }
        assert_eq!((bus.ids.len(), bus.other_ids), (MOST_IDS, 5_000 - MOST_IDS as u64));
    }
}

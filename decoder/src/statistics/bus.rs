//! Statistics of one bus: identifiers, load, nodes, NMT master.

use std::collections::BTreeMap;

use super::{Intervals, Load, NodeStatistics};
use crate::event::{Event, EventKind, Protocol};
use crate::frame::{CanId, Frame, FrameFlags};
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::nmt::NmtService;

/// Maximum number of identifiers counted separately per bus.
pub(crate) const MOST_IDS: usize = 4096;

/// Statistics of one identifier.
#[derive(Debug, Clone, Default)]
pub struct IdStatistics {
    /// Number of frames.
    pub frames: u64,
    /// Time between frames.
    pub intervals: Intervals,
}

/// Statistics of the NMT master, whose node-ID is not visible on CAN.
#[derive(Debug, Clone, Default)]
pub struct MasterStatistics {
    /// NMT commands by service.
    pub commands: Vec<(NmtService, u64)>,
    /// Time between SYNC messages.
    pub sync: Intervals,
    /// Number of SYNC messages.
    pub syncs: u64,
    /// Gaps in the SYNC counter.
    pub sync_gaps: u64,
    /// Number of TIME messages.
    pub times: u64,
    /// Number of guarding requests.
    pub guard_requests: u64,
}

/// Statistics of one bus.
#[derive(Debug, Clone, Default)]
pub struct BusStatistics {
    /// Statistics per identifier and remote flag.
    pub ids: BTreeMap<(CanId, bool), IdStatistics>,
    /// Number of frames of further identifiers, beyond the first 4,096.
    pub other_ids: u64,
    /// Bus load.
    pub load: Load,
    /// Statistics per node.
    pub nodes: BTreeMap<NodeId, NodeStatistics>,
    /// NMT master and SYNC producer.
    pub master: MasterStatistics,
    /// Number of frames of no known protocol.
    pub undecoded: u64,
    /// Number of malformed messages.
    pub malformed: u64,
    /// Number of presumed CANopen messages of one frame each, and of the malformed ones among them.
    presumed: (u64, u64),
}

impl BusStatistics {
    /// Counts a frame.
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

    fn count_presumed(&mut self, event: &Event) {
        let is_message = matches!(
            event.kind,
            EventKind::Pdo(_) | EventKind::Emcy(_) | EventKind::Sync { .. } | EventKind::Time { .. }
        );
        let is_malformed = matches!(event.kind, EventKind::Malformed { .. });
        self.presumed.0 += u64::from(is_message || is_malformed);
        self.presumed.1 += u64::from(is_malformed);
    }

    /// Removes the CANopen figures of a bus that proved not to be CANopen; nodes that the user named keep theirs.
    /// Removes nodes of which only PDOs on predefined identifiers were received. Call it after the last event.
    pub fn withdraw(&mut self, bus: &Bus) {
        if bus.is_withdrawn(None) {
            self.master = MasterStatistics::default();
            let (messages, malformed) = std::mem::take(&mut self.presumed);
            self.undecoded += messages;
            self.malformed = self.malformed.saturating_sub(malformed);
        }
        if bus.is_time_withdrawn() {
            self.undecoded += std::mem::take(&mut self.master.times);
        }
        // The predefined connection set assigns every identifier to a node, present or not.
        let is_absent = |id, node: &NodeStatistics| bus.node(id).is_none() && node.has_only_pdos();
        self.nodes.retain(|id, node| !bus.is_withdrawn(Some(*id)) && !is_absent(*id, node));
    }

    /// Counts an event.
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
            EventKind::BusSilent { .. } | EventKind::ClockStep { .. } => self.master.sync.interrupt(),
            EventKind::Time { .. } => self.master.times += 1,
            EventKind::Frame(frame) => self.undecoded += u64::from(frame.message.is_none()),
            EventKind::Malformed { .. } => self.malformed += 1,
            _ => {}
        }
        if matches!(event.kind, EventKind::GuardRequest) {
            self.master.guard_requests += 1;
        }
        if event.presumed && event.protocol == Protocol::Canopen {
            self.count_presumed(event);
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

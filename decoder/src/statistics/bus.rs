//! Statistics of one bus: identifiers, load, nodes, NMT master.

use super::bits::LastFrameBits;
use super::identifier_index::IdentifierIndex;
use super::node_table::NodeTable;
use super::{BusLoad, IntervalStatistics, NodeStatistics, frame_bits};
use crate::event::{Event, EventKind, EventProtocol};
use crate::frame::{CanId, Frame, FrameFlags};
use crate::profile::PdoName;
use crate::session::{Bus, MessagePreview};
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
    pub intervals: IntervalStatistics,
    bits: LastFrameBits,
}

/// Statistics of the NMT master, whose node-ID is not visible on CAN.
#[derive(Debug, Clone, Default)]
pub struct MasterStatistics {
    /// NMT commands by service.
    pub commands: Vec<(NmtService, u64)>,
    /// Time between SYNC messages.
    pub sync: IntervalStatistics,
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
    /// Statistics per identifier and remote flag, in order of appearance.
    ids: Vec<((CanId, bool), IdStatistics)>,
    index: IdentifierIndex,
    /// Number of frames of further identifiers, beyond the first 4,096.
    pub other_ids: u64,
    /// Bus load.
    pub load: BusLoad,
    pub(super) nodes: NodeTable,
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
    pub fn count_frame(&mut self, frame: &Frame) {
        let bits = self.count_identifier(frame);
        self.load.count_bits(bits, frame.time.map(|time| time.0));
    }

    /// Counts frames.
    pub(super) fn count_frames(&mut self, frames: &[Frame]) {
        let mut pending = (0, 0);
        for frame in frames {
            let bits = self.count_identifier(frame);
            let time = frame.time.map(|time| time.0);
            if time.is_some_and(|time| self.load.continues_at(time)) {
                pending = (pending.0 + 1, pending.1 + u64::from(bits));
            } else {
                self.load.add_many(std::mem::take(&mut pending));
                self.load.count_bits(bits, time);
            }
        }
        self.load.add_many(pending);
    }

    /// Starts new series of frames: the clock of the recorder was set.
    pub(super) fn interrupt_identifiers(&mut self) {
        for (_, id) in &mut self.ids {
            id.intervals.interrupt_series();
        }
    }

    /// Starts new series of messages: the clock of the recorder was set.
    pub(super) fn interrupt_messages(&mut self) {
        self.master.sync.interrupt_series();
        self.nodes.iter_mut().for_each(NodeStatistics::interrupt_series);
    }

    /// Counts a frame of its identifier; bits of the frame, 0 if they are unknown.
    #[inline]
    fn count_identifier(&mut self, frame: &Frame) -> u32 {
        let time = frame.time.map(|time| time.0);
        let bits = if frame.flags.contains(FrameFlags::ERROR) {
            None
        } else if let Some(id) = self.id_entry(frame) {
            id.frames += 1;
            if let Some(time) = time {
                id.intervals.add_time(time);
            }
            id.bits.count_bits(frame)
        } else {
            self.other_ids += 1;
            frame_bits(frame)
        };
        bits.unwrap_or(0)
    }

    /// Statistics of the identifier of a frame, created if missing; None beyond [`MOST_IDS`].
    #[inline]
    fn id_entry(&mut self, frame: &Frame) -> Option<&mut IdStatistics> {
        let rows = self.ids.len();
        let place = self.index.row_of(frame, rows, MOST_IDS)?;
        if place == rows {
            let key = (frame.id, frame.flags.contains(FrameFlags::REMOTE));
            self.ids.push((key, IdStatistics::default()));
        }
        self.ids.get_mut(place).map(|(_, statistics)| statistics)
    }

    /// Statistics per identifier and remote flag, in ascending order.
    pub fn ids(&self) -> Vec<(CanId, bool, &IdStatistics)> {
        let mut ids: Vec<_> =
            self.ids.iter().map(|((id, is_remote), figures)| (*id, *is_remote, figures)).collect();
        ids.sort_by_key(|(id, is_remote, _)| (*id, *is_remote));
        ids
    }

    /// Statistics per node, in ascending order.
    pub fn nodes(&self) -> impl Iterator<Item = (NodeId, &NodeStatistics)> + use<'_> {
        self.nodes.iter()
    }

    /// Statistics of a node.
    pub fn node(&self, node: NodeId) -> Option<&NodeStatistics> {
        self.nodes.get(node)
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

    /// Counts a PDO without an event. Its identifier is known from an event.
    #[inline]
    pub(super) fn skip_pdo(&mut self, (pdo, node): (PdoName, NodeId), preview: &MessagePreview) {
        let Some(node) = self.nodes.entry(node) else { return };
        node.pdos += 1;
        if preview.change != 0 {
            node.reactions.change_pdo(pdo, preview.time.0, preview.frame);
        }
    }

    /// Removes the CANopen figures of a bus that proved not to be CANopen; nodes that the user named keep theirs.
    /// Removes nodes of which only PDOs on predefined identifiers were received. Call it after the last event.
    pub fn withdraw_canopen(&mut self, bus: &Bus) {
        if bus.protocols().is_withdrawn(None) {
            self.master = MasterStatistics::default();
            let (messages, malformed) = std::mem::take(&mut self.presumed);
            self.undecoded += messages;
            self.malformed = self.malformed.saturating_sub(malformed);
        }
        if bus.protocols().is_time_withdrawn() {
            self.undecoded += std::mem::take(&mut self.master.times);
        }
        // The predefined connection set assigns every identifier to a node, present or not.
        let is_absent = |id, node: &NodeStatistics| bus.node(id).is_none() && node.has_only_pdos();
        self.nodes.retain_nodes(|id, node| !bus.protocols().is_withdrawn(Some(id)) && !is_absent(id, node));
    }

    /// Counts an event.
    pub fn count_event(&mut self, event: &Event) {
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
                    self.master.sync.add_time(time.0);
                }
            }
            EventKind::BusSilent { .. } | EventKind::ClockStep { .. } => self.master.sync.interrupt_series(),
            EventKind::Time { .. } => self.master.times += 1,
            EventKind::Frame(frame) => self.undecoded += u64::from(frame.message.is_none()),
            EventKind::Malformed { .. } => self.malformed += 1,
            _ => {}
        }
        if matches!(event.kind, EventKind::GuardRequest) {
            self.master.guard_requests += 1;
        }
        if event.presumed && event.protocol == EventProtocol::Canopen {
            self.count_presumed(event);
        }
        if let Some(node) = event.node.and_then(|node| self.nodes.entry(node)) {
            node.count_event(event);
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
            bus.count_frame(&Frame::data_frame(CanId::from_extended(id), &[]));
        }
        assert_eq!((bus.ids().len(), bus.other_ids), (MOST_IDS, 5_000 - MOST_IDS as u64));
        let bits =
            (0..5_000).map(|id| frame_bits(&Frame::data_frame(CanId::from_extended(id), &[])).unwrap());
        assert_eq!(bus.load.bits, bits.map(u64::from).sum::<u64>());
    }

    #[test]
    fn identifiers_are_sorted_and_remote_frames_counted_apart() {
        let mut bus = BusStatistics::default();
        let remote =
            Frame { flags: FrameFlags::REMOTE, ..Frame::data_frame(CanId::from_standard(0x705), &[]) };
        let data = Frame::data_frame(CanId::from_standard(0x705), &[5]);
        let error = Frame { flags: FrameFlags::ERROR, ..Frame::data_frame(CanId::from_extended(4), &[0; 8]) };
        for frame in [Frame::data_frame(CanId::from_extended(1), &[]), remote, data, data, error] {
            bus.count_frame(&frame);
        }
        let ids: Vec<_> = bus.ids().iter().map(|(id, is_remote, it)| (*id, *is_remote, it.frames)).collect();
        let id = CanId::from_standard(0x705);
        assert_eq!(ids, [(id, false, 2), (id, true, 1), (CanId::from_extended(1), false, 1)]);
        assert_eq!(bus.load.frames, 5);
    }
}

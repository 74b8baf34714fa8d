//! Figures of one bus: identifiers, load, nodes, the NMT master.

use std::collections::BTreeMap;

use super::{Intervals, MOST_IDS, NodeStatistics, frame_bits};
use crate::event::{Event, EventKind};
use crate::frame::{CanId, Frame, FrameFlags};
use crate::wire::canopen::nmt::NmtService;

/// Nanoseconds of the window in which the worst load is looked for.
const WINDOW: i64 = 1_000_000_000;

/// One identifier.
#[derive(Debug, Clone, Default)]
pub struct IdStatistics {
    /// Frames.
    pub frames: u64,
    /// Time between them.
    pub intervals: Intervals,
}

/// Frames and bits over time.
#[derive(Debug, Clone, Default)]
pub struct Load {
    /// Frames.
    pub frames: u64,
    /// Bits on the wire with stuffing; FD and error frames are not in it.
    pub bits: u64,
    window_start: Option<i64>,
    window_frames: u64,
    window_bits: u64,
    /// Most frames in a second, and when it began.
    pub worst_frames: (u64, i64),
    /// Most bits in a second, and when it began.
    pub worst_bits: (u64, i64),
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
    /// Identifiers that were seen.
    pub ids: BTreeMap<CanId, IdStatistics>,
    /// Frames of identifiers beyond the first 4,096.
    pub other_ids: u64,
    /// Load.
    pub load: Load,
    /// Nodes by node-ID.
    pub nodes: BTreeMap<u8, NodeStatistics>,
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
        let fits = self.ids.len() < MOST_IDS || self.ids.contains_key(&frame.id);
        if !fits {
            self.other_ids += 1;
            return;
        }
        let id = self.ids.entry(frame.id).or_default();
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
            EventKind::Frame(_) => self.undecoded += 1,
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

impl Load {
    fn add(&mut self, frame: &Frame, time: Option<i64>) {
        let bits = u64::from(frame_bits(frame).unwrap_or(0));
        self.frames += 1;
        self.bits += bits;
        let Some(time) = time else { return };
        let start = *self.window_start.get_or_insert(time);
        if time.saturating_sub(start) >= WINDOW || time < start {
            self.window_start = Some(time);
            self.window_frames = 0;
            self.window_bits = 0;
        }
        self.window_frames += 1;
        self.window_bits += bits;
        let start = self.window_start.unwrap_or(time);
        if self.window_frames > self.worst_frames.0 {
            self.worst_frames = (self.window_frames, start);
        }
        if self.window_bits > self.worst_bits.0 {
            self.worst_bits = (self.window_bits, start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Timestamp;

    #[test]
    fn the_worst_second_is_found() {
        let mut load = Load::default();
        let mut frame = Frame::data_frame(CanId::standard(0x555), &[]);
        // Two frames in the first second, three in the next.
        for milliseconds in [0, 500, 1_200, 1_300, 1_400, 2_500] {
            frame.time = Some(Timestamp(milliseconds * 1_000_000));
            load.add(&frame, frame.time.map(|time| time.0));
        }
        assert_eq!((load.frames, load.worst_frames), (6, (3, 1_200_000_000)));
        assert_eq!(load.bits, 6 * 48);
    }

    #[test]
    fn identifiers_beyond_the_limit_are_counted_together() {
        let mut bus = BusStatistics::default();
        for id in 0..5_000 {
            bus.frame(&Frame::data_frame(CanId::extended(id), &[]));
        }
        assert_eq!((bus.ids.len(), bus.other_ids), (MOST_IDS, 5_000 - MOST_IDS as u64));
    }
}

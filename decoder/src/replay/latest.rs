//! Times of the last boot-ups, errors and state changes of nodes, which the bus state does not store.
//!
//! ```text
//! event ─kind?─▶ PDO: ignored ─▶ other: node ─▶ last boot-up · errors with times · states with times
//! ```

use std::collections::BTreeMap;

use crate::event::{BootCause, DtcAction, EmcyAction, Event, EventKind};
use crate::frame::{BusIndex, Timestamp};
use crate::wire::NodeId;

/// Maximum number of errors, and of outputs, per node.
const MOST: usize = 64;

/// Code of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorCode {
    /// Error code of an EMCY.
    Emcy(u16),
    /// SPN and FMI of a DTC.
    Dtc(u32, u8),
}

/// A boot-up of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BootOccurrence {
    /// Number of the frame that shows the boot-up.
    pub frame: u64,
    /// Time of the boot-up.
    pub time: Option<Timestamp>,
    /// Cause of the boot-up.
    pub cause: BootCause,
    /// Number of values written by SDO that were lost.
    pub lost: u32,
}

/// Last occurrences at one node.
#[derive(Debug, Clone, Default)]
pub struct LatestOfNode {
    start: Option<BootOccurrence>,
    errors: Vec<(ErrorCode, Option<Timestamp>)>,
    states: Vec<(Option<u8>, Option<Timestamp>)>,
}

impl LatestOfNode {
    /// The last boot-up.
    pub fn last_boot(&self) -> Option<BootOccurrence> {
        self.start
    }

    /// Time at which an error was last raised.
    pub fn raised_at(&self, code: ErrorCode) -> Option<Timestamp> {
        self.errors.iter().find(|(known, _)| *known == code)?.1
    }

    /// Time of the last state change of an output's state machine.
    pub fn state_since(&self, channel: Option<u8>) -> Option<Timestamp> {
        self.states.iter().find(|(known, _)| *known == channel)?.1
    }

    fn start_now(&mut self, event: &Event, cause: BootCause, lost: u32) {
        let (frame, time) = (event.frames.last, event.time);
        self.start = Some(BootOccurrence { frame, time, cause, lost });
    }
}

/// Sets the entry for `key`. A full list drops its last entry; if that error is active, its next message
/// restores it.
fn set_entry<K: PartialEq, V>(list: &mut Vec<(K, V)>, key: K, value: V) {
    if let Some(entry) = list.iter_mut().find(|(known, _)| *known == key) {
        entry.1 = value;
        return;
    }
    if list.len() >= MOST {
        list.pop();
    }
    list.push((key, value));
}

/// Last occurrences at each node.
#[derive(Debug, Clone, Default)]
pub struct LatestOccurrences {
    nodes: BTreeMap<(BusIndex, NodeId), LatestOfNode>,
}

impl LatestOccurrences {
    /// Updates the times from an event.
    #[inline]
    pub(super) fn on_event(&mut self, event: &Event) {
        match &event.kind {
            EventKind::BootUp { .. }
            | EventKind::Emcy(_)
            | EventKind::Dtc(_)
            | EventKind::DeviceState(_)
            | EventKind::NodeIdChange { .. } => self.note_event(event),
            _ => {}
        }
    }

    #[cold]
    fn note_event(&mut self, event: &Event) {
        let Some(id) = event.node else { return };
        if let EventKind::NodeIdChange { from: Some(from), to, .. } = event.kind {
            let moved = self.nodes.remove(&(event.bus, NodeId::Canopen(from)));
            if let Some(moved) = moved {
                self.nodes.insert((event.bus, NodeId::Canopen(to)), moved);
            }
            return;
        }
        let node = self.nodes.entry((event.bus, id)).or_default();
        match &event.kind {
            EventKind::BootUp { cause, lost } => {
                node.start_now(event, *cause, *lost);
                node.errors.clear();
            }
            EventKind::Emcy(emergency) => {
                if let Some(cause) = emergency.boot {
                    node.start_now(event, cause, 0);
                }
                match (emergency.action, emergency.code) {
                    (EmcyAction::Raised, Some(code)) => {
                        set_entry(&mut node.errors, ErrorCode::Emcy(code), event.time);
                    }
                    (EmcyAction::AllCleared, _) => node.errors.clear(),
                    _ => {}
                }
            }
            EventKind::Dtc(dtc) if matches!(dtc.action, DtcAction::Raised | DtcAction::Recurred) => {
                set_entry(&mut node.errors, ErrorCode::Dtc(dtc.spn, dtc.fmi), event.time);
            }
            EventKind::DeviceState(state) => set_entry(&mut node.states, state.channel, event.time),
            _ => {}
        }
    }

    /// Last occurrences at a node.
    pub fn latest_of(&self, bus: BusIndex, node: NodeId) -> Option<&LatestOfNode> {
        self.nodes.get(&(bus, node))
    }

    /// Memory used in bytes.
    pub(super) fn footprint(&self) -> usize {
        let lists = |node: &LatestOfNode| {
            node.errors.capacity() * size_of::<(ErrorCode, Option<Timestamp>)>()
                + node.states.capacity() * size_of::<(Option<u8>, Option<Timestamp>)>()
        };
        self.nodes.values().map(|node| size_of::<LatestOfNode>() + lists(node)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::BusNames;
    use crate::frame::{CanId, Frame};
    use crate::replay::ReplayState;
    use crate::session::SessionOptions;

    /// Last occurrences at node 5 after frames, given as milliseconds, identifier and data.
    fn behind(frames: &[(i64, u16, &[u8])]) -> LatestOfNode {
        let mut world = ReplayState::new(SessionOptions::default());
        let names = BusNames::default();
        for (number, (time, id, data)) in (1..).zip(frames) {
            let mut frame = Frame::data_frame(CanId::from_standard(*id), data);
            (frame.number, frame.time) = (number, Some(Timestamp(time * 1_000_000)));
            world.push(&frame, &names, &mut |_| ());
        }
        world.latest().latest_of(BusIndex(0), NodeId::Canopen(5)).cloned().unwrap_or_default()
    }

    const BOOT: (i64, u16, &[u8]) = (10, 0x705, &[0]);
    const RAISED: (i64, u16, &[u8]) = (30, 0x085, &[0x30, 0x81, 0x11, 0, 0, 0, 0, 0]);

    #[test]
    fn a_start_and_an_error_have_their_times() {
        let node = behind(&[BOOT, RAISED]);
        let start = node.last_boot().unwrap();
        assert_eq!((start.frame, start.time), (1, Some(Timestamp(10_000_000))));
        assert_eq!(node.raised_at(ErrorCode::Emcy(0x8130)), Some(Timestamp(30_000_000)));
        assert_eq!(node.raised_at(ErrorCode::Emcy(0x8131)), None);
    }

    #[test]
    fn errors_end_with_a_start_or_when_all_are_gone() {
        let again = (40, BOOT.1, BOOT.2);
        let gone: (i64, u16, &[u8]) = (40, 0x085, &[0; 8]);
        for last in [again, gone] {
            assert_eq!(behind(&[BOOT, RAISED, last]).raised_at(ErrorCode::Emcy(0x8130)), None);
        }
        // Raised again: the time of the last message.
        let repeated = (50, RAISED.1, RAISED.2);
        let node = behind(&[BOOT, RAISED, repeated]);
        assert_eq!(node.raised_at(ErrorCode::Emcy(0x8130)), Some(Timestamp(50_000_000)));
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let mut list = Vec::new();
        (0..1_000).for_each(|code| set_entry(&mut list, ErrorCode::Emcy(code), ()));
        assert_eq!((list.len(), list.last()), (MOST, Some(&(ErrorCode::Emcy(999), ()))));
    }
}

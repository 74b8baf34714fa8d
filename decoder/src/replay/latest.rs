//! When things last happened to nodes that buses themselves need not remember: starts, errors, changes of state.
//!
//! ```text
//! event ─kind?─▶ a PDO: nothing ─▶ else: node ─▶ last start · errors and since when · states and since when
//! ```

use std::collections::BTreeMap;

use crate::event::{BootCause, DtcAction, EmcyAction, Event, EventKind};
use crate::frame::{BusIndex, Timestamp};
use crate::wire::NodeId;

/// Errors, and outputs, of a node whose times are kept.
const MOST: usize = 64;

/// An error as it is numbered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Code {
    /// Of an EMCY.
    Emcy(u16),
    /// SPN and FMI of a trouble code.
    Dtc(u32, u8),
}

/// A start of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Start {
    /// Frame that told it.
    pub frame: u64,
    /// When.
    pub time: Option<Timestamp>,
    /// Why.
    pub cause: BootCause,
    /// Values written by SDO that were lost.
    pub lost: u32,
}

/// What happened last to one node.
#[derive(Debug, Clone, Default)]
pub struct LatestOfNode {
    start: Option<Start>,
    errors: Vec<(Code, Option<Timestamp>)>,
    states: Vec<(Option<u8>, Option<Timestamp>)>,
}

impl LatestOfNode {
    /// Its last start.
    pub fn start(&self) -> Option<Start> {
        self.start
    }

    /// When an error was raised last.
    pub fn raised(&self, code: Code) -> Option<Timestamp> {
        self.errors.iter().find(|(known, _)| *known == code)?.1
    }

    /// Since when the machine of an output reports its state.
    pub fn state_since(&self, channel: Option<u8>) -> Option<Timestamp> {
        self.states.iter().find(|(known, _)| *known == channel)?.1
    }

    fn start_now(&mut self, event: &Event, cause: BootCause, lost: u32) {
        let (frame, time) = (event.frames.last, event.time);
        self.start = Some(Start { frame, time, cause, lost });
    }
}

/// The last entry of a list goes where it is full: what is active is told again by the next message.
fn note<K: PartialEq, V>(list: &mut Vec<(K, V)>, key: K, value: V) {
    if let Some(entry) = list.iter_mut().find(|(known, _)| *known == key) {
        entry.1 = value;
        return;
    }
    if list.len() >= MOST {
        list.pop();
    }
    list.push((key, value));
}

/// What happened last, by node.
#[derive(Debug, Clone, Default)]
pub struct Latest {
    nodes: BTreeMap<(BusIndex, NodeId), LatestOfNode>,
}

impl Latest {
    /// Takes an event.
    #[inline]
    pub(super) fn event(&mut self, event: &Event) {
        match &event.kind {
            EventKind::BootUp { .. }
            | EventKind::Emcy(_)
            | EventKind::Dtc(_)
            | EventKind::DeviceState(_)
            | EventKind::NodeIdChange { .. } => self.note(event),
            _ => {}
        }
    }

    #[cold]
    fn note(&mut self, event: &Event) {
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
                    (EmcyAction::Raised, Some(code)) => note(&mut node.errors, Code::Emcy(code), event.time),
                    (EmcyAction::AllCleared, _) => node.errors.clear(),
                    _ => {}
                }
            }
            EventKind::Dtc(dtc) if matches!(dtc.action, DtcAction::Raised | DtcAction::Recurred) => {
                note(&mut node.errors, Code::Dtc(dtc.spn, dtc.fmi), event.time);
            }
            EventKind::DeviceState(state) => note(&mut node.states, state.channel, event.time),
            _ => {}
        }
    }

    /// What happened last to a node.
    pub fn of(&self, bus: BusIndex, node: NodeId) -> Option<&LatestOfNode> {
        self.nodes.get(&(bus, node))
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        let lists = |node: &LatestOfNode| {
            node.errors.capacity() * size_of::<(Code, Option<Timestamp>)>()
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
    use crate::replay::World;
    use crate::session::SessionOptions;

    /// What is known of node 5 behind frames: milliseconds, identifier, data.
    fn behind(frames: &[(i64, u16, &[u8])]) -> LatestOfNode {
        let mut world = World::new(SessionOptions::default());
        let names = BusNames::default();
        for (number, (time, id, data)) in (1..).zip(frames) {
            let mut frame = Frame::data_frame(CanId::standard(*id), data);
            (frame.number, frame.time) = (number, Some(Timestamp(time * 1_000_000)));
            world.push(&frame, &names, &mut |_| ());
        }
        world.latest().of(BusIndex(0), NodeId::Canopen(5)).cloned().unwrap_or_default()
    }

    const BOOT: (i64, u16, &[u8]) = (10, 0x705, &[0]);
    const RAISED: (i64, u16, &[u8]) = (30, 0x085, &[0x30, 0x81, 0x11, 0, 0, 0, 0, 0]);

    #[test]
    fn a_start_and_an_error_have_their_times() {
        let node = behind(&[BOOT, RAISED]);
        let start = node.start().unwrap();
        assert_eq!((start.frame, start.time), (1, Some(Timestamp(10_000_000))));
        assert_eq!(node.raised(Code::Emcy(0x8130)), Some(Timestamp(30_000_000)));
        assert_eq!(node.raised(Code::Emcy(0x8131)), None);
    }

    #[test]
    fn errors_end_with_a_start_or_when_all_are_gone() {
        let again = (40, BOOT.1, BOOT.2);
        let gone: (i64, u16, &[u8]) = (40, 0x085, &[0; 8]);
        for last in [again, gone] {
            assert_eq!(behind(&[BOOT, RAISED, last]).raised(Code::Emcy(0x8130)), None);
        }
        // Raised again: the time of the last message.
        let repeated = (50, RAISED.1, RAISED.2);
        let node = behind(&[BOOT, RAISED, repeated]);
        assert_eq!(node.raised(Code::Emcy(0x8130)), Some(Timestamp(50_000_000)));
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let mut list = Vec::new();
        (0..1_000).for_each(|code| note(&mut list, Code::Emcy(code), ()));
        assert_eq!((list.len(), list.last()), (MOST, Some(&(Code::Emcy(999), ()))));
    }
}

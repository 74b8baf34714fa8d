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

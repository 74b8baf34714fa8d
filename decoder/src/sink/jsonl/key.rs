//! Keys of the lines that are reused for further events: PDO, heartbeat, guarding and SYNC.

use crate::event::{Event, EventKind, EventProtocol};
use crate::frame::{BusIndex, Timestamp};
use crate::session::Bus;
use crate::sink::line_key::{BUS_SLOTS, PDO_SLOTS, node_key, pdo_key, pdo_slot};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Slots for all events.
pub(super) const SLOTS: usize = PDO_SLOTS + OTHER_SLOTS;

/// Slots for all other events.
const OTHER_SLOTS: usize = 256;

/// Everything that determines the constant parts of a line of one capture, except names of nodes and devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LineTemplateKey {
    /// Determines the name of the bus.
    bus: BusIndex,
    protocol: EventProtocol,
    presumed: bool,
    /// Kind, node and all values in the constant parts, packed.
    content: u64,
}

/// Kinds of events whose lines have templates, in the bits of a key above all other values.
const PDO: u64 = 1 << 58;
const HEARTBEAT: u64 = 2 << 58;
const GUARD_REQUEST: u64 = 3 << 58;
const GUARD_REPLY: u64 = 4 << 58;
const SYNC: u64 = 5 << 58;

/// A key with its slot, and the time of the event in ns.
pub(super) struct KeyedEvent {
    pub(super) key: LineTemplateKey,
    pub(super) slot: usize,
    pub(super) time: u64,
}

impl KeyedEvent {
    /// `None` for an event whose lines have no template.
    #[inline]
    pub(super) fn key_event(event: &Event, bus: &Bus) -> Option<Self> {
        let (content, slot) = match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => (PDO | pdo_key(pdo, event.node), pdo_slot(pdo, bus)),
            kind => {
                let (content, slot) = content_of(kind)?;
                let node = event.node.map_or(0, NodeId::table_place);
                let slot = slot + node + usize::from(bus.index().0) * BUS_SLOTS;
                (content | node_key(event.node) << 48, PDO_SLOTS + slot % OTHER_SLOTS)
            }
        };
        if event.frames.first != event.frames.last {
            return None;
        }
        let Timestamp(time) = event.time?;
        let key =
            LineTemplateKey { bus: bus.index(), protocol: event.protocol, presumed: event.presumed, content };
        Some(Self { key, slot, time: u64::try_from(time).ok()? })
    }
}

/// Kind and values of an event other than a PDO, with an offset of its slot; `None` for an event whose lines
/// have no template.
#[inline(never)]
fn content_of(kind: &EventKind) -> Option<(u64, usize)> {
    let state_key = |state: Option<NmtState>| state.map_or(0, |state| state as u64 + 1);
    // Beyond all values of a counter without a value.
    let counter_key = |counter: Option<u8>| counter.map_or(1 << 8, u64::from);
    Some(match *kind {
        EventKind::Heartbeat { state, code } => {
            (HEARTBEAT | state_key(state) | u64::from(code) << 8, usize::from(code))
        }
        EventKind::GuardRequest => (GUARD_REQUEST, 128),
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            let flags = u64::from(toggle) << 16 | u64::from(toggle_error) << 17;
            let slot = 32 + 128 * usize::from(toggle) + usize::from(code);
            (GUARD_REPLY | state_key(state) | u64::from(code) << 8 | flags, slot)
        }
        EventKind::Sync { counter, expected } => {
            (SYNC | counter_key(counter) | counter_key(expected) << 16, usize::from(counter.unwrap_or(0)))
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contents_differ_if_a_field_differs() {
        let heartbeat = |state, code| EventKind::Heartbeat { state, code };
        let reply =
            |code, toggle, toggle_error| EventKind::GuardReply { state: None, code, toggle, toggle_error };
        let sync = |counter, expected| EventKind::Sync { counter, expected };
        let kinds = [
            heartbeat(None, 0),
            heartbeat(None, u8::MAX),
            heartbeat(Some(NmtState::Initialising), 0),
            heartbeat(Some(NmtState::PreOperational), 0),
            EventKind::GuardRequest,
            reply(0, false, false),
            reply(0, true, false),
            reply(0, false, true),
            reply(u8::MAX, false, false),
            sync(None, None),
            sync(Some(0), None),
            sync(None, Some(0)),
            sync(Some(u8::MAX), None),
        ];
        let mut contents: Vec<_> = kinds.iter().map(|kind| content_of(kind).unwrap().0).collect();
        // The node is packed from bit 48 on, the kind from bit 58 on.
        assert!(contents.iter().all(|content| (content >> 48).trailing_zeros() >= 10));
        contents.sort_unstable();
        contents.dedup();
        assert_eq!(contents.len(), kinds.len());
        assert_eq!(content_of(&EventKind::ClockStep { step: 1 }), None);
    }
}

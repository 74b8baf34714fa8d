//! Open transfers of a bus.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use super::session::TransportSession;
use crate::session::limits::{OPEN_DATA_LIMIT, TRANSPORT_LIMIT};

/// Key of an open transfer: sender, destination (255 for a broadcast), and protocol. J1939-21 §5.10.3 allows
/// one connection per direction, and one broadcast per sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct SessionKey {
    pub(super) source: u8,
    pub(super) destination: u8,
    pub(super) is_extended: bool,
}

/// Slot for an open transfer; its index is the subject of the deadline.
#[derive(Debug, Clone, Default)]
struct TransferSlot {
    open: Option<(SessionKey, Box<TransportSession>)>,
    is_queued: bool,
}

/// Result of the timer entry of a slot.
pub(super) enum SessionTimeout {
    /// No open transfer.
    Nothing,
    /// The deadline moved to this time.
    Later(i64),
    /// Transfer that timed out at this time.
    Over(Box<TransportSession>, i64),
}

/// Table of open transfers.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SessionTable {
    places: Vec<TransferSlot>,
    by_key: HashMap<SessionKey, u16, FixedState>,
    free: Vec<u16>,
    /// Data bytes held by all open transfers.
    open_bytes: usize,
}

impl SessionTable {
    /// Index of a transfer.
    pub(super) fn find_session(&self, key: SessionKey) -> Option<u16> {
        self.by_key.get(&key).copied()
    }

    pub(super) fn get(&self, place: u16) -> Option<&TransportSession> {
        self.places.get(usize::from(place))?.open.as_ref().map(|(_, session)| &**session)
    }

    pub(super) fn get_mut(&mut self, place: u16) -> Option<&mut TransportSession> {
        self.places.get_mut(usize::from(place))?.open.as_mut().map(|(_, session)| &mut **session)
    }

    /// Opens a transfer; if the table is full, the oldest transfer is evicted and returned.
    pub(super) fn open_session(
        &mut self,
        key: SessionKey,
        session: TransportSession,
    ) -> (u16, Option<Box<TransportSession>>) {
        let mut given_up = None;
        if self.free.is_empty() {
            match u16::try_from(self.places.len()) {
                Ok(place) if self.places.len() < TRANSPORT_LIMIT => {
                    self.places.push(TransferSlot::default());
                    self.free.push(place);
                }
                _ => given_up = self.oldest_session().and_then(|place| self.close_session(place)),
            }
        }
        let place = self.free.pop().unwrap_or_default();
        if let Some(entry) = self.places.get_mut(usize::from(place)) {
            entry.open = Some((key, Box::new(session)));
            self.by_key.insert(key, place);
        }
        (place, given_up)
    }

    fn oldest_session(&self) -> Option<u16> {
        let open = self.places.iter().zip(0..);
        let first = open.filter_map(|(place, number)| Some((place.open.as_ref()?.1.frames.first, number)));
        first.min().map(|(_, number)| number)
    }

    /// Removes and returns a transfer.
    pub(super) fn close_session(&mut self, place: u16) -> Option<Box<TransportSession>> {
        let (key, session) = self.places.get_mut(usize::from(place))?.open.take()?;
        self.by_key.remove(&key);
        self.free.push(place);
        self.open_bytes = self.open_bytes.saturating_sub(session.received.held_bytes());
        Some(session)
    }

    /// Updates the data size of a transfer from `before` bytes; `true` if its data was dropped for the limit.
    pub(super) fn update_size(&mut self, place: u16, before: usize) -> bool {
        let Some(session) = self.get_mut(place) else { return false };
        let held = session.received.held_bytes();
        let open = self.open_bytes.saturating_sub(before).saturating_add(held);
        self.open_bytes = open;
        if open <= OPEN_DATA_LIMIT || held == 0 {
            return false;
        }
        self.open_bytes = open.saturating_sub(held);
        if let Some(session) = self.get_mut(place) {
            session.received.give_up_data();
        }
        true
    }

    /// Deadline of a transfer without an entry in the timer queue; marks it as queued.
    pub(super) fn queue_deadline(&mut self, place: u16) -> Option<i64> {
        let place = self.places.get_mut(usize::from(place))?;
        let (_, session) = place.open.as_ref()?;
        (!std::mem::replace(&mut place.is_queued, true)).then(|| session.timeout_at())
    }

    /// Evaluates the timer entry of a slot that is due.
    pub(super) fn evaluate_timer(&mut self, number: u16, now: i64) -> SessionTimeout {
        let Some(place) = self.places.get_mut(usize::from(number)) else { return SessionTimeout::Nothing };
        place.is_queued = false;
        let Some((_, session)) = &place.open else { return SessionTimeout::Nothing };
        let deadline = session.timeout_at();
        if deadline >= now {
            place.is_queued = true;
            return SessionTimeout::Later(deadline);
        }
        self.close_session(number)
            .map_or(SessionTimeout::Nothing, |session| SessionTimeout::Over(session, deadline))
    }

    /// Postpones all deadlines by `delay` ns.
    pub(in crate::session) fn postpone_deadlines(&mut self, delay: i64) {
        for (_, session) in self.places.iter_mut().filter_map(|place| place.open.as_mut()) {
            session.postpone_timeout(delay);
        }
    }

    /// Removes and returns all transfers in the order of their start.
    pub(super) fn drain_sessions(&mut self) -> impl Iterator<Item = Box<TransportSession>> + use<> {
        let places: Vec<u16> = self.by_key.values().copied().collect();
        let mut open: Vec<_> = places.into_iter().filter_map(|place| self.close_session(place)).collect();
        open.sort_by_key(|session| session.frames.first);
        open.into_iter()
    }

    /// Bytes held by the table.
    pub(in crate::session) fn footprint(&self) -> usize {
        let open = self.places.iter().filter_map(|place| place.open.as_ref());
        let open = open.map(|(_, session)| size_of::<TransportSession>() + session.received.footprint());
        self.places.capacity() * size_of::<TransferSlot>()
            + self.by_key.capacity() * size_of::<(SessionKey, u16)>()
            + self.free.capacity() * size_of::<u16>()
            + open.sum::<usize>()
    }
}

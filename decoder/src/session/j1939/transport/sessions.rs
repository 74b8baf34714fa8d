//! All open transfers of a bus.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use super::session::Session;
use crate::session::limits::{OPEN_DATA_LIMIT, TRANSPORT_LIMIT};

/// What one transfer at a time can have: its sender, its destination (255 for a broadcast), and the protocol.
/// J1939-21 §5.10.3 allows one connection in a direction, and one broadcast of a sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Key {
    pub(super) source: u8,
    pub(super) destination: u8,
    pub(super) is_extended: bool,
}

/// A place for an open transfer; its number is the subject of its deadline.
#[derive(Debug, Clone, Default)]
struct Place {
    open: Option<(Key, Box<Session>)>,
    is_queued: bool,
}

/// What a timer entry of a place comes to.
pub(super) enum Due {
    /// Nothing is open.
    Nothing,
    /// The deadline lies later.
    Later(i64),
    /// The transfer is over since this time.
    Over(Box<Session>, i64),
}

/// Open transfers of a bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Sessions {
    places: Vec<Place>,
    by_key: HashMap<Key, u16, FixedState>,
    free: Vec<u16>,
    /// Bytes of data all of them hold.
    open_bytes: usize,
}

impl Sessions {
    /// Place of a transfer.
    pub(super) fn find(&self, key: Key) -> Option<u16> {
        self.by_key.get(&key).copied()
    }

    pub(super) fn get(&self, place: u16) -> Option<&Session> {
        self.places.get(usize::from(place))?.open.as_ref().map(|(_, session)| &**session)
    }

    pub(super) fn get_mut(&mut self, place: u16) -> Option<&mut Session> {
        self.places.get_mut(usize::from(place))?.open.as_mut().map(|(_, session)| &mut **session)
    }

    /// Opens a transfer; where all places are taken, that which began first is given up for it.
    pub(super) fn open(&mut self, key: Key, session: Session) -> (u16, Option<Box<Session>>) {
        let mut given_up = None;
        if self.free.is_empty() {
            match u16::try_from(self.places.len()) {
                Ok(place) if self.places.len() < TRANSPORT_LIMIT => {
                    self.places.push(Place::default());
                    self.free.push(place);
                }
                _ => given_up = self.oldest().and_then(|place| self.close(place)),
            }
        }
        let place = self.free.pop().unwrap_or_default();
        if let Some(entry) = self.places.get_mut(usize::from(place)) {
            entry.open = Some((key, Box::new(session)));
            self.by_key.insert(key, place);
        }
        (place, given_up)
    }

    fn oldest(&self) -> Option<u16> {
        let open = self.places.iter().zip(0..);
        let first = open.filter_map(|(place, number)| Some((place.open.as_ref()?.1.frames.first, number)));
        first.min().map(|(_, number)| number)
    }

    /// Takes a transfer out.
    pub(super) fn close(&mut self, place: u16) -> Option<Box<Session>> {
        let (key, session) = self.places.get_mut(usize::from(place))?.open.take()?;
        self.by_key.remove(&key);
        self.free.push(place);
        self.open_bytes = self.open_bytes.saturating_sub(session.received.held());
        Some(session)
    }

    /// A transfer grew from `before` bytes of data; `true` where its data had to be dropped for the others.
    pub(super) fn grew(&mut self, place: u16, before: usize) -> bool {
        let Some(session) = self.get_mut(place) else { return false };
        let held = session.received.held();
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

    /// The deadline of a transfer that has no entry in the timer queue; it has one from now on.
    pub(super) fn queue(&mut self, place: u16) -> Option<i64> {
        let place = self.places.get_mut(usize::from(place))?;
        let (_, session) = place.open.as_ref()?;
        (!std::mem::replace(&mut place.is_queued, true)).then(|| session.deadline())
    }

    /// What to do when the timer entry of a place comes due.
    pub(super) fn due(&mut self, number: u16, now: i64) -> Due {
        let Some(place) = self.places.get_mut(usize::from(number)) else { return Due::Nothing };
        place.is_queued = false;
        let Some((_, session)) = &place.open else { return Due::Nothing };
        let deadline = session.deadline();
        if deadline >= now {
            place.is_queued = true;
            return Due::Later(deadline);
        }
        self.close(number).map_or(Due::Nothing, |session| Due::Over(session, deadline))
    }

    /// Moves all deadlines by `delay` nanoseconds.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        for (_, session) in self.places.iter_mut().filter_map(|place| place.open.as_mut()) {
            session.postpone(delay);
        }
    }

    /// Takes out all transfers in the order they began.
    pub(super) fn drain(&mut self) -> impl Iterator<Item = Box<Session>> + use<> {
        let places: Vec<u16> = self.by_key.values().copied().collect();
        let mut open: Vec<_> = places.into_iter().filter_map(|place| self.close(place)).collect();
        open.sort_by_key(|session| session.frames.first);
        open.into_iter()
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        let open = self.places.iter().filter_map(|place| place.open.as_ref());
        let open = open.map(|(_, session)| size_of::<Session>() + session.received.footprint());
        self.places.capacity() * size_of::<Place>()
            + self.by_key.capacity() * size_of::<(Key, u16)>()
            + self.free.capacity() * size_of::<u16>()
            + open.sum::<usize>()
    }
}

//! Which J1939 addresses are in the middle of a transfer of several packets.

use crate::wire::j1939::Pgn;

/// Open transfers by the number of their session.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct OpenTransfers {
    /// Sender and group; no group where the start was not received.
    list: Vec<Option<(u8, Option<Pgn>)>>,
}

impl OpenTransfers {
    /// Session `number` is open now; `None`: it is closed.
    pub(in crate::session) fn set(&mut self, number: u16, transfer: Option<(u8, Option<Pgn>)>) {
        let number = usize::from(number);
        if number >= self.list.len() {
            self.list.resize(number.saturating_add(1), None);
        }
        if let Some(entry) = self.list.get_mut(number) {
            *entry = transfer;
        }
    }

    /// Whether an address has an open transfer that can be about a group.
    pub(in crate::session) fn contains(&self, source: u8, pgn: Pgn) -> bool {
        let mut open = self.list.iter().flatten();
        open.any(|(sender, group)| *sender == source && group.is_none_or(|group| group == pgn))
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.list.capacity() * size_of::<Option<(u8, Option<Pgn>)>>()
    }
}

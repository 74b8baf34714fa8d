//! J1939 addresses with an open multi-packet transfer.

use crate::wire::j1939::Pgn;

/// Open transfers by session number.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct OpenTransfers {
    /// Sender and group; no group if the start was not received.
    list: Vec<Option<(u8, Option<Pgn>)>>,
}

impl OpenTransfers {
    /// Opens session `number`, or closes it with `None`.
    pub(in crate::session) fn set_session(&mut self, number: u16, transfer: Option<(u8, Option<Pgn>)>) {
        let number = usize::from(number);
        if number >= self.list.len() {
            self.list.resize(number.saturating_add(1), None);
        }
        if let Some(entry) = self.list.get_mut(number) {
            *entry = transfer;
        }
    }

    /// Whether `source` has an open transfer that may be about `pgn`.
    pub(in crate::session) fn contains(&self, source: u8, pgn: Pgn) -> bool {
        let mut open = self.list.iter().flatten();
        open.any(|(sender, group)| *sender == source && group.is_none_or(|group| group == pgn))
    }

    /// Bytes held by the list.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.list.capacity() * size_of::<Option<(u8, Option<Pgn>)>>()
    }
}

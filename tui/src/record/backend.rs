//! Writers behind the queue of a recorder.

use std::time::Instant;

use super::item::Item;
use super::parts::Parts;
use super::status::RecordStatus;

/// Writes the items of a recorder, on the thread of the recorder.
pub(super) trait Backend: Send {
    /// Takes items in order and passes them to the system. `buses` contains the names of their buses.
    fn take(&mut self, items: Vec<Item>, buses: &[String], now: Option<Instant>);

    /// Waits until all is on the disk.
    fn sync(&mut self);

    /// Writes the rest at the end.
    fn finish(&mut self, buses: &[String]);

    /// Status so far.
    fn status(&self) -> &RecordStatus;
}

impl Backend for Parts {
    fn take(&mut self, items: Vec<Item>, buses: &[String], now: Option<Instant>) {
        Self::take(self, items, buses, now);
    }

    fn sync(&mut self) {
        Self::sync(self);
    }

    fn finish(&mut self, _buses: &[String]) {
        Self::finish(self);
    }

    fn status(&self) -> &RecordStatus {
        Self::status(self)
    }
}

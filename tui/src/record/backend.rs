//! Writers behind the queue of a recorder.

use std::time::Instant;

use super::item::PendingItem;
use super::parts::RecordParts;
use super::status::RecordStatus;

/// Writes the items of a recorder, on the thread of the recorder.
pub(super) trait RecorderBackend: Send {
    /// Takes items in order and passes them to the system. `buses` contains the names of their buses.
    fn take_items(&mut self, items: Vec<PendingItem>, buses: &[String], now: Option<Instant>);

    /// Waits until all is on the disk.
    fn sync_to_disk(&mut self);

    /// Writes the rest at the end.
    fn finish_recording(&mut self, buses: &[String]);

    /// Status so far.
    fn status(&self) -> &RecordStatus;
}

impl RecorderBackend for RecordParts {
    fn take_items(&mut self, items: Vec<PendingItem>, buses: &[String], now: Option<Instant>) {
        Self::take_items(self, items, buses, now);
    }

    fn sync_to_disk(&mut self) {
        Self::sync_to_disk(self);
    }

    fn finish_recording(&mut self, _buses: &[String]) {
        Self::finish_recording(self);
    }

    fn status(&self) -> &RecordStatus {
        Self::status(self)
    }
}

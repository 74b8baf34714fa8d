//! Ring on disk: the same items as in memory, further into the past.
//!
//! ```text
//! removed ◀─ ring-…-0003.pcapng │ … │ ring-…-0010.pcapng ◀─ items
//!                                          └──── in memory ────┘
//! ```

use std::io::{self, BufReader};
use std::path::Path;
use std::time::Instant;

use cobscope_decoder::capture::{Batch, BatchItem as CaptureItem, CaptureReader, ReadOptions};

use super::super::disk::RecordDisk;
use super::super::item::{PendingItem, RecordItem};
use super::super::parts::RecordParts;
use super::super::status::RecordFailure;

/// Maximum number of files.
pub(super) const MOST_FILES: u32 = 8;

/// Receives items with the number of frames before each; returns whether it needs more.
pub(super) type ItemReceiver<'a> = &'a mut dyn FnMut(u64, PendingItem) -> bool;

/// The files.
pub(super) struct RingFiles {
    parts: RecordParts,
    disk: Box<dyn RecordDisk>,
    /// Number of frames in removed files.
    removed: u64,
    /// The oldest file was read but could not be removed.
    is_read: bool,
}

impl RingFiles {
    pub(super) fn new(parts: RecordParts, disk: Box<dyn RecordDisk>) -> Self {
        Self { parts, disk, removed: 0, is_read: false }
    }

    /// Writes items.
    pub(super) fn take_items(&mut self, items: &[PendingItem], buses: &[String], now: Option<Instant>) {
        let kept = items.iter().filter(|item| !matches!(item.what, RecordItem::Trigger(_)));
        self.parts.take_items(kept.cloned().collect(), buses, now);
    }

    /// Waits until all is on the disk.
    pub(super) fn sync_to_disk(&mut self) {
        self.parts.sync_to_disk();
    }

    /// Removes all files.
    pub(super) fn remove_all(&mut self) {
        self.parts.remove_all();
    }

    /// The last failure to write.
    pub(super) fn last_failure(&self) -> Option<&RecordFailure> {
        self.parts.status().failure.as_ref()
    }

    /// Whether the files contain all frames since the oldest one.
    pub(super) fn is_complete(&self) -> bool {
        self.parts.status().missing == 0
    }

    /// Number of frames before the oldest one.
    pub(super) fn removed_frames(&self) -> u64 {
        self.removed
    }

    /// Removes the oldest files if there are too many; passes their items on before.
    pub(super) fn remove_oldest(&mut self, buses: &[String], each: &mut dyn FnMut(&PendingItem)) {
        while self.parts.paths().count() > MOST_FILES as usize {
            let Some(oldest) = self.parts.paths().next().cloned() else { return };
            if !self.is_read {
                let mut last = self.removed;
                // After an unreadable record the items before it still count.
                let _ = self.read_file(&oldest, self.removed, buses, &mut |before, item| {
                    last = before.saturating_add(u64::from(item.is_frame()));
                    each(&item);
                    true
                });
                self.removed = last;
            }
            self.is_read = !self.parts.remove_oldest();
            if self.is_read {
                return;
            }
        }
    }

    /// Reads the items of all files in order.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(super) fn read_items(&mut self, buses: &[String], each: ItemReceiver<'_>) -> io::Result<()> {
        let paths: Vec<_> = self.parts.paths().skip(usize::from(self.is_read)).cloned().collect();
        let mut before = self.removed;
        for path in paths {
            let mut needs_more = true;
            self.read_file(&path, before, buses, &mut |count, item| {
                before = count.saturating_add(u64::from(item.is_frame()));
                needs_more = each(count, item);
                needs_more
            })?;
            if !needs_more {
                break;
            }
        }
        Ok(())
    }

    fn read_file(
        &mut self,
        path: &Path,
        mut before: u64,
        buses: &[String],
        each: ItemReceiver<'_>,
    ) -> io::Result<()> {
        let file = BufReader::new(self.disk.read(path)?);
        let mut reader = CaptureReader::open(file, &ReadOptions::default()).map_err(io::Error::other)?;
        let mut batch = Batch::new();
        while reader.read(&mut batch).map_err(io::Error::other)? {
            for item in batch.items() {
                let (own, what) = match item {
                    CaptureItem::Frame(frame) => (frame.bus, RecordItem::Frame(*frame)),
                    CaptureItem::Notice(notice) => (notice.bus(), RecordItem::Notice(notice.clone())),
                };
                let name = reader.buses().names().get(usize::from(own.0));
                let Some(bus) = name.and_then(|name| buses.iter().position(|known| known == name)) else {
                    continue;
                };
                let mut item = PendingItem { bus, what };
                let is_frame = item.is_frame();
                if let RecordItem::Frame(frame) = &mut item.what {
                    frame.number = before.saturating_add(1);
                }
                if !each(before, item) {
                    return Ok(());
                }
                before = before.saturating_add(u64::from(is_frame));
            }
        }
        Ok(())
    }
}

//! One file of a capture; it always ends after a complete record, whatever fails.

use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use cobscope_decoder::capture::{FrameWriter, WritableFormat, WriteOptions};

use super::disk::RecordFile;
use super::item::{PendingItem, RecordItem};

/// Bytes of records that are not written yet.
#[derive(Clone, Default)]
struct SharedBuffer(Arc<Mutex<Vec<u8>>>);

impl SharedBuffer {
    fn lock(&self) -> MutexGuard<'_, Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for SharedBuffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Result of writing.
#[derive(Debug, Default)]
pub(super) struct WriteResult {
    /// Number of frames added to the file.
    pub frames: u64,
    /// Number of bytes added to the file.
    pub bytes: u64,
    /// Error that prevented a complete write.
    pub failure: Option<io::Error>,
}

/// A file being written.
pub(super) struct RecordPart {
    path: PathBuf,
    file: Box<dyn RecordFile>,
    writer: Box<dyn FrameWriter>,
    held: SharedBuffer,
    held_length: usize,
    /// Buffered items, each with the end of its bytes.
    records: Vec<(usize, PendingItem)>,
    /// Bytes of complete records in the file.
    length: u64,
    frames: u64,
    is_empty: bool,
    is_synced: bool,
    /// Time of its start.
    pub begun: Option<Instant>,
}

impl RecordPart {
    pub(super) fn new(path: PathBuf, file: Box<dyn RecordFile>, format: &WritableFormat) -> Self {
        let held = SharedBuffer::default();
        Self {
            path,
            file,
            writer: (format.writer)(Box::new(held.clone()), &WriteOptions::default()),
            held,
            held_length: 0,
            records: Vec::new(),
            length: 0,
            frames: 0,
            is_empty: true,
            is_synced: false,
            begun: None,
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the path after the file was renamed.
    pub(super) fn set_path(&mut self, path: PathBuf) {
        self.path = path;
    }

    /// Number of frames in the file and in the buffer.
    pub(super) fn frames(&self) -> u64 {
        self.frames
    }

    /// Whether the file has no record and can be removed.
    pub(super) fn is_empty(&self) -> bool {
        self.is_empty
    }

    /// Number of buffered bytes.
    pub(super) fn held_bytes(&self) -> usize {
        self.held_length
    }

    /// Bytes of complete records in the file.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Size of the file after all buffered bytes are written.
    pub(super) fn full_length(&self) -> u64 {
        self.length.saturating_add(self.held_bytes() as u64).saturating_add(self.writer.pending())
    }

    /// Whether the format buffers records, so that none can be removed.
    pub(super) fn gathers_records(&self) -> bool {
        self.writer.pending() > 0
    }

    /// Adds an item to the buffer; returns it if the format cannot store it.
    ///
    /// # Errors
    /// The item cannot be encoded; it stays in the buffer, to be returned with the others.
    pub(super) fn push(&mut self, item: PendingItem, bus: &str) -> io::Result<Option<PendingItem>> {
        let kept = match &item.what {
            RecordItem::Frame(frame) => self.writer.write(frame, bus).map(|()| true),
            RecordItem::Commented(commented) => {
                let (frame, comment) = &**commented;
                self.writer.write_commented(frame, bus, comment).map(|()| true)
            }
            RecordItem::Notice(notice) => self.writer.notice(notice, bus),
            RecordItem::Trigger(_) => Ok(false),
        };
        if matches!(kept, Ok(false)) {
            self.held.lock().truncate(self.held_length);
            return Ok(Some(item));
        }
        self.frames += u64::from(item.is_frame());
        self.held_length = self.held.lock().len();
        self.records.push((self.held_length, item));
        kept.map(|_| None)
    }

    /// Removes the last item if it is still buffered.
    pub(super) fn undo_item(&mut self) -> Option<PendingItem> {
        if self.gathers_records() {
            return None;
        }
        let (_, item) = self.records.pop()?;
        self.held_length = self.records.last().map_or(0, |(end, _)| *end);
        self.held.lock().truncate(self.held_length);
        self.frames -= u64::from(item.is_frame());
        Some(item)
    }

    /// Writes the buffer. On failure the file is truncated after its last complete record, and the other
    /// items stay buffered.
    pub(super) fn write_out(&mut self) -> WriteResult {
        if let Err(error) = self.writer.flush() {
            return WriteResult { failure: Some(error), ..WriteResult::default() };
        }
        let known = std::mem::take(&mut self.held_length);
        let bytes = std::mem::take(&mut *self.held.lock());
        if bytes.len() > known {
            // Buffered records of the format are written completely or not at all.
            self.records.iter_mut().for_each(|(end, _)| *end = bytes.len());
        }
        if bytes.is_empty() {
            return WriteResult::default();
        }
        let (done, failure) = write_all(self.file.as_mut(), &bytes);
        let whole = self.records.partition_point(|(end, _)| *end <= done);
        let kept = match (&failure, whole.checked_sub(1).and_then(|last| self.records.get(last))) {
            (None, _) => done,
            (Some(_), last) => last.map_or(0, |(end, _)| *end),
        };
        self.length = self.length.saturating_add(kept as u64);
        if failure.is_some() {
            // A device that is gone has nothing to truncate.
            let _ = self.file.truncate_to(self.length);
        }
        let frames = self.records.drain(..whole).filter(|(_, item)| item.is_frame()).count();
        self.is_empty &= whole == 0;
        self.is_synced = false;
        // Reuses the memory.
        *self.held.lock() = clear_bytes(bytes);
        WriteResult { frames: frames as u64, bytes: kept as u64, failure }
    }

    /// Writes the buffer and the end of the format.
    pub(super) fn end_part(&mut self) -> WriteResult {
        match self.writer.finish() {
            Ok(()) => self.write_out(),
            Err(error) => WriteResult { failure: Some(error), ..WriteResult::default() },
        }
    }

    /// Waits until the written bytes are on the disk.
    ///
    /// # Errors
    /// The disk reports a failure.
    pub(super) fn sync_to_disk(&mut self) -> io::Result<()> {
        if !self.is_synced {
            self.file.sync_to_disk()?;
            self.is_synced = true;
        }
        Ok(())
    }

    /// The items that could not be written.
    pub(super) fn unwritten_items(self) -> impl Iterator<Item = PendingItem> {
        self.records.into_iter().map(|(_, item)| item)
    }
}

fn clear_bytes(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.clear();
    bytes
}

/// Writes as many bytes as possible; returns their number and the error.
fn write_all(file: &mut dyn RecordFile, bytes: &[u8]) -> (usize, Option<io::Error>) {
    let mut done = 0;
    while let Some(rest) = bytes.get(done..).filter(|rest| !rest.is_empty()) {
        match file.write(rest) {
            Ok(0) => return (done, Some(ErrorKind::WriteZero.into())),
            Ok(count) => done += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => (),
            Err(error) => return (done, Some(error)),
        }
    }
    (done, None)
}

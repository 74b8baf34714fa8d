//! One file of a record: a whole capture, which ends behind a whole record whatever fails.

use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use cobscope_decoder::capture::{FrameWriter, WritableFormat, WriteOptions};

use super::disk::PartFile;
use super::item::{Item, What};

/// Bytes of records that are not written yet.
#[derive(Clone, Default)]
struct Held(Arc<Mutex<Vec<u8>>>);

impl Held {
    fn lock(&self) -> MutexGuard<'_, Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Held {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What came of writing.
#[derive(Debug, Default)]
pub(super) struct Written {
    /// Frames that are in the file now and were not before.
    pub frames: u64,
    /// Bytes, likewise.
    pub bytes: u64,
    /// Why not all of it is there.
    pub failure: Option<io::Error>,
}

/// A file being written.
pub(super) struct Part {
    path: PathBuf,
    file: Box<dyn PartFile>,
    writer: Box<dyn FrameWriter>,
    held: Held,
    held_length: usize,
    /// What is held, each with the end of its bytes.
    records: Vec<(usize, Item)>,
    /// Bytes of whole records in the file.
    length: u64,
    frames: u64,
    is_empty: bool,
    is_synced: bool,
    /// When it was begun.
    pub begun: Option<Instant>,
}

impl Part {
    pub(super) fn new(path: PathBuf, file: Box<dyn PartFile>, format: &WritableFormat) -> Self {
        let held = Held::default();
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

    /// Frames in it and held for it.
    pub(super) fn frames(&self) -> u64 {
        self.frames
    }

    /// Whether its file has no record, so that it is worth nothing.
    pub(super) fn is_empty(&self) -> bool {
        self.is_empty
    }

    /// Bytes held.
    pub(super) fn held(&self) -> usize {
        self.held_length
    }

    /// Bytes of whole records in its file.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Bytes its file has when all is written.
    pub(super) fn full_length(&self) -> u64 {
        self.length.saturating_add(self.held() as u64).saturating_add(self.writer.pending())
    }

    /// Whether its format gathers records, so that none can be taken back.
    pub(super) fn gathers(&self) -> bool {
        self.writer.pending() > 0
    }

    /// Adds an item, which is held until it is written; gives it back where the format has no place for it.
    ///
    /// # Errors
    /// When it cannot be put in bytes; it is held then, to be given back with the others.
    pub(super) fn push(&mut self, item: Item, bus: &str) -> io::Result<Option<Item>> {
        let kept = match &item.what {
            What::Frame(frame) => self.writer.write(frame, bus).map(|()| true),
            What::Notice(notice) => self.writer.notice(notice, bus),
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

    /// Takes the last item back if it is held.
    pub(super) fn undo(&mut self) -> Option<Item> {
        if self.gathers() {
            return None;
        }
        let (_, item) = self.records.pop()?;
        self.held_length = self.records.last().map_or(0, |(end, _)| *end);
        self.held.lock().truncate(self.held_length);
        self.frames -= u64::from(item.is_frame());
        Some(item)
    }

    /// Writes what is held. When that fails the file is cut behind its last whole record, and what is not in it
    /// stays here.
    pub(super) fn write_out(&mut self) -> Written {
        if let Err(error) = self.writer.flush() {
            return Written { failure: Some(error), ..Written::default() };
        }
        let known = std::mem::take(&mut self.held_length);
        let bytes = std::mem::take(&mut *self.held.lock());
        if bytes.len() > known {
            // What was gathered until now is there as a whole or not at all.
            self.records.iter_mut().for_each(|(end, _)| *end = bytes.len());
        }
        if bytes.is_empty() {
            return Written::default();
        }
        let (done, failure) = write_all(self.file.as_mut(), &bytes);
        let whole = self.records.partition_point(|(end, _)| *end <= done);
        let kept = match (&failure, whole.checked_sub(1).and_then(|last| self.records.get(last))) {
            (None, _) => done,
            (Some(_), last) => last.map_or(0, |(end, _)| *end),
        };
        self.length = self.length.saturating_add(kept as u64);
        if failure.is_some() {
            // A device that is gone has nothing to cut.
            let _ = self.file.cut(self.length);
        }
        let frames = self.records.drain(..whole).filter(|(_, item)| item.is_frame()).count();
        self.is_empty &= whole == 0;
        self.is_synced = false;
        // The same memory again.
        *self.held.lock() = cleared(bytes);
        Written { frames: frames as u64, bytes: kept as u64, failure }
    }

    /// Writes what is held and whatever the format has at a capture's end.
    pub(super) fn end(&mut self) -> Written {
        match self.writer.finish() {
            Ok(()) => self.write_out(),
            Err(error) => Written { failure: Some(error), ..Written::default() },
        }
    }

    /// Waits until what was written is on the disk.
    ///
    /// # Errors
    /// When the disk says that it is not.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        if !self.is_synced {
            self.file.sync()?;
            self.is_synced = true;
        }
        Ok(())
    }

    /// What it could not write.
    pub(super) fn abandon(self) -> impl Iterator<Item = Item> {
        self.records.into_iter().map(|(_, item)| item)
    }
}

fn cleared(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.clear();
    bytes
}

/// Writes as much as can be: how many bytes, and why not all.
fn write_all(file: &mut dyn PartFile, bytes: &[u8]) -> (usize, Option<io::Error>) {
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

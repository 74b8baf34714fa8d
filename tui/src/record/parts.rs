//! The parts of a capture, one after the other. Thread and clock belong to the recorder.
//!
//! ```text
//! items ──▶ part ──full, over time──▶ next part
//!            └─ fails: truncated after its last record ──▶ gap, counted ──seconds──▶ next part with the gap
//! ```
//! Later parts start with a frame, so that no part is without one.

use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{LossCounter, WritableFormat};

use super::disk::{RecordDisk, RecordFile};
use super::item::{PendingItem, RecordGap, RecordItem};
use super::names::{RecordNames, creation_error};
use super::part::{RecordPart, WriteResult};
use super::status::{RecordFailure, RecordStatus, UnstoredKind};

/// Time between a failure and the next attempt.
pub(super) const RETRY_AFTER: Duration = Duration::from_secs(5);

/// Number of bytes buffered before they are written.
const CHUNK: usize = 64 * 1024;

/// Maximum size of one more frame in a format that buffers records.
const LARGEST_FRAME: u64 = 256;

/// Maximum number of existing file names that are skipped for a new part.
const TAKEN: u32 = 1_000;

/// Limits of a part, and number of parts kept.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordLimits {
    pub bytes: u64,
    pub time: Duration,
    pub files: usize,
}

/// All parts of a capture.
pub(super) struct RecordParts {
    disk: Box<dyn RecordDisk>,
    names: RecordNames,
    format: &'static WritableFormat,
    limits: RecordLimits,
    /// None while nothing can be written.
    part: Option<RecordPart>,
    kept: VecDeque<PathBuf>,
    now: Option<Instant>,
    retry_at: Option<Instant>,
    gap: RecordGap,
    losses: LossCounter,
    status: RecordStatus,
}

impl RecordParts {
    /// Starts the first part.
    ///
    /// # Errors
    /// The file exists or cannot be created or written.
    pub(super) fn open_parts(
        mut disk: Box<dyn RecordDisk>,
        names: RecordNames,
        format: &'static WritableFormat,
        limits: RecordLimits,
    ) -> anyhow::Result<Self> {
        let path = names.next();
        let file = disk.create_file(&path).map_err(|error| creation_error(&path, error))?;
        Self::in_file(disk, (path.clone(), file), names, format, limits)
            .map_err(|error| creation_error(&path, error))
    }

    /// Starts the first part in a new file, which need not have the next one of `names`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn in_file(
        disk: Box<dyn RecordDisk>,
        (path, file): (PathBuf, Box<dyn RecordFile>),
        names: RecordNames,
        format: &'static WritableFormat,
        limits: RecordLimits,
    ) -> io::Result<Self> {
        let mut parts = Self {
            disk,
            names,
            format,
            limits,
            part: None,
            kept: VecDeque::new(),
            now: None,
            retry_at: None,
            gap: RecordGap::default(),
            losses: LossCounter::new(format.holds),
            status: RecordStatus { format: format.title, ..RecordStatus::default() },
        };
        parts.adopt_file(path, file);
        parts.write_out();
        match parts.status.failure.take() {
            Some(RecordFailure { reason, .. }) => Err(io::Error::other(reason)),
            None => Ok(parts),
        }
    }

    pub(super) fn status(&self) -> &RecordStatus {
        &self.status
    }

    /// Takes items in order and passes them to the system. `buses` contains the names of their buses.
    pub(super) fn take_items(&mut self, items: Vec<PendingItem>, buses: &[String], now: Option<Instant>) {
        self.now = now.or(self.now);
        if let Some(part) = &mut self.part {
            part.begun = part.begun.or(self.now);
        }
        for item in items {
            let begins = item.is_frame();
            let has_place = match &self.part {
                None => begins && self.may_try() && self.begin_part(buses),
                Some(part) if begins && self.is_over_time(part) => self.end_part() && self.begin_part(buses),
                Some(_) => true,
            };
            if has_place {
                self.record_item(item, buses);
            } else {
                self.note_missed(item);
            }
        }
        self.write_out();
    }

    /// Renames the current part; replaces the file `to`.
    ///
    /// # Errors
    /// No part is open, or the file cannot be renamed.
    pub(super) fn rename_part(&mut self, to: PathBuf) -> io::Result<()> {
        let part = self.part.as_mut().ok_or(ErrorKind::NotFound)?;
        self.disk.rename_file(part.path(), &to)?;
        part.set_path(to.clone());
        if let Some(last) = self.kept.back_mut() {
            last.clone_from(&to);
        }
        self.status.path = to;
        Ok(())
    }

    /// Paths of the parts that were not removed.
    pub(super) fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.kept.iter()
    }

    /// Removes the oldest part, which is not the current one; `false` if it cannot be removed.
    pub(super) fn remove_oldest(&mut self) -> bool {
        let oldest = self.kept.front().filter(|_| self.kept.len() > 1);
        let is_removed = oldest.is_some_and(|oldest| self.disk.remove_file(oldest).is_ok());
        if is_removed {
            self.kept.pop_front();
            self.status.removed += 1;
        }
        is_removed
    }

    /// Removes all parts.
    pub(super) fn remove_all(&mut self) {
        self.part = None;
        for path in self.kept.drain(..) {
            // A file that cannot be removed stays; it is not part of the result.
            let _ = self.disk.remove_file(&path);
        }
    }

    /// Waits until all is on the disk.
    pub(super) fn sync_to_disk(&mut self) {
        let Some(Err(error)) = self.part.as_mut().map(RecordPart::sync_to_disk) else { return };
        // The lost items are unknown: the system had accepted them.
        let reason = format!("{error}; the last second may be missing on the disk");
        self.close_failed(&io::Error::new(error.kind(), reason));
    }

    /// Writes the rest at the end.
    pub(super) fn finish_recording(&mut self) {
        self.end_part();
        self.status.losses = self.losses.loss_texts();
        self.status.has_ended = true;
    }

    fn is_over_time(&self, part: &RecordPart) -> bool {
        let time = self.now.zip(part.begun).map(|(now, begun)| now.saturating_duration_since(begun));
        part.frames() > 0 && time.is_some_and(|time| time >= self.limits.time)
    }

    /// Whether enough time has passed since the last failure.
    fn may_try(&self) -> bool {
        self.now.is_some_and(|now| self.retry_at.is_none_or(|at| now >= at))
    }

    /// Adds an item to the current part, or to the next one if the current part is full.
    fn record_item(&mut self, item: PendingItem, buses: &[String]) {
        let begins = item.is_frame();
        if begins
            && self.part.as_ref().is_some_and(|part| part.gathers_records() && self.is_nearly_full(part))
        {
            if self.end_part() && self.begin_part(buses) {
                self.push(item, buses);
            } else {
                self.note_missed(item);
            }
            return;
        }
        self.push(item, buses);
        let too_much = |part: &RecordPart| part.full_length() > self.limits.bytes && part.frames() > 1;
        if begins
            && self.part.as_ref().is_some_and(too_much)
            && let Some(item) = self.part.as_mut().and_then(RecordPart::undo_item)
        {
            if self.end_part() && self.begin_part(buses) {
                self.push(item, buses);
            } else {
                self.note_missed(item);
            }
        }
        if self.part.as_ref().is_some_and(|part| part.held_bytes() >= CHUNK) {
            self.write_out();
        }
    }

    /// Whether the next frame may exceed the limit.
    fn is_nearly_full(&self, part: &RecordPart) -> bool {
        part.frames() > 0 && part.full_length().saturating_add(LARGEST_FRAME) > self.limits.bytes
    }

    fn push(&mut self, item: PendingItem, buses: &[String]) {
        let Some(part) = &mut self.part else {
            self.note_missed(item);
            return;
        };
        let bus = buses.get(item.bus).map_or("", String::as_str);
        if let Some(frame) = item.frame() {
            self.losses.count_frame(frame);
        }
        match part.push(item, bus) {
            Ok(None) => (),
            Ok(Some(item)) => {
                let RecordItem::Notice(notice) = item.what else { return };
                if let Some(unheld) = UnstoredKind::kind_of(&notice) {
                    self.status.leave_out(unheld);
                }
            }
            Err(error) => self.close_failed(&error),
        }
    }

    /// Starts the next part with notices about the gap before it; `false` on failure.
    fn begin_part(&mut self, buses: &[String]) -> bool {
        let (path, made) = self.create_file();
        let file = match made {
            Ok(file) => file,
            Err(error) => {
                self.note_failure(path, &error);
                return false;
            }
        };
        self.adopt_file(path, file);
        // Makes room on a full disk.
        self.remove_old();
        self.write_out();
        if self.part.is_none() {
            return false;
        }
        for item in self.gap.take_notices() {
            self.push(item, buses);
        }
        true
    }

    /// Creates a file with the next free name.
    fn create_file(&mut self) -> (PathBuf, io::Result<Box<dyn RecordFile>>) {
        let mut left = TAKEN;
        loop {
            let path = self.names.next();
            match self.disk.create_file(&path) {
                Err(error) if error.kind() == ErrorKind::AlreadyExists && left > 0 => {
                    self.names.number += 1;
                    left -= 1;
                }
                made => return (path, made),
            }
        }
    }

    fn adopt_file(&mut self, path: PathBuf, file: Box<dyn RecordFile>) {
        let mut part = RecordPart::new(path.clone(), file, self.format);
        part.begun = self.now;
        self.part = Some(part);
        self.kept.push_back(path.clone());
        self.names.number += 1;
        self.status.parts += 1;
        self.status.path = path;
    }

    fn remove_old(&mut self) {
        while self.kept.len() > self.limits.files.max(1) {
            let Some(oldest) = self.kept.pop_front() else { return };
            match self.disk.remove_file(&oldest) {
                Ok(()) => self.status.removed += 1,
                // Removed by the user.
                Err(error) if error.kind() == ErrorKind::NotFound => (),
                // Tried again with the next part.
                Err(_) => {
                    self.kept.push_front(oldest);
                    return;
                }
            }
        }
    }

    /// Ends the current part; `false` on failure.
    fn end_part(&mut self) -> bool {
        let Some(written) = self.part.as_mut().map(RecordPart::end_part) else { return false };
        self.count_written(written);
        self.sync_to_disk();
        self.part.take().is_some()
    }

    fn write_out(&mut self) {
        if let Some(written) = self.part.as_mut().map(RecordPart::write_out) {
            self.count_written(written);
        }
    }

    fn count_written(&mut self, written: WriteResult) {
        self.status.frames = self.status.frames.saturating_add(written.frames);
        self.status.bytes = self.status.bytes.saturating_add(written.bytes);
        match (written.failure, &mut self.status.failure) {
            (Some(error), _) => self.close_failed(&error),
            (None, Some(failure)) if written.frames > 0 => failure.is_over = true,
            (None, _) => (),
        }
    }

    /// Closes the current part after a failure.
    fn close_failed(&mut self, error: &io::Error) {
        let Some(part) = self.part.take() else { return };
        let path = part.path().to_owned();
        if part.is_empty() && self.disk.remove_file(&path).is_ok() {
            self.kept.pop_back();
            self.names.number -= 1;
            self.status.parts -= 1;
            self.status.bytes = self.status.bytes.saturating_sub(part.length());
        }
        self.note_failure(path, error);
        for item in part.unwritten_items() {
            self.note_missed(item);
        }
    }

    fn note_failure(&mut self, path: PathBuf, error: &io::Error) {
        let missing = match &self.status.failure {
            Some(failure) if !failure.is_over => failure.missing,
            _ => 0,
        };
        self.retry_at = self.now.map(|now| now + RETRY_AFTER);
        self.status.failure =
            Some(RecordFailure { path, reason: error.to_string(), missing, is_over: false });
    }

    fn note_missed(&mut self, item: PendingItem) {
        if item.is_frame() {
            self.status.missing += 1;
            if let Some(failure) = &mut self.status.failure {
                failure.missing += 1;
            }
        }
        self.gap.add_missed(item);
    }
}

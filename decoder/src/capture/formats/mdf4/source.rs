//! Reads the frames of one group in order.

use std::sync::Arc;

use super::field::Record;
use super::frame::{self, ChannelFrame};
use super::group::{Frames, Size};
use super::records::{Next, Records, Values};
use crate::capture::{Batch, CapturePlace, Notice};

/// Reader of one group of frames.
#[derive(Clone)]
pub(super) struct Source {
    frames: Arc<Frames>,
    records: Records,
    values: Values,
    size: u64,
    /// Declared number of records, if any.
    expected: Option<u64>,
    /// Byte offset of the group's description.
    at: u64,
    /// Whether this source reports problems of data shared with other groups.
    is_first: bool,
    index: u64,
    /// Latest time so far.
    clock: Option<i64>,
    /// The next frame, and its time in nanoseconds since the start.
    next: Option<(Option<i64>, ChannelFrame)>,
    has_ended: bool,
    record: Vec<u8>,
}

/// A time in nanoseconds since the start; frames without time sort first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Due(Option<i64>);

/// Arguments to create a source.
pub(super) struct Parts {
    pub(super) frames: Frames,
    pub(super) records: Records,
    pub(super) values: Values,
    pub(super) size: Size,
    pub(super) expected: Option<u64>,
    pub(super) at: u64,
    pub(super) is_first: bool,
}

impl Source {
    /// Creates a source before its first record.
    pub(super) fn new(parts: Parts) -> Self {
        Self {
            frames: Arc::new(parts.frames),
            records: parts.records,
            values: parts.values,
            size: match parts.size {
                Size::Fixed(size) => size,
                Size::Variable => 0,
            },
            expected: parts.expected,
            at: parts.at,
            is_first: parts.is_first,
            index: 0,
            clock: None,
            next: None,
            has_ended: false,
            record: Vec::new(),
        }
    }

    /// Whether the next record must be read before the next frame is known.
    pub(super) fn is_behind(&self) -> bool {
        self.next.is_none() && !self.has_ended
    }

    /// Time at which the next frame is due; not before an earlier frame of the group.
    pub(super) fn due(&self) -> Option<Due> {
        self.next.as_ref().map(|(time, _)| Due((*time).max(self.clock)))
    }

    /// Takes the next frame and its time.
    pub(super) fn take(&mut self) -> Option<(Option<i64>, ChannelFrame)> {
        let (time, found) = self.next.take()?;
        self.clock = self.clock.max(time);
        Some((time, found))
    }

    /// Number of skipped records that are not part of a frame; of shared data, one source returns it.
    pub(super) fn others(&self) -> u64 {
        if self.is_first { self.records.others } else { 0 }
    }

    /// Reads one record.
    pub(super) fn step(&mut self, file: &[u8], batch: &mut Batch) {
        let mut record = std::mem::take(&mut self.record);
        let next = self.records.next(file, &mut record);
        self.report_damage(batch);
        match next {
            Next::Record => self.record(file, &record, batch),
            Next::Broken => {
                if !self.records.align(self.size) {
                    self.end(batch);
                }
            }
            Next::Unknown(number) => {
                self.report(format!("record of undefined group {number}: rest of the data skipped"), batch);
                self.end(batch);
            }
            Next::End(left) => {
                if left > 0 {
                    self.cut(file, batch);
                }
                self.end(batch);
            }
        }
        self.record = record;
    }

    fn record(&mut self, file: &[u8], record: &[u8], batch: &mut Batch) {
        let time = self.frames.clock.map(|clock| clock.time(record, self.index));
        let numbered = Record { bytes: record, number: self.index };
        self.index += 1;
        let found = match time {
            Some(None) => Err("invalid time"),
            _ => frame::found(&self.frames, file, numbered, &mut self.values),
        };
        if let Some((at, reason)) = self.values.damage() {
            batch.notice(Notice::Unreadable { place: CapturePlace::Offset(at), reason });
        }
        match found {
            Ok(found) => self.next = Some((time.flatten(), found)),
            Err(reason) => {
                let place = CapturePlace::Offset(self.records.stream.at());
                let reason = format!("record {} of its group: {reason}", self.index);
                batch.notice(Notice::Unreadable { place, reason });
            }
        }
    }

    fn end(&mut self, batch: &mut Batch) {
        self.has_ended = true;
        if let Some(expected) = self.expected.filter(|expected| *expected != self.index) {
            let reason = format!("group: found {} records; expected {expected}", self.index);
            batch.notice(Notice::Unreadable { place: CapturePlace::Offset(self.at), reason });
        }
    }

    fn report_damage(&mut self, batch: &mut Batch) {
        let damage = self.records.stream.damage.take();
        if let Some((at, reason)) = damage.filter(|_| self.is_first) {
            batch.notice(Notice::Unreadable { place: CapturePlace::Offset(at), reason });
        }
    }

    /// Reports data that end inside a record, possibly at the end of the capture.
    fn cut(&self, file: &[u8], batch: &mut Batch) {
        let reason = "the data end inside a record".into();
        if self.is_first && self.records.stream.is_at_end(file) {
            batch.notice(Notice::CutOff { place: CapturePlace::Offset(self.records.stream.at()), reason });
        } else {
            self.report(reason, batch);
        }
    }

    fn report(&self, reason: String, batch: &mut Batch) {
        if self.is_first {
            let place = CapturePlace::Offset(self.records.stream.at());
            batch.notice(Notice::Unreadable { place, reason });
        }
    }
}

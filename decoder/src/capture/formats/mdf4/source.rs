//! One group of records that are frames, read one after the other.

use std::sync::Arc;

use super::frame::{self, Found};
use super::group::{Frames, Size};
use super::records::{Next, Records, Values};
use crate::capture::{Batch, Notice, Place};

/// A group of frames being read.
#[derive(Clone)]
pub(super) struct Source {
    frames: Arc<Frames>,
    records: Records,
    values: Values,
    size: u64,
    /// Records it should have, where that is said.
    expected: Option<u64>,
    /// Byte offset of its description.
    at: u64,
    /// Whether it speaks for the data it shares with others.
    is_first: bool,
    index: u64,
    /// Latest time so far.
    clock: Option<i64>,
    /// The frame that comes next, with its time in nanoseconds from the start.
    next: Option<(Option<i64>, Found)>,
    has_ended: bool,
    record: Vec<u8>,
}

/// A time in nanoseconds from the start; what has none comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Due(Option<i64>);

/// What a source is made of.
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
    /// Before the first record.
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

    /// Whether it must read on before anything is known of what comes next.
    pub(super) fn is_behind(&self) -> bool {
        self.next.is_none() && !self.has_ended
    }

    /// When the next frame is due: never before one of its earlier ones.
    pub(super) fn due(&self) -> Option<Due> {
        self.next.as_ref().map(|(time, _)| Due((*time).max(self.clock)))
    }

    /// The next frame, with its time.
    pub(super) fn take(&mut self) -> Option<(Option<i64>, Found)> {
        let (time, found) = self.next.take()?;
        self.clock = self.clock.max(time);
        Some((time, found))
    }

    /// Records passed over that are no part of a frame; of shared data only one source says it.
    pub(super) fn others(&self) -> u64 {
        if self.is_first { self.records.others } else { 0 }
    }

    /// Reads one record.
    pub(super) fn step(&mut self, file: &[u8], batch: &mut Batch) {
        let mut record = std::mem::take(&mut self.record);
        let next = self.records.next(file, &mut record);
        self.say_damage(batch);
        match next {
            Next::Record => self.record(file, &record, batch),
            Next::Broken => {
                if !self.records.align(self.size) {
                    self.end(batch);
                }
            }
            Next::Unknown(number) => {
                self.say(
                    format!("a record of group {number}, which is not described: no more is read"),
                    batch,
                );
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
        self.index += 1;
        let found = match time {
            Some(None) => Err("a record whose time is none"),
            _ => frame::found(&self.frames, file, record, &mut self.values),
        };
        if let Some((at, reason)) = self.values.damage() {
            batch.notice(Notice::Unreadable { place: Place::Offset(at), reason });
        }
        match found {
            Ok(found) => self.next = Some((time.flatten(), found)),
            Err(reason) => {
                let place = Place::Offset(self.records.stream.at());
                let reason = format!("record {} of its group: {reason}", self.index);
                batch.notice(Notice::Unreadable { place, reason });
            }
        }
    }

    fn end(&mut self, batch: &mut Batch) {
        self.has_ended = true;
        if let Some(expected) = self.expected.filter(|expected| *expected != self.index) {
            let reason = format!("a group of {expected} records, of which {} were read", self.index);
            batch.notice(Notice::Unreadable { place: Place::Offset(self.at), reason });
        }
    }

    fn say_damage(&mut self, batch: &mut Batch) {
        let damage = self.records.stream.damage.take();
        if let Some((at, reason)) = damage.filter(|_| self.is_first) {
            batch.notice(Notice::Unreadable { place: Place::Offset(at), reason });
        }
    }

    /// The data end inside a record, and perhaps the capture too.
    fn cut(&self, file: &[u8], batch: &mut Batch) {
        let reason = "the data end inside a record".into();
        if self.is_first && self.records.stream.is_at_end(file) {
            batch.notice(Notice::CutOff { place: Place::Offset(self.records.stream.at()), reason });
        } else {
            self.say(reason, batch);
        }
    }

    fn say(&self, reason: String, batch: &mut Batch) {
        if self.is_first {
            let place = Place::Offset(self.records.stream.at());
            batch.notice(Notice::Unreadable { place, reason });
        }
    }
}

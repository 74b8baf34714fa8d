//! Reads the frames of one group in order.

use std::sync::Arc;

use super::field::GroupRecord;
use super::frame::{self, ChannelFrame};
use super::group::{FrameGroup, RecordSize};
use super::records::{NextRecord, RecordReader, VariableValues};
use crate::capture::{Batch, CapturePlace, Notice};

/// Reader of one group of frames.
#[derive(Clone)]
pub(super) struct GroupSource {
    frames: Arc<FrameGroup>,
    records: RecordReader,
    values: VariableValues,
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
pub(super) struct FrameDueTime(Option<i64>);

/// Arguments to create a source.
pub(super) struct GroupSourceArguments {
    pub(super) frames: FrameGroup,
    pub(super) records: RecordReader,
    pub(super) values: VariableValues,
    pub(super) size: RecordSize,
    pub(super) expected: Option<u64>,
    pub(super) at: u64,
    pub(super) is_first: bool,
}

impl GroupSource {
    /// Creates a source before its first record.
    pub(super) fn new(parts: GroupSourceArguments) -> Self {
        Self {
            frames: Arc::new(parts.frames),
            records: parts.records,
            values: parts.values,
            size: match parts.size {
                RecordSize::Fixed(size) => size,
                RecordSize::Variable => 0,
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
    pub(super) fn due_time(&self) -> Option<FrameDueTime> {
        self.next.as_ref().map(|(time, _)| FrameDueTime((*time).max(self.clock)))
    }

    /// Takes the next frame and its time.
    pub(super) fn take_frame(&mut self) -> Option<(Option<i64>, ChannelFrame)> {
        let (time, found) = self.next.take()?;
        self.clock = self.clock.max(time);
        Some((time, found))
    }

    /// Number of skipped records that are not part of a frame; of shared data, one source returns it.
    pub(super) fn skipped_records(&self) -> u64 {
        if self.is_first { self.records.others } else { 0 }
    }

    /// Reads one record.
    pub(super) fn read_step(&mut self, file: &[u8], batch: &mut Batch) {
        let mut record = std::mem::take(&mut self.record);
        let next = self.records.next(file, &mut record);
        self.report_damage(batch);
        match next {
            NextRecord::Record => self.on_record(file, &record, batch),
            NextRecord::Broken => {
                if !self.records.has_fixed_size(self.size) {
                    self.on_end(batch);
                }
            }
            NextRecord::Unknown(number) => {
                self.report_unreadable(
                    format!("record of undefined group {number}: rest of the data skipped"),
                    batch,
                );
                self.on_end(batch);
            }
            NextRecord::End(left) => {
                if left > 0 {
                    self.report_cut(file, batch);
                }
                self.on_end(batch);
            }
        }
        self.record = record;
    }

    fn on_record(&mut self, file: &[u8], record: &[u8], batch: &mut Batch) {
        let time = self.frames.clock.map(|clock| clock.record_time(record, self.index));
        let numbered = GroupRecord { bytes: record, number: self.index };
        self.index += 1;
        let found = match time {
            Some(None) => Err("invalid time"),
            _ => frame::convert_record(&self.frames, file, numbered, &mut self.values),
        };
        if let Some((at, reason)) = self.values.take_damage() {
            batch.add_notice(Notice::Unreadable { place: CapturePlace::Offset(at), reason });
        }
        match found {
            Ok(found) => self.next = Some((time.flatten(), found)),
            Err(reason) => {
                let place = CapturePlace::Offset(self.records.stream.block_offset());
                let reason = format!("record {} of its group: {reason}", self.index);
                batch.add_notice(Notice::Unreadable { place, reason });
            }
        }
    }

    fn on_end(&mut self, batch: &mut Batch) {
        self.has_ended = true;
        if let Some(expected) = self.expected.filter(|expected| *expected != self.index) {
            let reason = format!("group: found {} records; expected {expected}", self.index);
            batch.add_notice(Notice::Unreadable { place: CapturePlace::Offset(self.at), reason });
        }
    }

    fn report_damage(&mut self, batch: &mut Batch) {
        let damage = self.records.stream.damage.take();
        if let Some((at, reason)) = damage.filter(|_| self.is_first) {
            batch.add_notice(Notice::Unreadable { place: CapturePlace::Offset(at), reason });
        }
    }

    /// Reports data that end inside a record, possibly at the end of the capture.
    fn report_cut(&self, file: &[u8], batch: &mut Batch) {
        let reason = "the data end inside a record".into();
        if self.is_first && self.records.stream.is_at_end(file) {
            batch.add_notice(Notice::CutOff {
                place: CapturePlace::Offset(self.records.stream.block_offset()),
                reason,
            });
        } else {
            self.report_unreadable(reason, batch);
        }
    }

    fn report_unreadable(&self, reason: String, batch: &mut Batch) {
        if self.is_first {
            let place = CapturePlace::Offset(self.records.stream.block_offset());
            batch.add_notice(Notice::Unreadable { place, reason });
        }
    }
}

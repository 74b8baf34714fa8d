//! Walk through a capture, one frame or notice at a time, from any position.

use std::io::Read;

use super::{Checkpoint, PlacedEvent, ReplayState};
use crate::capture::{Batch, BatchItem, BusNames, CaptureError, MergedReader, Notice};
use crate::frame::Frame;

/// A reader with the state after the last item.
pub struct CaptureWalk<R> {
    reader: MergedReader<R>,
    batch: Batch,
    frames: usize,
    notices: usize,
    /// State of the buses at this position.
    pub world: ReplayState,
    has_ended: bool,
}

impl<R: Read> CaptureWalk<R> {
    /// Starts at the position of a reader, with the state there.
    pub fn new(reader: MergedReader<R>, world: ReplayState) -> Self {
        Self { reader, batch: Batch::new(), frames: 0, notices: 0, world, has_ended: false }
    }

    /// The next item, if it is a frame.
    ///
    /// # Errors
    /// If the capture cannot be read further.
    pub fn peek_frame(&mut self) -> Result<Option<&Frame>, CaptureError> {
        let is_notice = |walk: &Self| walk.next_notice().is_some();
        Ok(if self.fill_batch()? && !is_notice(self) { self.batch.frames().get(self.frames) } else { None })
    }

    /// The notice before the next frame.
    fn next_notice(&self) -> Option<&Notice> {
        let (before, notice) = self.batch.notices().get(self.notices)?;
        (*before <= self.frames).then_some(notice)
    }

    /// Processes the next frame or notice. Returns `false` at the end, after closing open conditions.
    ///
    /// # Errors
    /// If the capture cannot be read further.
    pub fn step_item(&mut self, see: &mut impl FnMut(PlacedEvent<'_>)) -> Result<bool, CaptureError> {
        if !self.fill_batch()? {
            self.close_conditions(see);
            return Ok(false);
        }
        let names = self.reader.buses();
        let next = self.batch.notices().get(self.notices).filter(|(before, _)| *before <= self.frames);
        if let Some((_, notice)) = next {
            self.notices += 1;
            self.world.take_item(&BatchItem::Notice(notice), names, see);
        } else if let Some(frame) = self.batch.frames().get(self.frames) {
            self.frames += 1;
            self.world.take_item(&BatchItem::Frame(frame), names, see);
        }
        Ok(true)
    }

    /// Closes open conditions at the end, once.
    pub fn close_conditions(&mut self, see: &mut impl FnMut(PlacedEvent<'_>)) {
        if !self.has_ended {
            self.has_ended = true;
            self.world.finish_capture(self.reader.buses(), see);
        }
    }

    /// Processes the rest of the batch, up to frame `limit`; returns `false` at the end.
    ///
    /// # Errors
    /// If the capture cannot be read further.
    pub fn skip_batch(
        &mut self,
        limit: u64,
        see: &mut impl FnMut(PlacedEvent<'_>),
    ) -> Result<bool, CaptureError> {
        if !self.fill_batch()? {
            return self.step_item(see);
        }
        if self.frames > 0 || !self.batch.notices().is_empty() || self.last_of_batch() > limit {
            return self.step_item(see);
        }
        for frame in self.batch.frames() {
            self.world.push(frame, self.reader.buses(), see);
        }
        self.frames = self.batch.frames().len();
        Ok(true)
    }

    fn last_of_batch(&self) -> u64 {
        self.batch.frames().last().map_or(u64::MAX, |frame| frame.number)
    }

    /// Whether the batch is used up, so that the next step reads.
    pub fn is_drained(&self) -> bool {
        self.frames >= self.batch.frames().len() && self.notices >= self.batch.notices().len()
    }

    fn fill_batch(&mut self) -> Result<bool, CaptureError> {
        if self.has_ended {
            return Ok(false);
        }
        if !self.is_drained() {
            return Ok(true);
        }
        (self.frames, self.notices) = (0, 0);
        self.reader.read(&mut self.batch)
    }

    /// This position as a mark; None within a batch.
    pub fn mark_position(&self) -> Option<Checkpoint> {
        self.is_drained().then(|| Checkpoint {
            frames: self.world.frames(),
            time: self.world.last_time(),
            position: self.reader.position(),
            world: self.world.clone(),
        })
    }

    /// Names of all buses so far.
    pub fn buses(&self) -> &BusNames {
        self.reader.buses()
    }

    /// Names of all buses so far.
    pub fn names(&self) -> &[String] {
        self.reader.buses().names()
    }

    /// Number of decompressed bytes read.
    pub fn offset(&self) -> u64 {
        self.reader.offset()
    }
}

//! Goes through a capture item by item, from any place.

use cobscope_decoder::capture::{Batch, CaptureError, Item, Merged, Notice};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::replay::{Mark, Told, World};

use super::shared::Shared;
use crate::source::StoreReader;

/// A reader and the world behind what it gave last.
pub(super) struct Walk {
    reader: Merged<StoreReader>,
    batch: Batch,
    frames: usize,
    notices: usize,
    /// What is known here.
    pub(super) world: World,
    has_ended: bool,
}

impl Walk {
    /// From the beginning, or from the first place that is kept.
    pub(super) fn start(shared: &Shared) -> Result<Self, CaptureError> {
        if let Some(mark) = shared.first_kept() {
            return Self::resume(shared, &mark);
        }
        Ok(Self::new(shared.open()?, World::new(shared.options.clone())))
    }

    /// From a mark.
    pub(super) fn resume(shared: &Shared, mark: &Mark) -> Result<Self, CaptureError> {
        Ok(Self::new(shared.resume(&mark.position)?, mark.world.clone()))
    }

    fn new(reader: Merged<StoreReader>, world: World) -> Self {
        Self { reader, batch: Batch::new(), frames: 0, notices: 0, world, has_ended: false }
    }

    /// What is taken next, if it is a frame.
    pub(super) fn peek(&mut self) -> Result<Option<&Frame>, CaptureError> {
        let is_notice = |walk: &Self| walk.next_notice().is_some();
        Ok(if self.fill()? && !is_notice(self) { self.batch.frames().get(self.frames) } else { None })
    }

    /// A notice that stands before the next frame.
    fn next_notice(&self) -> Option<&Notice> {
        let (before, notice) = self.batch.notices().get(self.notices)?;
        (*before <= self.frames).then_some(notice)
    }

    /// Takes the next frame or notice; `false` behind the last one, when what was open has been closed.
    pub(super) fn step(&mut self, see: &mut impl FnMut(Told<'_>)) -> Result<bool, CaptureError> {
        if !self.fill()? {
            self.close(see);
            return Ok(false);
        }
        let names = self.reader.buses();
        let next = self.batch.notices().get(self.notices).filter(|(before, _)| *before <= self.frames);
        if let Some((_, notice)) = next {
            self.notices += 1;
            self.world.take(&Item::Notice(notice), names, see);
        } else if let Some(frame) = self.batch.frames().get(self.frames) {
            self.frames += 1;
            self.world.take(&Item::Frame(frame), names, see);
        }
        Ok(true)
    }

    /// Nothing follows: closes what was open, once.
    pub(super) fn close(&mut self, see: &mut impl FnMut(Told<'_>)) {
        if !self.has_ended {
            self.has_ended = true;
            self.world.finish(self.reader.buses(), see);
        }
    }

    /// Takes everything of the present batch, up to the frame with number `limit`; `false` behind the last one.
    pub(super) fn leap(&mut self, limit: u64, see: &mut impl FnMut(Told<'_>)) -> Result<bool, CaptureError> {
        if !self.fill()? {
            return self.step(see);
        }
        if self.frames > 0 || !self.batch.notices().is_empty() || self.last_of_batch() > limit {
            return self.step(see);
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

    /// Whether all that is known of a capture that grows was taken: going on would wait for more.
    pub(super) fn is_at_head(&self, shared: &Shared) -> bool {
        self.is_drained() && self.offset() >= shared.progress.bytes() && !shared.progress.is_complete()
    }

    /// Whether going on means reading.
    pub(super) fn is_drained(&self) -> bool {
        self.frames >= self.batch.frames().len() && self.notices >= self.batch.notices().len()
    }

    fn fill(&mut self) -> Result<bool, CaptureError> {
        if self.has_ended {
            return Ok(false);
        }
        if !self.is_drained() {
            return Ok(true);
        }
        (self.frames, self.notices) = (0, 0);
        self.reader.read(&mut self.batch)
    }

    /// This place as a mark, where no part of a batch is left.
    pub(super) fn mark(&self) -> Option<Mark> {
        self.is_drained().then(|| Mark {
            frames: self.world.frames(),
            time: self.world.time(),
            position: self.reader.position(),
            world: self.world.clone(),
        })
    }

    /// Names of all buses there are so far.
    pub(super) fn names(&self) -> &[String] {
        self.reader.buses().names()
    }

    /// Decompressed bytes read.
    pub(super) fn offset(&self) -> u64 {
        self.reader.offset()
    }
}

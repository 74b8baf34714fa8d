//! The reused block of frames a reader fills.

use super::notice::{Notice, Place};
use crate::frame::Frame;

/// Frames a batch holds: 256 of them stay in a core's second-level cache.
pub const BATCH_FRAMES: usize = 256;

/// Frames in order, and notices each of which stands before one of them.
pub struct Batch {
    frames: Box<[Frame]>,
    length: usize,
    notices: Vec<(usize, Notice)>,
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

impl Batch {
    /// An empty batch.
    pub fn new() -> Self {
        Self::of(BATCH_FRAMES)
    }

    /// An empty batch of a frame: what is known of the reader's place belongs to it.
    pub fn of_one() -> Self {
        Self::of(1)
    }

    fn of(frames: usize) -> Self {
        Self { frames: vec![Frame::EMPTY; frames].into(), length: 0, notices: Vec::new() }
    }

    /// Forgets all frames and notices; keeps the memory.
    pub fn clear(&mut self) {
        self.length = 0;
        self.notices.clear();
    }

    /// Whether no further frame fits.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.length >= self.frames.len() || self.notices.len() >= self.frames.len()
    }

    /// Whether it holds neither frame nor notice.
    pub fn is_empty(&self) -> bool {
        self.length == 0 && self.notices.is_empty()
    }

    /// The next free frame, holding leftovers of an earlier one; `None` when full.
    /// It counts only after `commit`.
    #[inline]
    pub fn slot(&mut self) -> Option<&mut Frame> {
        self.frames.get_mut(self.length)
    }

    /// Takes the frame last handed out by [`Batch::slot`] into the batch.
    #[inline]
    pub(crate) fn commit(&mut self) {
        self.length = (self.length + 1).min(self.frames.len());
    }

    /// Adds a whole frame; dropped when full, so ask [`Batch::is_full`] first.
    pub fn push(&mut self, frame: Frame) {
        if let Some(slot) = self.slot() {
            *slot = frame;
            self.commit();
        }
    }

    /// Adds a notice that belongs before the next frame.
    pub fn notice(&mut self, notice: Notice) {
        self.notices.push((self.length, notice));
    }

    /// Adds a line or record that cannot be read, before the next frame.
    pub(super) fn push_unreadable(&mut self, place: Place, reason: String) {
        self.notice(Notice::Unreadable { place, reason });
    }

    /// The frames, in capture order.
    pub fn frames(&self) -> &[Frame] {
        self.frames.get(..self.length).unwrap_or(&[])
    }

    /// Notices with the index of the frame before which each stands, ascending.
    pub fn notices(&self) -> &[(usize, Notice)] {
        &self.notices
    }

    /// Frames and notices merged in capture order.
    pub fn items(&self) -> impl Iterator<Item = Item<'_>> {
        let mut notices = self.notices.iter().peekable();
        let mut frames = self.frames().iter().enumerate().peekable();
        std::iter::from_fn(move || {
            let next_frame = frames.peek().map_or(usize::MAX, |(index, _)| *index);
            if let Some((_, notice)) = notices.next_if(|(before, _)| *before <= next_frame) {
                return Some(Item::Notice(notice));
            }
            frames.next().map(|(_, frame)| Item::Frame(frame))
        })
    }
}

/// One thing a batch holds.
#[derive(Debug)]
pub enum Item<'a> {
    /// A frame.
    Frame(&'a Frame),
    /// Something the reader has to say.
    Notice(&'a Notice),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    #[test]
    fn notices_come_before_the_frame_they_precede_and_after_the_last() {
        let mut batch = Batch::new();
        let bad = |line| Notice::Unreadable { place: Place::Line(line), reason: "x".into() };
        batch.push(Frame::data_frame(CanId::standard(1), &[]));
        batch.notice(bad(2));
        batch.push(Frame::data_frame(CanId::standard(2), &[]));
        batch.notice(bad(4));
        let order: Vec<String> = batch
            .items()
            .map(|item| match item {
                Item::Frame(frame) => frame.id.to_string(),
                Item::Notice(notice) => notice.to_string(),
            })
            .collect();
        assert_eq!(order, ["001", "line 2: x", "002", "line 4: x"]);
    }
}

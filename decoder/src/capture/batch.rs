//! The reused buffer of frames and notices that a reader fills.

use super::notice::{CapturePlace, Notice};
use crate::frame::{BusIndex, Frame};

/// Frames in a batch: 256 of them fit into the second-level cache of a core.
pub const BATCH_FRAMES: usize = 256;

/// Frames in capture order, and notices, each with its position before a frame.
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
        Self::with_room(BATCH_FRAMES)
    }

    /// An empty batch for a single frame, so that the reader's position is exact for that frame.
    pub fn of_one() -> Self {
        Self::with_room(1)
    }

    fn with_room(frames: usize) -> Self {
        Self { frames: vec![Frame::EMPTY; frames].into(), length: 0, notices: Vec::new() }
    }

    /// Removes all frames and notices; keeps the memory.
    pub fn clear(&mut self) {
        self.length = 0;
        self.notices.clear();
    }

    /// Whether the batch has no room for another frame.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.length >= self.frames.len() || self.notices.len() >= self.frames.len()
    }

    /// Whether the batch contains neither frames nor notices.
    pub fn is_empty(&self) -> bool {
        self.length == 0 && self.notices.is_empty()
    }

    /// The next free frame, with the content of an earlier one; `None` if the batch is full. It becomes part
    /// of the batch with `commit`.
    #[inline]
    pub fn free_slot(&mut self) -> Option<&mut Frame> {
        self.frames.get_mut(self.length)
    }

    /// Adds the frame last returned by [`Batch::free_slot`] to the batch.
    #[inline]
    pub(crate) fn commit_slot(&mut self) {
        self.commit_all(1);
    }

    /// All free frames, with the content of earlier ones. The first of them become part of the batch with
    /// `commit_all`.
    pub(super) fn free_slots(&mut self) -> &mut [Frame] {
        self.frames.get_mut(self.length..).unwrap_or_default()
    }

    /// Adds the first `count` of [`Batch::free_slots`] to the batch.
    #[inline]
    pub(super) fn commit_all(&mut self, count: u64) {
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        self.length = self.length.saturating_add(count).min(self.frames.len());
    }

    /// Adds a frame; drops it if the batch is full, so check [`Batch::is_full`] first.
    pub fn push(&mut self, frame: Frame) {
        if let Some(slot) = self.free_slot() {
            *slot = frame;
            self.commit_slot();
        }
    }

    /// Adds a notice before the next frame.
    pub fn add_notice(&mut self, notice: Notice) {
        self.notices.push((self.length, notice));
    }

    /// Adds a notice about an unreadable line or record before the next frame.
    pub(super) fn push_unreadable(&mut self, place: CapturePlace, reason: String) {
        self.add_notice(Notice::Unreadable { place, reason });
    }

    /// Frames in capture order.
    pub fn frames(&self) -> &[Frame] {
        self.frames.get(..self.length).unwrap_or(&[])
    }

    /// Notices, each with the index of the frame it precedes, ascending.
    pub fn notices(&self) -> &[(usize, Notice)] {
        &self.notices
    }

    /// Place and cause of a truncated end, if a notice reports one.
    pub fn cut_off(&self) -> Option<String> {
        let notices = self.notices.iter().map(|(_, notice)| notice);
        notices.filter(|notice| matches!(notice, Notice::CutOff { .. })).map(ToString::to_string).next()
    }

    /// Continues the numbers of an earlier part of the same capture: adds `before` to each frame number, and
    /// replaces each bus by its entry in `buses`, which is empty if they are equal.
    pub fn continue_from(&mut self, before: u64, buses: &[BusIndex]) {
        let of = |bus: BusIndex| buses.get(usize::from(bus.0)).copied().unwrap_or(bus);
        for frame in self.frames.iter_mut().take(self.length) {
            frame.number = frame.number.saturating_add(before);
            frame.bus = of(frame.bus);
        }
        for (_, notice) in &mut self.notices {
            if let Notice::LostFrames { bus, .. } | Notice::Link { bus, .. } | Notice::ClockSet { bus, .. } =
                notice
            {
                *bus = of(*bus);
            }
        }
    }

    /// Adds nanoseconds to all timestamps.
    pub fn shift_times(&mut self, nanoseconds: i64) {
        for frame in self.frames.iter_mut().take(self.length) {
            frame.time = frame.time.map(|time| time.plus(nanoseconds));
        }
        for (_, notice) in &mut self.notices {
            if let Notice::Link { time, .. } | Notice::Quiet(time) | Notice::ClockSet { time, .. } = notice {
                *time = time.plus(nanoseconds);
            }
        }
    }

    /// Removes the notices for which `keeps` is false.
    pub fn retain_notices(&mut self, mut keeps: impl FnMut(&Notice) -> bool) {
        self.notices.retain(|(_, notice)| keeps(notice));
    }

    /// Frames and notices merged in capture order.
    pub fn items(&self) -> impl Iterator<Item = BatchItem<'_>> {
        let mut notices = self.notices.iter().peekable();
        let mut frames = self.frames().iter().enumerate().peekable();
        std::iter::from_fn(move || {
            let next_frame = frames.peek().map_or(usize::MAX, |(index, _)| *index);
            if let Some((_, notice)) = notices.next_if(|(before, _)| *before <= next_frame) {
                return Some(BatchItem::Notice(notice));
            }
            frames.next().map(|(_, frame)| BatchItem::Frame(frame))
        })
    }
}

/// Element of a batch.
#[derive(Debug)]
pub enum BatchItem<'a> {
    /// A frame.
    Frame(&'a Frame),
    /// A message of the reader.
    Notice(&'a Notice),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    #[test]
    fn a_later_part_continues_numbers_and_buses() {
        let mut batch = Batch::new();
        let frame = Frame { number: 1, bus: BusIndex(1), ..Frame::data_frame(CanId::from_standard(1), &[]) };
        batch.push(frame);
        batch.push(Frame { number: 2, bus: BusIndex(7), ..frame });
        batch.add_notice(Notice::LostFrames { place: CapturePlace::Line(3), bus: BusIndex(0), count: None });
        batch.add_notice(Notice::Assumption("times read as UTC".into()));
        batch.continue_from(10, &[BusIndex(2), BusIndex(0)]);
        batch.retain_notices(|notice| !matches!(notice, Notice::Assumption(_)));
        // Bus 7 has no entry and keeps its number.
        let found: Vec<_> = batch.frames().iter().map(|frame| (frame.number, frame.bus.0)).collect();
        assert_eq!(found, [(11, 0), (12, 7)]);
        assert_eq!(batch.notices().iter().map(|(_, notice)| notice.bus().0).collect::<Vec<_>>(), [2]);
    }

    #[test]
    fn frames_are_committed_up_to_the_size_of_the_batch() {
        let mut batch = Batch::new();
        batch.push(Frame::EMPTY);
        assert_eq!(batch.free_slots().len(), BATCH_FRAMES - 1);
        batch.commit_all(2);
        assert_eq!((batch.frames().len(), batch.is_full()), (3, false));
        batch.commit_all(u64::MAX);
        assert_eq!((batch.frames().len(), batch.free_slots().len()), (BATCH_FRAMES, 0));
    }

    #[test]
    fn notices_come_before_the_frame_they_precede_and_after_the_last() {
        let mut batch = Batch::new();
        let bad = |line| Notice::Unreadable { place: CapturePlace::Line(line), reason: "x".into() };
        batch.push(Frame::data_frame(CanId::from_standard(1), &[]));
        batch.add_notice(bad(2));
        batch.push(Frame::data_frame(CanId::from_standard(2), &[]));
        batch.add_notice(bad(4));
        let order: Vec<String> = batch
            .items()
            .map(|item| match item {
                BatchItem::Frame(frame) => frame.id.to_string(),
                BatchItem::Notice(notice) => notice.to_string(),
            })
            .collect();
        assert_eq!(order, ["001", "line 2: x", "002", "line 4: x"]);
    }
}

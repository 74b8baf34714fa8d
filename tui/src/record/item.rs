//! Items of a capture, and the gap while it cannot be written.

use cobscope_decoder::capture::{CapturePlace, Notice};
use cobscope_decoder::frame::{BusIndex, Frame};

use super::trigger::CaptureTrigger;

/// An item to be written.
#[derive(Debug, Clone)]
pub(super) struct PendingItem {
    /// Index in the buses of the recorder.
    pub bus: usize,
    /// Frame or notice.
    pub what: RecordItem,
}

/// A frame, a notice about a bus, or a trigger.
#[derive(Debug, Clone)]
pub(super) enum RecordItem {
    /// A frame.
    Frame(Frame),
    /// A frame with a comment.
    Commented(Box<(Frame, String)>),
    /// A notice.
    Notice(Notice),
    /// The next item triggers a capture. It is never part of one.
    Trigger(Box<CaptureTrigger>),
}

impl PendingItem {
    /// The frame, if the item is one.
    pub(super) fn frame(&self) -> Option<&Frame> {
        match &self.what {
            RecordItem::Frame(frame) => Some(frame),
            RecordItem::Commented(commented) => Some(&commented.0),
            RecordItem::Notice(_) | RecordItem::Trigger(_) => None,
        }
    }

    /// Memory in bytes.
    pub(super) fn memory_size(&self) -> usize {
        let RecordItem::Trigger(trigger) = &self.what else { return size_of::<Self>() };
        let texts = [&trigger.bus, &trigger.subject, &trigger.cause, &trigger.text].map(String::len);
        size_of::<Self>() + size_of::<CaptureTrigger>() + texts.iter().sum::<usize>()
    }

    pub(super) fn is_frame(&self) -> bool {
        self.frame().is_some()
    }
}

/// Items that could not be written. When writing resumes, the capture gets a notice of the lost frames and
/// the state of each link.
#[derive(Debug, Default)]
pub(super) struct RecordGap(Vec<BusGap>);

#[derive(Debug)]
struct BusGap {
    bus: usize,
    lost: u64,
    /// Last state of the link.
    link: Option<Notice>,
}

impl RecordGap {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds an item to the gap. Frames lost before they arrived here count as lost too.
    pub(super) fn add_missed(&mut self, item: PendingItem) {
        let PendingItem { bus, what } = item;
        match what {
            RecordItem::Frame(_) | RecordItem::Commented(_) => self.add_lost(bus, 1),
            RecordItem::Notice(Notice::LostFrames { count: Some(count), .. }) => self.add_lost(bus, count),
            RecordItem::Notice(link @ Notice::Link { .. }) => self.bus_gap(bus, |gap| gap.link = Some(link)),
            RecordItem::Notice(_) | RecordItem::Trigger(_) => (),
        }
    }

    fn add_lost(&mut self, bus: usize, count: u64) {
        self.bus_gap(bus, |gap| gap.lost = gap.lost.saturating_add(count));
    }

    fn bus_gap(&mut self, bus: usize, change: impl FnOnce(&mut BusGap)) {
        if let Some(known) = self.0.iter_mut().find(|gap| gap.bus == bus) {
            change(known);
        } else {
            let mut gap = BusGap { bus, lost: 0, link: None };
            change(&mut gap);
            self.0.push(gap);
        }
    }

    /// Removes and returns the notices about the gap.
    pub(super) fn take_notices(&mut self) -> Vec<PendingItem> {
        let mut items = Vec::new();
        for BusGap { bus, lost, link } in self.0.drain(..) {
            let lost = (lost > 0).then(|| {
                let index = BusIndex(u8::try_from(bus).unwrap_or(u8::MAX));
                Notice::LostFrames { place: CapturePlace::Now, bus: index, count: Some(lost) }
            });
            let notices = lost.into_iter().chain(link);
            items.extend(notices.map(|notice| PendingItem { bus, what: RecordItem::Notice(notice) }));
        }
        items
    }
}

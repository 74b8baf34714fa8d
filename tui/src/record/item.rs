//! What is recorded, and what a record lacks while it cannot be written.

use cobscope_decoder::capture::{Notice, Place};
use cobscope_decoder::frame::{BusIndex, Frame};

/// One thing to be recorded.
#[derive(Debug, Clone)]
pub(super) struct Item {
    /// Which of the recorder's buses.
    pub bus: usize,
    /// What it is.
    pub what: What,
}

/// A frame, or what else is known of a bus.
#[derive(Debug, Clone)]
pub(super) enum What {
    /// A frame.
    Frame(Frame),
    /// Anything else.
    Notice(Notice),
}

impl Item {
    pub(super) fn is_frame(&self) -> bool {
        matches!(self.what, What::Frame(_))
    }
}

/// What could not be recorded. It is told in the record where that goes on: frames as lost ones, and how each link is.
#[derive(Debug, Default)]
pub(super) struct Gap(Vec<BusGap>);

#[derive(Debug)]
struct BusGap {
    bus: usize,
    lost: u64,
    /// The last of its links.
    link: Option<Notice>,
}

impl Gap {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds what is not recorded. Frames that were lost before they came here are lost to the record too.
    pub(super) fn miss(&mut self, item: Item) {
        let Item { bus, what } = item;
        match what {
            What::Frame(_) => self.lose(bus, 1),
            What::Notice(Notice::LostFrames { count: Some(count), .. }) => self.lose(bus, count),
            What::Notice(link @ Notice::Link { .. }) => self.of(bus, |gap| gap.link = Some(link)),
            What::Notice(_) => (),
        }
    }

    fn lose(&mut self, bus: usize, count: u64) {
        self.of(bus, |gap| gap.lost = gap.lost.saturating_add(count));
    }

    fn of(&mut self, bus: usize, change: impl FnOnce(&mut BusGap)) {
        if let Some(known) = self.0.iter_mut().find(|gap| gap.bus == bus) {
            change(known);
        } else {
            let mut gap = BusGap { bus, lost: 0, link: None };
            change(&mut gap);
            self.0.push(gap);
        }
    }

    /// What tells of it; it is empty then.
    pub(super) fn take(&mut self) -> Vec<Item> {
        let mut items = Vec::new();
        for BusGap { bus, lost, link } in self.0.drain(..) {
            let lost = (lost > 0).then(|| {
                let index = BusIndex(u8::try_from(bus).unwrap_or(u8::MAX));
                Notice::LostFrames { place: Place::Now, bus: index, count: Some(lost) }
            });
            let notices = lost.into_iter().chain(link);
            items.extend(notices.map(|notice| Item { bus, what: What::Notice(notice) }));
        }
        items
    }
}

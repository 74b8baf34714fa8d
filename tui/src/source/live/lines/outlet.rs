//! Where the reading thread puts what it reads.

use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;

use cobscope_decoder::capture::{
    BATCH_FRAMES, Batch, BusNames, CaptureError, Item, MAX_BUSES, Notice, Place, ReadOptions, Reader,
};
use cobscope_decoder::frame::{BusIndex, Frame};

use crate::source::live::gather::PACE;
use crate::source::live::{Arrival, Ended};

/// What the thread hands over.
pub enum Delivery {
    Items(BusNames, Vec<Arrival>),
    Ended(Ended),
}

/// Where the thread puts what it reads.
pub struct Outlet {
    give: SyncSender<Delivery>,
    is_over: Arc<AtomicBool>,
    /// Buses of all that was read, in order of appearance.
    names: BusNames,
}

impl Outlet {
    pub fn new(give: SyncSender<Delivery>, is_over: Arc<AtomicBool>) -> Self {
        Self { give, is_over, names: BusNames::default() }
    }

    /// Ends the source; where nobody listens any more nobody wants to know.
    pub fn end(&self, ended: Ended) {
        let _ = self.give.send(Delivery::Ended(ended));
    }

    /// Becomes true when nobody listens any more.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.is_over)
    }

    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Hands over; `false` when nobody takes it any more.
    pub fn give(&self, items: Vec<Arrival>) -> bool {
        self.give.send(Delivery::Items(self.names.clone(), items)).is_ok()
    }

    /// Says something that belongs to no bus.
    pub fn say(&self, text: String) -> bool {
        self.give(vec![Arrival::Notice(Notice::Assumption(text))])
    }

    /// Reads a capture to its end, or until nobody listens any more.
    pub fn pump(&mut self, source: impl Read, options: &ReadOptions) -> Result<(), CaptureError> {
        let mut reader = Reader::open(source, options)?;
        let mut batch = Batch::new();
        let mut buses = Vec::new();
        while reader.read(&mut batch)? {
            let known = reader.buses().names();
            for name in known.iter().skip(buses.len()) {
                buses.push(self.names.index_of(name.as_bytes()));
            }
            let items = batch.items().map(|item| match item {
                Item::Frame(frame) => renamed(frame, &buses),
                Item::Notice(notice) => Arrival::Notice(on_bus(notice, &buses)),
            });
            if !self.give(items.collect()) {
                break;
            }
            if batch.frames().len() < BATCH_FRAMES / 2 {
                // It comes as it happens: what comes meanwhile gathers.
                std::thread::sleep(PACE);
            }
        }
        Ok(())
    }
}

/// The bus of this source which is the capture's own `bus`; `None` where there are too many.
fn bus_of(bus: BusIndex, buses: &[Option<BusIndex>]) -> Option<BusIndex> {
    buses.get(usize::from(bus.0)).copied().flatten()
}

fn renamed(frame: &Frame, buses: &[Option<BusIndex>]) -> Arrival {
    match bus_of(frame.bus, buses) {
        Some(bus) => Arrival::Frame(Frame { bus, ..*frame }),
        None => Arrival::Notice(Notice::Unreadable {
            place: Place::Now,
            reason: format!("more than {MAX_BUSES} interfaces"),
        }),
    }
}

fn on_bus(notice: &Notice, buses: &[Option<BusIndex>]) -> Notice {
    let mut notice = notice.clone();
    if let Notice::LostFrames { bus, .. } | Notice::Link { bus, .. } = &mut notice {
        *bus = bus_of(*bus, buses).unwrap_or_default();
    }
    notice
}

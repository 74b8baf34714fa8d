//! Output of the reading thread.

use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::SyncSender;

use cobscope_decoder::capture::{
    BATCH_FRAMES, Batch, BatchItem, BusNames, CaptureError, CapturePlace, CaptureReader, MAX_BUSES, Notice,
    ReadOptions,
};
use cobscope_decoder::frame::{BusIndex, Frame};

use crate::source::live::gather::PACE;
use crate::source::live::{Arrival, SourceEnd};

/// A message of the reading thread.
pub enum ThreadDelivery {
    Items(BusNames, Vec<Arrival>),
    Ended(SourceEnd),
}

/// Output of the reading thread.
pub struct ThreadOutlet {
    give: SyncSender<ThreadDelivery>,
    is_over: Arc<AtomicBool>,
    /// Buses in order of appearance.
    names: BusNames,
}

impl ThreadOutlet {
    pub fn new(give: SyncSender<ThreadDelivery>, is_over: Arc<AtomicBool>) -> Self {
        Self { give, is_over, names: BusNames::default() }
    }

    /// Reports the end; the receiver may have ended already.
    pub fn report_end(&self, ended: SourceEnd) {
        let _ = self.give.send(ThreadDelivery::Ended(ended));
    }

    /// Becomes true when the receiver has ended.
    pub fn end_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.is_over)
    }

    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Delivers items; `false` if the receiver has ended.
    pub fn deliver_items(&self, items: Vec<Arrival>) -> bool {
        self.give.send(ThreadDelivery::Items(self.names.clone(), items)).is_ok()
    }

    /// Delivers a message without a bus; `false` if the receiver has ended.
    pub fn deliver_report(&self, text: String) -> bool {
        self.deliver_items(vec![Arrival::Notice(Notice::Assumption(text))])
    }

    /// Reads a capture to its end, or until the receiver ends.
    pub fn pump_capture(&mut self, source: impl Read, options: &ReadOptions) -> Result<(), CaptureError> {
        let mut reader = CaptureReader::open(source, options)?;
        let mut batch = Batch::new();
        let mut buses = Vec::new();
        while reader.read(&mut batch)? {
            let known = reader.buses().names();
            for name in known.iter().skip(buses.len()) {
                buses.push(self.names.index_of(name.as_bytes()));
            }
            let items = batch.items().map(|item| match item {
                BatchItem::Frame(frame) => rename_bus(frame, &buses),
                BatchItem::Notice(notice) => Arrival::Notice(on_bus(notice, &buses)),
            });
            if !self.deliver_items(items.collect()) {
                break;
            }
            if batch.frames().len() < BATCH_FRAMES / 2 {
                // A live input: further frames collect during the pause.
                std::thread::sleep(PACE);
            }
        }
        Ok(())
    }
}

/// Bus of this source for bus `bus` of the capture; `None` if there are too many.
fn bus_of(bus: BusIndex, buses: &[Option<BusIndex>]) -> Option<BusIndex> {
    buses.get(usize::from(bus.0)).copied().flatten()
}

fn rename_bus(frame: &Frame, buses: &[Option<BusIndex>]) -> Arrival {
    match bus_of(frame.bus, buses) {
        Some(bus) => Arrival::Frame(Frame { bus, ..*frame }),
        None => Arrival::Notice(Notice::Unreadable {
            place: CapturePlace::Now,
            reason: format!("more than {MAX_BUSES} interfaces"),
        }),
    }
}

fn on_bus(notice: &Notice, buses: &[Option<BusIndex>]) -> Notice {
    let mut notice = notice.clone();
    if let Notice::LostFrames { bus, .. } | Notice::Link { bus, .. } | Notice::ClockSet { bus, .. } =
        &mut notice
    {
        *bus = bus_of(*bus, buses).unwrap_or_default();
    }
    notice
}

//! Statistics of a capture, collected in one pass and in bounded memory.

mod beginning;
mod bits;
mod bus;
mod clock;
mod codes;
mod distribution;
mod first_frame;
mod holes;
mod identifier_index;
mod identifiers;
mod intervals;
mod j1939;
mod load;
mod load_over_time;
mod node;
mod node_table;
mod product;
mod quality;
mod reactions;
mod span;

pub use beginning::CaptureBeginning;
pub use bits::frame_bits;
pub use bus::{BusStatistics, IdStatistics, MasterStatistics};

pub use codes::{CodeCounts, dtc_of_key};
pub use codes::{MOST_CODES, dtc_key};
pub use distribution::DurationDistribution;
pub use first_frame::FirstFrame;
pub(crate) use holes::is_evidence;
pub use identifiers::{IdentifierRow, IdentifierRows, MOST_ROWS};
pub use intervals::IntervalStatistics;
pub use j1939::AddressStatistics;
pub use load::BusLoad;
pub use load_over_time::{LoadOverTime, LoadStep};
pub use node::NodeStatistics;
pub use product::DeviceProduct;
pub use quality::CaptureQuality;
pub use reactions::{ReactionTime, ReactionTimes};
pub use span::format_span;

use crate::event::Event;
use crate::frame::Frame;
use crate::session::{Bus, Buses, MessagePreview};
use clock::RecorderClock;

/// Statistics of one capture.
#[derive(Debug, Clone, Default)]
pub struct Statistics {
    /// Quality of the capture.
    pub quality: CaptureQuality,
    /// Statistics per bus, in order of appearance.
    pub buses: Vec<BusStatistics>,
    clock: RecorderClock,
    /// Steps of the clock up to the last event; events may follow many frames later.
    steps: usize,
}

impl Statistics {
    /// Counts a frame; call it before the events of the frame.
    pub fn count_frame(&mut self, frame: &Frame) {
        if self.clock.take_frame(frame) {
            self.buses.iter_mut().for_each(BusStatistics::interrupt_identifiers);
        }
        if self.clock.is_steady() {
            self.quality.count_frame(frame);
            return self.bus_entry(frame.bus.0).count_frame(frame);
        }
        let time = frame.time.map(|time| self.clock.corrected(frame.number, time));
        self.quality.count_frame_at(frame, time);
        self.bus_entry(frame.bus.0).count_frame(&Frame { time, ..*frame });
    }

    /// Counts frames before the events of the first one.
    pub fn count_frames(&mut self, frames: &[Frame]) {
        if !self.clock.take_steady(frames) {
            return frames.iter().for_each(|frame| self.count_frame(frame));
        }
        self.quality.add_frames(frames);
        for of_bus in frames.chunk_by(|frame, next| frame.bus == next.bus) {
            if let Some(first) = of_bus.first() {
                self.bus_entry(first.bus.0).count_frames(of_bus);
            }
        }
    }

    /// Counts an event.
    pub fn count_event(&mut self, event: &Event) {
        self.quality.count_event(event);
        if self.clock.is_steady() {
            return self.bus_entry(event.bus.0).count_event(event);
        }
        let steps = self.clock.steps_until(event.frames.last);
        if std::mem::replace(&mut self.steps, steps) != steps {
            self.buses.iter_mut().for_each(BusStatistics::interrupt_messages);
        }
        let time = event.time.map(|time| self.clock.corrected(event.frames.last, time));
        self.bus_entry(event.bus.0).count_event(&Event { time, ..event.clone() });
    }

    /// Counts a PDO or J1939 message without an event; see [`Observer::skip_event`](crate::session::Observer::skip_event).
    #[inline]
    pub fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) {
        if let Some((pdo, node)) = bus.identifiers().pdo_at(preview.identifier) {
            let preview = if self.clock.is_steady() {
                preview
            } else {
                &MessagePreview { time: self.clock.corrected(preview.frame, preview.time), ..*preview }
            };
            self.bus_entry(bus.index().0).skip_pdo((pdo, node), preview);
        }
    }

    /// Removes figures of services that the traffic of a bus proved not to use; call it after the last event.
    pub fn withdraw_canopen(&mut self, buses: Buses<'_>) {
        for (statistics, bus) in self.buses.iter_mut().zip(buses) {
            statistics.withdraw_canopen(bus);
        }
    }

    fn bus_entry(&mut self, index: u8) -> &mut BusStatistics {
        let place = usize::from(index);
        if self.buses.len() <= place {
            self.add_buses(place);
        }
        #[expect(clippy::indexing_slicing, reason = "ensured by `add_buses`")]
        &mut self.buses[place]
    }

    #[cold]
    fn add_buses(&mut self, last: usize) {
        self.buses.resize_with(last + 1, BusStatistics::default);
    }
}

//! The parts of this library.

use super::part::{FrameDemand, ReadingPart};
use crate::capture::BusNames;
use crate::comparison::BehaviourRecorder;
use crate::event::Event;
use crate::frame::Frame;
use crate::session::{Bus, Buses, MessagePreview};
use crate::statistics::Statistics;
use crate::why::WhyObserver;

impl ReadingPart for Statistics {
    fn event(&mut self, event: &Event, _bus: &Bus) {
        Self::count_event(self, event);
    }

    fn finding(&mut self, _event: &Event, _bus: &Bus) {}

    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }

    #[inline]
    fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        Self::skip_event(self, preview, bus);
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Batches
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        Self::count_frame(self, frame);
    }

    fn frames(&mut self, frames: &[Frame], _names: &BusNames) {
        Self::count_frames(self, frames);
    }

    fn finish(&mut self, buses: Buses<'_>) {
        self.withdraw_canopen(buses);
    }
}

impl ReadingPart for WhyObserver {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.observe_event(event, bus, true);
    }

    #[inline]
    fn need(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.needs_event(preview, bus)
    }

    #[inline]
    fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        Self::skip_event(self, preview, bus);
    }
}

impl ReadingPart for BehaviourRecorder {
    fn event(&mut self, event: &Event, bus: &Bus) {
        Self::event(self, event, bus);
    }

    fn finding(&mut self, _event: &Event, _bus: &Bus) {}

    #[inline]
    fn need(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.needs(preview, bus)
    }

    fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        Self::skip(self, preview, bus);
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Each
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        Self::count_frame(self, frame);
    }

    fn finish(&mut self, buses: Buses<'_>) {
        self.statistics.withdraw_canopen(buses);
    }
}

#[cfg(feature = "parquet")]
impl ReadingPart for crate::sink::lake::LakeWriter<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        Self::event(self, event, bus);
    }

    fn demand(&self) -> FrameDemand {
        if self.wants_frames() { FrameDemand::Each } else { FrameDemand::None }
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) {
        Self::add_frame(self, frame, names.name_of(frame.bus));
    }

    fn is_done(&self) -> bool {
        self.has_failed()
    }
}

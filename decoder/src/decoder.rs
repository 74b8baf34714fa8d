//! The decoder: combines capture, session and events.

use std::sync::Arc;

use crate::event::{Event, EventKind, EventProtocol, FrameRange};
use crate::frame::{BusIndex, Frame, LinkState, Timestamp};
use crate::session::{BusDecoder, Buses, Observer, SessionOptions};

use crate::capture::{BusNames, CapturePlace, Notice};

/// Number of unreadable lines that are reported individually; further ones are only counted.
pub const SHOWN_UNREADABLE: u64 = 10;

/// Decodes the frames of one capture to events. A clone is a checkpoint: decoding from it gives the same
/// result as decoding from the start.
#[derive(Debug, Clone)]
pub struct Decoder {
    options: Arc<SessionOptions>,
    buses: Vec<BusDecoder>,
    /// Bus of the events before the first frame, whose name and settings are not known yet.
    unnamed: Option<Box<BusDecoder>>,
    unreadable: u64,
    last_time: Option<Timestamp>,
    last_frame: u64,
    /// File of the notices, in a capture of several parts.
    part: Option<Arc<str>>,
}

impl Decoder {
    /// A decoder before the first frame.
    pub fn new(options: SessionOptions) -> Self {
        Self {
            options: Arc::new(options),
            buses: Vec::new(),
            unnamed: None,
            unreadable: 0,
            last_time: None,
            last_frame: 0,
            part: None,
        }
    }

    /// Starts a part of a capture that consists of several files: `file` is the place of the following
    /// notices.
    pub fn begin_part(&mut self, file: &str) {
        self.part = Some(file.into());
    }

    /// Decodes the next frame; `names` contains the name of its bus.
    #[inline]
    pub fn push(&mut self, frame: &Frame, names: &BusNames, out: &mut dyn Observer) {
        let index = usize::from(frame.bus.0);
        if index >= self.buses.len() {
            self.add_buses(index, names);
        }
        self.last_time = frame.time;
        self.last_frame = frame.number;
        if let Some(bus) = self.buses.get_mut(index) {
            bus.push(frame, out);
        }
    }

    /// Decodes the next frames, as [`Self::push`] with each of them.
    pub fn push_all(&mut self, frames: &[Frame], names: &BusNames, out: &mut dyn Observer) {
        for of_bus in frames.chunk_by(|frame, next| frame.bus == next.bus) {
            let (Some(first), Some(last)) = (of_bus.first(), of_bus.last()) else { continue };
            let index = usize::from(first.bus.0);
            if index >= self.buses.len() {
                self.add_buses(index, names);
            }
            (self.last_time, self.last_frame) = (last.time, last.number);
            if let Some(bus) = self.buses.get_mut(index) {
                bus.push_all(of_bus, out);
            }
        }
    }

    #[cold]
    fn add_buses(&mut self, last: usize, names: &BusNames) {
        for index in self.buses.len()..=last {
            let Ok(number) = u8::try_from(index) else { return };
            let name = names.names().get(index).map_or("", String::as_str);
            self.buses.push(BusDecoder::new(BusIndex(number), name, Arc::clone(&self.options)));
        }
    }

    /// Handles a notice of the reader.
    pub fn on_notice(&mut self, notice: &Notice, names: &BusNames, out: &mut dyn Observer) {
        let mut bus = BusIndex(0);
        let kind = match notice {
            Notice::Unreadable { place, reason } | Notice::CutOff { place, reason } => {
                self.unreadable += 1;
                if self.unreadable > SHOWN_UNREADABLE {
                    return;
                }
                let (line, offset) = match *place {
                    CapturePlace::Line(line) => (Some(line), None),
                    CapturePlace::Offset(offset) => (None, Some(offset)),
                    CapturePlace::Now => (None, None),
                };
                let file = self.part.clone();
                EventKind::Unreadable { file, line, offset, count: 1, reason: reason.clone() }
            }
            Notice::Assumption(text) => EventKind::Note { text: text.clone() },
            Notice::LostFrames { bus: losing, count, .. } => {
                bus = *losing;
                EventKind::LostFrames { count: *count }
            }
            Notice::Link { bus, time, state, bit_rate } => {
                return self.on_link_change(*bus, *time, (*state, *bit_rate), names, out);
            }
            Notice::Quiet(time) => return self.advance_time(*time, out),
            Notice::ClockSet { bus, time, step } => {
                if let Some(bus) = self.buses.get_mut(usize::from(bus.0)) {
                    bus.set_clock(*time, *step, out);
                }
                return;
            }
        };
        self.emit_event(bus, kind, names, out);
    }

    /// Handles the end of the capture: closes open transfers and emits totals.
    pub fn finish_capture(&mut self, names: &BusNames, out: &mut dyn Observer) {
        if self.buses.is_empty() {
            self.buses.extend(self.unnamed.take().map(|bus| *bus));
        }
        for bus in &mut self.buses {
            bus.finish_bus(out);
        }
        let more = self.unreadable.saturating_sub(SHOWN_UNREADABLE);
        if more > 0 {
            let reason = format!("{more} more, {} in total", self.unreadable);
            let kind = EventKind::Unreadable { file: None, line: None, offset: None, count: more, reason };
            self.emit_event(BusIndex(0), kind, names, out);
        }
    }

    /// Advances the time of a live bus without a frame.
    pub fn advance_time(&mut self, now: Timestamp, out: &mut dyn Observer) {
        for bus in &mut self.buses {
            bus.advance_time(now, out);
        }
    }

    /// Handles a change of the link to a bus, after all deadlines before it.
    fn on_link_change(
        &mut self,
        bus: BusIndex,
        time: Timestamp,
        (state, bit_rate): (LinkState, Option<u32>),
        names: &BusNames,
        out: &mut dyn Observer,
    ) {
        self.advance_time(time, out);
        self.last_time = Some(time);
        let index = usize::from(bus.0);
        if index >= self.buses.len() {
            self.add_buses(index, names);
        }
        if let (Some(rate), Some(bus)) = (bit_rate, self.buses.get_mut(index)) {
            bus.set_recorded_bit_rate(rate);
        }
        self.emit_event(bus, EventKind::Link { state, bit_rate }, names, out);
    }

    fn emit_event(&mut self, bus: BusIndex, kind: EventKind, names: &BusNames, out: &mut dyn Observer) {
        let event = Event {
            time: self.last_time,
            bus,
            frames: FrameRange::one(self.last_frame),
            protocol: EventProtocol::Capture,
            node: None,
            presumed: false,
            routine: false,
            kind,
        };
        let index = usize::from(bus.0);
        if index >= self.buses.len() && index < names.names().len() {
            self.add_buses(index, names);
        }
        let unnamed = || Box::new(BusDecoder::new(BusIndex(0), "", Arc::clone(&self.options)));
        let bus = match self.buses.get(index) {
            Some(bus) => bus,
            None => &**self.unnamed.get_or_insert_with(unnamed),
        };
        out.on_event(&event, bus.bus());
    }

    /// Number of the last frame decoded.
    pub fn frame_count(&self) -> u64 {
        self.last_frame
    }

    /// Time of the last frame decoded, if it had one.
    pub fn last_time(&self) -> Option<Timestamp> {
        self.last_time
    }

    /// Number of unreadable lines or records.
    pub fn unreadable_count(&self) -> u64 {
        self.unreadable
    }

    /// Buses in order of appearance.
    pub fn buses(&self) -> Buses<'_> {
        Buses::new(&self.buses)
    }

    /// Memory of a checkpoint in bytes, without the object stores, which are shared until they change.
    pub fn footprint(&self) -> usize {
        size_of::<Self>() + self.buses.iter().map(BusDecoder::footprint).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;
    use crate::session::Bus;

    #[test]
    fn a_bus_has_its_name_after_an_event_before_its_first_frame() {
        let mut names = BusNames::default();
        let mut events = Vec::new();
        let mut decoder = Decoder::new(SessionOptions::default());
        let mut take = |_: &Event, bus: &Bus| events.push(bus.name().to_owned());
        let note = Notice::Assumption("x".into());
        decoder.on_notice(&note, &names, &mut take);
        names.index_of(b"can0");
        decoder.push(
            &Frame { number: 1, ..Frame::data_frame(CanId::from_standard(0x705), &[5]) },
            &names,
            &mut take,
        );
        decoder.on_notice(&note, &names, &mut take);
        decoder.finish_capture(&names, &mut take);
        assert_eq!(events.first().map(String::as_str), Some(""), "before the first frame");
        assert_eq!(events.last().map(String::as_str), Some("can0"));
        assert_eq!(decoder.buses().iter().map(Bus::name).collect::<Vec<_>>(), ["can0"]);
    }

    #[test]
    fn a_capture_without_frames_has_a_bus_without_a_name() {
        let mut decoder = Decoder::new(SessionOptions::default());
        decoder.on_notice(
            &Notice::Assumption("x".into()),
            &BusNames::default(),
            &mut |_: &Event, _: &Bus| {},
        );
        decoder.finish_capture(&BusNames::default(), &mut |_: &Event, _: &Bus| {});
        assert_eq!(decoder.buses().iter().map(Bus::name).collect::<Vec<_>>(), [""]);
    }
}

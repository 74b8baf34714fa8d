//! Complete decoder state at one position in a capture.

use super::LatestOccurrences;
use crate::capture::{BatchItem, BusNames, Notice};
use crate::decoder::Decoder;
use crate::event::{Event, EventKind};
use crate::frame::{Frame, Timestamp};
use crate::session::{Bus, Buses, Observer, SessionOptions};
use crate::sink::text::PrintedPayloads;
use crate::statistics::{IdentifierRow, IdentifierRows};

/// Position of an event: its frame, and its order among the events of that frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct EventPosition {
    /// Number of the current or last frame; 0 before the first one.
    pub frame: u64,
    /// Number of events emitted before this one since the start of the frame.
    pub ordinal: u32,
}

impl EventPosition {
    /// Position before all events of a frame.
    pub const fn before_frame(frame: u64) -> Self {
        Self { frame, ordinal: 0 }
    }

    /// Position after all events of a frame.
    pub const fn after_frame(frame: u64) -> Self {
        Self { frame, ordinal: u32::MAX }
    }
}

/// An event with its position.
pub struct PlacedEvent<'a> {
    /// Position of the event.
    pub spot: EventPosition,
    /// The event.
    pub event: &'a Event,
    /// Bus of the event, in the state after the event.
    pub bus: &'a Bus,
    /// Frame that caused the event; `None` for events from notices and from the end of the capture.
    pub frame: Option<&'a Frame>,
    /// Whether the event shows a change and is printed by `decode` by default.
    pub is_news: bool,
    /// Earlier payloads of the identifier of the event.
    pub earlier: EarlierPayloads<'a>,
}

/// Earlier payloads of an identifier, to compare a message with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EarlierPayloads<'a> {
    /// Payload of the last message that was news; None if every change of this message is news.
    pub news: Option<&'a [u8]>,
    /// Payload of the last message.
    pub last: Option<&'a [u8]>,
}

/// State of buses, nodes, objects and identifiers after a frame. A clone can be used to resume decoding.
#[derive(Debug, Clone)]
pub struct ReplayState {
    decoder: Decoder,
    identifiers: IdentifierRows,
    latest: LatestOccurrences,
    news: PrintedPayloads,
    spot: EventPosition,
    zero: Option<Timestamp>,
    time: Option<Timestamp>,
    counts: ProblemCounts,
}

/// Number of problems in the capture up to a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ProblemCounts {
    /// Number of unreadable lines or records.
    pub unreadable: u64,
    /// Number of lost frames reported by the recorder; a report without number counts as one.
    pub lost: u64,
    /// Number of error frames.
    pub errors: u64,
}

impl ReplayState {
    /// State before the first frame.
    pub fn new(options: SessionOptions) -> Self {
        Self {
            decoder: Decoder::new(options),
            identifiers: IdentifierRows::default(),
            latest: LatestOccurrences::default(),
            news: PrintedPayloads::default(),
            spot: EventPosition::default(),
            zero: None,
            time: None,
            counts: ProblemCounts::default(),
        }
    }

    /// Handles the next item of a reader.
    #[inline]
    pub fn take_item(
        &mut self,
        item: &BatchItem<'_>,
        names: &BusNames,
        out: &mut impl FnMut(PlacedEvent<'_>),
    ) {
        match item {
            BatchItem::Frame(frame) => self.push(frame, names, out),
            BatchItem::Notice(notice) => self.on_notice(notice, names, out),
        }
    }

    /// Handles the next frame; `names` contains the name of its bus.
    #[inline]
    pub fn push(&mut self, frame: &Frame, names: &BusNames, out: &mut impl FnMut(PlacedEvent<'_>)) {
        if let Some(time) = frame.time {
            self.zero = self.zero.or(Some(time));
            self.time = Some(time);
        }
        self.spot = EventPosition::before_frame(frame.number);
        let place = self.identifiers.count_frame(frame);
        let (decoder, mut teller) = self.forward_events(place, Some(frame), out);
        decoder.push(frame, names, &mut teller);
    }

    /// Handles a notice of the reader.
    pub fn on_notice(&mut self, notice: &Notice, names: &BusNames, out: &mut impl FnMut(PlacedEvent<'_>)) {
        if let Notice::Unreadable { .. } | Notice::CutOff { .. } = notice {
            self.counts.unreadable += 1;
        }
        if let Notice::Link { time, .. } | Notice::Quiet(time) | Notice::ClockSet { time, .. } = notice {
            self.time = self.time.max(Some(*time));
        }
        let (decoder, mut teller) = self.forward_events(None, None, out);
        decoder.on_notice(notice, names, &mut teller);
    }

    /// Handles the end of the capture: closes open transfers.
    pub fn finish_capture(&mut self, names: &BusNames, out: &mut impl FnMut(PlacedEvent<'_>)) {
        let (decoder, mut teller) = self.forward_events(None, None, out);
        decoder.finish_capture(names, &mut teller);
    }

    #[inline]
    fn forward_events<'a, F>(
        &'a mut self,
        place: Option<usize>,
        frame: Option<&'a Frame>,
        out: &'a mut F,
    ) -> (&'a mut Decoder, EventForwarder<'a, F>) {
        let teller = EventForwarder {
            place,
            frame,
            identifiers: &mut self.identifiers,
            latest: &mut self.latest,
            news: &mut self.news,
            spot: &mut self.spot,
            counts: &mut self.counts,
            out,
        };
        (&mut self.decoder, teller)
    }

    /// Buses in order of appearance.
    pub fn buses(&self) -> Buses<'_> {
        self.decoder.buses()
    }

    /// Last frame and state of each identifier.
    pub fn identifiers(&self) -> &IdentifierRows {
        &self.identifiers
    }

    /// Last boot-up, errors and states of each node.
    pub fn latest(&self) -> &LatestOccurrences {
        &self.latest
    }

    /// Position of the next event, if the last frame causes one more.
    pub fn next_position(&self) -> EventPosition {
        self.spot
    }

    /// Number of frames decoded.
    pub fn frames(&self) -> u64 {
        self.spot.frame
    }

    /// Time of the first frame with a time.
    pub fn first_time(&self) -> Option<Timestamp> {
        self.zero
    }

    /// Time of the last frame with a time.
    pub fn last_time(&self) -> Option<Timestamp> {
        self.time
    }

    /// Number of problems in the capture so far.
    pub fn problem_counts(&self) -> ProblemCounts {
        self.counts
    }

    /// Memory of a checkpoint in bytes, without shared object stores.
    pub fn footprint(&self) -> usize {
        self.decoder.footprint()
            + self.identifiers.footprint()
            + self.latest.footprint()
            + self.news.footprint()
    }
}

/// Passes events on with their positions.
struct EventForwarder<'a, F> {
    place: Option<usize>,
    frame: Option<&'a Frame>,
    identifiers: &'a mut IdentifierRows,
    latest: &'a mut LatestOccurrences,
    news: &'a mut PrintedPayloads,
    spot: &'a mut EventPosition,
    counts: &'a mut ProblemCounts,
    out: &'a mut F,
}

impl<F: FnMut(PlacedEvent<'_>)> Observer for EventForwarder<'_, F> {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        match &event.kind {
            EventKind::LostFrames { count } => self.counts.lost += count.unwrap_or(1),
            EventKind::CanError(error) if !error.is_only_counters() => self.counts.errors += 1,
            _ => {}
        }
        let mut earlier = EarlierPayloads::default();
        let is_news = self.news.has_news(event);
        if let (Some(place), Some(frame)) = (self.place, self.frame)
            && event.frames.last == frame.number
        {
            self.identifiers.update_row(place, event);
            let last = self.identifiers.rows().get(place).and_then(IdentifierRow::previous_payload);
            earlier = EarlierPayloads { news: self.news.replaced_payload(), last };
        }
        self.latest.on_event(event);
        (self.out)(PlacedEvent { spot: *self.spot, event, bus, frame: self.frame, is_news, earlier });
        self.spot.ordinal = self.spot.ordinal.saturating_add(1);
    }
}

//! Everything known of a capture at one place in it.

use super::Latest;
use crate::capture::{BusNames, Item, Notice};
use crate::decoder::Decoder;
use crate::event::{Event, EventKind};
use crate::frame::{Frame, Timestamp};
use crate::session::{Bus, Buses, Observer, SessionOptions};
use crate::sink::text::News;
use crate::statistics::Identifiers;

/// The place of an event: events are told one behind the other while a frame is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Spot {
    /// Frame that was taken last, or is being taken; 0 before the first.
    pub frame: u64,
    /// How many events were told since that frame came.
    pub ordinal: u32,
}

impl Spot {
    /// Before all events of a frame.
    pub const fn before(frame: u64) -> Self {
        Self { frame, ordinal: 0 }
    }

    /// Behind all events of a frame.
    pub const fn behind(frame: u64) -> Self {
        Self { frame, ordinal: u32::MAX }
    }
}

/// An event with its place.
pub struct Told<'a> {
    /// Its place.
    pub spot: Spot,
    /// The event.
    pub event: &'a Event,
    /// Its bus, as it is behind it.
    pub bus: &'a Bus,
    /// Frame that brought it: none for what a reader says and for the end.
    pub frame: Option<&'a Frame>,
    /// Says something new, as `decode` prints by default.
    pub is_news: bool,
}

/// Buses, nodes, objects and identifiers behind a frame. A clone is the same world, to go on from.
#[derive(Debug, Clone)]
pub struct World {
    decoder: Decoder,
    identifiers: Identifiers,
    latest: Latest,
    news: News,
    spot: Spot,
    zero: Option<Timestamp>,
    time: Option<Timestamp>,
    counts: Counts,
}

/// What is wrong with the capture up to a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Lines or records that could not be read.
    pub unreadable: u64,
    /// Frames the recorder says it lost; where it does not say how many, one.
    pub lost: u64,
    /// Error frames.
    pub errors: u64,
}

impl World {
    /// A world in which nothing has happened.
    pub fn new(options: SessionOptions) -> Self {
        Self {
            decoder: Decoder::new(options),
            identifiers: Identifiers::default(),
            latest: Latest::default(),
            news: News::default(),
            spot: Spot::default(),
            zero: None,
            time: None,
            counts: Counts::default(),
        }
    }

    /// Takes what a reader gave next.
    #[inline]
    pub fn take(&mut self, item: &Item<'_>, names: &BusNames, out: &mut impl FnMut(Told<'_>)) {
        match item {
            Item::Frame(frame) => self.push(frame, names, out),
            Item::Notice(notice) => self.notice(notice, names, out),
        }
    }

    /// Takes the next frame; `names` holds the name of its bus.
    #[inline]
    pub fn push(&mut self, frame: &Frame, names: &BusNames, out: &mut impl FnMut(Told<'_>)) {
        if let Some(time) = frame.time {
            self.zero = self.zero.or(Some(time));
            self.time = Some(time);
        }
        self.spot = Spot::before(frame.number);
        let place = self.identifiers.frame(frame);
        let (decoder, mut teller) = self.teller(place, Some(frame), out);
        decoder.push(frame, names, &mut teller);
    }

    /// Takes what a reader has to say.
    pub fn notice(&mut self, notice: &Notice, names: &BusNames, out: &mut impl FnMut(Told<'_>)) {
        if let Notice::Unreadable { .. } | Notice::CutOff { .. } = notice {
            self.counts.unreadable += 1;
        }
        if let Notice::Link { time, .. } | Notice::Quiet(time) = notice {
            self.time = self.time.max(Some(*time));
        }
        let (decoder, mut teller) = self.teller(None, None, out);
        decoder.notice(notice, names, &mut teller);
    }

    /// The capture ended: closes what is open.
    pub fn finish(&mut self, names: &BusNames, out: &mut impl FnMut(Told<'_>)) {
        let (decoder, mut teller) = self.teller(None, None, out);
        decoder.finish(names, &mut teller);
    }

    #[inline]
    fn teller<'a, F>(
        &'a mut self,
        place: Option<usize>,
        frame: Option<&'a Frame>,
        out: &'a mut F,
    ) -> (&'a mut Decoder, Teller<'a, F>) {
        let teller = Teller {
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

    /// What each identifier carried last.
    pub fn identifiers(&self) -> &Identifiers {
        &self.identifiers
    }

    /// What happened last to each node.
    pub fn latest(&self) -> &Latest {
        &self.latest
    }

    /// Place of the next event, if the frame taken last brings one more.
    pub fn spot(&self) -> Spot {
        self.spot
    }

    /// Frames taken.
    pub fn frames(&self) -> u64 {
        self.spot.frame
    }

    /// Time of the first frame that has one.
    pub fn zero(&self) -> Option<Timestamp> {
        self.zero
    }

    /// Time of the last frame that has one.
    pub fn time(&self) -> Option<Timestamp> {
        self.time
    }

    /// What is wrong with the capture so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Bytes a checkpoint holds of its own.
    pub fn footprint(&self) -> usize {
        self.decoder.footprint()
            + self.identifiers.footprint()
            + self.latest.footprint()
            + self.news.footprint()
    }
}

/// Passes events on with their places.
struct Teller<'a, F> {
    place: Option<usize>,
    frame: Option<&'a Frame>,
    identifiers: &'a mut Identifiers,
    latest: &'a mut Latest,
    news: &'a mut News,
    spot: &'a mut Spot,
    counts: &'a mut Counts,
    out: &'a mut F,
}

impl<F: FnMut(Told<'_>)> Observer for Teller<'_, F> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        match &event.kind {
            EventKind::LostFrames { count } => self.counts.lost += count.unwrap_or(1),
            EventKind::CanError(_) => self.counts.errors += 1,
            _ => {}
        }
        if let (Some(place), Some(frame)) = (self.place, self.frame)
            && event.frames.last == frame.number
        {
            self.identifiers.event(place, event);
        }
        self.latest.event(event);
        let is_news = self.news.has(event);
        (self.out)(Told { spot: *self.spot, event, bus, frame: self.frame, is_news });
        self.spot.ordinal = self.spot.ordinal.saturating_add(1);
    }
}

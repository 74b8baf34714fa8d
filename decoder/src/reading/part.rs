//! Consumers of a pass over a capture.

use crate::capture::{BusNames, Notice};
use crate::event::Event;
use crate::frame::Frame;
use crate::replay::PlacedEvent;
use crate::session::{Bus, Buses, MessagePreview};

/// Frames that a [`ReadingPart`] receives in addition to events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum FrameDemand {
    /// No frames.
    #[default]
    None,
    /// All frames, several at once before the events of the first one.
    Batches,
    /// Each frame before its events.
    Each,
    /// Each frame before its events, and again after them with the state of its bus.
    Decoded,
}

/// One consumer of a pass over a capture: statistics, facts for stories, a sink.
///
/// A pass has one part; a tuple or an [`Option`] of parts is a part, too. Any `FnMut(&Event, &Bus)` is a part that receives
/// all events and findings.
///
/// Most frames of a machine repeat the payload of the frame before them. [`ReadingPart::need`] decides for such a frame whether the
/// part needs its event. If neither the part nor a rule needs it, [`ReadingPart::skip`] is called instead of [`ReadingPart::event`].
pub trait ReadingPart {
    /// Takes an event of the capture; `bus` is in the state after the event.
    fn event(&mut self, event: &Event, bus: &Bus);

    /// Takes an event about a finding, which follows the event that it is based on.
    fn finding(&mut self, event: &Event, bus: &Bus) {
        self.event(event, bus);
    }

    /// Takes an event with its position, in a pass that knows positions.
    fn placed(&mut self, placed: &PlacedEvent<'_>) {
        self.event(placed.event, placed.bus);
    }

    /// Takes an event about a finding with the position of the event that it is based on.
    fn placed_finding(&mut self, placed: &PlacedEvent<'_>) {
        self.finding(placed.event, placed.bus);
    }

    /// Whether the part needs the event of a frame; `bus` is in the state before the frame.
    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        true
    }

    /// Takes note of a frame without an event; `bus` is in the state before the frame.
    fn skip(&mut self, _preview: &MessagePreview, _bus: &Bus) {}

    /// Frames that the part receives from now on.
    fn demand(&self) -> FrameDemand {
        FrameDemand::None
    }

    /// Whether the part ends the capture before a frame; asked for each frame if the part demands
    /// [`FrameDemand::Each`].
    fn ends_before(&mut self, _frame: &Frame) -> bool {
        false
    }

    /// Takes a frame before its events.
    fn frame(&mut self, _frame: &Frame, _names: &BusNames) {}

    /// Takes the next frames before the events of the first one.
    fn frames(&mut self, frames: &[Frame], names: &BusNames) {
        for frame in frames {
            self.frame(frame, names);
        }
    }

    /// Takes a frame after its events, if the part demands [`FrameDemand::Decoded`].
    fn frame_decoded(&mut self, _frame: &Frame, _bus: &Bus) {}

    /// Takes a notice of the reader before its event.
    fn notice(&mut self, _notice: &Notice, _names: &BusNames) {}

    /// Whether the part needs no more events, so that the pass can end.
    fn is_done(&self) -> bool {
        false
    }

    /// The moment at which the part ended the capture, as text; `None` if it did not.
    fn end_moment(&self) -> Option<String> {
        None
    }

    /// Called once after the last event.
    fn finish(&mut self, _buses: Buses<'_>) {}
}

/// A part that receives nothing.
impl ReadingPart for () {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }
}

impl<F: FnMut(&Event, &Bus)> ReadingPart for F {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self(event, bus);
    }
}

/// A part that the caller keeps.
pub struct Borrowed<'a, P: ?Sized>(pub &'a mut P);

/// Forwards every method of a part to some of its fields.
macro_rules! forward_to {
    ($self:ident: $($part:expr),+) => {
        #[inline]
        fn event(&mut $self, event: &Event, bus: &Bus) {
            $($part.event(event, bus);)+
        }

        fn finding(&mut $self, event: &Event, bus: &Bus) {
            $($part.finding(event, bus);)+
        }

        fn placed(&mut $self, placed: &PlacedEvent<'_>) {
            $($part.placed(placed);)+
        }

        fn placed_finding(&mut $self, placed: &PlacedEvent<'_>) {
            $($part.placed_finding(placed);)+
        }

        #[inline]
        fn need(&$self, preview: &MessagePreview, bus: &Bus) -> bool {
            $($part.need(preview, bus))||+
        }

        #[inline]
        fn skip(&mut $self, preview: &MessagePreview, bus: &Bus) {
            $($part.skip(preview, bus);)+
        }

        fn demand(&$self) -> FrameDemand {
            [$($part.demand()),+].into_iter().max().unwrap_or_default()
        }

        fn ends_before(&mut $self, frame: &Frame) -> bool {
            $($part.ends_before(frame))||+
        }

        fn frame(&mut $self, frame: &Frame, names: &BusNames) {
            $($part.frame(frame, names);)+
        }

        fn frames(&mut $self, frames: &[Frame], names: &BusNames) {
            $($part.frames(frames, names);)+
        }

        fn frame_decoded(&mut $self, frame: &Frame, bus: &Bus) {
            $($part.frame_decoded(frame, bus);)+
        }

        fn notice(&mut $self, notice: &Notice, names: &BusNames) {
            $($part.notice(notice, names);)+
        }

        fn is_done(&$self) -> bool {
            $($part.is_done())||+
        }

        fn end_moment(&$self) -> Option<String> {
            None$(.or_else(|| $part.end_moment()))+
        }

        fn finish(&mut $self, buses: Buses<'_>) {
            $($part.finish(buses);)+
        }
    };
}

impl<P: ReadingPart + ?Sized> ReadingPart for Borrowed<'_, P> {
    forward_to!(self: self.0);
}

/// Forwards methods to a part, or to the part that receives nothing.
macro_rules! forward_if_some {
    ($($name:ident(self: $this:ty $(, $argument:ident: $type:ty)*) $(-> $result:ty)?;)+) => {
        $(fn $name(self: $this, $($argument: $type),*) $(-> $result)? {
            match self {
                Some(part) => part.$name($($argument),*),
                None => ().$name($($argument),*),
            }
        })+
    };
}

impl<P: ReadingPart> ReadingPart for Option<P> {
    forward_if_some! {
        event(self: &mut Self, event: &Event, bus: &Bus);
        finding(self: &mut Self, event: &Event, bus: &Bus);
        placed(self: &mut Self, placed: &PlacedEvent<'_>);
        placed_finding(self: &mut Self, placed: &PlacedEvent<'_>);
        need(self: &Self, preview: &MessagePreview, bus: &Bus) -> bool;
        skip(self: &mut Self, preview: &MessagePreview, bus: &Bus);
        demand(self: &Self) -> FrameDemand;
        ends_before(self: &mut Self, frame: &Frame) -> bool;
        frame(self: &mut Self, frame: &Frame, names: &BusNames);
        frames(self: &mut Self, frames: &[Frame], names: &BusNames);
        frame_decoded(self: &mut Self, frame: &Frame, bus: &Bus);
        notice(self: &mut Self, notice: &Notice, names: &BusNames);
        is_done(self: &Self) -> bool;
        end_moment(self: &Self) -> Option<String>;
        finish(self: &mut Self, buses: Buses<'_>);
    }
}

impl<A: ReadingPart, B: ReadingPart> ReadingPart for (A, B) {
    forward_to!(self: self.0, self.1);
}

impl<A: ReadingPart, B: ReadingPart, C: ReadingPart> ReadingPart for (A, B, C) {
    forward_to!(self: self.0, self.1, self.2);
}

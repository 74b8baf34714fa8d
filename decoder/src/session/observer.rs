//! Receiver of events.

use super::bus::Bus;
use crate::event::Event;
use crate::frame::Timestamp;

/// Receives events in their order.
///
/// Most frames of a machine repeat the payload of the frame before them. An observer states for each such frame
/// whether it needs the event; if no observer does, the session updates only times and counters.
pub trait Observer {
    /// `event` happened on `bus`; `bus` is in the state after the event.
    fn on_event(&mut self, event: &Event, bus: &Bus);

    /// Whether the observer needs the event of a frame; the default is yes. `bus` is in the state before the frame.
    fn needs_event(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        true
    }

    /// Takes note of a frame without its event; `false` if the observer needs the event, which follows. `bus` is in the
    /// state before the frame. An observer that consists of several asks [`Self::needs_event`] of all but one of them first.
    fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) -> bool {
        !self.needs_event(preview, bus)
    }

    /// Whether [`Self::skip_event`] saves work at events that the observer needs, too; otherwise it is asked rarely if it needed
    /// many frames in a row.
    fn is_selective(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }
}

/// PDO or J1939 message before its event. The frame has the data length of the last frame with its identifier.
#[derive(Debug, Clone, Copy)]
pub struct MessagePreview {
    /// Index of the identifier on its bus, in order of appearance.
    pub identifier: usize,
    /// Number of the frame in the capture.
    pub frame: u64,
    /// Time of the frame.
    pub time: Timestamp,
    /// Monotonic time of the bus in ns.
    pub now: i64,
    /// Payload, little-endian; unused bytes are 0.
    pub payload: u64,
    /// Payload bits that differ from the last frame with the identifier; bit 0 is the lowest bit of byte 0.
    pub change: u64,
}

/// An observer that needs nothing: only the state of the buses advances.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoObserver;

impl Observer for NoObserver {
    fn on_event(&mut self, _event: &Event, _bus: &Bus) {}

    fn needs_event(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }
}

impl<F: FnMut(&Event, &Bus)> Observer for F {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        self(event, bus);
    }
}
